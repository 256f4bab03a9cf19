"""The engine on an NVIDIA GPU: the equations of `smooth` and `convex`, the same source, a thread for each robot.

Needs the extra `gpu` (numba-cuda) and a CUDA device. A warp of 32 threads is a block of `LANES` robots with the layout
of the engine's work array, so that neighbouring threads load neighbouring numbers. The state stays in registers
over all samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from ballbot.arrays import positive_number, real_array, whole_number
from ballbot.errors import InputError
from ballbot.mechanics.engine.convex import convex_step
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.loading import load_parameters, under_torque
from ballbot.mechanics.engine.smooth import runge_kutta_step
from ballbot.mechanics.engine.vector import each_with
from ballbot.mechanics.equations import LARGEST_LEAN, attitude, rates_from_angles, rates_of_angles
from ballbot.mechanics.parameters import Exact, row_size

# numba.cuda decorates at run time, which its types do not say
# pyright: reportCallIssue=false, reportArgumentType=false, reportIndexIssue=false


_THREADS = 128  # a block of the GPU's; a whole number of warps


@dataclass(frozen=True, kw_only=True)
class GpuBatch:
    """The result of `simulate_on_gpu`."""

    #: (robots, 10), states after the last sample, or where the lean passed its limit
    finals: NDArray[np.float64]
    unsettled: NDArray[np.int64]  #: (robots,), steps in which five Newton rounds did not find the minimiser


@cuda.jit
def _advance(selected, parameters, states, torques, h, steps, unsettled):
    """Advance robot i from states[i] (10,) through torques (samples, n), steps of h a sample."""
    robot = cuda.grid(1)
    if robot >= states.shape[0]:
        return
    robot_alone = load_parameters(selected, parameters[robot // LANES], robot % LANES)
    x = states[robot]
    w = rates_from_angles(selected, attitude((x[2], x[3], x[4])), (x[7], x[8], x[9]))
    state = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], w[0], w[1], w[2])
    missed = 0
    for sample in range(torques.shape[0]):
        u = each_with(_at, selected.wheels, torques[sample])
        P = under_torque(selected, robot_alone, u)
        for _ in range(steps):
            end, margin = runge_kutta_step(selected, P, state, u, h)
            if not margin > 0.0:
                end, margin = convex_step(selected, P, state, u, h)
                missed += 0 if margin > 0.0 else 1
            if max(abs(state[2]), abs(state[3])) <= LARGEST_LEAN:
                state = end
    rates = rates_of_angles(
        selected, attitude((state[2], state[3], state[4])), (state[7], state[8], state[9])
    )
    for i in range(7):
        x[i] = state[i]
    for i in range(3):
        x[7 + i] = rates[i]
    unsettled[robot] = missed


@cuda.jit(device=True)
def _at(wheel, torques):
    return torques[wheel]


def simulate_on_gpu(
    selected: Exact,
    *,
    parameters: NDArray[np.float64],
    initial: NDArray[np.float64],
    torques: NDArray[np.float64],
    sample_time: float,
    steps: int,
) -> GpuBatch:
    """Simulate many three-wheeled robots under the same torques; see `ballbot.mechanics.engine.run.simulate_lanes`.

    Parameters
    ----------
    selected : Exact
        From `ballbot.mechanics.parameters.selector`, for three wheels.
    parameters : ndarray (robots, size) or (1, size)
        Rows from `ballbot.mechanics.parameters.pack`.
    initial : ndarray (robots, 10)
        [x y theta phi psi and their rates].
    torques : ndarray (samples, n)
        [N m], held over each sample.
    sample_time : float
        [s]
    steps : int
        Inner steps a sample.

    Raises
    ------
    InputError
        If there is no CUDA device, shapes disagree, or a value is not one that it can be.
    """
    n = len(selected.wheels)
    initial = real_array(initial, ("robots", 10), "The array of initial states")
    torques = real_array(torques, ("samples", n), "The array of torques")
    parameters = real_array(parameters, ("robots", row_size(selected)), "The array of parameters")
    if len(parameters) not in (1, len(initial)):
        raise InputError(
            f"There are {len(parameters)} rows of parameters for {len(initial)} robots; give one row, or one "
            "for each robot."
        )
    h = positive_number(sample_time, "The sample time") / whole_number(steps, "The number of steps", least=1)
    if not cuda.is_available():
        raise InputError(
            "No CUDA device was found; use ballbot.mechanics.engine.run.simulate_lanes on the processor instead."
        )
    robots = len(initial)
    states = cuda.to_device(initial)
    unsettled = cuda.device_array(robots, np.int64)
    blocks = -(-robots // _THREADS)
    rows = cuda.to_device(packed_in_lanes(parameters, robots))
    inputs = cuda.to_device(torques)
    _advance[blocks, _THREADS](selected, rows, states, inputs, h, steps, unsettled)
    return GpuBatch(finals=states.copy_to_host(), unsettled=unsettled.copy_to_host())


def packed_in_lanes(parameters: NDArray[np.float64], robots: int) -> NDArray[np.float64]:
    """Return rows of packed numbers as (blocks, size * LANES), number i of a block's robots side by side."""
    blocks = -(-robots // LANES)
    rows = np.broadcast_to(parameters, (robots, parameters.shape[1]))
    padded = np.concatenate([rows, np.repeat(rows[-1:], blocks * LANES - robots, axis=0)])
    size = parameters.shape[1]
    return np.ascontiguousarray(padded.reshape(blocks, LANES, size).transpose(0, 2, 1)).reshape(
        blocks, size * LANES
    )
