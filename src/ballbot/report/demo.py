"""`ballbot demo`: a page with two recorded runs at once, and beside it what the log of the first one shows.

The friction is identified from that log while the reader looks at the runs. The law is the one that this short log can
determine, and the settings of the search are small, so that its result is there soon after a first start, in which
everything is compiled (`python -m benchmarks.first_use`); `ballbot study` takes the full ones.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.fitting.run import Run
from ballbot.identification import Identification, identify
from ballbot.identification.identify import IdentificationOptions
from ballbot.log import Log
from ballbot.log.checks import CheckedLogs
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.blocks import provenance
from ballbot.report.demo_runs import ROBOT, SOFT, robot_of_runs
from ballbot.report.identification import friction_curve, identification_report
from ballbot.report.page import render
from ballbot.robot import Robot
from ballbot.rounding import digits
from ballbot.viewer.page import ResultState

#: part of the first run that is identified [s], the law, and the settings of the search
LOG_END, LAW = 20.0, "coulomb"
OPTIONS = IdentificationOptions(
    generations=25, population=16, evolution_windows=24, gauss_newton_steps=4, most_profiles=0
)
#: speed at which the friction found is compared with the twin's [rad/s]
SPEED = 1.0


def identified(log: Log, run: Run) -> Identification:
    """Return the friction of the demo's robot from the log of its first run."""
    return identify(Robot.load(ROBOT), CheckedLogs.simulated(_part(log)), law=LAW, options=OPTIONS, run=run)


def _part(log: Log) -> Log:
    return log.without_truth().between(0.0, LOG_END)


def write_report(found: Identification, log: Log, folder: Path) -> None:
    """Write the report on the friction found in the first run's log, and results.json."""
    made = provenance(command="ballbot demo", files=[], seed=0)
    report = identification_report(found, {SOFT: _part(log)}, findings=(), selection=None, holdouts=())
    render(replace(report, made=made), folder)


def state_found(found: Identification) -> ResultState:
    """Return what the page shows of the friction found."""
    robot = found.robot
    truth = robot_of_runs().friction
    speeds = np.full(robot.wheel_count, SPEED)
    true = wheel_friction(speeds, truth)
    friction = f"friction [N\N{NO-BREAK SPACE}m] at {SPEED:g}\N{NO-BREAK SPACE}rad/s"
    rows = []
    for wheel in range(robot.wheel_count):
        value, half = (float(one[0]) for one in friction_curve(found, wheel, speeds[:1]))
        half *= 1.96
        interval = f"{digits(value - half, 2)} to {digits(value + half, 2)}"
        own = digits(float(true[wheel]), 2)
        rows.append((f"wheel {wheel + 1}", digits(value, 2), interval, own))
    return ResultState(
        heading="The friction in the first run's log",
        sentences=(
            f"Identified on this computer from the first {LOG_END:g} s of “{SOFT}”, as from a real robot's log: the "
            "true values were not used. The law is viscous and Coulomb friction, which so short a log determines. The "
            "precise controller compensates friction identified from the whole log, by the full law.",
            error_sentence(found),
        ),
        columns=(friction, "identified", "95 % interval", "true"),
        rows=tuple(rows),
        caption=f"Friction torque of each wheel at {SPEED:g} rad/s. The interval contains the variation between logs.",
    )


def error_sentence(found: Identification) -> str:
    """Return how much better the model with the friction found predicts windows that the fit did not see."""
    errors = found.held_out
    place = 0  # x
    without, with_friction = errors.rmse_without[place], errors.rmse_with[place]
    return (
        f"Over {found.window:g} s that the fit did not see, the model without friction is off by "
        f"{digits(1000.0 * float(without), 2)} mm in x, with it by {digits(1000.0 * float(with_friction), 2)} mm "
        f"(RMS of {errors.windows} windows)."
    )
