"""Feed-forward: the lean and the torques that a planned motion needs, from the exact model.

Linearised about upright and without friction, with p = (x, y), l = (theta, phi, psi) and torques u,

    p'' = A_p l + B_p u        l'' = A_l l + B_l u

the point s = p + C l with B_p + C B_l = 0 does not depend on the torques: s'' = (A_p + C A_l) l = G (theta, phi). (It
is a flat output: state and torques follow from it and its derivatives.) A motion s(t) of it therefore needs

    (theta, phi) = G^-1 s''       p = s - C (theta, phi)       u = B^+ (r' - A r)

with B^+ the pseudoinverse. At rest p = s. A rolling ball needs the lean kappa besides, which carries its friction
(`ballbot.mechanics.model.contact_momentum`). All quantities are in the heading frame; the feedback covers the small
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
    FollowedMotion,
    LawSettings,
    Pair,
    Part,
    RobotState,
    SmoothReference,
    pair_times,
    turned,
    turned_back,
)
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.floor import SLOW
from ballbot.mechanics.model import contact_momentum
from ballbot.records import MAX_WHEELS, number, whole

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
    rolling: float = field(metadata=number("rad"))  #: kappa
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
    moves = reference[2] != 0.0 or reference[3] != 0.0
    for i in range(5, 10):
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
def planned(law, memory, a, reference, asked):
    """Return a planned reference, of which `asked` is the pose relative to the measured one; after `follows_plan`."""
    own, changes = law.feed_forward, memory.feed_forward.changes
    rolling = _rolling_lean(own, reference[5], reference[6])  # which a plan's leans have
    second = _in_world(own.pull, a, reference[2] - rolling.x, reference[3] - rolling.y)
    third = _in_world(own.pull, a, reference[7], reference[8])
    fourth = _in_world(own.pull, a, changes[0], changes[1])
    ahead, ahead_rate = (
        _in_world(own.offset, a, second.x, second.y),
        _in_world(own.offset, a, third.x, third.y),
    )
    x = SmoothReference(asked.x + ahead.x, reference[5] + ahead_rate.x, second.x, third.x, fourth.x)
    y = SmoothReference(asked.y + ahead.y, reference[6] + ahead_rate.y, second.y, third.y, fourth.y)
    psi = SmoothReference(asked.psi, reference[9], changes[2], 0.0, 0.0)
    ahead_by = own.delay + memory.feed_forward.age / own.rate
    return FollowedMotion(_after(ahead_by, x), _after(ahead_by, y), _after(ahead_by, psi))


@inlined
def _in_world(M, a, x, y):
    """Return the product of a matrix of the heading frame and a vector of the world, in the world."""
    product = pair_times(M, turned(a, x, y))
    return turned_back(a, product.x, product.y)


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
def _rolling_lean(own, v_x, v_y):
    """Return the lean theta, phi that carries the rolling friction at a velocity."""
    share = own.rolling / max((v_x * v_x + v_y * v_y) ** 0.5, SLOW)
    return Pair(-share * v_y, share * v_x)


@inlined
def lean_error(law, a, to, e):
    """Return the error with respect to the lean and the position that the motion needs; see the module's docstring."""
    own = law.feed_forward
    if own.on == 0:
        return e
    second, third = turned(a, to.x.second, to.y.second), turned(a, to.x.third, to.y.third)
    lean, lean_rate = pair_times(own.lean, second), pair_times(own.lean, third)
    ahead, ahead_rate = pair_times(own.offset, second), pair_times(own.offset, third)
    v = turned(a, to.x.rate, to.y.rate)
    rolling = _rolling_lean(own, v.x - ahead_rate.x, v.y - ahead_rate.y)
    return RobotState(
        e.x - ahead.x,
        e.y - ahead.y,
        e.theta + lean.x + rolling.x,
        e.phi + lean.y + rolling.y,
        e.psi,
        e.x_dot - ahead_rate.x,
        e.y_dot - ahead_rate.y,
        e.theta_dot + lean_rate.x,
        e.phi_dot + lean_rate.y,
        e.psi_dot,
    )


@inlined
def add_feed_forward(law, now, torques, n):
    """Add the torques for the second and fourth derivative of s, heading frame, and the second of psi."""
    own = law.feed_forward
    if own.on == 0:
        return
    second = turned(now.a, now.to.x.second, now.to.y.second)
    fourth = turned(now.a, now.to.x.fourth, now.to.y.fourth)
    for i in range(n):
        by_second, by_fourth = own.by_second[i], own.by_fourth[i]
        motion = by_second[0] * second.x + by_second[1] * second.y + by_fourth[0] * fourth.x
        torques[i] += motion + by_fourth[1] * fourth.y + own.by_turning[i] * now.to.psi.second


@dataclass(frozen=True, kw_only=True)
class FeedForward(Part):
    """Give a motion the lean and the torques that it needs, from the exact model; there is nothing to set.

    Takes the second to fourth derivatives of the planned x and y, turned into the heading frame, and psi's second. Adds
    the lean theta, phi [rad] to the reference and torques (n,) [N m] to the output. Needs `Planner`. A
    reference with leans and rates, as `ballbot.plan` makes it, is followed as it is.

    Raises
    ------
    InputError
        When the controller is made, if the robot's wheels cannot turn it about all three axes.
    """

    label = "feed-forward"
    comment = "A planned motion is given the lean and the torques that it needs."
    record = FeedForwardRecord
    state = FeedForwardState
    needs: ClassVar[Mapping[str, str]] = {"planner": "it uses the derivatives of the planned motion"}

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
            rolling=contact_momentum(settings.robot).rolling,
            rate=1.0 / settings.sample_time,
            delay=settings.delay,
        )
