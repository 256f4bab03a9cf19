"""The engine: many robots through many samples in one compiled call.

Robots are stepped in blocks of `LANES`, side by side, in loops that become vector instructions; a single robot is a
block of one. Each step is first tried as RK4 with known signs of friction (`smooth`), for the whole block; robots
in which a sign may have changed take the convex step (`stick_slip`) instead, one by one.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.compiled import by_types_of, compiled, inlined
from ballbot.mechanics.equations import (
    attitude,
    ball_torque,
    rates_from_angles,
    rates_of_angles,
    solve,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.friction import dry_friction
from ballbot.mechanics.parameters import LANES, Exact, Thesis, entry, load
from ballbot.mechanics.smooth import runge_kutta_step
from ballbot.mechanics.stick_slip import minimise
from ballbot.mechanics.vector import add, each_pair

#: beyond this lean, theta or phi [rad], a simulation ends: no wheel touches the ball any more
LARGEST_LEAN = 1.2

_MOST_PARAMETERS = 48  # rows kept for a robot's numbers; the state and the rest follow
STATE = _MOST_PARAMETERS
_TRIAL = STATE + 10
TORQUE = _TRIAL + 10
STEP = TORQUE + 4
_MARGIN = STEP + 1
ROWS = _MARGIN + 1


@inlined
def load_state(work, row, lane):
    return (
        entry(work, row, lane),
        entry(work, row + 1, lane),
        entry(work, row + 2, lane),
        entry(work, row + 3, lane),
        entry(work, row + 4, lane),
        entry(work, row + 5, lane),
        entry(work, row + 6, lane),
        entry(work, row + 7, lane),
        entry(work, row + 8, lane),
        entry(work, row + 9, lane),
    )


@inlined
def _store_state(work, row, lane, state):
    work[row * LANES + lane] = state[0]
    work[(row + 1) * LANES + lane] = state[1]
    work[(row + 2) * LANES + lane] = state[2]
    work[(row + 3) * LANES + lane] = state[3]
    work[(row + 4) * LANES + lane] = state[4]
    work[(row + 5) * LANES + lane] = state[5]
    work[(row + 6) * LANES + lane] = state[6]
    work[(row + 7) * LANES + lane] = state[7]
    work[(row + 8) * LANES + lane] = state[8]
    work[(row + 9) * LANES + lane] = state[9]


def load_torques(selected, work, lane) -> tuple:  # pragma: no cover (compiled form below)
    """Return the wheel torques of one lane."""
    raise NotImplementedError("compiled code only")


@by_types_of(load_torques)
def _load_torques_overload(selected, work, lane):
    if len(selected.types[0]) == 3:
        return lambda selected, work, lane: (
            entry(work, TORQUE, lane),
            entry(work, TORQUE + 1, lane),
            entry(work, TORQUE + 2, lane),
        )
    return lambda selected, work, lane: (
        entry(work, TORQUE, lane),
        entry(work, TORQUE + 1, lane),
        entry(work, TORQUE + 2, lane),
        entry(work, TORQUE + 3, lane),
    )


@inlined
def smooth_block(selected, work, width):
    """Try an RK4 step of every lane; states go to the trial rows, margins to theirs."""
    for lane in range(width):
        P = load(selected, work, lane)
        state = load_state(work, STATE, lane)
        u = load_torques(selected, work, lane)
        h = entry(work, STEP, lane)
        end, margin = runge_kutta_step(selected, P, state, u, h)
        _store_state(work, _TRIAL, lane, end)
        work[_MARGIN * LANES + lane] = margin
        # past the largest lean a lane takes steps of zero: it stays where it is
        work[STEP * LANES + lane] = h if max(abs(end[2]), abs(end[3])) <= LARGEST_LEAN else 0.0


@inlined
def _free_torque(u, wheel_and_speed):
    return u - wheel_and_speed[0].b * wheel_and_speed[1]


@inlined
def _with_speed(wheel, speed):
    return (wheel, speed)


@inlined
def _limit(wheel, speed):
    return dry_friction(wheel, speed)


@compiled
def stick_slip_step(selected, work, lane):
    """Take one step of one lane by the convex minimisation; the state goes to its trial rows.

    Velocities: nu+ of `minimise`, with M, the viscous friction and the limits at the step's start. Positions: the
    mean of old and new velocities over the step, the angles by the midpoint rule; so rest stays rest to the bit.
    """
    P = load(selected, work, lane)
    state = load_state(work, STATE, lane)
    u = load_torques(selected, work, lane)
    h = entry(work, STEP, lane)
    v, w = (state[5], state[6]), (state[7], state[8], state[9])
    a = attitude((state[2], state[3], state[4]))
    system = terms(selected, P, a, v, w)
    speeds = wheel_speeds(selected, P, a, v, w)
    F, L = wheel_force(
        selected, P, a, ball_torque(P, each_pair(_free_torque, u, each_pair(_with_speed, P.wheels, speeds)))
    )
    v_dot, w_dot = solve(system, (system.f_v[0] + F[0], system.f_v[1] + F[1]), add(system.f_w, L))

    start = np.array([v[0], v[1], w[0], w[1], w[2]])
    free = np.array(
        [
            v[0] + h * v_dot[0],
            v[1] + h * v_dot[1],
            w[0] + h * w_dot[0],
            w[1] + h * w_dot[1],
            w[2] + h * w_dot[2],
        ]
    )
    limits = np.array(each_pair(_limit, P.wheels, speeds))
    end = minimise(mass_matrix(system), free, wheel_rows(selected, P, a), limits, P.rolling, h, start)

    half = 0.5 * h
    middle = (0.5 * (w[0] + end[2]), 0.5 * (w[1] + end[3]), 0.5 * (w[2] + end[4]))
    rates = rates_of_angles(selected, a, middle)
    a = attitude((state[2] + half * rates[0], state[3] + half * rates[1], state[4] + half * rates[2]))
    rates = rates_of_angles(selected, a, middle)
    trial = (
        state[0] + half * (v[0] + end[0]),
        state[1] + half * (v[1] + end[1]),
        state[2] + h * rates[0],
        state[3] + h * rates[1],
        state[4] + h * rates[2],
        end[0],
        end[1],
        end[2],
        end[3],
        end[4],
    )
    _store_state(work, _TRIAL, lane, trial)


@inlined
def mass_matrix(system):
    """Return M (5, 5) as an array."""
    M = np.empty((5, 5))
    M[0, 0], M[1, 1], M[0, 1] = system.M_vv
    M[1, 0] = M[0, 1]
    for i in range(2):
        for j in range(3):
            M[i, 2 + j] = M[2 + j, i] = system.M_vw[i][j]
    M[2, 2], M[3, 3], M[4, 4], M[2, 3], M[2, 4], M[3, 4] = system.M_ww
    M[3, 2], M[4, 2], M[4, 3] = M[2, 3], M[2, 4], M[3, 4]
    return M


@inlined
def wheel_rows(selected, P, a):
    """Return W (n, 5): the rows that give the wheel speeds."""
    n = len(P.wheels)
    W = np.empty((n, 5))
    i = 0
    for wheel in P.wheels:
        F, L = wheel_force(selected, P, a, wheel.axle)
        W[i, 0], W[i, 1] = F
        W[i, 2], W[i, 3], W[i, 4] = L
        i += 1
    return W


@inlined
def take_steps(selected, work, width, steps):
    """Advance every lane of a block by `steps` steps with torques held."""
    for _ in range(steps):
        smooth_block(selected, work, width)
        for lane in range(width):
            if not work[_MARGIN * LANES + lane] > 0.0 and work[STEP * LANES + lane] > 0.0:
                stick_slip_step(selected, work, lane)
        for index in range(10 * LANES):
            work[STATE * LANES + index] = work[_TRIAL * LANES + index]


@inlined
def to_body_rates(selected, work, lane, angle_rates):
    """Turn a lane's Euler-angle rates into the formulation's body rates."""
    a = attitude((entry(work, STATE + 2, lane), entry(work, STATE + 3, lane), entry(work, STATE + 4, lane)))
    w = rates_from_angles(selected, a, angle_rates)
    for axis in range(3):
        work[(STATE + 7 + axis) * LANES + lane] = w[axis]


@inlined
def write_state(selected, work, lane, out):
    """Write a lane's state, with Euler-angle rates, to `out` (10,)."""
    state = load_state(work, STATE, lane)
    a = attitude((state[2], state[3], state[4]))
    rates = rates_of_angles(selected, a, (state[7], state[8], state[9]))
    for i in range(7):
        out[i] = state[i]
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
        x = initial[initial_of[first + lane]]
        for i in range(7):
            work[(STATE + i) * LANES + lane] = x[i]
        to_body_rates(selected, work, lane, (x[7], x[8], x[9]))
        work[STEP * LANES + lane] = h
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

    states: NDArray[np.float64]  #: (lanes, samples // every, 10), after each recorded sample
    ended: NDArray[np.int64]  #: (lanes,), whole samples simulated before the lean passed `LARGEST_LEAN`


def simulate_lanes(
    selected: Exact | Thesis,
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
    selected : Exact or Thesis
        From `ballbot.mechanics.parameters.selector`.
    parameters : ndarray (sets, size)
        Rows from `ballbot.mechanics.parameters.pack`.
    initial : ndarray (starts, 10)
        [x y theta phi psi and their rates].
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
    out = np.empty((lanes, torques.shape[1] // every, 10))
    ended = np.empty(lanes, np.int64)

    def run(first: int) -> None:
        width = min(LANES, lanes - first)
        arrays = (parameters, indices[0], initial, indices[1], torques, indices[2])
        run_block(selected, *arrays, first, width, sample_time / steps, steps, every, out, ended)

    blocks = range(0, lanes, LANES)
    workers = min(threads or os.cpu_count() or 1, len(blocks))
    if workers <= 1:
        for first in blocks:
            run(first)
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run, blocks))
    return Batch(states=out, ended=ended)
