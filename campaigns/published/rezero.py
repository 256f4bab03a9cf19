"""Rezero (ETH Zurich, 2010): its linearisation and gain.

P. Fankhauser and C. Gwerder, Modeling and Control of a Ballbot. State of the three-dimensional model: the body's
angles and the ball's, each followed by its rate, (theta_x theta_y theta_z phi_x phi_y); the ball's angles are ours as
phi_x = -y/r_b, phi_y = x/r_b.

Its convention: wheel and rotor count as one inertia Theta_W that turns with the *absolute* spin (relative speed plus
the body's turning about the axle). A rotor's speed is n times the wheel's relative one, and the body's inertia holds
the locked wheels already. Torques do act relative to the body, as they should.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import LqrDesign, lqr
from ballbot.mechanics.model import LinearModel, Model
from ballbot.robot import Robot
from campaigns.published.printed import (
    Entry,
    SourceModel,
    entry_table,
    in_state,
    mixture_model,
    unstable_poles,
)
from campaigns.reproduce import markdown_table
from tests.support.lagrangian import corrections_of

#: the exact equations, but for rotors of their own and for the locked wheels in the body's inertia
ABSOLUTE_WHEELS = replace(corrections_of("exact"), locked_wheels_once=False, reflected_rotors=False)

_ANGLES = ("theta_x", "theta_y", "theta_z", "phi_x", "phi_y")
_PRINTED_A = {
    ("theta_x", "theta_x"): "37.69",
    ("theta_y", "theta_y"): "37.73",
    ("phi_x", "theta_x"): "-73.02",
    ("phi_y", "theta_y"): "-73.09",
}
_PRINTED_B = {
    "theta_x": ("4.02", "-2.01", "-2.01"),
    "theta_y": ("0.000", "3.485", "-3.485"),
    "theta_z": ("-10.76", "-10.76", "-10.76"),
    "phi_x": ("-13.48", "6.738", "6.738"),
    "phi_y": ("0.00", "-11.68", "11.68"),  # the figure has -11.68 twice; see MISPRINTED
}
#: the entry of B whose sign the figure misprints
MISPRINTED = ("phi_y", 2)

STATE_WEIGHTS = (100.0, 50.0, 100.0, 50.0, 40.0, 20.0, 20.0, 10.0, 20.0, 10.0)
TORQUE_WEIGHT = 100.0
#: K, first row, as printed: the source cuts digits off and does not round
PRINTED_GAIN = (22.34, 4.63, 0.0, 0.0, -0.36, -0.29, 0.36, 0.53, 0.0, 0.0)


def as_modelled(robot: Robot) -> Robot:
    """Return the robot with wheel and rotor as one inertia, Theta_W, and no rotor (with `ABSOLUTE_WHEELS`)."""
    drive = robot.drive
    return robot.replace(
        wheels=replace(robot.wheels, inertia=robot.wheels.inertia + drive.reflected_inertia),
        drive=replace(drive, motor_inertia=0.0, gear_inertia=0.0),
    )


def in_source_state(model: LinearModel, robot: Robot) -> SourceModel:
    """Return a model in the source's state (10,): its five angles, each followed by its rate."""
    T = np.zeros((10, 10))
    r_b = robot.ball.radius
    ours = {
        "theta_x": (2, 1.0),
        "theta_y": (3, 1.0),
        "theta_z": (4, 1.0),
        "phi_x": (1, -1.0 / r_b),
        "phi_y": (0, 1.0 / r_b),
    }
    for index, name in enumerate(_ANGLES):
        place, scale = ours[name]
        T[2 * index, place] = T[2 * index + 1, 5 + place] = scale
    return in_state(model, T)


def printed_model(*, misprinted: bool = False) -> SourceModel:
    """Return the printed three-dimensional A (10, 10) and B (10, 3).

    Parameters
    ----------
    misprinted : bool
        With the figure's own sign of the last entry instead of the right one.
    """
    A, B = np.zeros((10, 10)), np.zeros((10, 3))
    A[::2, 1::2] = np.eye(5)
    for (row, column), printed in _PRINTED_A.items():
        A[_rate(row), _rate(column) - 1] = float(printed)
    for row, printed_row in _PRINTED_B.items():
        B[_rate(row)] = [float(one) for one in printed_row]
    if misprinted:
        row, wheel = MISPRINTED
        B[_rate(row), wheel] *= -1.0
    return SourceModel(A=A, B=B)


