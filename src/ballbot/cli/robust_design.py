"""`ballbot design --robust`: the weights sought over perturbed robots."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from ballbot.cli.findings import Accept, accept_words
from ballbot.cli.long_run import long_run
from ballbot.cli.output import matrix_text, progress_bar, standard_output, table
from ballbot.control.controller import Compensation
from ballbot.control.file import controller_text
from ballbot.errors import InputError
from ballbot.experiments.robust_design.design import Effort, RobustDesign, robust_design
from ballbot.experiments.robust_design.perturbed import Spread
from ballbot.files import write_text
from ballbot.fitting.checkpoint import identity
from ballbot.mechanics.model import Model
from ballbot.printable import shell_line
from ballbot.report.json_text import as_json
from ballbot.report.linearization import linearization_results
from ballbot.report.provenance import provenance
from ballbot.report.robust_figures import robust_figure
from ballbot.report.style import drawn
from ballbot.result_folder import result_folder
from ballbot.robot import Friction, Robot

#: of a design with and without a search
DESIGN_FILES = ("controller.toml", "results.json", "robust.svg")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RobustOptions:
    """What a search for robust weights is told; without --robust it has no effect."""

    perturb: str = ""
    """Ranges of the perturbed robots: mass=0.2,height=0.2,friction=0.2 (fractions), delay=2 (samples), tilt=1 (degrees
    of the floor). What is not named keeps these values."""

    robots: int = Effort.robots
    """Number of perturbed robots on which each candidate is tested."""

    generations: int = Effort.generations
    """Largest number of generations of the search."""

    population: int = Effort.population
    """Candidates in each generation."""

    fresh: int = Effort.fresh
    """Number of other robots on which the result is compared with the nominal weights and a plain LQR."""

    seed: int = 0
    """Random seed. The same seed gives the same result."""

    resume: Annotated[bool, Parameter(negative="")] = False
    """Continue an interrupted search in the same folder."""


def design_robustly(
    source: str,
    *,
    sample_time: float | None,
    compensation: Compensation,
    options: RobustOptions,
    accept: Accept,
    out: Path,
) -> None:
    """Seek the weights, and write controller.toml, results.json and robust.svg."""
    robot = Robot.load(source)
    if sample_time is not None:
        robot = robot.replace(sensors=replace(robot.sensors, sample_time=sample_time))
    spread = spread_of(options.perturb)
    effort = Effort(
        robots=options.robots,
        generations=options.generations,
        population=options.population,
        fresh=options.fresh,
    )
    console = standard_output()
    words = [*_words(source, sample_time, compensation, options, out), *accept_words(accept)]
    files = [Path(source)] if Path(source).is_file() else []
    asked = {"compensation": compensation, "seed": options.seed, **asdict(spread), **asdict(effort)}
    with (
        result_folder(out, command="design", names=DESIGN_FILES, inputs=files, resumes=True) as folder,
        long_run(
            folder.path,
            words=words,
            belongs_to=identity(robot, [], asked),
            resume=options.resume,
            cluster=None,
        ) as run,
        progress_bar(console, "robust design") as bar,
    ):
        found = robust_design(
            robot,
            compensation=compensation,
            spread=spread,
            effort=effort,
            seed=options.seed,
            tell=lambda share, note: bar.show(share, note=note),
            recall=run.recall,
        )
        command = shell_line(words)
        made = provenance(command=command, files=files, seed=options.seed)
        results = {
            "robot": robot.name,
            "sample_time": found.controller.sample_time,
            "compensation": compensation,
            "gain": found.controller.gain,
            "poles": [[pole.real, pole.imag] for pole in found.design.poles.tolist()],
            "linearization": linearization_results(
                Model(robot.replace(friction=Friction.none(robot.wheel_count)))
            ),
            **found.to_dict(),
            "perturbed": asdict(spread),
            "provenance": made.to_dict(),
        }
        with folder.replaced() as new:
            how = _how(found, command) + controller_text(found.controller)
            write_text(new / "controller.toml", how)
            write_text(new / "robust.svg", drawn(lambda: robust_figure(found), name="robust"))
            write_text(new / "results.json", as_json(results))
    _show(found, console)
    console.print(str(folder.path / "controller.toml"), soft_wrap=True)


def spread_of(text: str) -> Spread:
    """Return the spread that a text such as mass=0.2,tilt=1 asks for.

    Raises
    ------
    InputError
        Where a name or a number is none.
    """
    names = [one.name for one in fields(Spread)]
    given: dict[str, float | int] = {}
    for part in filter(None, text.split(",")):
        name, _, number = part.partition("=")
        if name not in names:
            raise InputError(
                f"--perturb has no {name!r}; it has {', '.join(names)}, such as mass=0.2,delay=2."
            )
        try:
            given[name] = int(number) if name == "delay" else float(number)
        except ValueError:
            kind = "a whole number" if name == "delay" else "a number"
            raise InputError(f"--perturb gives {name} as {number!r}; it must be {kind}.") from None
    return replace(Spread(), **given)


def _words(
    source: str, sample_time: float | None, compensation: str, options: RobustOptions, out: Path
) -> list[str]:
    words = ["ballbot", "design", source, "--robust", "--compensation", compensation]
    words += [] if sample_time is None else ["--sample-time", repr(sample_time)]
    words += ["--perturb", options.perturb] if options.perturb else []
    for name in ("robots", "generations", "population", "fresh", "seed"):
        words += [f"--{name}", str(getattr(options, name))]
    return [*words, "--out", str(out)]


def _how(found: RobustDesign, command: str) -> str:
    """Return the comment that says how the gain was found."""
    weights = ", ".join(f"{weight:.4g}" for weight in found.state_weights)
    rivals = {name: f"{one.worst_tenth:.3g}" for name, one in found.rivals.items()}
    return (
        f"# Found by: {command}\n"
        f"# Q = diag({weights}), R = {found.torque_weight:g} I\n"
        f"# worst tenth of J on {found.fresh} fresh robots: {rivals['robust']}; nominal gain {rivals['nominal']}, "
        f"plain LQR {rivals['plain']}\n\n"
    )


def _show(found: RobustDesign, console: Console) -> None:
    console.print(matrix_text("K", found.controller.gain), markup=False, soft_wrap=True)
    headings = ("design", "worst tenth of J", "mean J", "worst error (mm)", "worst roughness (N m)", "falls")
    rows = [
        [
            name,
            f"{one.worst_tenth:.2f}",
            f"{one.mean:.2f}",
            f"{1e3 * one.worst_error:.1f}",
            f"{one.worst_roughness:.3f}",
            f"{one.falls}",
        ]
        for name, one in found.rivals.items()
    ]
    title = f"On {found.fresh} perturbed robots that the search did not use"
    console.print(table(title, headings, rows, framed=console.is_terminal))
    weights = ", ".join(f"{weight:.4g}" for weight in found.state_weights)
    console.print(f"Q = diag({weights}), R = {found.torque_weight:g} I", soft_wrap=True)
