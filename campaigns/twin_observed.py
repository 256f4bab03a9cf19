"""Measure and draw on the twin what the thesis observed on its robot.

.venv/bin/python -m campaigns.evidence twin_observed

The figures are those of docs/twin.md.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import welch

from ballbot import Log, Model
from ballbot.processes import worker_pool
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.style import LineStyle
from ballbot.robot import Friction
from ballbot.twin import Scenario
from ballbot.twin.bench import run_bench
from campaigns.section import Section, write_picture
from campaigns.twin_logs import NOMINAL, ROBOT, twin_log

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
        """Median amplitude between the mean and the encoder counts' noise."""
        return float(np.median(self.amplitude[(self.order > 3) & (self.order < 40)]))


def roller_ripple(scenario: Scenario, *, seed: int) -> Ripple:
    """Return the ripple of a wheel upside down, all wheels driven alike, so that the ball turns evenly on them."""
    log, _ = run_bench(ROBOT, scenario, np.full((6000, 3), 0.25), bench="upside_down", seed=seed)
    even = log.t > RUNNING_IN
    angle, speed = log["wheel1"][even], log["wheel1_dot"][even]
    angles = np.arange(angle[0], angle[-1], 2 * np.pi / POINTS)
    ripple = np.interp(angles, angle, speed) / speed.mean() - 1.0
    amplitude = 4 / len(ripple) * np.abs(np.fft.rfft(ripple * np.hanning(len(ripple))))
    return Ripple(
        turns=(angles - angles[0]) / (2 * np.pi),
        ripple=ripple,
        order=np.arange(len(amplitude)) * POINTS / len(ripple),
        amplitude=amplitude,
        per_row=scenario.rollers.per_row,
    )


