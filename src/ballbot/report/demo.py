"""The two recorded runs of `ballbot demo`, and the friction identified from the log of the first.

The twin's nominal robot goes around a square twice: under the soft gain of the thesis's kind, and under the precise
controller for the friction that was identified from the first run. `python -m campaigns.demo_runs` records them again.
Each is a log of a robot's measurements and the true pose, rounded so that it stays small.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.fitting.run import Run
from ballbot.log import Log
from ballbot.log.columns import POSITION_NAMES, TRUE_PREFIX
from ballbot.log.pose import with_odometry
from ballbot.report.blocks import Result, Sheet, provenance, section
from ballbot.robot import Robot
from ballbot.rounding import digits, interval
from ballbot.twin.scenario import Scenario

ROBOT = "alten"
SOFT, PRECISE = "Soft gain, as in the thesis", "Precise controller"
#: the file of each run, in the order in which they are shown
FILES: Mapping[str, Path] = {
    run: Path(__file__).with_name(name)
    for run, name in ((SOFT, "demo_soft.mat"), (PRECISE, "demo_precise.mat"))
}


def robot_of_runs() -> Robot:
    """Return the robot of the runs, with the twin's friction."""
    robot = Robot.load(ROBOT)
    return robot.replace(friction=Scenario.nominal(robot).friction)


def read_runs() -> dict[str, Log]:
    """Return the runs that ship with Ballbot: what a robot logs, the position by odometry, and the true states.

    The true rates are derivatives of the true pose.
    """
    robot, runs = Robot.load(ROBOT), {}
    for run, path in FILES.items():
        log = Log.read(path)
        true = [f"{TRUE_PREFIX}{name}" for name in POSITION_NAMES]
        rates = {f"{name}_dot": np.gradient(log[name], log.sample_time) for name in true}
        runs[run] = with_odometry(log.with_columns(rates), robot)
    return runs


def friction_report(log: Log, run: Run) -> Result:
    """Identify the friction from the first 20 s of the first run's log, and return the page.

    The law is one that so short a log can determine, and the search is small, so that the result comes soon even after
    a first start, which compiles everything; `ballbot study` searches fully.
    """
    # imported late: they compile, and the replay is shown first
    from ballbot.identification import identify
    from ballbot.identification.identify import IdentificationOptions
    from ballbot.log.checks import CheckedLogs
    from ballbot.mechanics.friction import wheel_friction
    from ballbot.report.identification import friction_curve, identification_report

    part = log.without_truth().between(0.0, 20.0)
    options = IdentificationOptions(search_windows=24, most_steps=4, most_profiles=0)
    checked = CheckedLogs(logs={"": part}, findings=())  # of Ballbot itself, which needs no checks
    fit = identify(Robot.load(ROBOT), checked, law="coulomb", options=options, run=run)
    report = identification_report(fit, {SOFT: part})
    speeds = np.ones(fit.robot.wheel_count)  # [rad/s]
    rows = []
    for wheel, true in enumerate(wheel_friction(speeds, robot_of_runs().friction)):
        value, error = (float(curve[0]) for curve in friction_curve(fit, wheel, speeds[:1]))
        ends = interval(value - 1.96 * error, value + 1.96 * error, lambda end: digits(end, 2))
        rows.append((f"wheel {wheel + 1}", digits(value, 2), ends, digits(float(true), 2)))
    sheet = Sheet(
        ("friction [N m] at 1 rad/s", "identified", "95 % interval", "true"),
        rows,
        f"Identified on this computer from “{SOFT}”; the true values were not used.",
    )
    return replace(
        report,
        sections=[section("The friction found and the true one", sheet), *report.sections],
        provenance=provenance(command="ballbot demo", files=[], seed=0),
    )
