"""Kugle (Aalborg University, 2019): its linearised matrices and the gain of its balance LQR.

T. K. Jespersen, github.com/mindThomas/Kugle-MATLAB. State: x, y, the quaternion (q1 q2 q3 q4) and their rates; about
upright (q2 q3 q4) is half of our (theta phi psi). Its kinetic energy has two peculiarities, both switched on here by
data alone:

* the body's inertia J_b is already about the ball's centre, and 1/2 M_b |v_com|^2 is added to it: m_r l^2 counts
  twice, the slip of the thesis (item 5 of its list);
* wheels and rotors alike turn at the speed relative to the body, r_k/r_w (ball - body), which is right for the
  rotors alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import LqrDesign, lqr
from ballbot.mechanics.model import LinearModel, Model
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia
from campaigns.published.printed import (
    Entry,
    SourceModel,
    entry_table,
    in_state,
    unstable_poles,
)
from campaigns.reproduce import markdown_table

#: acceleration by quaternion element, as the source prints it (LinearizedModelMatrices, A)
_PRINTED_A = {
    ("ddx", "q3"): "-9.5964",
    ("ddy", "q2"): "9.6198",
    ("ddq2", "q2"): "14.0494",
    ("ddq3", "q3"): "14.0152",
}
#: acceleration by wheel torque (LinearizedModelMatrices, B)
_PRINTED_B = {
    "ddx": ("0.0000", "-1.0421", "1.0421"),
    "ddy": ("1.2045", "-0.6022", "-0.6022"),
    "ddq2": ("0.7007", "-0.3504", "-0.3504"),
    "ddq3": ("0.0000", "0.6054", "-0.6054"),
    "ddq4": ("-6.8957", "-6.8957", "-6.8957"),
}
#: the source's order of what is accelerated, which is ours
_NAMES = ("ddx", "ddy", "ddq2", "ddq3", "ddq4")
_HALVES = np.array([1.0, 1.0, 0.5, 0.5, 0.5])  # q2 q3 q4 are half the angles

#: weights of q2 q3 q4 and of the body's rates, and of each torque (GainComputation_UsingLinearizedMatrices)
STATE_WEIGHTS = (1000.0, 1000.0, 1.0, 0.1, 0.1, 0.01)
TORQUE_WEIGHT = 0.05


def as_modelled(robot: Robot) -> Robot:
    """Return the robot whose exact equations are the source's: both peculiarities, as data.

    Parameters
    ----------
    robot : Robot
        The preset "kugle", its inertia about the ball's centre.
    """
    return inertia_counted_twice(all_on_relative_speed(robot))


def inertia_counted_twice(robot: Robot) -> Robot:
    """Return the robot with the inertia about the ball's centre taken for one about the centre of mass."""
    return robot.replace(body=replace(robot.body, inertia_about="center_of_mass"))


def all_on_relative_speed(robot: Robot) -> Robot:
    """Return the robot whose wheels have no inertia of their own and whose rotors have it in their stead."""
    n = robot.drive.gear_ratio
    rotor = reflected_rotor_inertia(
        gear_ratio=n, motor_inertia=robot.drive.motor_inertia, gear_inertia=robot.drive.gear_inertia
    )
    total = robot.wheels.inertia + rotor
    return robot.replace(
        wheels=replace(robot.wheels, inertia=0.0),
        drive=replace(robot.drive, motor_inertia=total / n**2, gear_inertia=0.0),
    )


def entries(robot: Robot) -> list[Entry]:
    """Return every number of the printed A and B that is not zero."""
    reproduced, right = in_quaternion(Model(as_modelled(robot))), in_quaternion(Model(robot))
    found = []
    for (row, column), printed in _PRINTED_A.items():
        place = 5 + _NAMES.index(row), 2 + ("q2", "q3").index(column)
        found.append(_entry(f"{row}/{column}", printed, reproduced.A[place], right.A[place]))
    for row, printed_row in _PRINTED_B.items():
        for wheel, printed in enumerate(printed_row):
            place = 5 + _NAMES.index(row), wheel
            if float(printed):
                found.append(_entry(f"{row}/tau{wheel + 1}", printed, reproduced.B[place], right.B[place]))
    return found


