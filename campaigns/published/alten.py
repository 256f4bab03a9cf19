"""The thesis's robot ("alten"): printed geometry and poles, and what its approximations do to them."""

from __future__ import annotations

import numpy as np

from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Friction, Robot
from campaigns.published.printed import unstable_poles
from campaigns.reproduce import markdown_table

#: (V.2) T_owb and (V.3) its inverse, as printed
PRINTED_T_OWB = ((-1.2346, 0.0, 1.2346), (0.6173, -1.0692, 1.2346), (0.6173, 1.0692, 1.2346))
PRINTED_T_OBW = ((-0.5400, 0.2700, 0.2700), (0.0, -0.4676, 0.4676), (0.2700, 0.2700, 0.2700))

_FORMULATIONS: tuple[Formulation, ...] = ("thesis", "exact")
#: entries of A and B that determine the linear model of a symmetric robot with three wheels
_ENTRIES = (
    ("theta_dd/theta [1/s^2]", "A", 7, 2),
    ("y_dd/theta [m/s^2/rad]", "A", 6, 2),
    ("theta_dd/u1 [1/(kg m^2)]", "B", 7, 0),
    ("y_dd/u1 [1/(kg m)]", "B", 6, 0),
    ("psi_dd/u1 [1/(kg m^2)]", "B", 9, 0),
)


def section(robot: Robot) -> str:
    """Return the source's part of the page, computed."""
    robot = robot.replace(friction=Friction.none(robot.wheel_count))
    body, ball, wheels = robot.body, robot.ball, robot.wheels
    heading = np.divide(*(Model(robot, name).linearize().B[9, 0] for name in _FORMULATIONS))
    thesis_pole, exact_pole = (unstable_poles(Model(robot, name).linearize())[0] for name in _FORMULATIONS)
    return f"""\
## The thesis (ALTEN's ball-balancing robot)

Source: the thesis, Appendices II, III and V; preset `alten`, formulation "thesis" (Appendix II with its misprints
mended and its physics as printed) beside "exact". It prints no poles and no gains; the geometry that it prints comes
out: (V.2) and (V.3) to {geometry_difference(robot):.1g}, less than half of a last digit.

**What it does.** It makes six approximations, of which four act upright and at rest. The
body's inertia, {body.inertia[0]:.2f} kg m^2, was measured about the ball's centre and v_body moves the mass again, so
that m_r l^2 = {body.mass * body.center_of_mass**2:.3f} kg m^2 counts twice. The locked wheels, in the body's inertia
already, turn again with the wheels. Rotors and gears are left out. And the motors' counter-torque is missing, which
makes the body's torque (r_b + r_w)/r_b = {1.0 + wheels.radius / ball.radius:.3f} times too large.

**How it is switched on.** `Model(robot, formulation="thesis")`; any mixture by
`tests.support.lagrangian.equations(robot, Corrections(...))`.

{_model_table(robot)}

The printed model falls with {thesis_pole:.3f} rad/s where the robot falls with {exact_pole:.3f}, that is
{exact_pole / thesis_pole:.2f} times too slowly. Its torques turn the heading {heading:.2f} times too fast.
"""


def geometry_difference(robot: Robot) -> float:
    """Return the largest difference of our T_owb and its inverse from (V.2) and (V.3)."""
    T = transforms(robot)
    pairs = ((T.T_owb, PRINTED_T_OWB), (T.T_obw, PRINTED_T_OBW))
    return max(float(np.abs(ours - np.array(printed)).max()) for ours, printed in pairs)


def _model_table(robot: Robot) -> str:
    models = {name: Model(robot, name).linearize() for name in _FORMULATIONS}
    rows = []
    for label, matrix, row, column in _ENTRIES:
        thesis, exact = (getattr(model, matrix)[row, column] for model in models.values())
        rows.append([label, f"{thesis:.4f}", f"{exact:.4f}", f"{thesis / exact:.3f}"])
    poles = [unstable_poles(model)[0] for model in models.values()]
    rows.append(
        ["unstable pole, twice [rad/s]", *(f"{pole:.4f}" for pole in poles), f"{poles[0] / poles[1]:.3f}"]
    )
    return markdown_table(["", "thesis", "exact", "thesis/exact"], rows)
