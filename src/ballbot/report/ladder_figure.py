"""The ladder of friction laws as a figure: each law's error on windows held out, and what it gains."""

from __future__ import annotations

from matplotlib.figure import Figure

from ballbot.identification.laws import Candidate, ModelSelection
from ballbot.report.style import BLUE, INK, MUTED


def ladder_figure(ladder: ModelSelection) -> Figure:
    """Draw, for each law, its error over that without friction and its gain with the 95 % interval."""
    figure = Figure(figsize=(7.4, 0.75 + 0.36 * len(ladder.rungs)), layout="constrained")
    errors, gains = figure.subplots(1, 2, sharey=True, width_ratios=[1.0, 1.4])
    for place, rung in enumerate(ladder.rungs):
        color = BLUE if rung.taken else MUTED
        errors.barh(place, rung.error, height=0.55, color=color, alpha=1.0 if rung is ladder.best else 0.6)
        errors.text(rung.error, place, f" {rung.error:.3f}", va="center", color=INK, fontsize=7.5)
        gain = rung.gain
        gains.plot([100 * gain.lower, 100 * gain.upper], [place, place], color=color, linewidth=1.6)
        gains.plot(100 * gain.share, place, marker="o" if rung.taken else "x", color=color, markersize=5)
        gains.text(100 * gain.upper, place, f"  {_words(rung)}", va="center", color=INK, fontsize=7.5)
    errors.set_yticks(range(len(ladder.rungs)), [rung.law.name for rung in ladder.rungs])
    errors.invert_yaxis()
    errors.set_xlim(0.0, 1.25 * max(rung.error for rung in ladder.rungs))
    errors.set_title("error relative to no friction")
    gains.axvline(0.0, color=INK, linewidth=0.8)
    gains.set_xscale("symlog", linthresh=1.0)
    lowest = min(0.0, *(100 * rung.gain.lower for rung in ladder.rungs))
    gains.set_xlim(min(-2.0, 1.5 * lowest), 5e3)  # room for the words beside a gain near 100 %
    ticks = [tick for tick in (-100, -10, -1, 0, 1, 10, 100) if tick >= 1.5 * lowest]
    gains.set_xticks(ticks, [str(tick) for tick in ticks], minor=False)
    gains.minorticks_off()
    gains.set_title("gain in error, 95 % interval [%]")
    return figure


def _words(rung: Candidate) -> str:
    return f"{'taken' if rung.taken else 'not taken'}, over {rung.law.within or 'no friction'}"
