"""The two recorded runs of `ballbot demo`, their file, and the friction identified from the log of the first.

The twin's nominal robot goes around a square twice: under the soft gain of the thesis's kind, and under the precise
controller for the friction that was identified from the first run. `python -m campaigns.demo_runs` records them again.

For each run the file holds a robot's measurements and the true pose, compressed: each value is the difference to the
row before, as a whole number of the steps below. A step is at most a tenth of the sensor's noise, so that rounding
changes no result; the steps of the wheels' speeds are those of the encoders.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files

import numpy as np

from ballbot.fitting.run import Run
from ballbot.log import Log
from ballbot.log.columns import POSITION_NAMES, TRUE_PREFIX, Columns, torque_names, wheel_speed_names
from ballbot.log.pose import with_odometry
from ballbot.report.blocks import Result, Sheet, provenance, section
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step
from ballbot.rounding import digits, interval
from ballbot.twin.scenario import Scenario

#: the runs, in the order in which they are shown
SOFT, PRECISE = "Soft gain, as in the thesis", "Precise controller"
ROBOT, SAMPLE_TIME = "alten", 0.005
_FILE = "demo_runs.npz"
KEYS = {SOFT: "soft", PRECISE: "precise"}

#: torque noise 0.01 N m; lean noise 1.7e-3 rad and gyro noise 1.9e-3 rad/s; references are exact
_STEPS = {
    **dict.fromkeys(torque_names(3), 1e-3),
    **dict.fromkeys(("theta", "phi", "psi"), 1e-4),
    **dict.fromkeys(("theta_dot", "phi_dot", "psi_dot"), 1e-4),
    **dict.fromkeys(("ref_x", "ref_y", "ref_psi"), 1e-3),
    **{TRUE_PREFIX + name: 1e-5 for name in POSITION_NAMES},
}


def steps() -> Mapping[str, float]:
    """Return the step of each column in the file."""
    robot = Robot.load(ROBOT)
    turn = encoder_step(encoder_counts=robot.sensors.encoder_counts, gear_ratio=robot.drive.gear_ratio)
    return {**_STEPS, **dict.fromkeys(wheel_speed_names(3), turn / SAMPLE_TIME)}


def robot_of_runs() -> Robot:
    """Return the robot of the runs, with the twin's friction."""
    robot = Robot.load(ROBOT)
    return robot.replace(friction=Scenario.nominal(robot).friction)


def read_runs() -> dict[str, Log]:
    """Return the runs that ship with Ballbot; see `runs_of`."""
    return runs_of((files("ballbot.report") / _FILE).read_bytes())


def runs_of(content: bytes) -> dict[str, Log]:
    """Return the runs of a file: what a robot logs, the position by odometry, and the true states.

    The true rates are derivatives of the true pose.
    """
    robot, runs = Robot.load(ROBOT), {}
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        for run, key in KEYS.items():
            columns: Columns = {
                name: (step * np.cumsum(arrays[f"{key} {name}"])).astype(np.float64)
                for name, step in steps().items()
            }
            columns["t"] = np.arange(len(columns["theta"]), dtype=np.float64) * SAMPLE_TIME
            for name in POSITION_NAMES:
                rate = np.gradient(columns[TRUE_PREFIX + name], SAMPLE_TIME)
                columns[f"{TRUE_PREFIX}{name}_dot"] = np.asarray(rate, dtype=np.float64)
            runs[run] = with_odometry(Log(columns), robot)
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
    checked = CheckedLogs.simulated(part)
    fit = identify(Robot.load(ROBOT), checked, law="coulomb", options=options, run=run)
    report = identification_report(fit, {SOFT: part}, findings=(), selection=None, holdouts=())
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
