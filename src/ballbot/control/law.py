"""The control law, compiled once for one robot and for batches of robots.

    u = K S(psi) (r_s - x) + parts' torques + friction compensation,  filtered and limited

S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame: K is designed at
psi = 0 and the wheels turn with the body. `_decide` calls the steps of the parts in order; the steps of a missing part
have no effect.

A controller's numbers are one record (`LAW`), so that every robot in a batch can have its own law; its memory between
updates is another (`MEMORY`). Both are derived from the parts' dataclasses (`ballbot.control.records`). In C
a part is one file with these two structs and a function for each of its steps; `law.c` has the calls in order.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numba import carray  # pyright: ignore[reportPrivateImportUsage] (documented by Numba)
from numpy.typing import NDArray

from ballbot.control.interface import LARGEST_STATE
from ballbot.control.parts import KINDS, Parts
from ballbot.control.parts.compensation import CompensationRecord, compensate, compensation_record
from ballbot.control.parts.disturbance_observer import add_estimate, observe
from ballbot.control.parts.feed_forward import add_feed_forward, follows_plan, lean_error, planned
from ballbot.control.parts.integral import add_integral, learn_integral
from ballbot.control.parts.lean_limit import limit_error
from ballbot.control.parts.notch import notched
from ballbot.control.parts.part import (
    LawSettings,
    Measured,
    Sample,
    SmoothReference,
    TorqueHistory,
    clipped,
    heading_frame,
    row_times,
)
from ballbot.control.parts.policy import ERRORS, HISTORY, act, with_policy, within_policy
from ballbot.control.parts.prediction import predict
from ballbot.control.parts.reference_shaping import restart_shaping, shape, slow_motion
from ballbot.control.records import MAX_WHEELS, Schema, fill_record, number, schema_of, whole
from ballbot.control.tuning import CHANGE_TIME, TuningRecord, TuningState, tune
from ballbot.estimation.heading import TURN, compiled_turns_after
from ballbot.mechanics.engine.compiled import c_code, compiled, inlined
from ballbot.mechanics.engine.tracing import outside, traced
from ballbot.mechanics.equations import attitude

#: what `control_law` returns if the reference is allowed
ALLOWED = -1


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedbackRecord:
    """The numbers of every law."""

    torque_limit: float = field(metadata=number("N m"))
    rate: float = field(metadata=number("1/s"))
    gain: NDArray[np.float64] = field(metadata=number("N m per state", MAX_WHEELS, 10))


#: a controller's numbers: feedback, compensation, what may change, and each part's record by its name
LAW = Schema(
    name="law",
    fields={
        **schema_of(FeedbackRecord).fields,
        "compensation": schema_of(CompensationRecord),
        "tuning": schema_of(TuningRecord),
        **{name: schema_of(kind.record) for name, kind in KINDS.items()},
    },
)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadingMemory:
    """The last value of a heading that wraps around, and the whole turns since the start."""

    started: int = field(metadata=whole())
    last: float = field(metadata=number("rad"))
    turns: int = field(metadata=whole())


#: a controller's memory: torques of the last updates, headings, what has changed, each part's state by its name; zeros
#: when a run starts
MEMORY = Schema(
    name="memory",
    fields={
        "history": schema_of(TorqueHistory),
        "measured_heading": schema_of(HeadingMemory),
        "reference_heading": schema_of(HeadingMemory),
        "tuning": schema_of(TuningState),
        **{name: schema_of(kind.state) for name, kind in KINDS.items()},
    },
)
LAW_TYPE, MEMORY_TYPE = LAW.dtype(), MEMORY.dtype()

#: lengths of the numbers before a policy's weights, and of the memory, as arrays of float64
LAW_SIZE, MEMORY_SIZE = LAW_TYPE.itemsize // 8, MEMORY_TYPE.itemsize // 8
#: place of the torque limit in the numbers
LIMIT_AT = (LAW_TYPE.fields or {})["torque_limit"][1] // 8


def law_record(settings: LawSettings, *, torque_limit: float, parts: Parts) -> NDArray[np.void]:
    """Return a controller's numbers as a record (1,) of `LAW`.

    InputError if a part is not possible with the robot, the sample time or the number of wheels.
    """
    record = LAW.zeros()
    feedback = FeedbackRecord(torque_limit=torque_limit, rate=1.0 / settings.sample_time, gain=settings.gain)
    fill_record(record, feedback)
    fill_record(record["compensation"], compensation_record(settings))
    record["tuning"]["step"], record["tuning"]["compensation"] = settings.sample_time / CHANGE_TIME, 1.0
    for name, part in parts.present():
        fill_record(record[name], part.numbers(settings))
    return record


@inlined
def _forbidden(reference):
    """Return the first index of the reference at which A r is not 0 (lean or a rate), else `ALLOWED`."""
    for i in (2, 3, 5, 6, 7, 8, 9):
        if reference[i] != 0.0:
            return i
    return ALLOWED


@inlined
def _turned_by(memory, angle):
    """Return the whole turns [rad] to add to the next value of a heading; see `ballbot.estimation.heading`."""
    last = memory.last if memory.started == 1 else angle
    memory.turns = compiled_turns_after(angle, last, memory.turns)
    memory.last, memory.started = angle, 1
    return TURN * memory.turns


@inlined
def _unshaped(reference, moved):
    """Return the reference of x, y and psi, each a `SmoothReference` at rest, with an angle added to psi."""
    return (
        SmoothReference(reference[0], 0.0, 0.0, 0.0, 0.0),
        SmoothReference(reference[1], 0.0, 0.0, 0.0, 0.0),
        SmoothReference(reference[4] + moved, 0.0, 0.0, 0.0, 0.0),
    )


@inlined
def _followed(law, memory, now, reference, asked):
    """Return the motion that is followed: a plan as it is, or the shaped motion to the pose that is asked for."""
    if follows_plan(law, memory, reference):
        restart_shaping(memory, asked)
        return planned(law, memory, now.a, reference, asked[2].value)
    return shape(law, memory, asked, now)


@inlined
def _heading_error(a, state, moved, wanted):
    """Return S(psi) (r_s - x), with an angle added to the state's heading."""
    x, y, psi = wanted
    pose = (x.value - state[0], y.value - state[1], -state[2], -state[3], psi.value - (state[4] + moved))
    rates = (x.rate - state[5], y.rate - state[6], -state[7], -state[8], psi.rate - state[9])
    return heading_frame(a, (*pose, *rates))


