"""Figure I.1: the robot's architecture."""

from __future__ import annotations

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.reproduce.blocks import Arrow, Block, Diagram, blocks_figure


def figure_i_1(bench: Bench) -> Figure:
    """Return the architecture with the preset's numbers."""
    robot, ball = bench.robot, bench.robot.ball
    drive, sensors, n = robot.drive, robot.sensors, robot.wheel_count
    diameter = 2e3 * robot.wheels.radius
    return blocks_figure(
        Diagram(
            size=(7.4, 2.9),
            blocks=(
                Block(text="IMU MTi-3 AHRS\nlean, heading, rates", at=(0.11, 0.90), size=(0.20, 0.17)),
                Block(
                    text=f"controller STM32F303\n{1.0 / sensors.sample_time:g} Hz",
                    at=(0.11, 0.50),
                    size=(0.20, 0.26),
                ),
                Block(text=f"batteries\n{drive.supply_voltage:g} V", at=(0.38, 0.90), size=(0.16, 0.17)),
                Block(text=f"{n} drivers\nESCON 36/3 EC", at=(0.38, 0.50), size=(0.16, 0.26)),
                Block(
                    text=f"{n} motors EC-i 40\ngears {drive.gear_ratio:g} : 1",
                    at=(0.65, 0.50),
                    size=(0.18, 0.26),
                ),
                Block(text=f"{n} omni-wheels\n{diameter:g} mm", at=(0.90, 0.50), size=(0.17, 0.26)),
                Block(
                    text=f"{n} encoders HEDL 5540\n{sensors.encoder_counts} counts a turn",
                    at=(0.60, 0.12),
                    size=(0.26, 0.20),
                ),
                Block(
                    text=f"ball\n{ball.mass:g} kg, {200.0 * ball.radius:g} cm",
                    at=(0.90, 0.12),
                    size=(0.17, 0.20),
                ),
            ),
            arrows=(
                Arrow(path=((0.11, 0.815), (0.11, 0.63))),
                Arrow(path=((0.21, 0.50), (0.30, 0.50)), label="torque"),
                Arrow(path=((0.38, 0.815), (0.38, 0.63))),
                Arrow(path=((0.46, 0.50), (0.56, 0.50)), label="current"),
                Arrow(path=((0.74, 0.50), (0.815, 0.50))),
                Arrow(path=((0.90, 0.37), (0.90, 0.22)), both_ways=True),
                Arrow(path=((0.65, 0.37), (0.65, 0.22))),
                Arrow(path=((0.47, 0.12), (0.11, 0.12), (0.11, 0.37))),
            ),
        )
    )
