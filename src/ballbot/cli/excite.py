"""`ballbot excite`: an excitation that is informative about friction, within limits, tried on the loop with sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.context import (
    PAGE,
    CommandResult,
    OutFolder,
    RobotName,
    Seed,
    WholeNumber,
    open_result,
)
from ballbot.control.controller import Controller
from ballbot.control.file import write_controller
from ballbot.control.presets import named_controller
from ballbot.control.references import write_reference
from ballbot.files import write_text
from ballbot.fitting.run import Run
from ballbot.identification import read_bounds
from ballbot.report.excitation import (
    errors_picture,
    excitation_parts,
    excitation_report,
    followed_run,
    run_figure,
)
from ballbot.report.style import drawn
from ballbot.robot import Robot
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.excitation_design import DesignEffort
from ballbot.workflows.excitation_task import Law, RunLimits
from ballbot.workflows.excite import Excitation, ExcitationOptions, deviations_found
from ballbot.workflows.excite import excite as find

_WRITTEN = (PAGE, "reference.csv", "controller.toml", "results.json", "run.svg", "errors.svg")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LimitOptions:
    """Limits of the run."""

    lean: float = 8.0
    """Largest lean of the axis from the vertical [degrees]."""

    floor: float = 1.0
    """Largest distance from the start [m]."""

    torque: float | None = None
    """Largest torque of a wheel [N m]; half the robot's torque limit if not given."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExciteSearchOptions:
    """The search for the run."""

    duration: float = 32.0
    """Length of the run [s]."""

    generations: WholeNumber = 40
    """Largest number of generations of the search."""

    population: WholeNumber = 16
    """References tried in each generation."""

    seed: Seed = 0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExciteTrialOptions:
    """The trial on the compiled loop with sensors."""

    tried: Annotated[bool, Parameter(name="--try", negative="--no-try")] = True
    """Run the excitation and a square of the same length on the loop with sensors, with the scenario's friction, half
    and one and a half times as much and three seeds each, and identify friction from a log of both."""

    scenario: str = "nominal"
    """Sensors, drive, play and true friction of the trial: a scenario's name or file, as in ballbot record."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExciteFitOptions:
    """The identification that the run is for."""

    found: Path | None = None
    """results.json of `ballbot identify`, from which the accuracy of predicted states is taken. If not given, that
    of the loop around the square is used."""

    law: Law = "stribeck"
    """The friction law that will be identified."""

    bounds: Path | None = None
    """The bounds file of `ballbot identify`. Standard errors are weighted by the width of the bounds."""

    window: float = 0.25
    """Length of the windows of the identification [s]."""


_LIMITS, _SEARCH = LimitOptions(), ExciteSearchOptions()
_TRIAL, _IDENTIFICATION = ExciteTrialOptions(), ExciteFitOptions()


def excite(
    robot: RobotName,
    /,
    *,
    within: LimitOptions = _LIMITS,
    search: ExciteSearchOptions = _SEARCH,
    trial: ExciteTrialOptions = _TRIAL,
    identification: ExciteFitOptions = _IDENTIFICATION,
    controller: str = "nominal",
    out: OutFolder,
) -> None:
    """Design an informative excitation within limits on lean, floor space and torque, and try it on the loop
    with sensors.

    Example: ballbot excite alten --lean 8 --floor 1 --torque 3 --out experiment

    Example: ballbot excite found/robot.toml --found found/results.json --controller mine.toml --out experiment

    Writes report.html, reference.csv (t, ref_x, ref_y, ref_psi: follow it with controller.toml beside it, on the robot
    or by ballbot record nominal --reference experiment/reference.csv), results.json, run.svg and errors.svg.

    Parameters
    ----------
    controller
        The controller that the robot will use: nominal (without compensation), precise or a controller file.
    """
    described = Robot.load(robot)
    limits = RunLimits(
        lean=math.radians(within.lean),
        floor=within.floor,
        torque=0.5 * described.drive.torque_limit if within.torque is None else within.torque,
    )
    effort = DesignEffort(generations=search.generations, population=search.population)
    chosen = named_controller(controller, described)
    scenario = load_scenario(trial.scenario, described)
    bounds = read_bounds(identification.bounds) if identification.bounds else None
    deviations = deviations_found(identification.found) if identification.found else None
    inputs = [robot, trial.scenario, controller, identification.found, identification.bounds]
    with open_result(out, command="excite", writes=_WRITTEN, inputs=inputs, seed=search.seed) as result:
        with result.progress("excite") as bar:
            found = find(
                described,
                chosen,
                limits=limits,
                duration=search.duration,
                scenario=scenario,
                options=ExcitationOptions(
                    deviations=deviations,
                    tried=trial.tried,
                    law=identification.law,
                    bounds=bounds,
                    window=identification.window,
                    effort=effort,
                ),
                run=Run(seed=search.seed, progress=bar.report),
            )
        with result.replaced() as new:
            _write(found, chosen, result, new)
    result.show(excitation_parts(found))
    result.show_file("reference.csv", PAGE)


def _write(found: Excitation, controller: Controller, result: CommandResult, folder: Path) -> None:
    design, limits = found.design, found.task.limits
    write_reference(design.times, design.poses, folder / "reference.csv")
    write_controller(controller, folder / "controller.toml")
    shown = followed_run(found)
    run = drawn(lambda: run_figure(shown, limits), name="run")
    errors = errors_picture(found)
    write_text(folder / "run.svg", run)
    write_text(folder / "errors.svg", errors.markup)
    result.write_json(found.results(), folder)
    page = excitation_report(found, found.task.robot, errors=errors, made=result.origin)
    result.write_page(page, folder)
