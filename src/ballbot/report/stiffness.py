"""Where friction matters for a robot: the error over the stiffness of the gain, as a figure and two sentences."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot.report.blocks import Paragraph, Section, section
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.style import drawn_picture, plain_log_ticks
from ballbot.report.words import millimetres
from ballbot.rounding import digits
from ballbot.summary import counted
from ballbot.workflows.comparison import MedianEstimate
from ballbot.workflows.controller_prediction import MIN_RUNS
from ballbot.workflows.stiffness import (
    LARGEST_SENSITIVITY,
    VARIANTS,
    FrictionByStiffness,
    Stiffness,
    Variant,
)

#: of the robots, that a band holds
_BAND = (0.1, 0.9)
_PLAIN = VARIANTS[0]


def too_few(robots: int) -> str:
    """Return that these are too few for an interval of 95 %."""
    return f"{counted(robots, 'robot')} {'is' if robots == 1 else 'are'} too few to tell"


def interval_words(estimate: MedianEstimate) -> str:
    """Return a median's interval in words; of fewer than six values the range, which is no 95 % interval."""
    bounds = f"{digits(estimate.low)} to {digits(estimate.high)}"
    return f"95 % interval {bounds}" if estimate.runs >= MIN_RUNS else f"{bounds} in {estimate.runs} draws"


def stiffness_section(found: FrictionByStiffness) -> Section:
    """Return the section of a study's page."""
    runs = len(found.gains[0].trials[_PLAIN].scores)
    caption = (
        f"Peak error on {found.course.duration:g} s of the {found.course.name} over the torque that a metre of error "
        f"asks of the wheels. Lines: medians over {runs} of the simulated robots; bands: eight of ten robots; crosses "
        "at the top: gains with which a run fell. All have the Kalman filter, shaped references with feed-forward and "
        "the lean limit; with the observer, integral action."
    )
    return section(
        "Where friction matters for this robot",
        Paragraph(text=stiffness_sentences(found)),
        drawn_picture("stiffness", partial(stiffness_figure, found), caption),
    )


def stiffness_sentences(found: FrictionByStiffness) -> str:
    """Return how stiff the robot may be, and up to which stiffness compensation pays."""
    runs = len(found.gains[0].trials[_PLAIN].scores)
    if runs < MIN_RUNS:
        return f"{too_few(runs)} where friction matters."
    return f"{_stiffest_sentence(found)} {_compensation_sentence(found)}"


def _stiffest_sentence(found: FrictionByStiffness) -> str:
    one, softest, last = found.stiffest(_PLAIN), found.gains[0], found.gains[-1]
    if one is None:
        return f"Even the soft gain, {_gain(softest)}, falls or lacks margins on this robot."
    trial = one.trials[_PLAIN]
    ratio = one.position_gain / softest.position_gain
    rougher = trial.roughness.median / softest.trials[_PLAIN].roughness.median
    words = (
        f"This robot may be as stiff as {_gain(one)}, {digits(ratio, 2)} times the soft gain: without compensation and "
        f"observer the peak error is {millimetres(trial.peak.median)} mm there, and the torques "
        f"{digits(rougher, 2)} times as rough as with the soft gain"
    )
    if one is last:
        return (
            f"{words}; {'beyond, the margins end' if found.margins_end else 'stiffer gains were not tried'}."
        )
    beyond = found.gains[found.gains.index(one) + 1]
    return f"{words}; at {_gain(beyond)} {_failure(beyond)}."


def _failure(one: Stiffness) -> str:
    """Return what ends the stiffness that a robot may have."""
    trial = one.trials[_PLAIN]
    if trial.falls:
        return f"it falls in {trial.falls} of {len(trial.scores)} runs"
    if one.sensitivity > LARGEST_SENSITIVITY:
        return "the margins have ended"
    return f"the error grows again, to {millimetres(trial.peak.median)} mm"


def _compensation_sentence(found: FrictionByStiffness) -> str:
    parts = []
    for observer, words in ((False, "without the observer"), (True, "with it")):
        paying = found.pays_over(observer=observer)
        if not paying:
            parts.append(f"{words} at none of these gains")
            continue
        first, last = paying[0], paying[-1]
        ratio = last.trials[Variant(compensation=False, observer=observer)].ratio_to(
            last.trials[Variant(compensation=True, observer=observer)]
        )
        from_on = "" if first is found.gains[0] else f"from {_gain(first)} on "
        parts.append(
            f"{words} {from_on}up to {_gain(last)} (there it makes the peak error {digits(ratio.median, 2)} times "
            f"smaller, {interval_words(ratio)})"
        )
    return f"Compensating the friction pays {', and '.join(parts)}."


def _gain(one: Stiffness) -> str:
    return f"{digits(one.position_gain, 2)} N m/m"


def stiffness_figure(found: FrictionByStiffness) -> Figure:
    """Draw the peak error over the position gain, a line and a band for each variant."""
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    axes = figure.subplots()
    for variant in VARIANTS:
        _draw(axes, found, variant)
    axes.set(xscale="log", yscale="log")
    for name, gain in (("soft", found.gains[0].position_gain), ("precise", found.precise_gain)):
        axes.axvline(gain, color=MUTED, linestyle=":", linewidth=0.9)
        place = axes.get_xaxis_transform()
        axes.text(gain, 0.99, f" {name}", transform=place, va="top", color=INK, fontsize=7)
    for axis in (axes.xaxis, axes.yaxis):
        plain_log_ticks(axis)
    axes.set_xlabel("position gain [N m/m]")
    axes.set_ylabel("peak error [mm]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def _draw(axes: Axes, found: FrictionByStiffness, variant: Variant) -> None:
    color, dash = BLUE if variant.compensation else ORANGE, "-" if variant.observer else "--"
    label = (
        f"{'full' if variant.compensation else 'no'} compensation, "
        f"{'observer' if variant.observer else 'no observer'}"
    )
    gains = np.array([one.position_gain for one in found.gains])
    trials = [one.trials[variant] for one in found.gains]
    peaks = [1e3 * trial.peaks[np.isfinite(trial.peaks)] for trial in trials]
    low, middle, high = np.array(
        [np.quantile(one, (_BAND[0], 0.5, _BAND[1])) if len(one) else [np.nan] * 3 for one in peaks]
    ).T
    axes.fill_between(gains, low, high, color=color, alpha=0.13, linewidth=0)
    axes.plot(gains, middle, color=color, linestyle=dash, marker="o", markersize=3, label=label)
    fell = gains[[trial.falls > 0 for trial in trials]]
    height = 0.96 - 0.04 * VARIANTS.index(variant)
    mark = {"color": color, "marker": "x", "linestyle": "", "transform": axes.get_xaxis_transform()}
    axes.plot(fell, np.full(len(fell), height), **mark)
