"""`ballbot excite`: a run that is informative about friction, designed within limits and tried on the twin."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from ballbot.cli.context import long_run
from ballbot.cli.output import Bar, progress_bar, standard_output, table
from ballbot.control.controller import Controller
from ballbot.control.file import controller_text, read_controller, write_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import write_reference
from ballbot.files import write_text
from ballbot.fitting.checkpoint import digest, identity
from ballbot.fitting.run import Run
from ballbot.identification import Bounds, read_bounds
from ballbot.printable import shell_line
from ballbot.report.excitation import errors_figure, followed_run, run_figure
from ballbot.report.page import Provenance, as_json, provenance
from ballbot.report.style import drawn
from ballbot.report.tables import digits
from ballbot.result_folder import result_folder
from ballbot.robot import Robot
from ballbot.twin import Scenario
from ballbot.twin.scenario_file import scenario_text
from ballbot.workflows.excitation_design import DesignEffort
from ballbot.workflows.excitation_task import Law, RunLimits, RunPeaks
from ballbot.workflows.excite import Excitation, Trial, deviations_found
from ballbot.workflows.excite import excite as find

#: how a limit is shown: its unit, and by what its SI number is multiplied
_SHOWN = {"lean": ("degrees", 180.0 / np.pi), "floor": ("m", 1.0), "torque": ("N m", 1.0)}


def limits_table(result: Excitation, *, framed: bool) -> Table:
    """Return each limit with the peaks of the square and of the design, on the model and on the twin."""
    trials = result.trials
    runs = {"square": result.square.run.peaks, "designed": result.design.peaks}
    runs |= {f"{name}, twin": trial.peaks for name, trial in trials.items()}
    rows = [
        (f"{name} [{_SHOWN[name][0]}]", _shown(name, value), *(_peak(name, peaks) for peaks in runs.values()))
        for name, value in result.task.limits.to_dict().items()
    ]
    return table("Limits, and the largest values of each run", ("limit", "", *runs), rows, framed=framed)


def errors_table(result: Excitation, *, framed: bool) -> Table:
    """Return the standard errors: expected, and of identifications from the twin's logs; the worst of each last."""
    question = result.task.question
    believed = question.coordinates.physical(question.point)[question.coordinates.free]
    scaled = {"square": result.square.errors, "designed": result.design.errors}
    columns = {name: question.in_units(errors) for name, errors in scaled.items()}
    for name, trial in result.trials.items():
        scaled[f"{name}, twin"] = trial.errors
        columns[f"{name}, twin"] = _errors_in_units(trial)[question.coordinates.free]
    rows = [
        (label, digits(float(believed[i])), *(digits(float(one[i]), 2) for one in columns.values()))
        for i, label in enumerate(question.labels)
    ]
    rows.append(("worst, % of bounds", "", *(_worst(errors) for errors in scaled.values())))
    headings = ("parameter", "believed", *columns)
    return table("Standard errors: expected, and from the twin's logs", headings, rows, framed=framed)


def verdict(result: Excitation) -> list[str]:
    """Return what to know of the design, in sentences."""
    sentences = [gain_words(float(result.square.errors.max() / result.design.errors.max()))]
    if not result.trials:
        return [*sentences, "The design has not been tried on the twin."]
    trial = result.trials["designed"]
    if trial.log.ended:
        return [*sentences, f"On the twin the run ended early: {trial.log.ended}. Lower the limits."]
    exceeded = result.task.limits.exceeded(trial.peaks)
    kept = (
        f"The twin exceeded the limit on {' and '.join(exceeded)}; lower that limit"
        if exceeded
        else "The twin stayed within all limits"
    )
    return [*sentences, f"{kept}."]


def gain_words(gain: float) -> str:
    """Return what a square's worst standard error over the design's says; infinite where the square tells less."""
    if not np.isfinite(gain):
        return (
            "With a square of the same length some parameters cannot be identified; with the design all can."
        )
    if gain < 1.0:
        return (
            f"The worst expected standard error is {1.0 / gain:.1f} times a square's, so the "
            "square is more informative. Search for longer (--generations, --population)."
        )
    return f"The worst expected standard error is {gain:.1f} times smaller than a square's."


def _errors_in_units(trial: Trial) -> NDArray[np.float64]:
    return np.concatenate([np.atleast_1d(one) for one in trial.found.standard_errors.values()])


def _peak(name: str, peaks: RunPeaks) -> str:
    return _shown(name, peaks.to_dict()[name])


def _shown(name: str, value: float) -> str:
    return digits(value * _SHOWN[name][1])


def _worst(errors: NDArray[np.float64]) -> str:
    """Return the worst of scaled errors, and how many parameters got none where some did."""
    none = int(np.count_nonzero(~np.isfinite(errors)))
    if none == len(errors):
        return "none identified"
    text = f"{100.0 * float(errors[np.isfinite(errors)].max()):.1f}"
    return f"{text} ({none} not identified)" if none else text


