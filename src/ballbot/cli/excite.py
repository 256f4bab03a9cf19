"""`ballbot excite`: an experiment that tells a robot's friction, within limits, tried on the twin."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from ballbot.cli.excite_tables import errors_table, limits_table, verdict
from ballbot.cli.long_run import long_run
from ballbot.cli.output import progress_bar, standard_output
from ballbot.control.controller import Controller
from ballbot.control.file import controller_text, read_controller, write_controller
from ballbot.control.nominal import nominal_controller
from ballbot.control.reference_file import write_reference
from ballbot.experiments.excite import Effort, Excitation, Law, Limits, deviations_found
from ballbot.experiments.excite import excite as find
from ballbot.files import write_text
from ballbot.identification import read_bounds
from ballbot.identification.checkpoint import digest, identity
from ballbot.report.excitation_figures import errors_figure, followed_run, run_figure
from ballbot.report.provenance import Provenance, provenance
from ballbot.report.study_files import check_folder
from ballbot.report.style import drawn
from ballbot.robot import Robot
from ballbot.twin import Scenario
from ballbot.twin.scenario_text import scenario_text


def excite(
    robot: str,
    /,
    *,
    duration: float = 32.0,
    lean: float = 8.0,
    floor: float = 1.0,
    torque: float | None = None,
    controller: Path | None = None,
    found: Path | None = None,
    on_twin: Annotated[bool, Parameter(name="--try", negative="--no-try")] = True,
    scenario: str = "nominal",
    law: Law = "stribeck",
    bounds: Path | None = None,
    window: float = 0.25,
    generations: int = 40,
    population: int = 16,
    seed: int = 0,
    resume: bool = False,
    out: Path,
) -> None:
    """Design a run whose log tells the friction best, within limits on lean, floor and torque; try it on the twin.

    Example: ballbot excite alten --lean 8 --floor 1 --torque 3 --out experiment

    Example: ballbot excite found/robot.toml --found found/results.json --controller mine.toml --out experiment

    Writes reference.csv (t, ref_x, ref_y, ref_psi: follow it with controller.toml beside it, on the robot or by
    ballbot record nominal --reference experiment/reference.csv), results.json, run.svg and errors.svg.

    Parameters
    ----------
    robot
        A preset's name or a robot file: with the friction that an identification found, or without any as yet.
    duration
        Of the run [s].
    lean
        Largest lean of the axis from the vertical [degrees].
    floor
        Largest distance from where the run begins [m].
    torque
        Largest torque of a wheel [N m]; half the robot's torque limit where not given.
    controller
        The controller file that the robot will be run with; the nominal one without compensation where not given.
    found
        An identification's results.json, for how well the robot's states can be predicted; the twin's where not given.
    on_twin
        Try the run and a square of the same length on the twin, and identify from both logs.
    scenario
        What is true of the twin: a name or a scenario file, as in ballbot record.
    law
        The friction law that identification will seek.
    bounds
        Identification's file of bounds; errors count in shares of their width.
    window
        Identification's windows, in seconds.
    generations
        Of the search, at most.
    population
        References tried in each generation.
    seed
        Equal seeds give equal results.
    resume
        Go on with a run into the same folder that was interrupted.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    chosen = read_controller(controller, described) if controller else nominal_controller(described)
    limits = Limits(
        lean=math.radians(lean),
        floor=floor,
        torque=0.5 * described.drive.torque_limit if torque is None else torque,
    )
    folder, console = check_folder(out), standard_output()
    faults, within = Scenario.load(scenario, described), read_bounds(bounds) if bounds else None
    deviations = deviations_found(found) if found else None
    effort = Effort(generations=generations, population=population)
    given = {"--controller": controller, "--found": found, "--bounds": bounds}
    words = ["ballbot", "excite", robot, "--duration", repr(duration), "--lean", repr(lean)]
    words += ["--floor", repr(floor), "--torque", repr(limits.torque), "--scenario", scenario, "--law", law]
    words += [word for name, path in given.items() if path for word in (name, str(path))]
    words += ["--try" if on_twin else "--no-try", "--window", repr(window)]
    words += ["--generations", str(generations), "--population", str(population)]
    words += ["--seed", str(seed), "--out", str(out)]
    named = [Path(name) for name in (robot, scenario) if Path(name).is_file()]
    sources = [*named, *(path for path in given.values() if path)]
    made = provenance(command=shlex.join(words), files=sources, seed=seed)
    depends_on = {
        "controller": digest(controller_text(chosen)).hex(),
        "scenario": digest(scenario_text(faults)).hex(),
        "deviations": digest(deviations).hex(),
        "limits": limits,
        "duration": duration,
        "try": on_twin,
        "law": law,
        "bounds": within,
        "window": window,
        "effort": effort,
        "seed": seed,
    }
    belongs_to = identity(described, [], depends_on)
    with long_run(folder, words=words, belongs_to=belongs_to, resume=resume, cluster=None) as run:
        with progress_bar(console, "excite") as bar:
            result = find(
                described,
                chosen,
                limits=limits,
                duration=duration,
                scenario=faults,
                deviations=deviations,
                on_twin=on_twin,
                law=law,
                bounds=within,
                window=window,
                effort=effort,
                seed=seed,
                recall=run.recall,
                tell=lambda share, doing, note: bar.show(share, doing=doing, note=note),
            )
        _write(result, chosen, made, folder)
    _show(result, console)
    console.print(str(folder / "reference.csv"), soft_wrap=True)


def _write(result: Excitation, controller: Controller, made: Provenance, folder: Path) -> None:
    design = result.design
    write_reference(design.times, design.poses, folder / "reference.csv")
    write_controller(controller, folder / "controller.toml")
    shown = followed_run(result)
    limits = result.task.limits
    write_text(folder / "run.svg", drawn(lambda: run_figure(shown, limits), name="run"))
    write_text(folder / "errors.svg", drawn(lambda: errors_figure(result), name="errors"))
    results = result.to_dict() | {"provenance": made.to_dict()}
    write_text(folder / "results.json", json.dumps(results, indent=2, allow_nan=False) + "\n")


def _show(result: Excitation, console: Console) -> None:
    framed = console.is_terminal
    console.print(limits_table(result, framed=framed))
    console.print(errors_table(result, framed=framed))
    for sentence in verdict(result):
        console.print(sentence, soft_wrap=True)
