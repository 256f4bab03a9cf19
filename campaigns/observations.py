"""How what the thesis saw on its robot is measured on a run of the twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from ballbot import Log, Model, Robot
from ballbot.robot import Friction
from ballbot.twin import Scenario
from ballbot.twin.bench import run_bench

ROBOT = Robot.load("alten")
RUNNING_IN = 2.0  # [s] until a wheel on the bench turns evenly
POINTS = 256  # a turn


@dataclass(frozen=True, kw_only=True, eq=False)
class Ripple:
    """A wheel's speed over the wheel's own angle, in shares of its mean speed.

    Rollers that pass `per_row` times a turn make a line at that order whatever the speed.
    """

    turns: NDArray[np.float64]  #: (N,) the wheel's angle
    ripple: NDArray[np.float64]  #: (N,) speed less its mean
    order: NDArray[np.float64]  #: (M,) cycles a turn
    amplitude: NDArray[np.float64]  #: (M,) of the ripple there
    per_row: int

    @property
    def line(self) -> float:
        """Amplitude at the passing of the rollers."""
        return float(self.amplitude[np.abs(self.order - self.per_row) < 0.15].max())

    @property
    def background(self) -> float:
        """Median amplitude of what is neither the mean nor the counts' noise."""
        return float(np.median(self.amplitude[(self.order > 3) & (self.order < 40)]))


def roller_ripple(scenario: Scenario, *, seed: int) -> Ripple:
    """Return the ripple of a wheel upside down, all wheels driven alike, so that the ball turns evenly on them."""
    log = run_bench(ROBOT, scenario, np.full((6000, 3), 0.25), bench="upside_down", seed=seed).log
    even = log.t > RUNNING_IN
    angle, speed = log["wheel1"][even], log["wheel1_dot"][even]
    places = np.arange(angle[0], angle[-1], 2 * np.pi / POINTS)
    ripple = np.interp(places, angle, speed) / speed.mean() - 1.0
    amplitude = 4 / len(ripple) * np.abs(np.fft.rfft(ripple * np.hanning(len(ripple))))
    return Ripple(
        turns=(places - places[0]) / (2 * np.pi),
        ripple=ripple,
        order=np.arange(len(amplitude)) * POINTS / len(ripple),
        amplitude=amplitude,
        per_row=scenario.rollers.per_row,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Impulses:
    """A run's wheel accelerations from sample to sample."""

    t: NDArray[np.float64]  #: (N,) [s]
    acceleration: NDArray[np.float64]  #: (N, n) [rad/s^2]

    @property
    def largest(self) -> float:
        """[rad/s^2]"""
        return float(np.abs(self.acceleration).max())

    @property
    def kurtosis(self) -> float:
        """Fourth moment over a normal distribution's."""
        centred = self.acceleration - self.acceleration.mean(axis=0)
        return float(np.mean((centred / centred.std(axis=0)) ** 4) / 3.0)


def impulses(log: Log) -> Impulses:
    """Return the wheel accelerations of a run."""
    return Impulses(t=log.t[1:], acceleration=np.diff(log.wheel_speeds, axis=0) / log.sample_time)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Power of the one-step residuals of x_dot."""

    frequency: NDArray[np.float64]  #: (M,) above 8 Hz [Hz]
    power: NDArray[np.float64]  #: (M,) [m^2/s^2/Hz]

    @property
    def peak(self) -> float:
        """Where it is strongest [Hz]."""
        return float(self.frequency[np.argmax(self.power)])

    @property
    def height(self) -> float:
        """The strongest over the median."""
        return float(self.power.max() / np.median(self.power))


def residual_spectrum(log: Log, friction: Friction) -> Spectrum:
    """Return the spectrum of what the exact model with that friction cannot tell of the next sample."""
    model = Model(ROBOT.replace(friction=friction))
    residuals = [
        after[5] - model.advance(before, u, log.sample_time)[5]
        for before, after, u in zip(log.states, log.states[1:], log.torques, strict=False)
    ]
    frequency, power = welch(np.array(residuals), 1 / log.sample_time, nperseg=1024)
    band = frequency > 8.0
    return Spectrum(frequency=frequency[band], power=power[band])


@dataclass(frozen=True, kw_only=True, eq=False)
class Drift:
    """How a run's on-board state leaves the truth."""

    t: NDArray[np.float64]  #: (N,) [s]
    heading: NDArray[np.float64]  #: (N,) on-board less true [degrees]
    position: NDArray[np.float64]  #: (N,) distance of the one from the other [m]

    @property
    def rate(self) -> float:
        """Of the heading [degrees/s]."""
        return float(np.polyfit(self.t, self.heading, 1)[0])

    def largest(self, until: float) -> float:
        """Return the largest distance up to a time [s]."""
        return float(self.position[self.t <= until].max())


def drift(log: Log) -> Drift:
    """Return a run's drift."""
    truth = log.truth()
    return Drift(
        t=log.t,
        heading=np.degrees(log["psi"] - truth["psi"]),
        position=np.hypot(log["x"] - truth["x"], log["y"] - truth["y"]),
    )
