"""Feed-forward: the lean and the torques that a shaped or planned motion needs, from the exact model.

Linearised about upright and without friction, with p = (x, y), l = (theta, phi, psi) and torques u,

    p'' = A_p l + B_p u        l'' = A_l l + B_l u

the point s = p + C l with B_p + C B_l = 0 does not depend on the torques: s'' = (A_p + C A_l) l = G (theta, phi). (It
is a flat output: state and torques follow from it and its derivatives.) A motion s(t) of it therefore needs

    (theta, phi) = G^-1 s''       p = s - C (theta, phi)       u = B^+ (r' - A r)

with B^+ the pseudoinverse. At rest p = s. All quantities are in the heading frame; the feedback covers the small
additional torques of a robot that moves and turns at once, and a body's small coupling of yaw with lean.

A planned reference (`ballbot.workflows.plan`) has leans and rates itself. Then s and its derivatives follow from them,

    s = p + C l        s' = p' + C l'        s'' = G l        s''' = G l'        s'''' = G l''

with l'' from the change of the rates since the last row. A row that is there again, as when the frame with the next
one is lost, is followed along its Taylor series; after 50 ms the plan counts as broken off, and the robot goes to rest
at the row's pose.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import (
    LawSettings,
    Part,
    SmoothReference,
    both_rows_times,
    row_times,
    turned,
    turned_back,
)
from ballbot.control.records import MAX_WHEELS, number, whole
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined

#: largest effect of torques on the flat output, relative to that on the position, that counts as zero
_ROUNDING = 1e-9
#: for which a row of a plan is followed without the next one [s]
_LAPSE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedForwardRecord:
    """What a motion of the flat output needs, linear in its derivatives, heading frame."""

    on: int = field(default=1, metadata=whole())
    #: G^-1: theta, phi for s''
    lean: NDArray[np.float64] = field(metadata=number("rad s^2/m", 2, 2))
    #: C G^-1: how far s is ahead of the position, for s''
    offset: NDArray[np.float64] = field(metadata=number("s^2", 2, 2))
    by_second: NDArray[np.float64] = field(metadata=number("N m s^2/m", MAX_WHEELS, 2))
    by_fourth: NDArray[np.float64] = field(metadata=number("N m s^4/m", MAX_WHEELS, 2))
    by_turning: NDArray[np.float64] = field(metadata=number("N m s^2/rad", MAX_WHEELS))
    #: G: s'' for theta, phi
    pull: NDArray[np.float64] = field(metadata=number("m/(s^2 rad)", 2, 2))
    rate: float = field(metadata=number("1/s"))
    #: that is predicted over
    delay: float = field(metadata=number("s"))


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedForwardState:
    """The row of a plan that is followed: its state, for how many samples, and the change of its rates."""

    started: int = field(metadata=whole())
    age: int = field(metadata=whole())
    row: NDArray[np.float64] = field(metadata=number("m", 10))
    changes: NDArray[np.float64] = field(metadata=number("rad/s^2", 3))


@inlined
def follows_plan(law, memory, reference):
    """Return whether a reference has leans or rates, for no longer than `_LAPSE`, and remember it."""
    own, state = law.feed_forward, memory.feed_forward
    moves = False
    for i in (2, 3, 5, 6, 7, 8, 9):
        moves = moves or reference[i] != 0.0
    if own.on == 0 or not moves:
        state.started = 0
        return False
    again = state.started == 1
    for i in range(10):
        again = again and reference[i] == state.row[i]
    most = _LAPSE * own.rate + 0.5
    if again:
        state.age += 1 if state.age < most else 0
    else:
        goes_on = state.started == 1 and state.age < most
        per_second = own.rate / (state.age + 1) if goes_on else 0.0
        for i in range(3):
            state.changes[i] = per_second * (reference[7 + i] - state.row[7 + i])
        for i in range(10):
            state.row[i] = reference[i]
        state.started, state.age = 1, 0
    return state.age < most


@inlined
def planned(law, memory, a, reference, psi):
    """Return a planned reference as three `SmoothReference`, its heading being psi; after `follows_plan`."""
    own, changes = law.feed_forward, memory.feed_forward.changes
    rates = (reference[7], reference[8], reference[9])
    s_2 = both_rows_times(own.pull, turned(a, reference[2], reference[3]))
    s_3 = both_rows_times(own.pull, turned(a, rates[0], rates[1]))
    s_4 = both_rows_times(own.pull, turned(a, changes[0], changes[1]))
    ahead, ahead_rate = both_rows_times(own.offset, s_2), both_rows_times(own.offset, s_3)
    ahead, ahead_rate = turned_back(a, ahead[0], ahead[1]), turned_back(a, ahead_rate[0], ahead_rate[1])
    second, third = turned_back(a, s_2[0], s_2[1]), turned_back(a, s_3[0], s_3[1])
    fourth = turned_back(a, s_4[0], s_4[1])
    x = SmoothReference(reference[0] + ahead[0], reference[5] + ahead_rate[0], second[0], third[0], fourth[0])
    y = SmoothReference(reference[1] + ahead[1], reference[6] + ahead_rate[1], second[1], third[1], fourth[1])
    turning = SmoothReference(psi, rates[2], changes[2], 0.0, 0.0)
    ahead_by = own.delay + memory.feed_forward.age / own.rate
    return _after(ahead_by, x), _after(ahead_by, y), _after(ahead_by, turning)


@inlined
def _after(delay, s):
    """Return a motion after a delay, by its Taylor series."""
    rest = s.second + delay * (s.third + 0.25 * delay * s.fourth) / 3.0
    return SmoothReference(
        s.value + delay * (s.rate + 0.5 * delay * rest),
        s.rate + delay * (s.second + 0.5 * delay * (s.third + delay * s.fourth / 3.0)),
        s.second + delay * (s.third + 0.5 * delay * s.fourth),
        s.third + delay * s.fourth,
        s.fourth,
    )


@inlined
def lean_error(law, e, a, wanted):
    """Return the error with respect to the lean and the position that the motion needs; see the module's docstring."""
    own = law.feed_forward
    x, y, _ = wanted
    second, third = turned(a, x.second, y.second), turned(a, x.third, y.third)
    lean, lean_rate = both_rows_times(own.lean, second), both_rows_times(own.lean, third)
    ahead, ahead_rate = both_rows_times(own.offset, second), both_rows_times(own.offset, third)
    pose = (e[0] - ahead[0], e[1] - ahead[1], e[2] + lean[0], e[3] + lean[1], e[4])
    rates = (e[5] - ahead_rate[0], e[6] - ahead_rate[1], e[7] + lean_rate[0], e[8] + lean_rate[1], e[9])
    return (*pose, *rates)


