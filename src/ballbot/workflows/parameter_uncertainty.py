"""What the standard deviations in a robot's file mean for its fastest pole and for predictions: Monte Carlo.

The fastest of two poles that lie together, as those of a symmetric robot's two leans do, is no smooth function of the
parameters, and the delta method halves what moves one of the two. So robots are drawn. The sources of the variance
come from linear propagation to the mean of the unstable poles, which is smooth.

For predictions, each robot drawn predicts the same windows from the same states under the same torques, all in one
batch. The band shows what the parameters alone leave open; noise, initial states and model errors come on top.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.windows import cut_windows
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.engine.run import simulate_lanes
from ballbot.mechanics.friction import wheel_law
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import pack, selector
from ballbot.results import left_out, reported
from ballbot.robot import Robot
from ballbot.robot.variations import draw_robots, propagate

#: relative error of a standard deviation from so many draws: 1 / sqrt(2 N), 2.5 %
POLE_DRAWS = 800


@dataclass(frozen=True, kw_only=True)
class PoleSpread:
    """The fastest unstable pole [rad/s] over robots as they may be."""

    standard_deviation: float
    interval_95: tuple[float, float]  #: 2.5 % of the draws are below, 2.5 % above
    draws: int
    variance_shares: Mapping[str, float]  #: by parameter, the largest first


def pole_spread(robot: Robot, *, draws: int = POLE_DRAWS, seed: int = 0) -> PoleSpread:
    """Return what a robot's standard deviations make of its fastest pole about upright, exact model.

    Raises
    ------
    InputError
        If the standard deviations are too large to be a robot's.
    """
    fastest = [float(_growths(one).max()) for one in draw_robots(robot, draws, seed=seed)]
    lower, upper = np.quantile(fastest, [0.025, 0.975])
    mean = propagate(robot, _mean_growth)
    return PoleSpread(
        standard_deviation=float(np.std(fastest, ddof=1)),
        interval_95=(float(lower), float(upper)),
        draws=draws,
        variance_shares=dict(mean.largest(len(mean.parts))),
    )


def _growths(robot: Robot) -> NDArray[np.float64]:
    return np.asarray(Model(robot).linearize().poles().real, dtype=np.float64)


def _mean_growth(robot: Robot) -> NDArray[np.float64]:
    growths = _growths(robot)
    return np.array([growths[growths > 0.0].mean()])


#: longest inner step [s]
BAND_STEP = 1e-3
#: windows simulated at most, spread evenly over the log
MAX_WINDOWS = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionBand:
    """Predictions of w windows of m samples by robots as they may be."""

    t: NDArray[np.float64] = field(metadata=left_out)  #: (m,) [s] after a window's start
    starts: NDArray[np.float64] = field(metadata=left_out)  #: (w,) the log's t at each window's start [s]
    measured: NDArray[np.float64] = field(metadata=left_out)  #: (w, m, 10)
    nominal: NDArray[np.float64] = field(metadata=left_out)  #: (w, m, 10), by the file's values
    deviation: NDArray[np.float64] = field(
        metadata=left_out
    )  #: (w, m, 10), standard deviation over the draws
    lower: NDArray[np.float64] = field(metadata=left_out)  #: (w, m, 10), 2.5 % of the draws are below
    upper: NDArray[np.float64] = field(metadata=left_out)  #: (w, m, 10), 2.5 % of the draws are above

    @reported
    def windows(self) -> int:
        """Number of windows."""
        return len(self.starts)

    @reported
    def horizon(self) -> float:
        """Length of a window [s]."""
        return float(self.t[-1])

    @reported
    def standard_deviation_at_end(self) -> dict[str, float]:
        """Root mean square over the windows of each state's standard deviation at the window's end."""
        return _by_state(np.sqrt((self.deviation[:, -1] ** 2).mean(axis=0)))

    @reported
    def rmse_at_end(self) -> dict[str, float]:
        """Root mean square over the windows of each state's error at the window's end."""
        return _by_state(np.sqrt(((self.nominal - self.measured)[:, -1] ** 2).mean(axis=0)))


def prediction_band(
    robot: Robot,
    log: Log,
    *,
    window: float = 0.25,
    draws: int = 200,
    seed: int = 0,
    threads: int | None = None,
) -> PredictionBand:
    """Predict windows of a log by many robots drawn from the standard deviations.

    Parameters
    ----------
    robot : Robot
        With standard deviations.
    log : Log
        With the ten states and the torques.
    window : float
        [s]
    draws : int
        Robots drawn.
    seed : int
    threads : int, optional
        All cores by default; the result does not depend on it.

    Raises
    ------
    InputError
        If no parameter has a standard deviation, fewer than two robots are asked for, or the log has no window.
    """
    if not any(np.any(np.asarray(one) > 0.0) for one in robot.standard_deviations.values()):
        raise InputError(
            f"No value of {robot.name} has a standard deviation; add standard_deviation to some values in "
            "its file."
        )
    if draws < 2:
        raise InputError(f"The number of draws is {draws}; it must be 2 or more, such as 200.")
    windows = cut_windows([log], wheel_count=robot.wheel_count, duration=window)
    if not len(windows):
        raise InputError(
            f"The log has no {window:g} s without a gap, a missing value or a fall; give a longer log."
        )
    count = min(MAX_WINDOWS, len(windows))
    windows = windows.take(np.linspace(0, len(windows) - 1, count).astype(np.int64))
    robots = (robot, *draw_robots(robot, draws, seed=seed))
    law = wheel_law(*(one.friction for one in robots))
    rows = [pack(one, "exact", law=law) for one in robots]
    lanes = np.arange(len(rows) * count)
    states = simulate_lanes(
        selector("exact", robot.wheel_count, law=law),
        parameters=np.array(rows),
        initial=windows.initial,
        torques=windows.torques,
        sample_time=windows.sample_time,
        steps=max(1, int(np.ceil(windows.sample_time / BAND_STEP - 1e-9))),
        parameter_of=lanes // count,
        initial_of=lanes % count,
        torque_of=lanes % count,
        threads=threads,
    ).states.reshape(len(rows), count, windows.samples, 10)
    lower, upper = np.quantile(states[1:], [0.025, 0.975], axis=0)
    return PredictionBand(
        t=windows.sample_time * np.arange(1.0, windows.samples + 1.0),
        starts=np.array([span.start for span in windows.spans]),
        measured=windows.measured,
        nominal=states[0],
        deviation=states[1:].std(axis=0, ddof=1),
        lower=lower,
        upper=upper,
    )


def _by_state(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))
