"""Inputs of the compiled loop: robots and laws as rows of numbers, random numbers, and arrays for the outcome."""

from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.law import law_code
from ballbot.estimation.interface import EstimatorName
from ballbot.estimation.kalman import kalman_record
from ballbot.estimation.kalman_model import sample_code
from ballbot.mechanics.engine.play import play_code_of
from ballbot.mechanics.engine.run import code_of
from ballbot.mechanics.model import Model
from ballbot.mechanics.traction import pack_contacts
from ballbot.records import fill_record, packed
from ballbot.robot import Robot
from ballbot.simulation.imperfections import (
    LOOP,
    Imperfections,
    LoopRecord,
    loop_record,
    packed_on_floor,
    waves_of,
)
from ballbot.simulation.loop import STARTED, Commands, Draws, Inputs, Outcome
from ballbot.simulation.model_plant import lift_off

T = TypeVar("T")
Rows = TypeVar("Rows", Inputs, Outcome)


def inputs_of(
    models: Sequence[Model],
    by_lane: Sequence[Imperfections],
    *,
    sample_time: float,
    laws: Sequence[Controller] = (),
    estimators: Sequence[EstimatorName | None] = (None,),
    initial: NDArray[np.float64] | None = None,
) -> Inputs:
    """Return what the compiled loop reads of robots side by side; each sequence has one item for all, or one for each.

    Without imperfections the controllers see the true state, and drives have no limits of their own. Without laws the
    torques come from outside. `initial` are the true states (1 or robots, 10) at the start, by default zeros.
    """
    robots, selected = [model.robot for model in models], models[0].selected
    filters = _filters(by_lane, robots, estimators, sample_time)
    slips = any(lane.grip for lane in by_lane)
    return Inputs(
        code=code_of(selected, slips=slips),
        play_code=play_code_of(selected, slips=slips) if any(lane.backlash > 0.0 for lane in by_lane) else 0,
        law_code=law_code() if laws else 0,
        filter_code=sample_code() if len(filters) else 0,
        parameters=_on_floors(models, by_lane),
        lift_offs=_rows(lift_off, robots),
        laws=_law_rows(laws),
        loops=_loops(by_lane, robots, estimators, sample_time),
        filters=filters,
        contacts=_rows(pack_contacts, robots),
        initial=np.zeros((1, 10)) if initial is None else initial,
        pushes=push_table(by_lane, sample_time),
        bumps=bump_table(models, by_lane),
    )


def _filters(
    by_lane: Sequence[Imperfections],
    robots: Sequence[Robot],
    estimators: Sequence[EstimatorName | None],
    sample_time: float,
) -> NDArray[np.float64]:
    """Return the records of `KALMAN`; none without a Kalman filter."""
    if not (any(lane.sensors for lane in by_lane) and "kalman" in estimators):
        return np.empty((0, 0))
    lanes = range(max(len(by_lane), len(robots), len(estimators)))
    known = [by_lane[k % len(by_lane)].known or robots[k % len(robots)] for k in lanes]
    return _rows(lambda robot: packed(kalman_record(robot, sample_time=sample_time)), known)


def _loops(
    by_lane: Sequence[Imperfections],
    robots: Sequence[Robot],
    estimators: Sequence[EstimatorName | None],
    sample_time: float,
) -> NDArray[np.void]:
    """Return the records of `loop_record`."""
    if not by_lane:
        # the controllers see the true state and the drives have no limits of their own
        record = LOOP.zeros()
        fill_record(record, LoopRecord(sample_time=sample_time))
        return record
    lanes = range(max(len(by_lane), len(robots), len(estimators)))
    of: list[tuple[Imperfections, Robot, EstimatorName | None]] = [
        (by_lane[k % len(by_lane)], robots[k % len(robots)], estimators[k % len(estimators)]) for k in lanes
    ]
    # a record does not depend on the seed, by which alone the lanes of a comparison differ
    keys = [
        (*(id(value) for name, value in vars(lane).items() if name != "seed"), id(robot), estimator)
        for lane, robot, estimator in of
    ]
    loops = _once(
        keys, lambda k: loop_record(of[k][0], of[k][1], estimator=of[k][2], sample_time=sample_time)
    )
    return np.array(loops).view(LOOP.dtype())[:, 0]


def _on_floors(models: Sequence[Model], by_lane: Sequence[Imperfections]) -> NDArray[np.float64]:
    """Return the rows of `packed_on_floor`; one if it holds for every robot."""
    by_lane = by_lane or [Imperfections()]
    of = [(models[k % len(models)], by_lane[k % len(by_lane)]) for k in range(max(len(models), len(by_lane)))]
    keys = [(id(model), lane.slope, lane.imbalance) for model, lane in of]
    rows = _once(keys, lambda k: packed_on_floor(*of[k]))
    return np.array(rows if len(set(keys)) > 1 else rows[:1])


def _law_rows(controllers: Sequence[Controller]) -> NDArray[np.float64]:
    """Return the controllers' numbers, as long as those of the one with the most weights."""
    rows = np.zeros((max(len(controllers), 1), max((len(one.packed) for one in controllers), default=0)))
    for row, controller in zip(rows, controllers, strict=False):
        row[: len(controller.packed)] = controller.packed
    return rows


