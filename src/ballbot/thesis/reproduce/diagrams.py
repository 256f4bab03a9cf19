"""The thesis's block diagrams, each in a wide form and in one for a phone: boxes and arrows as data."""

from __future__ import annotations

from ballbot.report.narrow import NARROW
from ballbot.robot import Robot
from ballbot.thesis.reproduce.drawing import Arrow, Block, Diagram


def _parts(robot: Robot) -> dict[str, str]:
    """Return the texts of the architecture's boxes, with the robot's numbers."""
    drive, sensors, n = robot.drive, robot.sensors, robot.wheel_count
    return {
        "imu": "IMU MTi-3 AHRS\nlean, heading, rates",
        "controller": f"controller STM32F303\n{1.0 / sensors.sample_time:g} Hz",
        "batteries": f"batteries\n{drive.supply_voltage:g} V",
        "drivers": f"{n} drivers\nESCON 36/3 EC",
        "motors": f"{n} motors EC-i 40\ngears {drive.gear_ratio:g} : 1",
        "wheels": f"{n} omni-wheels\n{2e3 * robot.wheels.radius:g} mm",
        "encoders": f"{n} encoders HEDL 5540\n{sensors.encoder_counts} counts a turn",
        "ball": f"ball\n{robot.ball.mass:g} kg, {200.0 * robot.ball.radius:g} cm",
    }


