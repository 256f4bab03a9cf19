"""An axis with play between its motor and its load, simulated apart from Ballbot: two masses and a stiff dead zone."""

import math

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.axis import AxisRecord
from ballbot.mechanics.engine.compiled import compiled

INERTIA, VISCOUS, COULOMB = 0.02, 0.05, 0.1
#: shares of the motor in the inertia and in the friction
MOTOR_INERTIA, MOTOR_FRICTION = 0.3, 0.4
_STEP, _ROWS_EVERY = 2e-5, 100
_ROW = _STEP * _ROWS_EVERY


@compiled
def _faster(speed, force, viscous, coulomb, inertia):
    """Return the speed after one step; dry friction takes away at most all of it."""
    free = speed + _STEP * force / inertia
    dry = _STEP * coulomb / inertia
    return math.copysign(max(abs(free) - dry, 0.0), free) / (1.0 + _STEP * viscous / inertia)


@compiled
def _follow(reference, rates, play, on_motor, rows):
    """Move motor and load along a reference under a loop around the load; `rows` (n, 2) takes position and force."""
    motor, motor_speed, load, load_speed = reference[0], 0.0, reference[0], 0.0
    j, f = MOTOR_INERTIA, MOTOR_FRICTION
    reduced = INERTIA * j * (1.0 - j)
    stiffness, damping = reduced * 900.0**2, reduced * 720.0
    for k in range(len(reference)):
        force = INERTIA * (600.0 * (reference[k] - load) + 30.0 * (rates[k] - load_speed))
        rows[k, 0] = motor if on_motor else load
        rows[k, 1] = force
        for _ in range(_ROWS_EVERY):
            apart, through = motor - load, 0.0
            if abs(apart) > 0.5 * play:
                through = stiffness * (apart - math.copysign(0.5 * play, apart))
                through += damping * (motor_speed - load_speed)
            motor_speed = _faster(motor_speed, force - through, f * VISCOUS, f * COULOMB, j * INERTIA)
            load_speed = _faster(
                load_speed, through, (1.0 - f) * VISCOUS, (1.0 - f) * COULOMB, (1.0 - j) * INERTIA
            )
            motor += _STEP * motor_speed
            load += _STEP * load_speed


def record_with_play(play: float, *, on_motor: bool = False, duration: float = 10.0) -> AxisRecord:
    """Return the record of an axis with so much play [rad], its encoder on the load or on the motor."""
    t: NDArray[np.float64] = np.arange(round(duration / _ROW)) * _ROW
    frequencies, sizes = np.array([0.2, 0.37, 0.71, 1.13]), np.array([0.5, 0.4, 0.3, 0.2])
    angles = 2.0 * np.pi * np.outer(t, frequencies) + np.arange(4.0)
    rows = np.empty((len(t), 2))
    _follow(
        np.sin(angles) @ sizes, np.cos(angles) @ (sizes * 2.0 * np.pi * frequencies), play, on_motor, rows
    )
    random = np.random.default_rng(1)
    return AxisRecord(
        name="with play" if play else "without play",
        sample_time=_ROW,
        force=rows[:, 1] + 0.01 * COULOMB * random.standard_normal(len(t)),
        position=rows[:, 0] + 3e-5 * random.standard_normal(len(t)),
        unit="rad",
    )
