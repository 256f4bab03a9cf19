"""`ballbot design`: a controller file for a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ballbot.arguments import numbers_listed
from ballbot.cli import options
from ballbot.cli.context import open_result, robot_words
from ballbot.cli.controllers import warn_of_idle_compensation
from ballbot.cli.findings import checked_robot
from ballbot.control.file import controller_text
from ballbot.control.presets import KINDS
from ballbot.report.design import controller_design_report
from ballbot.workflows.controller_design import DEFAULT_PARTS, GainOptions, PartOptions, design_controller

if TYPE_CHECKING:
    Kind = str
else:
    Kind = Literal[tuple(KINDS)]

_KINDS = f"{'; '.join(f'{name}: {preset.text}' for name, preset in KINDS.items())}."
_WRITTEN = ("controller.toml",)


def design(
    robot: options.Robot,
    /,
    *,
    kind: Annotated[Kind, Parameter(help=_KINDS)] = "nominal",
    q: str | None = None,
    r: float | None = None,
    sample_time: float | None = None,
    parts: Annotated[PartOptions, Parameter(name="*", negative="")] = DEFAULT_PARTS,
    accept: options.Accept = None,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Design a controller: sampled LQR on the exact model, with friction compensation.

    Example: ballbot design alten --q 20,20,500,500,5,30,30,20,20,2 --r 30 --compensation full --out soft

    Example: ballbot design found/robot.toml --kind precise --out precise

    Example: ballbot design found/robot.toml --kind precise --delay 0.016 --out precise

    Writes report.html, controller.toml and results.json (gain, closed-loop poles, stability margins, A and B). The
    precise kind is stiff and has integral action, smoothed references with feed-forward and a disturbance observer; it
    needs the Kalman filter's state. The standard deviations of the friction in the robot's file limit the compensation
    to the friction that is present with 95 % confidence. More than that injects energy and can destabilise the robot:
    it is refused, and the margin is shown.

    Parameters
    ----------
    q
        Weights of x y theta phi psi and of their rates: ten numbers separated by commas. If not given, those of the
        kind.
    r
        Weight of each wheel's torque. If not given, that of the kind.
    sample_time
        Time between two updates [s]; the robot's own if not given.
    """
    described, findings = checked_robot(robot, change, accept=accept)
    ten = "ten numbers with commas between"
    gain = GainOptions(
        kind=kind,
        state_weights=None if q is None else numbers_listed(q, "--q", count=10, wanted=ten),
        torque_weight=r,
        sample_time=sample_time,
    )
    with open_result(out, doing="designing the controller", writes=_WRITTEN) as result:
        designed = design_controller(described, gain=gain, parts=parts)
        page = controller_design_report(designed, findings)
        files = {"controller.toml": controller_text(designed.controller)}
        step = f"`ballbot compare {robot_words(robot, change)} none {result.path('controller.toml')} --out compared`"
        result.write(page, files=files, named=_WRITTEN, next_step=step)
    warn_of_idle_compensation("controller.toml", designed.controller)
