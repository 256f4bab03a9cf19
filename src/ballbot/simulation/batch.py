"""Many robots in closed loop at once: the law and the mechanics in one compiled call, robots side by side.

The numbers are those of `simulate` on a `Model`, to rounding. A lane may have late torques or a floor that is not
level (`conditions`), and may be left as soon as its outcome is known (`Verdict`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arguments import checked_arguments
from ballbot.arrays import real_array, whole_number
from ballbot.control.controller import Controller, refusal
from ballbot.control.law import MEMORY_SIZE, control_law
from ballbot.control.presets import ControllerLike, as_controller
from ballbot.control.references import Reference, ReferenceLike, as_reference
from ballbot.errors import InputError
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import called, compiled, inlined
from ballbot.mechanics.engine.lanes import LANES, STEP, TORQUE, new_work, put_robot, robot_in
from ballbot.mechanics.engine.loading import load
from ballbot.mechanics.engine.run import (
    load_state,
    load_torques,
    over_threads,
    start_lane,
    take_steps,
    write_state,
)
from ballbot.mechanics.engine.smooth import pose
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.friction import wheel_law
from ballbot.mechanics.model import Model, ModelLike, as_model
from ballbot.mechanics.parameters import selector
from ballbot.robot import Robot
from ballbot.simulation.batch_result import ClosedLoopBatch
from ballbot.simulation.conditions import FALLING_PART, Conditions, pack_conditions
from ballbot.simulation.model_plant import checked_states, friction_needed, lift_off, pack_contacts, sinking
from ballbot.simulation.run import initial_state_of, sample_count

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """When a lane's outcome counts as known, so that it need not be run on.

    Raises
    ------
    InputError
        If the bounds are not rows of ten numbers, or a limit is not above zero.
    """

    #: rows c (m, 10): settled where |c e| <= 1 for each, e = S(psi) (r - x) the error in the heading frame;
    #: infinite numbers if a lane is never to count as settled
    settled: NDArray[np.float64]
    lost: float  #: lean [rad] beyond which a robot that leans further cannot come back
    grip: float = math.inf  #: friction coefficient of wheels on ball that holds; needing more ends a lane

    def __post_init__(self) -> None:
        what = "The array of bounds within which a robot counts as settled"
        rows = real_array(self.settled, ("...", 10), what, finite=False)
        if np.isnan(rows).any():
            raise InputError(f"{what} holds a value that is not a number.")
        if rows.ndim != 2:
            raise InputError(
                f"The bounds of the verdict have the shape {rows.shape}; they must be rows of ten numbers."
            )
        object.__setattr__(self, "settled", rows)
        for name in ("lost", "grip"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name} of the verdict is {getattr(self, name)!r}; it must be above zero.")


class _Inputs(NamedTuple):
    """Each lane's robot, controller, conditions and start; one row may hold for every lane."""

    parameters: NDArray[np.float64]  #: rows of `pack`
    lift_offs: NDArray[np.float64]
    laws: NDArray[np.float64]
    conditions: NDArray[np.float64]  #: rows of `pack_conditions`
    contacts: NDArray[np.float64]  #: rows of `pack_contacts`
    initial: NDArray[np.float64]


class _Limits(NamedTuple):
    """The verdict, as compiled code reads it; see `Verdict`."""

    settled: NDArray[np.float64]  #: no rows without a verdict
    lost: float
    grip: float


class _Sampling(NamedTuple):
    """The reference at each sample, and the steps between."""

    references: NDArray[np.float64]  #: (samples, 10)
    h: float  #: [s]
    steps: int  #: in a sample
    every: int  #: so many samples between records


class _Outcome(NamedTuple):
    """The arrays that the compiled call fills, for each lane."""

    states: NDArray[np.float64]  #: (lanes, records, 10)
    torques: NDArray[np.float64]  #: (lanes, records, n)
    ended: NDArray[np.int64]  #: sample in which it fell, lifted off or slipped; all samples if it did not
    settled: NDArray[np.int64]
    lifted: NDArray[np.bool_]
    slipped: NDArray[np.bool_]
    changes: NDArray[np.float64]  #: sum of the squared changes of its torques


@called
def _decide(work, lane, limits, state, reference, sample, out, robot):
    """Stop a lane whose outcome is known; see `Verdict`."""
    lean = state[2] * state[2] + state[3] * state[3]
    if lean > limits.lost * limits.lost and state[2] * state[7] + state[3] * state[8] > 0.0:
        out.ended[robot] = sample
    elif _within(limits.settled, state, reference):
        out.settled[robot] = sample
    else:
        return
    work[STEP * LANES + lane] = 0.0


