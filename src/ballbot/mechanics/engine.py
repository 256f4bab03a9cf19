"""The engine: many robots through many samples in one compiled call.

Robots are stepped in blocks of `LANES`, side by side, in loops that become vector instructions; a single robot is a
block of one. Each step is first tried as RK4 with known signs of friction (`smooth`), for the whole block; robots
in which a sign may have changed take the convex step instead (`proximal`, and `stick_slip` where that does not settle).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.accelerations import solve
from ballbot.mechanics.compiled import by_types_of, compiled, inlined
from ballbot.mechanics.equations import attitude, rates_from_angles, rates_of_angles
from ballbot.mechanics.free_motion import finished, free_motion
from ballbot.mechanics.parameters import LANES, Exact, Pivoting, Thesis, entry, entry_after, load
from ballbot.mechanics.proximal import convex_step
from ballbot.mechanics.rows import box_rows, in_order, mass_matrix
from ballbot.mechanics.smooth import runge_kutta_step
from ballbot.mechanics.stick_slip import minimise
from ballbot.mechanics.vector import each, each_with, loaded, written

#: beyond this lean, theta or phi [rad], a simulation ends: no wheel touches the ball any more
LARGEST_LEAN = 1.2

_MOST_PARAMETERS = 50  # rows kept for a robot's numbers; the state and the rest follow
STATE = _MOST_PARAMETERS
_TRIAL = STATE + 11
TORQUE = _TRIAL + 11
STEP = TORQUE + 4
_MARGIN = STEP + 1
ROWS = _MARGIN + 1
_FEW = 3  # so many lanes take the convex step one by one; more, and the whole block does, side by side
_TEN = (0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
_ELEVEN = (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


def load_state(selected, work, lane) -> tuple:  # pragma: no cover (compiled form below)
    """Return a lane's state: ten numbers, and the spin where the ball pivots."""
    raise NotImplementedError("compiled code only")


@by_types_of(load_state)
def _load_state(selected, work, lane):
    if selected.instance_class is Pivoting:
        return lambda selected, work, lane: loaded(entry_after, _ELEVEN, work, STATE, lane)
    return lambda selected, work, lane: loaded(entry_after, _TEN, work, STATE, lane)


def store_trial(work, lane, state) -> tuple:  # pragma: no cover
    """Store a state in a lane's trial rows."""
    raise NotImplementedError("compiled code only")


@by_types_of(store_trial)
def _store_trial(work, lane, state):
    stored = ", ".join(f"put(work, {_TRIAL + i}, lane, state[{i}])" for i in range(len(state)))
    return written("work, lane, state", f"({stored})", put=put)


@inlined
def load_trial(selected, work, lane):
    """Return a lane's trial state."""
    return loaded(entry_after, load_state(selected, work, lane), work, _TRIAL, lane)


@inlined
def put(work, row, lane, value):
    """Store a number at that row and lane."""
    work[np.uint64(row * LANES + lane)] = value
    return 0


@inlined
def load_torques(selected, work, lane):
    """Return the wheel torques of one lane."""
    return loaded(entry_after, selected.wheels, work, TORQUE, lane)


@compiled
def smooth_block(selected, work, width):
    """Try an RK4 step of every lane; states go to the trial rows, margins to theirs."""
    for lane in range(width):
        P = load(selected, work, lane)
        h = entry(work, STEP, lane)
        end, margin = runge_kutta_step(
            selected, P, load_state(selected, work, lane), load_torques(selected, work, lane), h
        )
        store_trial(work, lane, end)
        put(work, _MARGIN, lane, margin)
        # past the largest lean a lane takes steps of zero: it stays where it is
        put(work, STEP, lane, h if max(abs(end[2]), abs(end[3])) <= LARGEST_LEAN else 0.0)


@compiled
def convex_block(selected, work, first, last):
    """Take the convex step of lanes first .. last - 1 whose trial does not count; margins then say which settled."""
    for lane in range(first, last):
        P = load(selected, work, lane)
        state, u = load_state(selected, work, lane), load_torques(selected, work, lane)
        end, settled = convex_step(selected, P, state, u, entry(work, STEP, lane))
        counts = entry(work, _MARGIN, lane) > 0.0
        store_trial(
            work, lane, each_with(_chosen, each(_pair, load_trial(selected, work, lane), end), counts)
        )
        put(work, _MARGIN, lane, 1.0 if counts else settled)