def architecture(robot: Robot) -> Diagram:
    """Return Figure I.1 with the robot's numbers."""
    parts = _parts(robot)
    return Diagram(
        size=(7.4, 2.9),
        blocks=(
            Block(text=parts["imu"], at=(0.11, 0.90), size=(0.20, 0.17)),
            Block(text=parts["controller"], at=(0.11, 0.50), size=(0.20, 0.26)),
            Block(text=parts["batteries"], at=(0.38, 0.90), size=(0.16, 0.17)),
            Block(text=parts["drivers"], at=(0.38, 0.50), size=(0.16, 0.26)),
            Block(text=parts["motors"], at=(0.65, 0.50), size=(0.18, 0.26)),
            Block(text=parts["wheels"], at=(0.90, 0.50), size=(0.17, 0.26)),
            Block(text=parts["encoders"], at=(0.60, 0.12), size=(0.26, 0.20)),
            Block(text=parts["ball"], at=(0.90, 0.12), size=(0.17, 0.20)),
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


def architecture_narrow(robot: Robot) -> Diagram:
    """Return it for a phone."""
    parts = _parts(robot)
    left, right = 0.26, 0.78
    return Diagram(
        size=(NARROW, 4.0),
        blocks=(
            Block(text=parts["imu"], at=(left, 0.92), size=(0.42, 0.14)),
            Block(text=parts["batteries"], at=(right, 0.92), size=(0.36, 0.14)),
            Block(text=parts["controller"], at=(left, 0.65), size=(0.42, 0.16)),
            Block(text=parts["drivers"], at=(right, 0.65), size=(0.36, 0.16)),
            Block(text=parts["encoders"], at=(left, 0.36), size=(0.46, 0.16)),
            Block(text=parts["motors"], at=(right, 0.36), size=(0.36, 0.16)),
            Block(text=parts["ball"], at=(left, 0.08), size=(0.42, 0.14)),
            Block(text=parts["wheels"], at=(right, 0.08), size=(0.36, 0.14)),
        ),
        arrows=(
            Arrow(path=((left, 0.85), (left, 0.73))),
            Arrow(path=((right, 0.85), (right, 0.73))),
            Arrow(path=((0.47, 0.65), (0.60, 0.65)), label="torque"),
            Arrow(path=((right, 0.57), (right, 0.44)), label="current"),
            Arrow(path=((0.60, 0.36), (0.49, 0.36))),
            Arrow(path=((left, 0.44), (left, 0.57))),
            Arrow(path=((right, 0.28), (right, 0.15))),
            Arrow(path=((0.60, 0.08), (0.47, 0.08)), both_ways=True),
        ),
    )


#: Figure 5.2, model-based compensation
COMPENSATION = Diagram(
    size=(7.4, 2.5),
    blocks=(
        Block(text="$r - x$", at=(0.10, 0.70), size=(0.10, 0.20)),
        Block(text="$S(\\psi)$\nheading frame", at=(0.28, 0.70), size=(0.16, 0.24)),
        Block(text="LQR\n$K$", at=(0.45, 0.70), size=(0.10, 0.24)),
        Block(text="$+$", at=(0.58, 0.70), size=(0.06, 0.20)),
        Block(text="torque\nlimit", at=(0.70, 0.70), size=(0.10, 0.24)),
        Block(text="robot", at=(0.87, 0.70), size=(0.13, 0.24)),
        Block(text="wheel speeds\n(3.9)", at=(0.80, 0.22), size=(0.17, 0.24)),
        Block(text="friction model\n(3.7), (3.8)", at=(0.58, 0.22), size=(0.17, 0.24)),
    ),
    arrows=(
        Arrow(path=((0.0, 0.70), (0.05, 0.70)), label="$r$"),
        Arrow(path=((0.15, 0.70), (0.20, 0.70))),
        Arrow(path=((0.36, 0.70), (0.40, 0.70))),
        Arrow(path=((0.50, 0.70), (0.55, 0.70))),
        Arrow(path=((0.61, 0.70), (0.65, 0.70)), label="$u$"),
        Arrow(path=((0.75, 0.70), (0.805, 0.70))),
        Arrow(path=((0.935, 0.70), (0.98, 0.70), (0.98, 0.22), (0.885, 0.22)), label="$x$"),
        Arrow(path=((0.715, 0.22), (0.665, 0.22))),
        Arrow(path=((0.58, 0.34), (0.58, 0.60))),
        Arrow(path=((0.98, 0.22), (0.98, 0.05), (0.10, 0.05), (0.10, 0.60))),
    ),
)
#: it for a phone
COMPENSATION_NARROW = Diagram(
    size=(NARROW, 3.2),
    blocks=(
        Block(text="$r - x$", at=(0.15, 0.86), size=(0.20, 0.18)),
        Block(text="$S(\\psi)$\nheading frame", at=(0.49, 0.86), size=(0.32, 0.20)),
        Block(text="LQR\n$K$", at=(0.85, 0.86), size=(0.22, 0.20)),
        Block(text="robot", at=(0.15, 0.50), size=(0.22, 0.18)),
        Block(text="torque\nlimit", at=(0.49, 0.50), size=(0.22, 0.20)),
        Block(text="$+$", at=(0.85, 0.50), size=(0.12, 0.18)),
        Block(text="wheel speeds\n(3.9)", at=(0.44, 0.12), size=(0.30, 0.20)),
        Block(text="friction model\n(3.7), (3.8)", at=(0.83, 0.12), size=(0.32, 0.20)),
    ),
    arrows=(
        Arrow(path=((0.0, 0.86), (0.05, 0.86)), label="$r$"),
        Arrow(path=((0.25, 0.86), (0.33, 0.86))),
        Arrow(path=((0.65, 0.86), (0.74, 0.86))),
        Arrow(path=((0.85, 0.76), (0.85, 0.59))),
        Arrow(path=((0.79, 0.50), (0.60, 0.50)), label="$u$"),
        Arrow(path=((0.38, 0.50), (0.26, 0.50))),
        Arrow(path=((0.15, 0.59), (0.15, 0.77)), label="$x$"),
        Arrow(path=((0.15, 0.41), (0.15, 0.12), (0.29, 0.12)), label="$x$"),
        Arrow(path=((0.59, 0.12), (0.67, 0.12))),
        Arrow(path=((0.85, 0.22), (0.85, 0.41))),
    ),
)
