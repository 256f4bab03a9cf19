"""Figures of results by themselves, as `.plot()` of a log, a controller, a design or a study returns them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ballbot.control.controller import Controller
from ballbot.control.linear import robot_loop
from ballbot.control.margins import loop_margins
from ballbot.errors import InputError
from ballbot.identification.upside_down import UpsideDown
from ballbot.log import Log
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.axis import laws_figure
from ballbot.report.comparison import (
    OVERALL_HEADINGS,
    course_figure,
    league_report,
    overall_rows,
    paths_figure,
)
from ballbot.report.design import robust_verdict
from ballbot.report.driveline import curve_figure
from ballbot.report.identification import friction_figure
from ballbot.report.limits import limit_words, planes_figure
from ballbot.report.loop import bode_figure, poles_figure
from ballbot.report.run import over_time
from ballbot.report.series import IN_TURN, TimeSeries
from ballbot.report.study import summary
from ballbot.report.study_files import study_results
from ballbot.report.style import LOOKS, thinned
from ballbot.report.validation import validation_results
from ballbot.report.validation_figures import horizon_figure
from ballbot.robot.figure import robot_figure
from ballbot.summary import Summary
from ballbot.workflows.league import League

#: wheel speeds shown reach this many Stribeck speeds
_SHOWN_SPEEDS = 8.0
#: absolute value below which a sampled pole has no continuous one: it settles within a sample
_DEADBEAT = 1e-6


def log_figure(log: Log) -> Figure:
    """Return position, lean, heading, torques and wheel speeds over time, as far as the log has them."""
    series = next((one for one in over_time(log, None) if isinstance(one, TimeSeries)), None)
    if series is None:
        raise InputError("The log has no position, lean, heading, torques or wheel speeds to plot.")
    figure = Figure(figsize=(7.4, 0.6 + 1.4 * len(series.panels)), layout="constrained")
    rows = figure.subplots(len(series.panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(rows, series.panels, strict=True):
        for line in panel.lines:
            axes.plot(*thinned(log.t, line.values), label=line.name, **LOOKS[line.look])
        axes.set_ylabel(panel.label)
        axes.margins(x=0.01)
        if len(panel.lines) > 1:
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(panel.lines), borderpad=0.0)
    rows[-1].set_xlabel("time [s]")
    return figure


def controller_figure(controller: Controller) -> Figure:
    """Return the Bode diagram of the loop, or the poles of an unstable one."""
    loop = robot_loop(controller)
    try:
        return bode_figure(loop_margins(loop))
    except InputError:
        poles = np.asarray(np.linalg.eigvals(loop.closed()), dtype=np.complex128)
        slow = poles[np.abs(poles) > _DEADBEAT]
        return poles_figure(np.asarray(np.log(slow) / loop.sample_time, dtype=np.complex128))


def upside_down_figure(found: UpsideDown) -> Figure:
    """Return each wheel's friction over its speed."""
    friction, n = found.robot.friction, found.robot.wheel_count
    speed = np.geomspace(1e-3, 1.0, 160) * _SHOWN_SPEEDS * friction.stribeck_speed
    torques = wheel_friction(np.repeat(speed[:, None], n, axis=1), friction)
    figure = Figure(figsize=(7.4, 2.8), layout="constrained")
    axes = figure.subplots()
    for wheel, (torque, look) in enumerate(zip(torques.T, IN_TURN, strict=False), start=1):
        axes.plot(speed, torque, label=f"wheel {wheel}", **LOOKS[look])
    axes.set_xlabel("wheel speed [rad/s]")
    axes.set_ylabel("friction torque [N m]")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="lower right")
    return figure


def league_summary(league: League) -> Summary:
    """Return the most accurate controller, and each one's ratios to the first."""
    report = league_report(league)
    rows = [(name, tuple(cells)) for name, *cells in (OVERALL_HEADINGS, *overall_rows(league))]
    return Summary(title=report.title, rows=tuple(rows), sentences=tuple(text for _, text in report.verdict))


#: what sums a value up, by its class
SUMMARIES: Mapping[str, Callable[[Any], Summary]] = {
    "League": league_summary,
    "RobotLimits": lambda limits: Summary(
        title="The largest tilt and impulse in every direction", sentences=(limit_words(limits),)
    ),
    "RobustDesign": lambda design: Summary(
        title=f"Robust LQR gain, compared on {design.fresh} perturbed robots",
        rows=tuple(robust_verdict(design)),
    ),
    "Study": lambda study: Summary(
        title=f"Study of the robot {study.robot.name}", rows=tuple(summary(study))
    ),
}

#: what draws a value, by its class
#: what results.json holds of a result whose own package does not know it, by the name of its class
RESULTS: Mapping[str, Callable[[Any], dict[str, object]]] = {
    "Study": study_results,
    "Validation": validation_results,
}
FIGURES: Mapping[str, Callable[[Any], Figure]] = {
    "AxisIdentification": laws_figure,
    "Controller": controller_figure,
    "ControllerDesign": lambda design: bode_figure(design.loop_margins),
    "DrivelineFit": lambda fit: curve_figure([fit], float(np.nanmax(np.abs(fit.predicted), initial=1.0))),
    "Identification": friction_figure,
    "League": lambda league: course_figure(league, league.courses[0]),
    "Log": log_figure,
    "LqrDesign": lambda design: poles_figure(design.poles),
    "Margins": bode_figure,
    "Robot": robot_figure,
    "RobotLimits": lambda limits: planes_figure({"limits": limits}),
    "RobustDesign": lambda design: controller_figure(design.controller),
    "Study": lambda study: paths_figure(study.choice.runs),
    "UpsideDown": upside_down_figure,
    "Validation": lambda validation: horizon_figure(validation.horizon, validation.models.names),
}