@inlined
def add_feed_forward(law, torque, now, i):
    """Add a wheel's torque for s'', s'''' (heading frame) and psi''."""
    own = law.feed_forward
    x, y, psi = now.wanted
    second, fourth = turned(now.a, x.second, y.second), turned(now.a, x.fourth, y.fourth)
    motion = row_times(own.by_second[i], second) + row_times(own.by_fourth[i], fourth)
    return torque + motion + own.by_turning[i] * psi.second


@dataclass(frozen=True, kw_only=True)
class FeedForward(Part):
    """Give a motion the lean and the torques that it needs, from the exact model; there is nothing to set.

    Takes the second to fourth derivatives of the shaped x and y, turned into the heading frame, and psi's second. Adds
    the lean theta, phi [rad] to the reference and torques (n,) [N m] to the output. Needs `ReferenceShaping`. A
    reference with leans and rates, as `ballbot.plan` makes it, is followed as it is, without shaping.

    Raises
    ------
    InputError
        When the controller is made, if the robot's wheels cannot turn it about all three axes.
    """

    label = "feed-forward"
    comment = "A shaped motion is given the lean and the torques that it needs."
    record = FeedForwardRecord
    state = FeedForwardState
    needs: ClassVar[Mapping[str, str]] = {"shaping": "it uses the derivatives of the shaped reference"}

    def numbers(self, settings: LawSettings) -> FeedForwardRecord:
        """Return the needed lean, offset and torques of the robot's exact model."""
        A, B = settings.linear.A, settings.linear.B
        C = -B[5:7] @ np.linalg.pinv(B[7:])
        if np.abs(B[5:7] + C @ B[7:]).max() > _ROUNDING * np.abs(B[5:7]).max():
            raise InputError(
                f"The robot {settings.robot.name!r} cannot have feed-forward: its wheels cannot turn it in every "
                "direction."
            )
        G = (A[5:7] + C @ A[7:])[:, 2:4]
        lean = np.asarray(np.linalg.inv(G), dtype=np.float64)
        offset = C[:, :2] @ lean
        motions = np.zeros((3, 10, 2)), np.zeros((3, 10, 2))  # r and r' for s'', s'''' and psi''
        (r_2, r_4, _), (d_2, d_4, d_psi) = motions
        r_2[:2], r_2[2:4] = -offset, lean
        d_2[5:7] = np.eye(2)
        d_4[5:7], d_4[7:9] = -offset, lean
        d_psi[9, 0] = 1.0
        back = np.linalg.pinv(B)
        return FeedForwardRecord(
            lean=lean,
            offset=offset,
            by_second=back @ (d_2 - A @ r_2),
            by_fourth=back @ (d_4 - A @ r_4),
            by_turning=(back @ d_psi)[:, 0],
            pull=np.asarray(G, dtype=np.float64),
            rate=1.0 / settings.sample_time,
            delay=settings.delay,
        )