_WRITTEN = ("reference.csv", "controller.toml", "results.json", "run.svg", "errors.svg")


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
    """Design an informative excitation within limits on lean, floor and torque, and try it on the twin.

    Example: ballbot excite alten --lean 8 --floor 1 --torque 3 --out experiment

    Example: ballbot excite found/robot.toml --found found/results.json --controller mine.toml --out experiment

    Writes reference.csv (t, ref_x, ref_y, ref_psi: follow it with controller.toml beside it, on the robot or by
    ballbot record nominal --reference experiment/reference.csv), results.json, run.svg and errors.svg.

    Parameters
    ----------
    robot
        A preset's name or a robot file, with identified friction or without any.
    duration
        Length of the run [s].
    lean
        Largest lean of the axis from the vertical [degrees].
    floor
        Largest distance from the start [m].
    torque
        Largest torque of a wheel [N m]; half the robot's torque limit if not given.
    controller
        The controller file that the robot will use. If not given, the nominal controller without compensation.
    found
        results.json of `ballbot identify`, which shows how well the robot's states can be predicted. If not given, the
        twin's are used.
    on_twin
        Run it and a square of the same length on the twin, and identify friction from both logs.
    scenario
        The twin's scenario: a name or a scenario file, as in ballbot record.
    law
        The friction law that will be identified.
    bounds
        The bounds file of `ballbot identify`. Standard errors are weighted by the width of the bounds.
    window
        Length of the windows of the identification, in seconds.
    generations
        Largest number of generations of the search.
    population
        References tried in each generation.
    seed
        Random seed. The same seed gives the same result.
    resume
        Continue an interrupted run in the same folder.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    asked = _Asked(
        robot=robot,
        duration=duration,
        limits=RunLimits(
            lean=math.radians(lean),
            floor=floor,
            torque=0.5 * described.drive.torque_limit if torque is None else torque,
        ),
        lean=lean,
        controller=controller,
        found=found,
        on_twin=on_twin,
        scenario=scenario,
        law=law,
        bounds=bounds,
        window=window,
        effort=DesignEffort(generations=generations, population=population),
        seed=seed,
        out=out,
    )
    chosen = read_controller(controller, described) if controller else nominal_controller(described)
    read = _Read(
        robot=described,
        controller=chosen,
        scenario=Scenario.load(scenario, described),
        bounds=read_bounds(bounds) if bounds else None,
        deviations=deviations_found(found) if found else None,
    )
    console = standard_output()
    made = provenance(command=shell_line(asked.words), files=asked.files, seed=seed)
    belongs_to = identity(described, [], asked.options | read.options)
    with (
        result_folder(out, command="excite", names=_WRITTEN, inputs=asked.files, resumes=True) as folder,
        long_run(folder.path, words=asked.words, belongs_to=belongs_to, resume=resume, seed=seed) as run,
    ):
        with progress_bar(console, "excite") as bar:
            result = _find(asked, read, run=run, bar=bar)
        with folder.replaced() as new:
            _write(result, chosen, made, new)
    _show(result, console)
    console.print(str(folder.path / "reference.csv"), soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """The command line."""

    robot: str
    duration: float
    limits: RunLimits
    lean: float  #: as given [degrees]
    controller: Path | None
    found: Path | None
    on_twin: bool
    scenario: str
    law: Law
    bounds: Path | None
    window: float
    effort: DesignEffort
    seed: int
    out: Path

    @property
    def options(self) -> dict[str, object]:
        """What the numbers depend on besides robot and files."""
        return {
            "limits": self.limits,
            "duration": self.duration,
            "try": self.on_twin,
            "law": self.law,
            "window": self.window,
            "effort": self.effort,
            "seed": self.seed,
        }

    @property
    def words(self) -> list[str]:
        """The command line that makes this again."""
        words = [
            "ballbot",
            "excite",
            self.robot,
            "--duration",
            repr(self.duration),
            "--lean",
            repr(self.lean),
        ]
        words += ["--floor", repr(self.limits.floor), "--torque", repr(self.limits.torque)]
        words += ["--scenario", self.scenario, "--law", self.law]
        words += [word for name, path in self._given.items() if path for word in (name, str(path))]
        words += ["--try" if self.on_twin else "--no-try", "--window", repr(self.window)]
        words += ["--generations", str(self.effort.generations), "--population", str(self.effort.population)]
        return [*words, "--seed", str(self.seed), "--out", str(self.out)]

    @property
    def files(self) -> list[Path]:
        """The files that the result is made from."""
        named = [Path(name) for name in (self.robot, self.scenario) if Path(name).is_file()]
        return [*named, *(path for path in self._given.values() if path)]

    @property
    def _given(self) -> dict[str, Path | None]:
        return {"--controller": self.controller, "--found": self.found, "--bounds": self.bounds}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Read:
    """What the command line's files hold."""

    robot: Robot
    controller: Controller
    scenario: Scenario
    bounds: Bounds | None
    deviations: NDArray[np.float64] | None

    @property
    def options(self) -> dict[str, object]:
        """What the numbers depend on besides the robot."""
        return {
            "controller": digest(controller_text(self.controller)).hex(),
            "scenario": digest(scenario_text(self.scenario)).hex(),
            "deviations": digest(self.deviations).hex(),
            "bounds": self.bounds,
        }


def _find(asked: _Asked, read: _Read, *, run: Run, bar: Bar) -> Excitation:
    return find(
        read.robot,
        read.controller,
        limits=asked.limits,
        duration=asked.duration,
        scenario=read.scenario,
        deviations=read.deviations,
        on_twin=asked.on_twin,
        law=asked.law,
        bounds=read.bounds,
        window=asked.window,
        effort=asked.effort,
        run=replace(run, progress=bar.report),
    )


def _write(result: Excitation, controller: Controller, made: Provenance, folder: Path) -> None:
    design = result.design
    write_reference(design.times, design.poses, folder / "reference.csv")
    write_controller(controller, folder / "controller.toml")
    shown = followed_run(result)
    limits = result.task.limits
    write_text(folder / "run.svg", drawn(lambda: run_figure(shown, limits), name="run"))
    write_text(folder / "errors.svg", drawn(lambda: errors_figure(result), name="errors"))
    results = result.to_dict() | {"provenance": made.to_dict()}
    write_text(folder / "results.json", as_json(results))


def _show(result: Excitation, console: Console) -> None:
    framed = console.is_terminal
    console.print(limits_table(result, framed=framed))
    console.print(errors_table(result, framed=framed))
    for sentence in verdict(result):
        console.print(sentence, soft_wrap=True)
