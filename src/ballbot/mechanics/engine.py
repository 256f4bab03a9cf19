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
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import index_array, positive_number, real_array, whole_number
from ballbot.mechanics.compiled import compiled
from ballbot.mechanics.lanes import LANES, STEP, TORQUE, new_work, robot_in
from ballbot.mechanics.parameters import RIGID_SIZE, WHEEL_SIZE, Exact, Pivoting, Thesis
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
    parameters: ArrayLike,
    initial: ArrayLike,
    torques: ArrayLike,
    sample_time: float,
    steps: int,
    parameter_of: ArrayLike | None = None,
    initial_of: ArrayLike | None = None,
    torque_of: ArrayLike | None = None,
    every: int = 1,
    threads: int | None = None,
    lost_lanes: bool = False,
) -> Batch:
    """Simulate many robots, each under torques held over each sample.

    Lane i takes row parameter_of[i] of `parameters`, and likewise for the others, so that a population of parameter
    sets can be run over many windows of a log without copying either; without an index, lane i takes row i.

    Parameters
    ----------
    selected : Exact, Thesis or Pivoting
        From `ballbot.mechanics.parameters.selector`.
    parameters : array_like (sets, size)
        Rows from `ballbot.mechanics.parameters.pack`.
    initial : array_like (starts, 10), or (starts, 11) where the ball pivots
        [x y theta phi psi and their rates], and the ball's spin [rad/s].
    torques : array_like (inputs, samples, n)
        [N m].
    sample_time : float
        [s]
    steps : int
        Inner steps a sample.
    every : int
        Record every so many samples.
    threads : int, optional
        All cores by default. The result does not depend on it.
    lost_lanes : bool
        Whether a lane may begin with values that are not finite, as one that an earlier call has lost does. It stays
        lost, and its neighbours do not notice.

    Returns
    -------
    Batch

    Raises
    ------
    InputError
        If shapes disagree, an index names no row, or a value is not one that it can be.
    """
    n = len(selected.wheels)
    size = 11 if isinstance(selected, Pivoting) else 10
    finite = not lost_lanes
    parameters = real_array(
        parameters, ("sets", RIGID_SIZE + WHEEL_SIZE * n), "The array of parameters", finite=finite
    )
    initial = real_array(initial, ("starts", size), "The array of initial states", finite=finite)
    torques = real_array(torques, ("inputs", "samples", n), "The array of torques", finite=finite)
    h = positive_number(sample_time, "The sample time") / whole_number(steps, "The number of steps", least=1)
    every = whole_number(every, "every", least=1)
    given = (("parameter_of", parameter_of), ("initial_of", initial_of), ("torque_of", torque_of))
    lanes = max(len(parameters), len(initial), len(torques))
    for _, index in given:
        lanes = lanes if index is None else np.size(index)
    indices = [
        index_array(np.arange(lanes) if index is None else index, name, count=len(rows), length=lanes)
        for (name, index), rows in zip(given, (parameters, initial, torques), strict=True)
    ]
    out = np.empty((lanes, torques.shape[1] // every, size))
    ended = np.empty(lanes, np.int64)

    def run(first: int) -> None:
        width = min(LANES, lanes - first)
        arrays = (parameters, indices[0], initial, indices[1], torques, indices[2])
        run_block(selected, *arrays, first, width, h, steps, every, out, ended)

    over_threads(run, lanes, threads)
    return Batch(states=out, ended=ended)


_ONLY_ROW = np.zeros(1, np.int64)


def simulate_one(
    selected: Exact | Thesis | Pivoting,
    parameters: NDArray[np.float64],
    state: NDArray[np.float64],
    torques: NDArray[np.float64],
    *,
    sample_time: float,
    steps: int,
) -> NDArray[np.float64]:
    """Return one robot's state after a sample; all that is given has been checked already.

    Parameters
    ----------
    parameters : ndarray (size,)
    state : ndarray (10,), or (11,) where the ball pivots
    torques : ndarray (n,)
        [N m].
    """
    out, ended = np.empty((1, 1, len(state))), np.empty(1, np.int64)
    arrays = (parameters[None], _ONLY_ROW, state[None], _ONLY_ROW, torques[None, None], _ONLY_ROW)
    run_block(selected, *arrays, 0, 1, sample_time / steps, steps, 1, out, ended)
    return out[0, 0]


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
