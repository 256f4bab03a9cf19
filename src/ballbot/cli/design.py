"""`ballbot design`: a controller file for a robot."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.cli.output import matrix_text, standard_output, table
from ballbot.cli.robust_design import RobustOptions, design_robustly
from ballbot.control.controller import Compensation, Controller
from ballbot.control.file import write_controller
from ballbot.control.lqr import LqrDesign
from ballbot.control.nominal import STATE_WEIGHTS, TORQUE_WEIGHT, design_gain
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.robot import Robot
from ballbot.robot.deviations import Propagated, propagate

_WEIGHTS = ",".join(f"{weight:g}" for weight in STATE_WEIGHTS)
_SEARCH = RobustOptions()


def design(
    robot: str,
    /,
    *,
    q: str = _WEIGHTS,
    r: float = TORQUE_WEIGHT,
    sample_time: float | None = None,
    compensation: Compensation = "none",
    robust: bool = False,
    search: RobustOptions = _SEARCH,
    out: Path,
) -> None:
    """Design a controller: sampled LQR on the exact model, with friction compensation.

    Example: ballbot design alten --q 20,20,500,500,5,30,30,20,20,2 --r 30 --compensation full --out soft

    Example: ballbot design found/robot.toml --robust --compensation full --out robust

    Writes controller.toml and results.json (gain and closed-loop poles). Standard deviations in the robot's file are
    carried through to each entry of the gain.

    Parameters
    ----------
    robot
        A preset's name or a robot file. Its friction is what is compensated; the gain is designed without it.
    q
        Weights of x y theta phi psi and of their rates, ten numbers with commas between them.
    r
        Weight of each wheel's torque.
    sample_time
        Time between two updates [s]; the robot's own where not given.
    compensation
        none; full (all friction); partial (only while friction works against the intended motion).
    robust
        Seek the weights by search over perturbed robots in simulation, for the worst tenth of them; takes minutes,
        shows how far it is, and goes on with --resume.
    out
        The folder to write into.
    """
    if robust:
        if q != _WEIGHTS or r != TORQUE_WEIGHT:
            raise InputError("--robust seeks the weights itself; leave out --q and --r.")
        design_robustly(robot, sample_time=sample_time, compensation=compensation, options=search, out=out)
        return
    described, weights = Robot.load(robot), _weights(q)

    def gain_of(one: Robot) -> NDArray[np.float64]:
        return design_gain(one, state_weights=weights, torque_weight=r, sample_time=sample_time).gain

    found = design_gain(described, state_weights=weights, torque_weight=r, sample_time=sample_time)
    spread = propagate(described, gain_of)
    controller = Controller(described, found.gain, sample_time=found.sample_time, compensation=compensation)
    write_controller(controller, out / "controller.toml")
    write_text(out / "results.json", json.dumps(_results(controller, found, spread), indent=2) + "\n")
    console = standard_output()
    console.print(matrix_text("K", found.gain), markup=False, soft_wrap=True)
    if spread.parts:
        causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in spread.largest())
        console.print(
            f"\nits standard deviation by those in the robot's file ({causes}):\n",
            markup=False,
            soft_wrap=True,
        )
        console.print(matrix_text("+-", spread.deviation), markup=False, soft_wrap=True)
    rows = [[f"{pole.real:.4f}", f"{pole.imag:.4f}"] for pole in found.poles]
    console.print(table("Closed-loop poles (rad/s)", ["real", "imaginary"], rows, framed=console.is_terminal))
    console.print(str(out / "controller.toml"), soft_wrap=True)


def _weights(text: str) -> list[float]:
    try:
        return [float(weight) for weight in text.split(",")]
    except ValueError:
        raise InputError(f"--q is {text!r}; it must be ten numbers with commas between them.") from None


def _results(controller: Controller, found: LqrDesign, spread: Propagated) -> dict[str, object]:
    return {
        "robot": controller.robot.name,
        "sample_time": controller.sample_time,
        "compensation": controller.compensation,
        "gain": controller.gain.tolist(),
        "gain_standard_deviation": spread.deviation.tolist() if spread.parts else None,
        "gain_variance_shares": dict(spread.largest(len(spread.parts))),
        "poles": [[pole.real, pole.imag] for pole in found.poles],
    }