def entries(robot: Robot) -> list[Entry]:
    """Return every number of the printed three-dimensional A and B that is not zero."""
    reproduced = in_source_state(mixture_model(as_modelled(robot), ABSOLUTE_WHEELS), robot)
    right = in_source_state(Model(robot).linearize(), robot)
    found = []
    for (row, column), printed in _PRINTED_A.items():
        place = _rate(row), _rate(column) - 1
        name = f"{row} dd/{column}"
        found.append(Entry(name=name, printed=printed, reproduced=reproduced.A[place], right=right.A[place]))
    for row, printed_row in _PRINTED_B.items():
        for wheel, printed in enumerate(printed_row):
            place = _rate(row), wheel
            name = f"{row} dd/T{wheel + 1}"
            if float(printed):
                found.append(
                    Entry(name=name, printed=printed, reproduced=reproduced.B[place], right=right.B[place])
                )
    return found


def balance_lqr(model: SourceModel) -> LqrDesign:
    """Return the three-dimensional model's gain (3, 10) with the source's weights."""
    return lqr(model, STATE_WEIGHTS, (TORQUE_WEIGHT,) * 3)


def section(robot: Robot) -> str:
    """Return the source's part of the page, computed."""
    source = mixture_model(as_modelled(robot), ABSOLUTE_WHEELS)
    right = Model(robot).linearize()
    poles = [
        ["printed", f"{np.sqrt(float(_PRINTED_A['theta_y', 'theta_y'])):.4f}"],
        ["by the source's convention", f"{unstable_poles(source)[0]:.4f}"],
        ["right", f"{unstable_poles(right)[0]:.4f}"],
    ]
    worst = max(abs(entry.difference) for entry in entries(robot))
    return f"""\
## Rezero (ETH Zurich, 2010)

Source: P. Fankhauser and C. Gwerder, *Modeling and Control of a Ballbot*, doi 10.3929/ethz-a-010056685; preset
`rezero`. Its torques act relative to the body, with the counter-torque, as they should (and as Kugle's do).

**What it does.** Wheel and rotor count as one inertia, Theta_W = {as_modelled(robot).wheels.inertia:.5f} kg m^2,
that turns with the wheel's absolute spin. But the rotor, most of it, turns n times as fast as the wheel turns
*relative* to the body; and the body's inertia holds the locked wheels already, whose spin about the axle so counts
twice.

**How it is switched on.** The rotor's inertia moves to the wheel (data), and of the thesis's corrections "reflected
rotors" and "locked wheels once" stay off. The heading then comes out to its last digit, and only then; the lean comes
within {100.0 * worst:.1f} %:

{entry_table(entries(robot))}

What is left of the lean we cannot explain: the printed matrices were made with other numbers than are printed.

{markdown_table(["", "fastest pole [rad/s]"], poles)}

LQR with the source's Q and R = 100 I, first wheel. The figure prints the last entry of B with the sign of the one
before ({float(_PRINTED_B["phi_y"][1]):.2f}); the gain shows that it is a misprint. The source truncates the gain's
digits and does not round them; the remaining difference is the rounding of the printed A and B.

{_gain_table(robot, source, right)}
"""


def _gain_table(robot: Robot, source: LinearModel, right: LinearModel) -> str:
    designs = {
        "printed A, B with the sign mended": balance_lqr(printed_model()),
        "printed A, B as in the figure": balance_lqr(printed_model(misprinted=True)),
        "the source's convention": balance_lqr(in_source_state(source, robot)),
        "right": balance_lqr(in_source_state(right, robot)),
    }
    states = [text for angle in _ANGLES for text in (angle, "its rate")]
    rows = [["printed", *(f"{value:g}" for value in PRINTED_GAIN)]]
    rows += [
        [name, *(f"{value + 0.0:.4g}" for value in _clean(design.gain[0]))]
        for name, design in designs.items()
    ]
    return markdown_table(["gain on", *states], rows)


def _rate(angle: str) -> int:
    """Return the place of an angle's rate in the source's state."""
    return 2 * _ANGLES.index(angle) + 1


def _clean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.abs(values) < 1e-9, 0.0, values)
