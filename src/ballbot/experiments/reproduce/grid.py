"""Plants whose state is rounded at every sample, so that a chaotic run is the same on every machine.

The loop is chaotic: a rolling friction larger by one part in 10^12 moves a peak error by centimetres within a minute,
and so does another processor's last digit. Rounding takes such differences away before they grow: what two machines
differ by within one sample, some 1e-9 at most, is far below the grid, so that both round to the same numbers and go on
alike. The grid itself is far below the sensors' and the motors' noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement
from ballbot.twin import Twin

#: decimals that are kept of the torques [N m]
_TORQUE = 4
#: of the twin's positions [m, rad], speeds [m/s, rad/s] and of the accelerations that its solver starts from
_POSITION, _SPEED, _WARM_START = 7, 5, 0
#: of the model's state, whose differences within a sample are smaller
_STATE = 7
#: the solver's; with MuJoCo's own, 1e-8, where it stops makes differences of 1e-5 rad/s in a roller
_TOLERANCE = 1e-12


class TwinOnGrid:
    """A `Twin` whose state and torques are rounded at every sample."""

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        twin.engine.model.opt.tolerance = _TOLERANCE

    @property
    def robot(self) -> Robot:
        """The twin's robot."""
        return self._twin.robot

    def reset(self, initial_state: ArrayLike | None, *, seed: int) -> Measurement:
        """Start again; see `Twin.reset`."""
        measured = self._twin.reset(initial_state, seed=seed)
        self._round()
        return measured

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration; see `Twin.step`."""
        measured = self._twin.step(np.round(np.asarray(torques, np.float64), _TORQUE), duration)
        self._round()
        return measured

    def _round(self) -> None:
        engine = self._twin.engine
        for values, decimals in (
            (engine.qpos, _POSITION),
            (engine.qvel, _SPEED),
            (engine.data.qacc_warmstart, _WARM_START),
        ):
            np.round(values, decimals, out=values)


class ModelOnGrid(ModelPlant):
    """A `ModelPlant` whose state and torques are rounded at every sample."""

    def __init__(self, model: Model) -> None:
        super().__init__(model)

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration; see `ModelPlant.step`."""
        measured = super().step(np.round(np.asarray(torques, np.float64), _TORQUE), duration)
        self._state = np.round(self._state, _STATE)
        return measured
