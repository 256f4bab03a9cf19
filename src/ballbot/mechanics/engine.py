"""The engine: many robots through many samples in one compiled call.

Robots are stepped in blocks of `LANES`, side by side, in loops that become vector instructions; a single robot is a
block of one. Where no contact is at rest, a step is first tried as RK4 with known signs of friction (`smooth`); robots
in which a sign may have changed take the convex step instead (`proximal`, and `stick_slip` where that does not settle).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.compiled import compiled
from ballbot.mechanics.lanes import LANES, STEP, TORQUE, new_work, robot_in
from ballbot.mechanics.parameters import Exact, Pivoting, Thesis
from ballbot.mechanics.steps import start_lane, take_steps, write_state


@compiled
def run_block(
    selected,
    parameters,
    parameter_of,
    initial,
    initial_of,
    torques,
    torque_of,
    first,
    width,
    h,
    steps,
    every,
    out,
    ended,
):
    """Simulate lanes first .. first + width - 1 of `simulate_lanes`."""
    work = new_work()
    samples, n = torques.shape[1], torques.shape[2]
    for lane in range(width):
        row = parameters[parameter_of[first + lane]]
        for i in range(len(row)):
            work[i * LANES + lane] = row[i]
        start_lane(selected, work, lane, initial[initial_of[first + lane]], h)
        ended[first + lane] = samples
    for sample in range(samples):
        for lane in range(width):
            held = torques[torque_of[first + robot_in(work, lane)], sample]
            for i in range(n):
                work[(TORQUE + i) * LANES + lane] = held[i]
        take_steps(selected, work, width, steps)
        for lane in range(width):
            robot = first + robot_in(work, lane)
            if work[STEP * LANES + lane] == 0.0 and ended[robot] == samples:
                ended[robot] = sample
            if (sample + 1) % every == 0:
                write_state(selected, work, lane, out[robot, (sample + 1) // every - 1])


@dataclass(frozen=True, kw_only=True)
class Batch:
    """What `simulate_lanes` returns."""

    states: NDArray[np.float64]  #: (lanes, samples // every, 10 or 11), after each recorded sample
    ended: NDArray[np.int64]  #: (lanes,), whole samples simulated before the lean passed `LARGEST_LEAN`


def simulate_lanes(
    selected: Exact | Thesis | Pivoting,
    *,
    parameters: NDArray[np.float64],
    initial: NDArray[np.float64],
    torques: NDArray[np.float64],
    sample_time: float,
    steps: int,
    parameter_of: NDArray[np.int64] | None = None,
    initial_of: NDArray[np.int64] | None = None,
    torque_of: NDArray[np.int64] | None = None,
    every: int = 1,
    threads: int | None = None,
) -> Batch:
    """Simulate many robots, each under torques held over each sample.

    Lane i takes row parameter_of[i] of `parameters`, and likewise for the others, so that a population of parameter
    sets can be run over many windows of a log without copying either; without an index, lane i takes row i.

    Parameters
    ----------
    selected : Exact, Thesis or Pivoting
        From `ballbot.mechanics.parameters.selector`.
    parameters : ndarray (sets, size)
        Rows from `ballbot.mechanics.parameters.pack`.
    initial : ndarray (starts, 10), or (starts, 11) where the ball pivots
        [x y theta phi psi and their rates], and the ball's spin [rad/s].
    torques : ndarray (inputs, samples, n)
        [N m].
    sample_time : float
        [s]
    steps : int
        Inner steps a sample.
    every : int
        Record every so many samples.
    threads : int, optional
        All cores by default. The result does not depend on it.

    Returns
    -------
    Batch
    """
    lanes = max(len(parameters), len(initial), len(torques))
    for index in (parameter_of, initial_of, torque_of):
        lanes = lanes if index is None else len(index)
    indices = [
        np.arange(lanes) if i is None else np.asarray(i, np.int64)
        for i in (parameter_of, initial_of, torque_of)
    ]
    parameters, initial, torques = (np.ascontiguousarray(a, float) for a in (parameters, initial, torques))
    out = np.empty((lanes, torques.shape[1] // every, initial.shape[1]))
    ended = np.empty(lanes, np.int64)

    def run(first: int) -> None:
        width = min(LANES, lanes - first)
        arrays = (parameters, indices[0], initial, indices[1], torques, indices[2])
        run_block(selected, *arrays, first, width, sample_time / steps, steps, every, out, ended)

    over_threads(run, lanes, threads)
    return Batch(states=out, ended=ended)


def over_threads(run: Callable[[int], None], lanes: int, threads: int | None) -> None:
    """Call run(first lane) for each block of lanes, over so many threads; all cores where `threads` is None."""
    blocks = range(0, lanes, LANES)
    workers = min(threads or os.cpu_count() or 1, len(blocks))
    if workers <= 1:
        for first in blocks:
            run(first)
        return
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, blocks))