@inlined
def _filter_and_limit(law, memory, torques, learned):
    """Filter, limit and remember the torques, `learned` ones among them; return whether one exceeded the limit."""
    history, limit = memory.history, law.torque_limit
    limited = False
    for i in range(len(torques)):
        history.disturbance_compensation[0, i] = 0.0  # the observer adds to it
        torques[i] = notched(law, memory, add_estimate(law, memory, torques[i], i), i)
        if learned:
            torques[i] = with_policy(law, memory, torques[i], i)
        limited = limited or abs(torques[i]) > limit
        torques[i] = clipped(torques[i], limit)
        history.acting[0, i] = torques[i]
    for i in range(len(torques)):
        history.limited[0, i] = 1.0 if limited else 0.0
    return limited


@inlined
def _is_state(measured):
    """Return whether every number of a measured state is possible for a robot."""
    for i in range(10):  # noqa: SIM110 (compiled code has no generators)
        if not abs(measured[i]) <= LARGEST_STATE:  # a NaN is not
            return False
    return True


@inlined
def _decide(law, memory, weights, measured, reference, torques):
    """Fill `torques` (n,) for a state and a reference that are valid; see `control_law`. A policy has weights."""
    n = len(torques)
    tune(law, memory)
    seen = Measured(attitude((measured[2], measured[3], measured[4])), measured)
    observe(law, memory, seen, n)
    a, state = predict(law, memory, seen, n)
    # zero at the start of a run, when a part takes the measured pose as its start
    moved = _turned_by(memory.measured_heading, measured[4])
    asked = _unshaped(reference, _turned_by(memory.reference_heading, reference[4]))
    act(law, memory, weights, seen, asked, moved)
    wanted = _followed(law, memory, Measured(a, state), reference, asked)
    error = lean_error(law, _heading_error(a, state, moved, wanted), a, wanted)
    e, error_limited = limit_error(law, memory, error)
    if error_limited:
        slow_motion(law, memory)
    now = Sample(a, state, wanted, e)
    for i in range(n):
        feedback = row_times(law.gain[i], e) + row_times(memory.tuning.gain[i], e)
        torque = add_feed_forward(law, feedback, now, i)
        torques[i] = add_integral(law, memory, torque, now, i)
    if law.compensation.full + law.compensation.partial > 0.0:
        compensate(law, memory, now, torques)
    torque_limited = _filter_and_limit(law, memory, torques, within_policy(law, seen))
    learn_integral(law, memory, now, torque_limited or error_limited)


@cache
def law_code() -> int:
    """Return the address of the law's code; the first call compiles, or reads what was compiled."""

    @c_code("void(voidptr, voidptr, CPointer(float64), CPointer(float64), CPointer(float64), int64)")
    def address(laws, memories, measured, reference, torques, n):
        state, held = carray(measured, 10), carray(torques, n)
        if _is_state(state):
            law, memory = carray(laws, 1, LAW_TYPE)[0], carray(memories, 1, MEMORY_TYPE)[0]
            own = law.policy
            inputs = (ERRORS + HISTORY * own.wheels + 1) * own.hidden
            size = inputs + (own.hidden + 1) * (own.hidden + own.wheels)
            weights = carray(laws, LAW_SIZE + size, np.float64)[LAW_SIZE:]
            _decide(law, memory, weights, state, carray(reference, 10), held)
        else:
            for i in range(n):
                held[i] = 0.0

    return address


@traced
def decide_torques(code, law, memory, measured, reference, torques, n):
    """Do as `control_law`, with a reference that is allowed, by `law_code`; law and memory are arrays of one record."""
    outside(code, law, memory, measured, reference, torques, n)


@compiled
def _control_law(code, law, memory, measured, reference, torques, plans):
    refused = ALLOWED if plans else _forbidden(reference)
    if refused == ALLOWED:
        decide_torques(code, law, memory, measured, reference, torques, len(torques))
    else:
        for i in range(len(torques)):
            torques[i] = 0.0
    return refused


def control_law(
    law: NDArray[np.float64],
    memory: NDArray[np.float64],
    measured: NDArray[np.float64],
    reference: NDArray[np.float64],
    torques: NDArray[np.float64],
    *,
    plans: bool = False,
) -> int:
    """Fill `torques` (n,) [N m] and return `ALLOWED`, or the index in the reference at which A r is not 0.

    Law and memory are the float64 views of records of `LAW` and `MEMORY`; the memory, all zero at the start of a run,
    is changed. Without a valid state, or with a reference that is refused, the torques are zero and it stays as it is.
    `plans` says that the law has feed-forward: then no reference is refused, and leans and rates are followed.
    """
    return _control_law(law_code(), law, memory, measured, reference, torques, plans)