@called
def _within(bounds, state, reference):
    """Return whether each row's product with the heading frame's error is between -1 and 1."""
    c, s = math.cos(state[4]), math.sin(state[4])
    e = np.empty(10)
    for i in range(10):
        e[i] = reference[i] - state[i]
    for i in (0, 2, 5, 7):
        e[i], e[i + 1] = c * e[i] + s * e[i + 1], c * e[i + 1] - s * e[i]
    for row in range(len(bounds)):
        size = 0.0
        for i in range(10):
            size += bounds[row, i] * e[i]
        if not abs(size) <= 1.0:
            return False
    return True


def _models(source: ModelLike | Sequence[ModelLike]) -> list[Model]:
    """Return the models; one compiled call steps them all."""
    if isinstance(source, Sequence) and not isinstance(source, str):
        models = [as_model(one) for one in source]
    else:
        models = [as_model(source)]
    if not models:
        raise InputError("The sequence of models is empty; give one model, or one for each lane.")
    kinds = {(one.formulation, one.step, one.pivots) for one in models}
    if len(kinds) != 1:
        raise InputError(
            f"The models are of {len(kinds)} kinds; all models of a batch must have the same formulation and inner "
            "step, and all or none a pivoting ball."
        )
    return models


def _compiled_controllers(
    source: ControllerLike | Sequence[ControllerLike], robot: Robot
) -> list[Controller]:
    """Return the controllers, whose laws are compiled into the lanes."""
    if isinstance(source, Sequence) and not isinstance(source, str):
        return [one for each in source for one in _compiled_controllers(each, robot)]
    controller = as_controller(source, robot)
    if not isinstance(controller, Controller):
        raise InputError(
            f"A batch runs controllers of Ballbot, not one of type {type(controller).__name__}; run it with `simulate`."
        )
    return [controller]


@checked_arguments
def simulate_batch(
    model: ModelLike | Sequence[ModelLike],
    controller: Controller | str | Path | Sequence[Controller | str | Path],
    reference: ReferenceLike,
    *,
    duration: float,
    initial_states: ArrayLike | None = None,
    conditions: Sequence[Conditions] | None = None,
    verdict: Verdict | None = None,
    every: int = 1,
    threads: int | None = None,
) -> ClosedLoopBatch:
    """Run many robots in closed loop, each from its own start, with its own model and controller.

    Parameters
    ----------
    model : Model, robot, preset or robot file, or a sequence of them
        One for all lanes or one for each; of one formulation and inner step, and a pivoting ball in all or in none.
        A ball that pivots starts without spin.
    controller : Controller, "nominal", "precise" or controller file, or a sequence of them
        One for all lanes or one for each; of one sample time. A name stands for that of the first model's robot.
    reference : callable, name or reference file
        f(t) -> (10,), the same for all lanes.
    duration : float
        [s]
    initial_states : array_like (10,) or (lanes, 10), optional
        The default start of `simulate`, that of seed 0, by default.
    conditions : sequence of Conditions, optional
        One for all lanes or one for each: late torques, a sloping floor. None of either by default.
    verdict : Verdict, optional
        Leaves lanes as soon as their outcome is known; all are run to the end by default.
    every : int
        Record every so many samples; 0 records the last only.
    threads : int, optional
        All cores by default. The result does not depend on it.

    Returns
    -------
    ClosedLoopBatch

    Raises
    ------
    InputError
        If lanes, models, wheels or sample times disagree, or the reference asks for a lean or a rate.
    """
    models = _models(model)
    robots = [one.robot for one in models]
    controllers = _compiled_controllers(controller, robots[0])
    initial = checked_states(initial_state_of(0) if initial_states is None else initial_states)
    borne = [Conditions()] if conditions is None else list(conditions)
    lanes = _lanes(len(initial), len(models), len(controllers), len(borne))
    sample_time = _common_sample_time(controllers)
    n = _common_wheel_count(robots, controllers)
    samples = sample_count(duration, sample_time)
    every = whole_number(every, "every", least=0) or samples
    references = _sampled(as_reference(reference), samples, sample_time)
    records = samples // every
    out = _Outcome(
        states=np.empty((lanes, records, 10)),
        torques=np.empty((lanes, records, n)),
        ended=np.full(lanes, samples, np.int64),
        settled=np.full(lanes, samples, np.int64),
        lifted=np.zeros(lanes, np.bool_),
        slipped=np.zeros(lanes, np.bool_),
        changes=np.zeros(lanes),
    )
    law = wheel_law(*(robot.friction for robot in robots))
    selected = selector(models[0].formulation, n, pivoting=models[0].pivots, law=law)
    inputs = _Inputs(
        parameters=_rows(lambda one: one.packed_under(law), models),
        lift_offs=_rows(lift_off, robots),
        laws=np.stack([one.packed for one in controllers]),
        conditions=pack_conditions(borne, robots),
        contacts=_rows(pack_contacts, robots),
        initial=initial,
    )
    limits = _Limits(
        settled=np.zeros((0, 10)) if verdict is None else verdict.settled,
        lost=LARGEST_LEAN if verdict is None else min(verdict.lost, LARGEST_LEAN),
        grip=math.inf if verdict is None else verdict.grip,
    )
    steps = models[0].steps_in(sample_time)
    sampling = _Sampling(references=references, h=sample_time / steps, steps=steps, every=every)

    def run(first: int) -> None:
        _run_closed_loop_block(selected, inputs, limits, sampling, first, min(LANES, lanes - first), out)

    over_threads(run, lanes, threads)
    decided = np.minimum(out.ended, out.settled)
    return ClosedLoopBatch(
        t=np.arange(1.0, records + 1.0) * (every * sample_time),
        states=out.states,
        torques=out.torques,
        ended=np.where(out.ended < samples, out.ended * sample_time, np.inf),
        settled=np.where(out.settled < samples, out.settled * sample_time, np.inf),
        lifted=out.lifted,
        slipped=out.slipped,
        torque_change=np.sqrt(out.changes / (n * np.maximum(decided - 1, 1))),
    )


