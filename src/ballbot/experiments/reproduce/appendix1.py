"""Appendix I, hardware: Figure I.1."""

from __future__ import annotations

from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Check, Item
from ballbot.robot.derived import shell_wall, wheel_speed_limit

#: of the ball's rubber, by Appendix I [kg/m^3]
RUBBER = 1000.0


def figure_i_1(bench: Bench) -> Item:
    """The robot's architecture, a drawing; the appendix's numbers are held against its formulas."""
    ball, drive = bench.robot.ball, bench.robot.drive
    wall = 100.0 * shell_wall(mass=ball.mass, radius=ball.radius, density=RUBBER)
    limit = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )
    return Item(
        name="Figure I.1",
        title="The robot's architecture",
        thesis="The thesis draws controller, motor drivers, motors, wheels, encoders and IMU; it computes a "
        "wall of 2.5 cm for the ball and 27.59 rad/s for the wheels.",
        ours=f"Ours is the same drawing with the numbers of the preset {bench.robot.name}; its formulas give "
        f"{wall:.2f} cm and {limit:.2f} rad/s.",
        checks=(
            Check(
                claim="the wall is 2.5 cm",
                quantity="by mass, radius and density",
                value=wall,
                unit="cm",
                lowest=2.45,
                highest=2.55,
            ),
            Check(
                claim="the wheels' speed limit is 27.59 rad/s",
                quantity="by supply, motor and gear",
                value=limit,
                unit="rad/s",
                lowest=27.585,
                highest=27.595,
            ),
        ),
    )
