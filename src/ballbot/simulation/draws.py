"""Inputs of the compiled loop beside its records: pushes, bumps, random numbers, and arrays for the outcome."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.simulation.imperfections import Imperfections, waves_of
from ballbot.simulation.loop import Draws, Outcome


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
    return Draws(noise=noise, faults=faults, positions=positions, turns=turns, durations=durations)


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
