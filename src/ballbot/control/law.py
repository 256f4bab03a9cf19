"""The control law, compiled once for the single robot and for robots in lanes.

    u = K S(psi) (r_s - x) + feed-forward + integral action + friction compensation + lost torque,  limited

S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame: K is designed at
psi = 0 and the wheels turn with the body. The law is a sequence of stages, and each part of `ballbot.control.parts`
adds its steps to some of them (`Steps` says what a step is given and returns):

    observe    look back on the sample that has passed              disturbance observer
    predict    x, the state in which u will act                     prediction
    shape      r_s, a smooth reference with its derivatives         reference shaping
    error      S(psi) (r_s - x)                                     feed-forward, lean limit
    torque     K times the error, and summands                      feed-forward, integral action
               friction compensation
    filter     each wheel's torque on its way to the limit          disturbance observer, notch
    learn      step what follows the error                          integral action, floor adaptation

A controller's numbers are one record (`LAW`), so that every robot in a batch can have a law of its own, and what it
remembers is another (`MEMORY`). Both are derived from the parts' dataclasses; see `ballbot.control.records`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import LARGEST_STATE
from ballbot.control.parts import KINDS, Parts
from ballbot.control.parts.compensation import CompensationRecord, compensate, compensation_record
from ballbot.control.parts.part import LawSettings, Sample, Smooth
from ballbot.control.parts.prediction import TorqueHistory
from ballbot.control.records import MAX_WHEELS, Schema, fill_record, number, schema_of
from ballbot.mechanics.engine.compiled import called, compiled, inlined
from ballbot.mechanics.equations import attitude

#: what `control_law` returns where the reference may be followed
ALLOWED = -1


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedbackRecord:
    """The gain, and what every law has."""

    torque_limit: float = field(metadata=number("N m"))
    rate: float = field(metadata=number("1/s"))
    gain: NDArray[np.float64] = field(metadata=number("N m per state", MAX_WHEELS, 10))


#: a controller's numbers: feedback, compensation, and each part's record by its name
LAW = Schema(
    name="law",
    fields={
        **schema_of(FeedbackRecord).fields,
        "compensation": schema_of(CompensationRecord),
        **{name: schema_of(kind.record) for name, kind in KINDS.items()},
    },
)
#: what a controller remembers: the last torques, and each part's state by its name; zeros at the start of a run
MEMORY = Schema(
    name="memory",
    fields={
        "history": schema_of(TorqueHistory),
        **{name: schema_of(kind.state) for name, kind in KINDS.items()},
    },
)
_LAW_TYPE, _MEMORY_TYPE = LAW.dtype(), MEMORY.dtype()

#: length of what a controller remembers, as an array of float64
MEMORY_SIZE = _MEMORY_TYPE.itemsize // 8


def law_record(settings: LawSettings, *, torque_limit: float, parts: Parts) -> NDArray[np.void]:
    """Return a controller's numbers as a record (1,) of `LAW`.

    Raises
    ------
    InputError
        If a part is not possible with the robot, the sample time or the number of wheels.
    """
    record = LAW.zeros()
    feedback = FeedbackRecord(torque_limit=torque_limit, rate=1.0 / settings.sample_time, gain=settings.gain)
    fill_record(record, feedback)
    fill_record(record["compensation"], compensation_record(settings))
    for name, part in parts.present():
        fill_record(record[name], part.numbers(settings))
    return record


def _steps(stage: str) -> list[Callable]:
    """Return the parts' steps of a stage in order."""
    return [step for kind in KINDS.values() if (step := getattr(kind.steps, stage)) is not None]


def _in_turn(before: Callable, last: Callable) -> Callable:
    """Return two steps of `observe`, one after the other."""

    @inlined
    def both(law, memory, a, measured, n):
        before(law, memory, a, measured, n)
        last(law, memory, a, measured, n)

    return both


def _predicted_in_turn(before: Callable, last: Callable) -> Callable:
    @inlined
    def both(law, memory, a, state, n):
        first, changed = before(law, memory, a, state, n)
        second, again = last(law, memory, a, first, n)
        return second, changed or again

    return both


def _shaped_in_turn(before: Callable, last: Callable) -> Callable:
    @inlined
    def both(law, memory, state, wanted):
        return last(law, memory, state, before(law, memory, state, wanted))

    return both


def _error_in_turn(before: Callable, last: Callable) -> Callable:
    @inlined
    def both(law, memory, a, wanted, e):
        first, limited = before(law, memory, a, wanted, e)
        second, again = last(law, memory, a, wanted, first)
        return second, limited or again

    return both


def _torques_added(before: Callable, last: Callable) -> Callable:
    @inlined
    def both(law, memory, now, i):
        return before(law, memory, now, i) + last(law, memory, now, i)

    return both


def _filtered_in_turn(before: Callable, last: Callable) -> Callable:
    @inlined
    def both(law, memory, i, torque):
        return last(law, memory, i, before(law, memory, i, torque))

    return both


def _learnt_in_turn(before: Callable, last: Callable) -> Callable:
    @inlined
    def both(law, memory, now, limited):
        before(law, memory, now, limited)
        last(law, memory, now, limited)

    return both