@compiled
def _run_closed_loop_block(selected, inputs, limits, sampling, first, width, out):
    """Simulate lanes first .. first + width - 1 of `simulate_batch`."""
    work = new_work()
    conditions, references, ended, settled = inputs.conditions, sampling.references, out.ended, out.settled
    state, held = np.empty(10), np.empty(out.torques.shape[2])
    memories = np.zeros((width, MEMORY_SIZE))
    samples, moving = len(references), width
    longest = 0
    for row in range(len(conditions)):
        longest = max(longest, int(conditions[row, 0]))
    late = np.zeros((1 + longest, width, len(held)))  # torques on their way
    acting, room = np.zeros((width, len(held))), np.zeros(len(held))
    for lane in range(width):
        put_robot(work, lane, inputs.parameters[_row_of(inputs.parameters, first + lane)])
        fill(state, inputs.initial[_row_of(inputs.initial, first + lane)])
        _shift_lean(state, conditions[_row_of(conditions, first + lane)], -1.0)
        start_lane(selected, work, lane, state, sampling.h)
    for sample in range(samples):
        for lane in range(width if moving > 0 else 0):
            robot = first + robot_in(work, lane)
            if ended[robot] == samples and settled[robot] == samples:
                row = conditions[_row_of(conditions, robot)]
                _measure(selected, work, lane, row, state)
                if row[len(row) - 2] <= sample < row[len(row) - 1]:
                    state[0] = np.nan
                law, memory = inputs.laws[_row_of(inputs.laws, robot)], memories[robot - first]
                control_law(law, memory, state, references[sample], held)
                fill(late[sample % len(late), robot - first], held)
                due = late[(sample - int(row[0])) % len(late), robot - first]
                if sample > int(row[0]):
                    out.changes[robot] += _squared_distance(due, acting[robot - first])
                fill(acting[robot - first], due)
                _put_torques(selected, work, lane, row, state[4], acting[robot - first])
        if moving > 0:
            take_steps(selected, work, width, sampling.steps)
        for lane in range(width):
            robot = first + robot_in(work, lane)
            row = conditions[_row_of(conditions, robot)]
            if ended[robot] == samples and settled[robot] == samples:
                limit = inputs.lift_offs[_row_of(inputs.lift_offs, robot)]
                _end_where_due(selected, work, lane, limit, sample + 1, out, robot)
                if limits.grip < math.inf and ended[robot] == samples:
                    touching = inputs.contacts[_row_of(inputs.contacts, robot)]
                    if not _grips(selected, work, lane, touching, room, limits.grip):
                        ended[robot], out.slipped[robot] = sample + 1, True
                        work[STEP * LANES + lane] = 0.0  # the lane stays where it is
                if len(limits.settled) > 0 and ended[robot] == samples:
                    _measure(selected, work, lane, row, state)
                    _decide(work, lane, limits, state, references[sample], sample + 1, out, robot)
                moving -= 1 if work[STEP * LANES + lane] == 0.0 else 0
            if (sample + 1) % sampling.every == 0:
                record = (sample + 1) // sampling.every - 1
                _measure(selected, work, lane, row, out.states[robot, record])
                fill(out.torques[robot, record], acting[robot - first])


@inlined
def _row_of(rows, lane):
    """Return the lane's row, where one row may hold for every lane."""
    return lane if len(rows) > 1 else 0