def _rows(row_of: Callable[[T], NDArray[np.float64] | float], values: Sequence[T]) -> NDArray[np.float64]:
    """Return a row for each value, made once where a value is there more than once."""
    return np.array(_once([id(value) for value in values], lambda k: row_of(values[k])))


def _once(keys: Sequence[Hashable], make: Callable[[int], T]) -> list[T]:
    """Return make(k) for each place k, made once for those of the same key."""
    made: dict[Hashable, T] = {}
    for k, key in enumerate(keys):
        if key not in made:
            made[key] = make(k)
    return [made[key] for key in keys]


def push_table(by_lane: Sequence[Imperfections], sample_time: float) -> NDArray[np.float64]:
    """Return (1 or lanes, m, 6): first sample, the first one after it, force [N] and height [m] of each push."""
    most = max((len(lane.pushes) for lane in by_lane), default=0)
    table = np.zeros((max(len(by_lane), 1), most, 6))
    for row, lane in zip(table, by_lane, strict=False):
        for entry, push in zip(row, lane.pushes, strict=False):
            ends = [push.time / sample_time, (push.time + push.duration) / sample_time]
            entry[:] = [*np.ceil(np.subtract(ends, 1e-4)), *push.force, push.height]
    return table


def change_samples(imperfections: Imperfections, sample_time: float) -> list[int]:
    """Return the samples from which each of a robot's changes holds."""
    times = [change.time / sample_time for change in imperfections.later]
    return np.ceil(np.subtract(times, 1e-4)).astype(np.int64).tolist()


def bump_table(models: Sequence[Model], by_lane: Sequence[Imperfections]) -> NDArray[np.float64]:
    """Return (1 or lanes, m, 4): the waves of each robot's floor, their amplitudes times its weight."""
    most = max((len(waves_of(lane.roughness)) for lane in by_lane if lane.roughness), default=0)
    lanes = max(len(by_lane), len(models)) if most else 1
    table = np.zeros((lanes, most, 4))
    for k in range(lanes if most else 0):
        rough, robot = by_lane[k % len(by_lane)].roughness, models[k % len(models)].robot
        if rough is not None:
            table[k] = waves_of(rough)
            table[k, :, 3] *= (robot.ball.mass + robot.body.mass) * robot.gravity
    return table


def draws_of(
    runs: Sequence[tuple[Imperfections, int]], width: int, *, n: int, samples: int, sample_time: float
) -> Draws:
    """Return the random numbers of a block's runs, each drawn from its seed as `SensedPlant` draws them."""
    by_lane = {id(lane): lane for lane, _ in runs}.values()
    noisy = any(lane.random for lane in by_lane)
    faulty = any(lane.sensor_faults is not None for lane in by_lane)
    jitters, plays = any(lane.jitter > 0.0 for lane in by_lane), any(lane.backlash > 0.0 for lane in by_lane)
    noise = np.empty((width, (6 + n) * samples if noisy else 0))
    faults = np.empty((width, 5 * (samples + 1) if faulty else 0))
    positions, turns = np.zeros((2, width, n))
    durations = np.zeros((width, samples if jitters else 0))
    for k, (lane, seed) in enumerate(runs):
        random = np.random.default_rng(seed)
        if faulty:
            random.spawn(1)[0].standard_normal(out=faults[k])
        if noisy:
            random.standard_normal(out=noise[k])
        if plays:
            positions[k] = np.random.default_rng([seed, 7]).uniform(-0.5, 0.5, n)
        if lane.contacts is not None:
            turns[k] = np.random.default_rng([seed, 11]).uniform(0.0, 2.0 * np.pi, n)
        if jitters:
            late = lane.jitter * np.random.default_rng([seed, 5]).uniform(-1.0, 1.0, samples)
            durations[k] = sample_time + np.diff(late, prepend=0.0)
    return Draws(noise, faults, positions, turns, durations, samples)


def empty_outcome(lanes: int, records: int, samples: int, n: int) -> Outcome:
    """Return the arrays for the outcome of lanes, filled as if all run to the end."""
    return Outcome(
        states=np.empty((lanes, records, 10)),
        finals=np.empty((lanes, 10)),
        torques=np.empty((lanes, records, n)),
        seen=np.empty((lanes, records, 10)),
        commanded=np.empty((lanes, records, n)),
        encoders=np.empty((lanes, records, 2 * n)),
        gyro=np.empty((lanes, records, 3)),
        ended=np.full(lanes, samples, np.int64),
        lifted=np.zeros(lanes, np.bool_),
        slipped=np.zeros(lanes, np.bool_),
        changes=np.zeros(lanes),
    )


def rows_of(arrays: Rows, robots: slice) -> Rows:
    """Return inputs or outcome of some of the robots; what holds for every robot stays."""
    parts = (part[robots] if isinstance(part, np.ndarray) and len(part) > 1 else part for part in arrays)
    return arrays._make(parts)


def new_commands(robots: int, n: int, *, references: int = 1) -> Commands:
    """Return the commands of robots that are to start, with n torques from outside and so many rows of references."""
    todo, ages = np.full(robots, STARTED), np.zeros(robots, np.int64)
    return Commands(todo, ages, torques=np.zeros((robots, n)), references=np.zeros((references, 10)))
