"""`ballbot excite`: an excitation that is informative about friction, within limits, tried on the loop with sensors."""

import math
from functools import partial
from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import changed_robot, open_result
from ballbot.control.file import controller_text
from ballbot.control.references import write_reference
from ballbot.control.source import named_controller
from ballbot.fitting.run import Run
from ballbot.identification import read_bounds
from ballbot.report.excitation import excitation_report
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.excite import Extent, Law
from ballbot.workflows.excite import excite as find

_WRITTEN = ("reference.csv", "controller.toml")


def excite(
    robot: options.Robot,
    /,
    *,
    lean: float = 8.0,
    floor: float = 1.0,
    torque: float | None = None,
    duration: options.Duration = 32.0,
    scenario: options.Scenario = "nominal",
    law: Law = "stribeck",
    bounds: Path | None = None,
    controller: str = "nominal",
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Design an informative excitation within limits on lean, floor space and torque.

    Example: ballbot excite alten --lean 8 --floor 1 --torque 3 --out experiment

    Example: ballbot excite found/robot.toml --controller mine.toml --out experiment

    The excitation and a square of the same length also run on the compiled loop with sensors, with the scenario's
    friction, half and one and a half times as much and three seeds each: do the limits hold?

    Writes report.html, reference.csv (t, ref_x, ref_y, ref_psi: follow it with controller.toml beside it, on the robot
    or by ballbot record nominal --reference experiment/reference.csv) and results.json.

    Parameters
    ----------
    lean
        Largest lean of the axis from the vertical [degrees].
    floor
        Largest distance from the start [m].
    torque
        Largest torque of a wheel [N m]; half the robot's torque limit if not given.
    law
        The friction law that will be identified.
    bounds
        The bounds file of `ballbot identify`. Standard errors are weighted by the width of the bounds.
    controller
        The controller that the robot will use: as of ballbot check.
    """
    described = changed_robot(robot, change)
    limits = Extent(
        lean=math.radians(lean),
        floor=floor,
        torque=0.5 * described.drive.torque_limit if torque is None else torque,
    )
    chosen = named_controller(controller, described)
    conditions = load_scenario(scenario, described)
    widths = read_bounds(bounds) if bounds else None
    with open_result(out, doing="excite", writes=_WRITTEN) as result:
        excitation = find(
            described,
            chosen,
            limits=limits,
            duration=duration,
            scenario=conditions,
            law=law,
            bounds=widths,
            run=Run(progress=result.report),
        )
        page = excitation_report(excitation)
        files = {
            "reference.csv": partial(write_reference, excitation.sines.times, excitation.sines.poses()),
            "controller.toml": controller_text(chosen),
        }
        named = "ROBOT" if change else robot  # `run` takes a file, in which the changes must stand
        step = (
            f"`ballbot run PORT --reference {result.path('reference.csv')} --controller "
            f"{result.path('controller.toml')} --robot {named} --out run`, then `ballbot identify {named} run/log.csv`"
        )
        result.write(page, files=files, named=["reference.csv"], next_step=step)
