"""Accelerations with friction of known signs at many states, from the very functions that the engine inlines."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ballbot.mechanics.engine.compiled import FAST
from ballbot.mechanics.engine.lanes import LANES, ROWS, TORQUE, load, put
from ballbot.mechanics.engine.run import load_state, load_torques, start_lane
from ballbot.mechanics.model import Model
from ballbot.simulation.model_plant import moving


@njit(error_model="numpy", fastmath=FAST)
def _fill(selected, row, states, torques, out):
    work = np.zeros(ROWS * LANES)
    for i in range(len(row)):
        put(work, i, 0, row[i])
    P = load(selected, work, 0)
    for lane in range(len(states)):
        start_lane(selected, work, 0, states[lane], 0.0)
        for axis in range(3):
            put(work, TORQUE + axis, 0, torques[lane, axis])
        state = load_state(selected, work, 0)
        state = state[:7] + (states[lane, 7], states[lane, 8], states[lane, 9])  # noqa: RUF005 (Numba adds tuples)
        _, _, _, _, _, v_dot, w_dot = moving(selected, P, state, load_torques(selected, work, 0))
        for i in range(2):
            out[lane, i] = v_dot[i]
        for i in range(3):
            out[lane, 2 + i] = w_dot[i]


def accelerations(
    model: Model, states: NDArray[np.float64], torques: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (v_dot, w_dot) (lanes, 5) at states (lanes, 10) whose last three are body rates."""
    out = np.empty((len(states), 5))
    _fill(model.selected, model.packed, states, torques, out)
    return out
