"""Figures of what the one-step residuals show: their spectra, and the wheels' residual torques."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from ballbot.log import STATE_NAMES
from ballbot.report.style import BLUE, GREEN, INK, MUTED, ORANGE, STATE_SYMBOLS
from ballbot.validation.residuals import ResidualAnalysis
from ballbot.validation.residuals.play_effect import PlayEffect
from ballbot.validation.residuals.position_effect import PositionEffect
from ballbot.validation.residuals.speed_effect import SpeedEffect

#: how wheels are told apart, in grey too
_WHEELS = ((BLUE, "o"), (ORANGE, "s"), (GREEN, "^"), (INK, "D"))
#: from a peak's number to the peak
_ARROW = {"arrowstyle": "-|>", "color": INK, "lw": 0.6}


def spectrum_figure(found: ResidualAnalysis) -> Figure:
    """Return the residuals' densities against frequency, a panel for each state, the peaks marked."""
    spectrum = found.spectrum
    assert spectrum is not None
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    panels = figure.subplots(2, 5, sharex=True)
    for index, (axes, name) in enumerate(zip(panels.flat, STATE_NAMES, strict=True)):
        # at zero and at half the sampling rate a density is another thing
        frequencies, density = spectrum.frequencies[1:-1], spectrum.densities[1:-1, index]
        axes.semilogy(frequencies, density, color=BLUE, linewidth=0.9)
        for peak in (one for one in spectrum.peaks if one.state == index):
            height = np.interp(peak.frequency, frequencies, density)
            axes.annotate(f"{peak.frequency:.1f}", (peak.frequency, height), (0, 9), textcoords="offset points",
                          ha="center", fontsize=6.5, arrowprops=_ARROW)  # fmt: skip
        axes.set_title(rf"$\varepsilon$({STATE_SYMBOLS[name]})")
        axes.yaxis.set_minor_locator(NullLocator())
        axes.tick_params(labelsize=7)
        axes.margins(y=0.18)
    for axes in panels[-1]:
        axes.set_xlabel("frequency [Hz]")
    for axes in panels[:, 0]:
        axes.set_ylabel("unit²/Hz")
    return figure


def wheels_figure(found: ResidualAnalysis) -> Figure:
    """Return the wheels' residual torques against speed, travel since a reversal, and order of the wheel's position."""
    assert found.by_speed is not None
    figure = Figure(figsize=(7.4, 2.7), layout="constrained")
    by_speed, by_travel, by_position = figure.subplots(1, 3)
    _draw_by_speed(by_speed, found.by_speed)
    _draw_by_travel(by_travel, found.by_travel)
    _draw_by_position(by_position, found.by_position)
    handles, labels = by_speed.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _draw_by_speed(axes: Axes, effects: tuple[SpeedEffect, ...]) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for wheel, effect in enumerate(effects):
        color, marker = _WHEELS[wheel]
        axes.errorbar(effect.speeds, effect.torques, yerr=effect.half_widths, fmt=marker, color=color,
                      markersize=3.2, linewidth=0.9, label=f"wheel {wheel + 1}")  # fmt: skip
    axes.set_xlabel("wheel speed [rad/s]")
    axes.set_ylabel("residual torque [N m]")


def _draw_by_travel(axes: Axes, effect: PlayEffect | None) -> None:
    axes.set_xlabel("since the last reversal [deg]")
    axes.set_ylabel("along the motion [N m]")
    if effect is None:
        _say(axes, "too few reversals")
        return
    axes.axhline(0.0, color=INK, linewidth=0.8)
    travels = np.degrees(effect.travels)
    axes.errorbar(
        travels, effect.torques, yerr=effect.half_widths, fmt="o", color=INK, markersize=3.2, linewidth=0.9
    )
    axes.set_xscale("log")
    axes.set_xticks([0.1, 1.0], ["0.1", "1"])
    axes.xaxis.set_minor_locator(NullLocator())


def _draw_by_position(axes: Axes, effect: PositionEffect | None) -> None:
    axes.set_xlabel("times a turn of the wheel")
    axes.set_ylabel("amplitude [N m]")
    if effect is None:
        _say(axes, "the wheels turned too little")
        return
    for wheel, (amplitudes, significant) in enumerate(
        zip(effect.amplitudes.T, effect.significant.T, strict=True)
    ):
        color, marker = _WHEELS[wheel]
        for which, face in ((significant, color), (~significant, "white")):
            axes.plot(effect.orders[which], amplitudes[which], marker, color=color, markerfacecolor=face,
                      markersize=3.2, linestyle="none")  # fmt: skip
    axes.plot(effect.orders, effect.half_widths.mean(axis=1), color=MUTED, linestyle=":", linewidth=1.1)
    axes.set_xticks(np.arange(0, effect.orders[-1] + 1, effect.per_row))
    axes.set_ylim(bottom=0.0)


def _say(axes: Axes, words: str) -> None:
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", fontsize=8, color=MUTED)
    axes.set_xticks([])
    axes.set_yticks([])
