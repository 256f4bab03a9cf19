"""The control law, compiled once for one robot and for batches of robots.

    u = K S(psi) (r_s - x) + parts' torques + friction compensation,  filtered and limited

A policy scales these torques and adds its own before they are limited.

S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame: K is designed at
psi = 0 and the wheels turn with the body. `decide` calls the steps of the parts in order; the steps of a missing part
have no effect.

A controller's numbers are one record (`LAW`), so that every robot in a batch can have its own law; its memory between
updates is another (`MEMORY`). Both are derived from the parts' dataclasses (`ballbot.records`). The
firmware's C, decide.c and parts/, is written from this file and those of the parts (`tests.support.firmware_law`).
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
    FollowedMotion,
    LawSettings,
    Pose,
    RobotState,
    Sample,
    SmoothReference,
    TorqueHistory,
    clipped,
    heading_frame,
    turned_state,
)
from ballbot.control.parts.planner import plan_gently, plan_motion, restart_planner
from ballbot.control.parts.policy import ERRORS, HISTORY, act, with_policy, within_policy
from ballbot.control.parts.prediction import predict
from ballbot.control.tuning import CHANGE_TIME, TuningRecord, TuningState, tune
from ballbot.estimation.heading import HEADING, unwrapped
from ballbot.mechanics.engine.compiled import c_code, compiled, inlined
from ballbot.mechanics.engine.tracing import outside, traced
from ballbot.records import MAX_WHEELS, Schema, fill_record, number, schema_of

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


#: a controller's memory: torques of the last updates, headings, what has changed, each part's state by its name; zeros
#: when a run starts
MEMORY = Schema(
    name="memory",
    fields={
        "history": schema_of(TorqueHistory),
        "measured_heading": HEADING,
        "reference_heading": HEADING,
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
def _at_rest(value):
    """Return the reference of an axis without a planner."""
    return SmoothReference(value, 0.0, 0.0, 0.0, 0.0)


@inlined
def _followed(law, memory, pose, ahead, reference, wanted):
    """Return the motion that is followed: a plan as it is, or the planned one to the pose that is asked for."""
    asked = Pose(wanted.x - pose.x, wanted.y - pose.y, wanted.psi - pose.psi)
    if follows_plan(law, memory, reference):
        restart_planner(memory, wanted)
        return planned(law, memory, ahead.a, reference, asked)
    if law.planner.on == 0:
        return FollowedMotion(_at_rest(asked.x), _at_rest(asked.y), _at_rest(asked.psi))
    return plan_motion(law, memory, pose, ahead, wanted)


@inlined
def _heading_error(a, state, to):
    """Return S(psi) (r_s - x)."""
    error = RobotState(
        to.x.value - state.x,
        to.y.value - state.y,
        -state.theta,
        -state.phi,
        to.psi.value - state.psi,
        to.x.rate - state.x_dot,
        to.y.rate - state.y_dot,
        -state.theta_dot,
        -state.phi_dot,
        to.psi.rate - state.psi_dot,
    )
    return turned_state(a, error)


@inlined
def _feedback(gain, e):
    """Return the torque K e of a wheel."""
    for_pose = gain[0] * e.x + gain[1] * e.y + gain[2] * e.theta + gain[3] * e.phi + gain[4] * e.psi
    for_speed = gain[5] * e.x_dot + gain[6] * e.y_dot
    return for_pose + for_speed + gain[7] * e.theta_dot + gain[8] * e.phi_dot + gain[9] * e.psi_dot


@inlined
def _limit_together(torques, limit, n):
    """Limit the torques of all wheels so that the lean's come first and nothing turns the robot that was not asked for.

    Their mean turns the robot, and what they differ by moves it. If more than twice the limit is asked for, the robot
    is about to fall: the more is asked, the more each wheel gives what it can, though that turns the robot.
    """
    mean, least, most = 0.0, 0.0, 0.0
    for i in range(n):
        mean += torques[i] / n
    for i in range(n):
        least = min(least, torques[i] - mean)
        most = max(most, torques[i] - mean)
    largest = max(most, -least)
    share = limit / largest if largest > limit else 1.0
    turning = min(max(mean, -limit - share * least), limit - share * most)
    falling = max(0.0, 1.0 - 2.0 * share)
    for i in range(n):
        together = turning + share * (torques[i] - mean)
        torques[i] = clipped(together + falling * (clipped(torques[i], limit) - together), limit)


@inlined
def _filter_and_limit(law, memory, torques, n, learned):
    """Filter, limit and remember the torques, `learned` ones among them; return whether one exceeded the limit."""
    history, limit, limited = memory.history, law.torque_limit, False
    for i in range(n):
        history.disturbance_compensation[0, i] = 0.0  # the observer adds to it
        torques[i] = notched(law, memory, add_estimate(memory, torques[i], i), i)
        if learned:
            torques[i] = with_policy(law, memory, torques[i], i)
        limited = limited or abs(torques[i]) > limit
    if limited:
        _limit_together(torques, limit, n)
    for i in range(n):
        history.acting[0, i] = torques[i]
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
def decide(law, memory, weights, measured, reference, torques, n):
    """Fill the torques of n wheels for a state and a reference that are valid. A policy has weights."""
    tune(law, memory)
    a, psi = heading_frame(measured[4]), unwrapped(memory.measured_heading, measured[4])
    pose = Pose(measured[0], measured[1], psi)
    wanted = Pose(reference[0], reference[1], unwrapped(memory.reference_heading, reference[4]))
    # relative to the pose
    seen = RobotState(
        0.0,
        0.0,
        measured[2],
        measured[3],
        0.0,
        measured[5],
        measured[6],
        measured[7],
        measured[8],
        measured[9],
    )
    observe(law, memory, a, seen, n)
    act(law, memory, weights, a, seen, pose, wanted)
    ahead = predict(law, memory, a, seen, n)
    to = _followed(law, memory, pose, ahead, reference, wanted)
    error = _heading_error(ahead.a, ahead.state, to)
    error_with_lean = lean_error(law, ahead.a, to, error)
    less = limit_error(law, memory, error_with_lean)
    if less.limited:
        plan_gently(memory)
    now = Sample(ahead.a, ahead.state, to, less.e)
    for i in range(n):
        torques[i] = _feedback(law.gain[i], now.e)
        if law.tuning.others > 0:
            torques[i] += _feedback(memory.tuning.gain[i], now.e)
    add_feed_forward(law, now, torques, n)
    add_integral(law, memory, now, torques, n)
    if law.compensation.full + law.compensation.partial > 0.0:
        compensate(law, memory, now, torques, n)
    limited = _filter_and_limit(law, memory, torques, n, within_policy(law, seen))
    learn_integral(law, memory, now, limited or less.limited)


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
            decide(law, memory, weights, state, carray(reference, 10), held, n)
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