@inlined
def _pair(a, b):
    return (a, b)


@inlined
def _chosen(pair, first):
    return pair[0] if first else pair[1]


@compiled
def robust_lane(selected, work, lane):
    """Take the convex step of one lane by `stick_slip.minimise`, which always finds the minimiser."""
    P = load(selected, work, lane)
    state, u = load_state(selected, work, lane), load_torques(selected, work, lane)
    h = entry(work, STEP, lane)
    free = free_motion(selected, P, state, u)
    v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
    start = in_order(free.v, free.w)
    C, limits = box_rows(selected, P, free.a), np.array(free.limits)
    end = minimise(
        mass_matrix(free.system), start + h * in_order(v_dot, w_dot), C, limits, P.rolling, h, start
    )
    store_trial(
        work, lane, finished(selected, state, free, velocity_in(free.v, end), (end[2], end[3], end[4]), h)
    )


def velocity_in(like, nu) -> tuple:  # pragma: no cover (compiled form below)
    """Return v out of velocities in the order of `rows`."""
    raise NotImplementedError("compiled code only")


@by_types_of(velocity_in)
def _velocity_in(like, nu):
    if len(like) == 2:
        return lambda like, nu: (nu[0], nu[1])
    return lambda like, nu: (nu[0], nu[1], nu[5])


@compiled
def take_steps(selected, work, width, steps):
    """Advance every lane of a block by `steps` steps with torques held."""
    for _ in range(steps):
        smooth_block(selected, work, width)
        open_lanes = 0
        for lane in range(width):
            open_lanes += 1 if _is_open(work, lane) else 0
        if open_lanes > _FEW:
            convex_block(selected, work, 0, width)
        elif open_lanes > 0:
            for lane in range(width):
                if _is_open(work, lane):
                    convex_block(selected, work, lane, lane + 1)
        if open_lanes > 0:
            for lane in range(width):
                if _is_open(work, lane):
                    robust_lane(selected, work, lane)
        for row in range(11):
            for lane in range(width):
                put(work, STATE + row, lane, entry(work, _TRIAL + row, lane))


@inlined
def _is_open(work, lane):
    """Return whether a moving lane's step still has to be taken."""
    return not work[_MARGIN * LANES + lane] > 0.0 and work[STEP * LANES + lane] > 0.0


@inlined
def start_lane(selected, work, lane, x, h):
    """Set a lane's state from x (10,), or (11,) where the ball pivots, with Euler-angle rates; and its step."""
    put(work, STEP, lane, h)
    for i in range(len(x)):
        put(work, STATE + i, lane, x[i])
    w = rates_from_angles(selected, attitude((x[2], x[3], x[4])), (x[7], x[8], x[9]))
    for axis in range(3):
        put(work, STATE + 7 + axis, lane, w[axis])


@inlined
def write_state(selected, work, lane, out):
    """Write a lane's state, with Euler-angle rates, to `out`."""
    for i in range(len(out)):
        out[i] = entry(work, STATE + i, lane)
    rates = rates_of_angles(selected, attitude((out[2], out[3], out[4])), (out[7], out[8], out[9]))
    for axis in range(3):
        out[7 + axis] = rates[axis]


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
    work = np.zeros(ROWS * LANES)
    samples, n = torques.shape[1], torques.shape[2]
    for lane in range(width):
        row = parameters[parameter_of[first + lane]]
        for i in range(len(row)):
            work[i * LANES + lane] = row[i]
        start_lane(selected, work, lane, initial[initial_of[first + lane]], h)
        ended[first + lane] = samples
    for sample in range(samples):
        for lane in range(width):
            held = torques[torque_of[first + lane], sample]
            for i in range(n):
                work[(TORQUE + i) * LANES + lane] = held[i]
        take_steps(selected, work, width, steps)
        for lane in range(width):
            if work[STEP * LANES + lane] == 0.0 and ended[first + lane] == samples:
                ended[first + lane] = sample
        if (sample + 1) % every == 0:
            for lane in range(width):
                write_state(selected, work, lane, out[first + lane, (sample + 1) // every - 1])


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