@inlined
def _shift_lean(state, row, sign):
    """Add or subtract the lean at which the floor's slope has the robot rest."""
    state[2] += sign * row[1]
    state[3] += sign * row[2]


@inlined
def _measure(selected, work, lane, row, out):
    """Write a lane's state as it is seen on its floor."""
    write_state(selected, work, lane, out)
    _shift_lean(out, row, 1.0)


@inlined
def _squared_distance(a, b):
    total = 0.0
    for i in range(len(a)):
        total += (a[i] - b[i]) * (a[i] - b[i])
    return total


@inlined
def _put_torques(selected, work, lane, row, psi, torques):
    """Let torques act on a lane, limited to those its motors can give, less those that hold it on the floor's slope."""
    if row[3] < math.inf:
        _, speeds = pose(selected, load(selected, work, lane), load_state(selected, work, lane))
        for i in range(len(torques)):
            torques[i] = _within_supply(torques[i], speeds[i], row[3], row[4])
    c, s = math.cos(psi), math.sin(psi)
    for i in range(len(torques)):
        work[(TORQUE + i) * LANES + lane] = torques[i] - (c * row[5 + 2 * i] + s * row[6 + 2 * i])


@inlined
def _within_supply(torque, speed, top, most):
    """Return a torque limited to the motor's: near its highest speed the driving torque falls to zero."""
    share = (top - math.copysign(speed, speed * torque)) / (FALLING_PART * top)
    left = most * min(max(share, 0.0), 1.0)
    return min(max(torque, -left), left)


@inlined
def _end_where_due(selected, work, lane, limit, sample, out, robot):
    """Stop a lane that has fallen within the sample or would lift off at its end."""
    state = load_state(selected, work, lane)
    fallen = work[STEP * LANES + lane] == 0.0 or not max(abs(state[2]), abs(state[3])) <= LARGEST_LEAN
    lifts = False
    if not fallen:
        P, u = load(selected, work, lane), load_torques(selected, work, lane)
        lifts = not sinking(selected, P, state, u) < limit
    if fallen or lifts:
        out.ended[robot] = sample
        out.lifted[robot] = lifts
        work[STEP * LANES + lane] = 0.0  # the lane stays where it is


@inlined
def _grips(selected, work, lane, touching, room, grip):
    """Return whether a lane's wheels need no more than this friction coefficient not to slip."""
    P, state, u = (
        load(selected, work, lane),
        load_state(selected, work, lane),
        load_torques(selected, work, lane),
    )
    return friction_needed(selected, P, state, u, touching, room) <= grip


def _lanes(*counts: int) -> int:
    lanes = max(counts)
    if any(count not in (1, lanes) for count in counts):
        starts, models, controllers, conditions = counts
        raise InputError(
            f"There are {starts} initial states, {models} models, {controllers} controllers and {conditions} "
            "conditions; each number must be one or the number of lanes."
        )
    return lanes


def _rows(row_of: Callable[[T], NDArray[np.float64] | float], values: Sequence[T]) -> NDArray[np.float64]:
    """Return a row for each value, made once where a value is there more than once."""
    made = {id(value): row_of(value) for value in {id(value): value for value in values}.values()}
    return np.array([made[id(value)] for value in values])


def _common_sample_time(controllers: Sequence[Controller]) -> float:
    times = {one.sample_time for one in controllers}
    if len(times) != 1:
        raise InputError(
            f"The controllers' sample times are {sorted(times)} s; all controllers of a batch must have the "
            "same."
        )
    return times.pop()


def _common_wheel_count(robots: Sequence[Robot], controllers: Sequence[Controller]) -> int:
    counts = {*(one.wheel_count for one in robots), *(len(one.gain) for one in controllers)}
    if len(counts) != 1:
        raise InputError(
            f"Robots and controllers have {sorted(counts)} wheels; all of a batch must have the same number."
        )
    return counts.pop()


def _sampled(reference: Reference, samples: int, sample_time: float) -> NDArray[np.float64]:
    """Return the reference at every sample (samples, 10)."""
    references = np.empty((samples, 10))
    for k in range(samples):
        wanted = reference(k * sample_time)
        # a check of each sample would take longer than its simulation
        plain = type(wanted) is np.ndarray and wanted.dtype == np.float64 and wanted.shape == (10,)
        references[k] = wanted if plain else real_array(wanted, (10,), "The reference")
    real_array(references, (samples, 10), "The reference")
    forbidden = np.argwhere(references[:, [2, 3, 5, 6, 7, 8, 9]] != 0.0)
    if len(forbidden):
        row, column = forbidden[0]
        place = (2, 3, 5, 6, 7, 8, 9)[column]
        raise InputError(refusal(place, float(references[row, place])))
    return references