@inlined
def _feedback(law, memory, now, i):
    gain, e = law.gain, now.e
    return (
        gain[i, 0] * e[0]
        + gain[i, 1] * e[1]
        + gain[i, 2] * e[2]
        + gain[i, 3] * e[3]
        + gain[i, 4] * e[4]
        + gain[i, 5] * e[5]
        + gain[i, 6] * e[6]
        + gain[i, 7] * e[7]
        + gain[i, 8] * e[8]
        + gain[i, 9] * e[9]
    )


_observe = reduce(_in_turn, _steps("observe"))
_predict = reduce(_predicted_in_turn, _steps("predict"))
_shape = reduce(_shaped_in_turn, _steps("shape"))
_change_error = reduce(_error_in_turn, _steps("error"))
_torque = reduce(_torques_added, _steps("torque"), _feedback)
_filter = reduce(_filtered_in_turn, _steps("filter"))
_learn = reduce(_learnt_in_turn, _steps("learn"))


@inlined
def _limited(torque, limit):
    """Clip so that a NaN stays one."""
    return limit if torque > limit else (-limit if torque < -limit else torque)


@inlined
def _forbidden(reference):
    """Return the first place at which A r is not 0 (lean or a rate), else `ALLOWED`."""
    for i in (2, 3, 5, 6, 7, 8, 9):
        if reference[i] != 0.0:
            return i
    return ALLOWED


@inlined
def _turned(a, v_x, v_y):
    """Return a vector of the world in the heading frame."""
    return a.cos_psi * v_x + a.sin_psi * v_y, a.cos_psi * v_y - a.sin_psi * v_x


@inlined
def _unshaped(reference):
    """Return x, y and psi asked for, each a `Smooth` at rest."""
    return (
        Smooth(reference[0], 0.0, 0.0, 0.0, 0.0),
        Smooth(reference[1], 0.0, 0.0, 0.0, 0.0),
        Smooth(reference[4], 0.0, 0.0, 0.0, 0.0),
    )


@inlined
def _heading_error(a, state, wanted):
    """Return S(psi) (r_s - x)."""
    x, y, psi = wanted
    position = _turned(a, x.value - state[0], y.value - state[1])
    lean = _turned(a, state[2], state[3])
    speed = _turned(a, x.rate - state[5], y.rate - state[6])
    lean_rate = _turned(a, state[7], state[8])
    return (
        position[0],
        position[1],
        -lean[0],
        -lean[1],
        psi.value - state[4],
        speed[0],
        speed[1],
        -lean_rate[0],
        -lean_rate[1],
        psi.rate - state[9],
    )


@inlined
def _release(law, memory, torques):
    """Filter and limit the torques, and remember them; return whether one was beyond the limit."""
    past, given_back = memory.history, memory.disturbance_observer.given_back
    limit = law.torque_limit
    beyond = False
    for i in range(len(torques)):
        torques[i] = _filter(law, memory, i, torques[i])
        beyond = beyond or abs(torques[i]) > limit
        torques[i] = _limited(torques[i], limit)
        past.given[0, i] = torques[i]
        past.effective[0, i] = torques[i] - past.compensated[0, i] - given_back[i]
    for i in range(len(torques)):
        past.beyond[0, i] = 1.0 if beyond else 0.0
    return beyond


@inlined
def _is_state(measured):
    """Return whether every number of a measured state is one that a robot can have."""
    for i in range(10):  # noqa: SIM110 (compiled code has no generators)
        if not abs(measured[i]) <= LARGEST_STATE:  # a NaN is not
            return False
    return True


@called
def _decide(law, memory, measured, reference, torques):
    """Fill `torques` (n,) for a state and a reference that are valid; see `control_law`."""
    n = len(torques)
    a = attitude((measured[2], measured[3], measured[4]))
    _observe(law, memory, a, measured, n)
    state, changed = _predict(law, memory, a, measured, n)
    if changed:
        a = attitude((state[2], state[3], state[4]))
    wanted = _shape(law, memory, state, _unshaped(reference))
    e, limited = _change_error(law, memory, a, wanted, _heading_error(a, state, wanted))
    now = Sample(a, state, wanted, e)
    for i in range(n):
        torques[i] = _torque(law, memory, now, i)
    if law.compensation.full + law.compensation.partial > 0.0:
        compensate(law, memory, now, torques)
    beyond = _release(law, memory, torques)
    _learn(law, memory, now, beyond or limited)


@compiled
def control_law(law, memory, measured, reference, torques):
    """Fill `torques` (n,) and return `ALLOWED`, or the place in the reference at which A r is not 0.

    Without a valid state, or with a reference that is refused, the torques are zero and the memory stays as it is.

    Parameters
    ----------
    law : ndarray
        The float64 view of a record of `LAW`.
    memory : ndarray (`MEMORY_SIZE`,)
        The float64 view of a record of `MEMORY`; changed. All zero at the start of a run.
    measured, reference : ndarray (10,)
    torques : ndarray (n,)
        [N m]
    """
    refused = _forbidden(reference)
    if refused != ALLOWED or not _is_state(measured):
        for i in range(len(torques)):
            torques[i] = 0.0
        return refused
    _decide(law.view(_LAW_TYPE)[0], memory.view(_MEMORY_TYPE)[0], measured, reference, torques)
    return ALLOWED
