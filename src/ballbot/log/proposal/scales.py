"""Units of a foreign log's columns: from the encoder's step, from sizes, and from the gain that kinematics asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.robot import Robot

#: a step that agrees with an encoder's this well is that encoder's
STEP_AGREEMENT = 0.02
#: beyond this lean, in a tenth of the rows, a balancing robot's angle is not in radians
LEAN_IN_RADIANS = 0.35
#: largest numbers that drivers and libraries call full duty
FULL_DUTIES = (1.0, 100.0, 127.0, 255.0, 1000.0, 1023.0, 4095.0, 32639.0, 32767.0, 65535.0)


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How a column becomes Ballbot's: a unit's word, a factor beside it, and why."""

    unit: str
    factor: float  #: what turns the file's number into radians (or a duty of 1), unit and scale in one
    scale: float = 1.0  #: part of the factor that the unit does not say
    reason: str


def step_of(values: NDArray[np.float64]) -> float | None:
    """Return the smallest step of which all steps of a column are multiples; None where there is no such step."""
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 1e-9]
    if len(steps) < 20:
        return None
    step = float(np.quantile(steps, 0.001, method="lower"))
    multiples = steps[steps < 20.5 * step] / step
    whole = np.abs(multiples - np.round(multiples)) < 0.05
    return step if len(multiples) >= 20 and whole.mean() > 0.95 else None


def wheel_scale(angles: NDArray[np.float64], robot: Robot) -> Scale:
    """Return the unit of wheel angles (N, n) in the file, by the encoder's step where it shows."""
    turn = float(robot.sensors.encoder_counts * robot.drive.gear_ratio)
    steps = [step_of(column) for column in angles.T]
    known = [step for step in steps if step is not None]
    step = float(np.median(known)) if known else None
    if step is not None and abs(step - 1.0) < 1e-6:
        reason = f"whole numbers; the robot's encoder has {turn:g} counts a turn of the wheel"
        return Scale(unit="counts", factor=2.0 * math.pi / turn, reason=reason)
    gear = robot.drive.gear_ratio
    candidates = (
        Scale(unit="rad", factor=1.0, reason="one encoder count in radians"),
        Scale(unit="deg", factor=math.pi / 180.0, reason="one encoder count in degrees"),
        Scale(unit="turn", factor=2.0 * math.pi, reason="one encoder count in turns"),
        Scale(
            unit="rad", factor=1.0 / gear, scale=1.0 / gear, reason="one encoder count, the motor's radians"
        ),
        Scale(
            unit="deg",
            factor=math.pi / 180.0 / gear,
            scale=1.0 / gear,
            reason="one encoder count, the motor's degrees",
        ),
    )
    if step is not None:
        for scale in candidates:
            ratio = step * scale.factor / (2.0 * math.pi / turn)
            if abs(ratio - 1.0) < STEP_AGREEMENT:
                return Scale(
                    unit=scale.unit,
                    factor=scale.factor,
                    scale=scale.scale,
                    reason=f"steps of {step:.5g} are {scale.reason}",
                )
    return Scale(unit="rad", factor=1.0, reason="assumed: no encoder step was recognised")


def lean_scale(lean: NDArray[np.float64]) -> Scale:
    """Return the unit of roll and pitch (N, 2) by their size."""
    size = float(np.nanquantile(np.abs(lean), 0.9))
    if size > LEAN_IN_RADIANS:
        return Scale(
            unit="deg",
            factor=math.pi / 180.0,
            reason=f"a tenth of the angles exceeds {size:.2g}, too much for radians",
        )
    return Scale(unit="rad", factor=1.0, reason=f"nine tenths of the angles are within {size:.2g}")


def duty_scale(commands: NDArray[np.float64]) -> Scale:
    """Return what makes the full duty 1, by the largest command (N, n)."""
    largest = float(np.nanmax(np.abs(commands)))
    # 1 %: what rounding and filters add
    full = next((duty for duty in FULL_DUTIES if largest <= 1.01 * duty), largest)
    return Scale(
        unit="duty",
        factor=1.0 / full,
        scale=1.0 / full,
        reason=f"the largest command is {largest:.4g}, so {full:g} is assumed to be full duty",
    )
