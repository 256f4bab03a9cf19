"""The page on published models: the sources' parts, the robots with published parameters only, and all presets.

Of ROB 311 and CMU's ballbot only parameters are published. CMU's planar equations are public (alpha, beta, gamma
below); with massless wheels they must be ours.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.files import write_text
from ballbot.mechanics.model import Model
from ballbot.progress import ProgressCallback, ignore_progress
from ballbot.robot import Friction, Robot
from ballbot.robot.derived import reflected_rotor_inertia, solid_sphere_inertia, thin_shell_inertia
from campaigns.published import alten, kugle, rezero
from campaigns.published.printed import unstable_poles
from campaigns.reproduce import markdown_table


def planar_pole(robot: Robot) -> float:
    """Return the unstable pole [rad/s] of CMU's planar equations: ball and body, wheels without inertia.

    With the ball's angle relative to the body first and the lean second,

        M = [[alpha, alpha + beta], [alpha + beta, alpha + gamma + 2 beta]],   gravity on the lean m_r g l
        alpha = j_b + (m_b + m_r) r_b^2,   beta = m_r l r_b,   gamma = J_com + m_r l^2
    """
    ball, body = robot.ball, robot.body
    alpha = ball.inertia + (ball.mass + body.mass) * ball.radius**2
    beta = body.mass * body.center_of_mass * ball.radius
    gamma = float(body.inertia_about_ball_center()[0, 0])
    M = np.array([[alpha, alpha + beta], [alpha + beta, alpha + gamma + 2.0 * beta]])
    tipping = body.mass * robot.gravity * body.center_of_mass
    return float(np.sqrt(np.linalg.inv(M)[1, 1] * tipping))


def without_wheel_inertia(robot: Robot) -> Robot:
    """Return the robot with wheels, rotors and gears that weigh nothing, and without friction."""
    return robot.replace(
        wheels=replace(robot.wheels, inertia=0.0),
        drive=replace(robot.drive, motor_inertia=0.0, gear_inertia=0.0),
        friction=Friction.none(robot.wheel_count),
    )


def parameters_section(rob311: Robot, cmu: Robot) -> str:
    """Return the part of the page on robots without printed matrices, computed."""
    ours = unstable_poles(Model(without_wheel_inertia(cmu)).linearize())[0]
    ball, wheels = rob311.ball, rob311.wheels
    solid = solid_sphere_inertia(mass=ball.mass, radius=ball.radius)
    shell = thin_shell_inertia(mass=ball.mass, radius=ball.radius)
    return f"""\
## ROB 311 (University of Michigan) and CMU's ballbot

Only parameters are published; presets `rob311` and `cmu`.

**ROB 311.** The ball's inertia, {ball.inertia:g} kg m^2, is a solid ball's ({solid:.4f}); a basketball is a shell, at
most {shell:.4f}. The wheel's radius is {wheels.radius:g} m; one class script has .0048, another .096, the diameter. The
wheel's inertia, {wheels.inertia:g} kg m^2, is what the diameter gives for the radius: half of 0.29 kg times
(0.096 m)^2 is {0.5 * 0.29 * 0.096**2:.5f}.

**CMU.** The inertia {cmu.body.inertia[0]:g} kg m^2 is about the centre of mass, and the planar equations add m_r l^2
once: right. They give an unstable pole of {planar_pole(cmu):.4f} rad/s, and our equations, with wheels that weigh
nothing, {ours:.4f}. The rollers at the ball's equator are four omniwheels here, of assumed sizes.

The NXT ballbot is driven by two wheels, which no preset can have: a robot has three or four.
"""


def presets_section() -> str:
    """Return the table of all presets, computed."""
    rows = []
    for name in Robot.presets():
        robot = Robot.load(name)
        fast, slow = unstable_poles(
            Model(robot.replace(friction=Friction.none(robot.wheel_count))).linearize()
        )
        drive = robot.drive
        rotor = reflected_rotor_inertia(
            gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
        )
        rows.append(
            [
                name,
                str(robot.wheel_count),
                f"{robot.ball.mass:g} + {robot.body.mass:g}",
                f"{robot.body.center_of_mass:g}",
                f"{robot.ball.radius / robot.wheels.radius:.3f}",
                f"{robot.wheels.inertia:g} + {rotor:.2g}",
                f"{fast:.3f}, {slow:.3f}",
            ]
        )
    headings = [
        "preset",
        "wheels",
        "ball + body [kg]",
        "l [m]",
        "r_b/r_w",
        "wheel + rotor [kg m^2]",
        "falls with [rad/s]",
    ]
    return "## All presets, by the exact equations\n\n" + markdown_table(headings, rows) + "\n"


COMMAND = "python -m campaigns.published.page"

_HEAD = f"""\
# Published models: what they print, what they should print, and why

Computed by `{COMMAND}`; nothing on this page is written by hand but the words.

Each table has what the source *prints*; what our equations give with the source's own convention or mistake switched on
(*reproduced*); and what is *right*, by the [exact equations](../mechanics.md). A number "comes out to its last digit"
where the reproduced one rounds to the printed one. Items are the thesis's
[misprints and mistakes](reproduce.md#misprints-and-mistakes).
"""


def published_page(*, progress: ProgressCallback = ignore_progress) -> str:
    """Return the whole page in Markdown; about a minute, most of it to derive the thesis's mixtures.

    Parameters
    ----------
    progress : callable, optional
        Called with the progress.
    """
    load = Robot.load
    parts = [
        _HEAD,
        alten.section(load("alten"), progress=progress),
        kugle.section(load("kugle")),
        rezero.section(load("rezero")),
        parameters_section(load("rob311"), load("cmu")),
        presets_section(),
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    write_text(Path(__file__).parents[2] / "docs" / "generated" / "published_models.md", published_page())