def printed_attitude() -> SourceModel:
    """Return the attitude's part of the printed matrices, state (q2 q3 q4, rates of the body)."""
    A, B = np.zeros((6, 6)), np.zeros((6, 3))
    A[:3, 3:] = 0.5 * np.eye(3)
    A[3, 0], A[4, 1] = (2.0 * float(_PRINTED_A[place]) for place in (("ddq2", "q2"), ("ddq3", "q3")))
    B[3:] = 2.0 * np.array([[float(one) for one in _PRINTED_B[row]] for row in ("ddq2", "ddq3", "ddq4")])
    return SourceModel(A=A, B=B)


def attitude(model: LinearModel) -> SourceModel:
    """Return the attitude's part of a model in the source's state (q2 q3 q4, rates of the body)."""
    T = np.zeros((6, 10))
    T[:3, 2:5], T[3:, 7:] = 0.5 * np.eye(3), np.eye(3)
    return in_state(model, T)


def balance_lqr(model: SourceModel) -> LqrDesign:
    """Return the balance controller's gain (3, 6) for (q2 q3 q4, rates), with the source's weights."""
    return lqr(model, STATE_WEIGHTS, (TORQUE_WEIGHT,) * 3)


def section(robot: Robot) -> str:
    """Return the source's part of the page, computed."""
    mistaken, relative = (
        Model(as_modelled(robot)).linearize(),
        Model(all_on_relative_speed(robot)).linearize(),
    )
    right = Model(robot).linearize()
    body, faster = robot.body, unstable_poles(right)[0] / unstable_poles(mistaken)[0]
    poles = [
        ["as printed", *_pole_cells(mistaken)],
        ["with the inertia right, wheels still on relative speed", *_pole_cells(relative)],
        ["right", *_pole_cells(right)],
    ]
    designs = [balance_lqr(printed_attitude()), *(balance_lqr(attitude(one)) for one in (mistaken, right))]
    names = ("from the printed A and B", "from the source's convention", "from the right model")
    gains = [
        [name, *(f"{value:.3f}" for value in _gain_text(design.gain))]
        for name, design in zip(names, designs, strict=True)
    ]
    return f"""\
## Kugle (Aalborg University, 2019)

Source: T. K. Jespersen, Kugle-MATLAB (MIT), `LinearizedModelMatrices` and `BalanceLQRgain`; preset `kugle`. The model
is in quaternions; about upright q2, q3, q4 are half of theta, phi, psi.

**What it does.** The body's inertia, {body.inertia[0]:.4f} kg m^2, is about the ball's centre. The kinetic energy adds
1/2 M_b |v_com|^2 to it, so that m_r l^2 = {body.mass * body.center_of_mass**2:.3f} kg m^2 counts twice, as in
the thesis. And wheels and rotors alike turn at the speed relative to the body, r_k/r_w (ball - body); the wheels' own
part of their inertia should turn with the absolute spin.

**How it is switched on.** By data: the preset with `about = "center_of_mass"` over the inertia about the ball's centre,
and the wheels' inertia moved to the rotors. The exact equations of that robot print the source's matrices:

{entry_table(entries(robot))}

The robot falls {faster:.2f} times as fast as the printed model:

{markdown_table(["", "unstable poles [rad/s]", ""], poles)}

Balance LQR, Q = diag(1000, 1000, 1, .1, .1, .01) on (q2 q3 q4, rates), R = 0.05 I. First wheel's gain on q2, q4 and
their rates. (`tests/thesis/test_published_robots.py` compares the gain with the authors' file: 1e-12 from their A, B.)

{markdown_table(["gain", "q2", "q4", "rate about x", "rate about z"], gains)}
"""


def in_quaternion(model: Model) -> SourceModel:
    """Return a model in the source's state (x, y, q2, q3, q4, their rates)."""
    halves = np.diag(np.concatenate([_HALVES, _HALVES]))
    return in_state(model.linearize(), halves)


def _entry(name: str, printed: str, reproduced: float, right: float) -> Entry:
    return Entry(name=name, printed=printed, reproduced=float(reproduced), right=float(right))


def _pole_cells(model: LinearModel) -> list[str]:
    return [f"{pole:.4f}" for pole in unstable_poles(model)]


def _gain_text(gain: NDArray[np.float64]) -> NDArray[np.float64]:
    return gain[0, [0, 2, 3, 5]]