def impulses(log: Log) -> tuple[float, float]:
    """Return the largest wheel acceleration from sample to sample [rad/s^2], and its kurtosis over a normal one's."""
    acceleration = np.diff(log.wheel_speeds, axis=0) / log.sample_time
    centred = acceleration - acceleration.mean(axis=0)
    return float(np.abs(acceleration).max()), float(np.mean((centred / centred.std(axis=0)) ** 4) / 3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Power of the one-step residuals of x_dot."""

    frequency: NDArray[np.float64]  #: (M,) above 8 Hz [Hz]
    power: NDArray[np.float64]  #: (M,) [m^2/s^2/Hz]

    @property
    def peak(self) -> float:
        """Frequency of the largest power [Hz]."""
        return float(self.frequency[np.argmax(self.power)])

    @property
    def height(self) -> float:
        """Ratio of the largest power to the median."""
        return float(self.power.max() / np.median(self.power))


def residual_spectrum(log: Log, friction: Friction) -> Spectrum:
    """Return the spectrum of the one-step residuals of the exact model with that friction."""
    model = Model(ROBOT.replace(friction=friction))
    residuals = [
        after[5] - model.advance(before, u, log.sample_time)[5]
        for before, after, u in zip(log.states, log.states[1:], log.torques, strict=False)
    ]
    frequency, power = welch(np.array(residuals), 1 / log.sample_time, nperseg=1024)
    band = frequency > 8.0
    return Spectrum(frequency=frequency[band], power=power[band])


_ON: LineStyle = {"color": ORANGE, "linestyle": "-", "linewidth": 1.0}
_OFF: LineStyle = {"color": BLUE, "linestyle": "-", "linewidth": 1.0}
_TURNS = 3.0  # that are shown of a wheel's


def rollers_figure(ripples: Mapping[str, Ripple]) -> Figure:
    """Return the wheel's speed over its angle, and the orders in it, of wheels of several kinds."""
    figure = Figure(figsize=(7.4, 1.35 * len(ripples)), layout="constrained")
    panels = figure.subplots(len(ripples), 2, sharex="col", width_ratios=(3, 2), squeeze=False)
    highest = 1.15 * max(float(np.abs(ripple.ripple).max()) for ripple in ripples.values())
    for (speed, orders), (name, ripple) in zip(panels, ripples.items(), strict=True):
        shown = ripple.turns < _TURNS
        speed.plot(ripple.turns[shown], 100 * ripple.ripple[shown], color=BLUE, linewidth=0.9)
        speed.set(xlim=(0.0, _TURNS), ylim=(-100 * highest, 100 * highest))
        speed.set_title(f"{name.replace('_', ' ')}: {100 * ripple.line:.2f} % at {ripple.per_row} a turn")
        below = (ripple.order > 1.0) & (ripple.order < 30.0)
        orders.semilogy(ripple.order[below], 100 * ripple.amplitude[below], color=BLUE, linewidth=0.9)
        orders.axvline(ripple.per_row, color=ORANGE, linewidth=2.5, alpha=0.35)
        orders.set(xlim=(0.0, 30.0), ylim=(1e-3, 20.0))
    figure.supylabel("wheel speed, off its mean [%]", fontsize=8.5, color=INK)
    panels[0, 1].set_title("amplitude of each order [%]")
    panels[-1, 0].set_xlabel("turns of the wheel")
    panels[-1, 1].set_xlabel("cycles a turn (orange: the rollers)")
    return figure


def resonance_figure(on: Mapping[str, Spectrum], off: Mapping[str, Spectrum]) -> Figure:
    """Return the residuals' spectrum with the resonance switched on and off, without and with play."""
    figure = Figure(figsize=(7.4, 2.6), layout="constrained")
    panels = figure.subplots(1, len(on), sharex=True, sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, on, strict=True):
        for label, log, line in (("off", off[name], _OFF), ("on", on[name], _ON)):
            text = f"{label}: {log.height:.0f} times the median at {log.peak:.0f} Hz"
            axes.semilogy(log.frequency, log.power, label=text, **line)
        axes.axvline(on[name].peak, color=MUTED, linewidth=0.8, linestyle=":")
        axes.set_title(f"Resonance, {name}")
        axes.set_xlabel("frequency [Hz]")
        axes.legend(loc="upper right")
    low, high = panels[0].get_ylim()
    panels[0].set_ylim(low, 8.0 * high)
    panels[0].set_ylabel(r"residual of $\dot{x}$ [m$^2$/s$^2$/Hz]")
    return figure


SEEDS = range(1, 4)
WHEELS = ("nominal", "wide_rows", "single_row", "single_point")
RESONANT = Scenario.named("resonant", ROBOT)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A closed-loop run to make."""

    scenario: Scenario = NOMINAL
    seed: int = 1
    duration: float = 64.0  #: [s]


PLAY = {"1 degree of play": NOMINAL, "without play": replace(NOMINAL, backlash=0.0)}
RESONANCE = {
    "without play": (PLAY["without play"], replace(RESONANT, backlash=0.0)),
    "1 degree of play": (NOMINAL, RESONANT),
}


def closed_loop(run: Run) -> Log:
    """Run the nominal gain around the square."""
    return twin_log("square", duration=run.duration, seed=run.seed, scenario=run.scenario)


def campaign() -> Section:
    """Return each observation and its number, and draw it."""
    played = [Run(scenario=play, seed=seed) for play in PLAY.values() for seed in SEEDS]
    twisted = [Run(scenario=twist) for pair in RESONANCE.values() for twist in pair]
    wanted = list(dict.fromkeys([*played, *twisted]))
    with worker_pool(os.cpu_count()) as pool:
        logs = dict(zip(wanted, pool.map(closed_loop, wanted), strict=True))
    ripples = {
        name: [roller_ripple(Scenario.named(name, ROBOT), seed=seed) for seed in (1, 2, 3)] for name in WHEELS
    }
    kicks = {
        name: [impulses(logs[Run(scenario=play, seed=seed)]) for seed in SEEDS] for name, play in PLAY.items()
    }
    spectra = {
        name: [residual_spectrum(logs[Run(scenario=twist)], NOMINAL.friction) for twist in pair]
        for name, pair in RESONANCE.items()
    }
    off, on = ({name: pair[k] for name, pair in spectra.items()} for k in (0, 1))
    write_picture("twin_rollers", lambda: rollers_figure({name: runs[0] for name, runs in ripples.items()}))
    write_picture("twin_resonance", lambda: resonance_figure(on, off))
    return Section(
        title="What the thesis observed, on the twin",
        before=f"The nominal twin under the nominal gain around the square; 64 s and {len(SEEDS)} seeds unless stated "
        "otherwise. The figures are in [the twin](../twin.md).",
        columns=["observation", "twin"],
        rows=[*_roller_rows(ripples), *_impulse_rows(kicks), *_resonance_rows(spectra)],
        after="The thesis: bumps from the gaps between rollers (3.2), impulses from 1 degree of play (chapter 6), a "
        "resonance in the residuals (4.2). The resonance is set at 40 Hz: sampled feedback of the motors' speed lowers "
        "it; play, which is slack at first, lowers it further.",
    )


def _roller_rows(ripples: Mapping[str, list[Ripple]]) -> list[list[str]]:
    rows = []
    for name, repeats in ripples.items():
        line, background = (
            100 * np.mean([getattr(repeat, part) for repeat in repeats]) for part in ("line", "background")
        )
        text = f"{line:.2f} % of it, background {background:.3f} %"
        rows.append([f"ripple of the wheel's speed at roller passing, {name}", text])
    return rows


def _impulse_rows(kicks: Mapping[str, list[tuple[float, float]]]) -> list[list[str]]:
    rows = []
    for name, repeats in kicks.items():
        largest, kurtosis = np.mean(repeats, axis=0)
        text = f"up to {largest:.0f} rad/s^2, kurtosis {kurtosis:.1f} times a normal distribution's"
        rows.append([f"wheel acceleration from sample to sample, {name}", text])
    return rows


def _resonance_rows(spectra: Mapping[str, list[Spectrum]]) -> list[list[str]]:
    return [
        [
            f"peak of the one-step residuals of x_dot, resonance {state}, {name}",
            f"{log.height:.0f} times the median, at {log.peak:.0f} Hz",
        ]
        for name, pair in spectra.items()
        for state, log in zip(("off", "on"), pair, strict=True)
    ]
