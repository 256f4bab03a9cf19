"""Friction of the same robot by the thesis's three stages: what a driveline has, and what predicts best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballbot.identification.driveline import fit_driveline, sweeps_of
from ballbot.identification.upside_down import identify_upside_down
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Friction, Robot
from campaigns.identified_errors import identified, log_of
from campaigns.section import Section

SPEEDS = (0.2, 0.5, 1.0, 2.0, 5.0)  # [rad/s]


def driveline_friction() -> Friction:
    """Return the friction of the three drivelines, wheels free; v_s and delta are the three's means."""
    robot = Robot.load("alten")
    fits = [fit_driveline(sweep) for sweep in sweeps_of(robot, log_of("driveline_sweep"))]
    b, c, s, v_s, delta = np.array([fit.values for fit in fits]).T
    return Friction(
        viscous=tuple(b.tolist()),
        coulomb=tuple(c.tolist()),
        stribeck=tuple(s.tolist()),
        stribeck_speed=float(v_s.mean()),
        stribeck_exponent=float(delta.mean()),
        rolling=0.0,
    )


def campaign() -> Section:
    """Identify by all three stages and return the section of docs/generated/evidence.md."""
    upside_down = identify_upside_down(Robot.load("alten"), log_of("upside_down")).robot.friction
    stages = {
        "driveline, wheel free": driveline_friction(),
        "upside down, ball on the wheels": replace(upside_down, rolling=0.0),
        "balancing": identified()[0].robot.friction,
    }
    rows = []
    for name, friction in stages.items():
        torque = wheel_friction(np.repeat(np.array(SPEEDS)[:, None], 3, axis=1), friction).mean(axis=1)
        parts = [np.mean(values) for values in (friction.viscous, friction.coulomb, friction.stribeck)]
        shared = [friction.stribeck_speed, friction.stribeck_exponent]
        rows.append([name, *(f"{value:.3f}" for value in [*parts, *shared, *torque])])
    return Section(
        title="Friction by the three stages",
        before="Means over the wheels; the last columns are the friction torque [N m] at that wheel speed [rad/s].",
        columns=["stage", "b", "c", "s", "v_s", "delta", *(f"at {speed:g}" for speed in SPEEDS)],
        rows=rows,
        after="The driveline's is what motor and gear resist with. Balancing, the wheels also carry the robot on the"
        " ball: what slips and rolls between rollers, ball and floor grows with speed and, in a model that rolls"
        " without slip, has no place but b; so b is what predicts best over a quarter of a second at balancing's"
        " speeds of a few rad/s, not what a wheel has that spins freely at twenty. Compensate and predict with the"
        " balancing robot's; judge motors and gears by the driveline's.",
    )
