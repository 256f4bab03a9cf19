"""Figures 4.1 to 4.3, of the first of the runs."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.log import Log
from ballbot.report.reproduce.lines import BASIC_LABELS, THESIS_EQUATIONS, Shown, states_figure
from ballbot.report.style import MEASURED, WITH_FRICTION, WITHOUT_FRICTION
from ballbot.report.validation_figures import correlation_figure, symbols

_STATES = ("x", "y", "theta", "phi", "psi", "psi_dot")


def figure_4_1(bench: Bench) -> Figure:
    """Return measured and simulated states in closed loop, over the whole run."""
    one = bench.validations[0]
    return states_figure(
        _shown({"measured": one.log.without_truth()} | one.runs), _STATES, start=0.0, end=float(one.log.t[-1])
    )


def figure_4_2(bench: Bench) -> Figure:
    """Return them in open loop, each model until its own lean is past recovery."""
    example = bench.validations[0].example
    t = example["measured"].t
    return states_figure(_shown(example), _STATES, start=float(t[0]), end=float(t[-1]))


def figure_4_3(bench: Bench) -> Figure:
    """Return the correlation matrix of residuals and torques, its significant cells framed."""
    found = bench.validations[0].correlations
    return correlation_figure(symbols(found.labels), found.matrix, marked=found.significant)


def _shown(logs: Mapping[str, Log]) -> list[Shown]:
    return [
        Shown(label="measured", log=logs["measured"], line=MEASURED),
        Shown(label="model with friction", log=logs["friction"], line=WITH_FRICTION),
        Shown(label=BASIC_LABELS["exact"], log=logs["exact"], line=WITHOUT_FRICTION),
        Shown(label=BASIC_LABELS["thesis"], log=logs["thesis"], line=THESIS_EQUATIONS),
    ]
