"""What `ballbot excite` prints: the limits and what was made of them, and the standard errors, by run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from ballbot.cli.output import table
from ballbot.experiments.excite import Excitation, Peaks, Trial
from ballbot.report.tables import digits

#: how a limit is shown: its unit, and by what its SI number is multiplied
_SHOWN = {"lean": ("degrees", 180.0 / np.pi), "floor": ("m", 1.0), "torque": ("N m", 1.0)}


def limits_table(result: Excitation, *, framed: bool) -> Table:
    """Return each limit with the peaks of the square and of the design, on the model and on the twin."""
    trials = result.trials
    runs = {"square": result.square.run.peaks, "designed": result.design.peaks}
    runs |= {f"{name}, twin": trial.peaks for name, trial in trials.items()}
    rows = [
        (f"{name} [{_SHOWN[name][0]}]", _shown(name, value), *(_peak(name, peaks) for peaks in runs.values()))
        for name, value in result.task.limits.to_dict().items()
    ]
    return table("Limits, and the largest values of each run", ("limit", "", *runs), rows, framed=framed)


def errors_table(result: Excitation, *, framed: bool) -> Table:
    """Return the standard errors: expected, and of identifications from the twin's logs; the worst of each last."""
    question = result.task.question
    believed = question.coordinates.physical(question.point)[question.coordinates.free]
    scaled = {"square": result.square.errors, "designed": result.design.errors}
    columns = {name: question.in_units(errors) for name, errors in scaled.items()}
    for name, trial in result.trials.items():
        scaled[f"{name}, twin"] = trial.errors
        columns[f"{name}, twin"] = _errors_in_units(trial)[question.coordinates.free]
    rows = [
        (label, digits(float(believed[i])), *(digits(float(one[i]), 2) for one in columns.values()))
        for i, label in enumerate(question.labels)
    ]
    rows.append(("worst, % of bounds", "", *(_worst(errors) for errors in scaled.values())))
    headings = ("parameter", "believed", *columns)
    return table("Standard errors: expected, and from the twin's logs", headings, rows, framed=framed)


def verdict(result: Excitation) -> list[str]:
    """Return what to know of the design, in sentences."""
    sentences = [gain_words(float(result.square.errors.max() / result.design.errors.max()))]
    if not result.trials:
        return [*sentences, "The design has not been tried on the twin."]
    trial = result.trials["designed"]
    if trial.log.ended:
        return [*sentences, f"On the twin the run ended early: {trial.log.ended}. Lower the limits."]
    exceeded = result.task.limits.exceeded(trial.peaks)
    kept = (
        f"The twin exceeded the limit on {' and '.join(exceeded)}; lower that limit"
        if exceeded
        else "The twin stayed within all limits"
    )
    return [*sentences, f"{kept}."]


def gain_words(gain: float) -> str:
    """Return what a square's worst standard error over the design's says; infinite where the square tells less."""
    if not np.isfinite(gain):
        return (
            "With a square of the same length some parameters cannot be identified; with the design all can."
        )
    if gain < 1.0:
        return (
            f"The worst expected standard error is {1.0 / gain:.1f} times a square's, so the "
            "square is more informative. Search for longer (--generations, --population)."
        )
    return f"The worst expected standard error is {gain:.1f} times smaller than a square's."


def _errors_in_units(trial: Trial) -> NDArray[np.float64]:
    return np.concatenate([np.atleast_1d(one) for one in trial.found.standard_errors.values()])


def _peak(name: str, peaks: Peaks) -> str:
    return _shown(name, peaks.to_dict()[name])


def _shown(name: str, value: float) -> str:
    return digits(value * _SHOWN[name][1])


def _worst(errors: NDArray[np.float64]) -> str:
    """Return the worst of scaled errors, and how many parameters got none where some did."""
    none = int(np.count_nonzero(~np.isfinite(errors)))
    if none == len(errors):
        return "none identified"
    text = f"{100.0 * float(errors[np.isfinite(errors)].max()):.1f}"
    return f"{text} ({none} not identified)" if none else text
