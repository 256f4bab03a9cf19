"""Predictions of windows by many sets of friction parameters in one batched call, and their errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.windows import Windows
from ballbot.mechanics.engine import simulate_lanes
from ballbot.mechanics.parameters import Formulation, friction_places, pack, selector
from ballbot.robot import Robot

#: windows simulated in one call, which bounds the memory and fixes the order of every sum
CHUNK = 256


@dataclass(frozen=True, kw_only=True)
class Predictor:
    """A robot whose friction varies.

    Parameters
    ----------
    robot : Robot
        Its friction is not used.
    formulation : {"exact", "thesis"}
    step : float
        Longest inner step [s].
    threads : int, optional
        All cores by default; the results do not depend on it.
    """

    robot: Robot
    formulation: Formulation
    step: float
    threads: int | None = None

    def residuals(
        self, friction: NDArray[np.float64], windows: Windows, *, every: int
    ) -> NDArray[np.float64]:
        """Return predicted minus measured states (sets, w, m // every, 10), after every so many samples.

        Parameters
        ----------
        friction : ndarray (sets, p)
            In SI units, in the order of `ballbot.identification.coordinates`.
        """
        sets, count = len(friction), len(windows)
        window_of = np.tile(np.arange(count), sets)
        batch = simulate_lanes(
            selector(self.formulation, self.robot.wheel_count),
            parameters=self._packed(friction),
            initial=windows.initial,
            torques=windows.torques,
            sample_time=windows.sample_time,
            steps=max(1, int(np.ceil(windows.sample_time / self.step - 1e-9))),
            parameter_of=np.repeat(np.arange(sets), count),
            initial_of=window_of,
            torque_of=window_of,
            every=every,
            threads=self.threads,
        )
        return batch.states.reshape(sets, count, -1, 10) - windows.measured[:, every - 1 :: every]

    def square_sums(
        self, friction: NDArray[np.float64], windows: Windows, *, every: int
    ) -> NDArray[np.float64]:
        """Return the residuals' sums of squares over windows and time, (sets, 10)."""
        sums = np.zeros((len(friction), 10))
        for chunk in chunks(windows):
            sums += (self.residuals(friction, chunk, every=every) ** 2).sum(axis=(1, 2))
        return sums

    def _packed(self, friction: NDArray[np.float64]) -> NDArray[np.float64]:
        robot = self.robot
        rows = np.repeat(pack(robot, self.formulation)[None], len(friction), axis=0)
        values = friction.copy()
        values[:, -3] = 1.0 / friction[:, -3]
        values[:, -1] = (robot.ball.mass + robot.body.mass) * robot.gravity * friction[:, -1]
        rows[:, friction_places(robot.wheel_count)] = values
        return rows


def chunks(windows: Windows) -> Iterator[Windows]:
    """Yield the windows `CHUNK` at a time."""
    for first in range(0, len(windows), CHUNK):
        yield windows.take(np.arange(first, min(first + CHUNK, len(windows))))


def frictionless(wheel_count: int) -> NDArray[np.float64]:
    """Return the parameters (1, p) of a robot without friction; v_s and delta are then without effect."""
    return np.concatenate([np.zeros(3 * wheel_count), [1.0, 1.0, 0.0]])[None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Cost:
    """What identification makes small: the mean over states of ln(error / error without friction).

    With squares summed over windows and time, its gradient is that of least squares in which each state weighs
    one over its residual's variance, so that no weights have to be chosen; exp(cost) is the geometric mean
    of the ten ratios. Below the resolution of the simulation, 1e-6 of the error without friction, it is level.
    """

    reference: NDArray[np.float64]  #: (10,), sums of squares without friction on the same windows

    def __call__(self, square_sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cost (sets,) of sums of squares (sets, 10), infinite where a prediction has no value."""
        least = 1e-12 * self.reference + np.finfo(float).tiny
        cost = 0.5 * np.log((square_sums + least) / (self.reference + least)).mean(axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)
