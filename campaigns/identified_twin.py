"""Identify friction from the twin's logs by all stages.

.venv/bin/python -m campaigns.evidence identified_friction drivelines

The logs are recorded on the nominal twin with its own sensors, balanced by a gain without compensation.
`ballbot record nominal --reference square --duration 32 --seed 1 --out square` makes the first of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ballbot import simulate
from ballbot.control.presets import nominal_controller
from ballbot.control.references import named_reference
from ballbot.findings import texts
from ballbot.identification import identify
from ballbot.identification.driveline import fit_driveline, robot_with_friction, sweep_estimate, sweeps_of
from ballbot.identification.upside_down import identify_upside_down
from ballbot.log import Log
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.bench import parameter_rows
from ballbot.robot import Friction, Robot
from ballbot.twin import Scenario, Twin
from ballbot.twin.bench import Bench, bench_torques, run_bench
from campaigns.section import Section

ROBOT = Robot.load("alten")
NOMINAL = Scenario.nominal(ROBOT)
#: the seed of each log of balancing, by its reference
BALANCING = {"square": 1, "hold": 2}
DURATION = 32.0  #: of each log [s]


@cache
def bench_log(bench: Bench) -> Log:
    """Return a minute of the held twin: the thesis's sweep on the stand, sines with the ball on the wheels."""
    duration = 62.83 if bench == "stand" else 60.0
    torques = bench_torques(ROBOT, NOMINAL, bench=bench, duration=duration, seed=5)
    return run_bench(ROBOT, NOMINAL, torques, bench=bench, seed=5)[0]


def _balancing_friction() -> Friction:
    """Return the friction identified from logs of balancing as the twin's own sensors have them."""
    controller = nominal_controller(ROBOT)
    logs = [
        simulate(Twin(ROBOT), controller, named_reference(name), duration=DURATION, seed=seed).without_truth()
        for name, seed in BALANCING.items()
    ]
    return identify(ROBOT, logs, seed=0).robot.friction


SPEEDS = (0.2, 0.5, 1.0, 2.0, 5.0)  # [rad/s]


def identified_friction() -> Section:
    """Identify by all three stages and return the section of docs/generated/evidence.md."""
    fits = [fit_driveline(sweep) for sweep in sweeps_of(ROBOT, bench_log("stand"))]
    upside_down = identify_upside_down(ROBOT, bench_log("upside_down")).robot.friction
    stages = {
        "driveline, wheel free": robot_with_friction(ROBOT, sweep_estimate(fits), source="stand").friction,
        "upside down, ball on the wheels": replace(upside_down, rolling=0.0),
        "balancing": _balancing_friction(),
        "set in the twin's drivelines": NOMINAL.friction,
    }
    rows = []
    for name, friction in stages.items():
        torque = wheel_friction(np.repeat(np.array(SPEEDS)[:, None], 3, axis=1), friction).mean(axis=1)
        parts = [np.mean(values) for values in (friction.viscous, friction.coulomb, friction.stribeck)]
        shared = [friction.stribeck_speed, friction.stribeck_exponent]
        rows.append([name, *(f"{value:.3f}" for value in [*parts, *shared, *torque])])
    return Section(
        title="Friction by the three stages",
        before="The nominal twin's friction from a sweep with the wheels free, from a minute upside down and from two "
        "logs of balancing, beside the friction that its drivelines are given. Means over the wheels; the last columns "
        "are the friction torque [N m] at that wheel speed [rad/s].",
        columns=["stage", "b", "c", "s", "v_s", "delta", *(f"at {speed:g}" for speed in SPEEDS)],
        rows=rows,
        after="The sweep shows the friction of motor and gear. When the robot balances, the wheels also carry its "
        "weight on the ball. Slip and losses between rollers, ball and floor grow with speed, and a model that rolls "
        "without slip can express them by b only. Predict and compensate with the friction identified from balancing; "
        "assess motors and gears by the sweep's.",
    )


def drivelines() -> Section:
    """Fit every wheel and return the section of docs/generated/evidence.md."""
    sweeps = sweeps_of(ROBOT, bench_log("stand"))
    fits = [fit_driveline(sweep) for sweep in sweeps]
    rows = [[f"{name} [{unit}]" if unit else name, *cells] for name, unit, *cells in parameter_rows(fits)]
    rows.append(["RMS speed error [rad/s]", *(f"{fit.rmse:.3f}" for fit in fits)])
    rows.append(["without friction", *(f"{fit.rmse_without:.1f}" for fit in fits)])
    return Section(
        title="Stage one: the drivelines, wheels free",
        before="The thesis's sweep on the nominal twin, wheels free: a sine of 1 N m and 62.83 s. Each "
        "wheel is fitted as an axis of known inertia, with delta = 1; in brackets 95 % intervals.",
        columns=["", *(f"wheel {fit.wheel}" for fit in fits)],
        rows=rows,
        after=" ".join(texts([one for fit in fits for one in fit.findings])),
    )
