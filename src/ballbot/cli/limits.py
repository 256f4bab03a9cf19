"""`ballbot limits`: how far a robot may lean and how hard it may be hit."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console

from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.control.controller import Controller
from ballbot.errors import InputError
from ballbot.experiments.league.entrants import entrants_of
from ballbot.experiments.limits.limits import RobotLimits, TwinEdge, find_limits
from ballbot.experiments.limits.loop import Loop
from ballbot.files import write_text
from ballbot.report.json_text import as_json
from ballbot.report.limits_figures import directions_figure, heights_figure, planes_figure
from ballbot.report.provenance import Provenance, provenance
from ballbot.report.study_files import check_folder
from ballbot.report.style import drawn
from ballbot.robot import Robot

#: directions tried on the twin, of the model's
_ON_TWIN = (0, 9, 18, 27)
_MOST_REFINEMENTS = 6  # four million points a plane


@dataclass(frozen=True, kw_only=True)
class _Found:
    """What was found of each controller, by its name."""

    model: dict[str, RobotLimits] = field(default_factory=dict)
    twin: dict[str, Sequence[TwinEdge]] = field(default_factory=dict)


def limits(
    robot: str,
    controllers: tuple[str, ...] = ("none", "full"),
    /,
    *,
    grip: float = 1.0,
    refinements: int = 5,
    twin: bool = False,
    scenario: str = "nominal",
    seed: int = 1,
    out: Path,
) -> None:
    """Find the limits of a robot with its controllers: the leans and the blows that it survives.

    Two limits are found, and the truth lies between them: up to the first no wheel lets go of the ball; the second
    takes the wheels to hold whatever they push. Both know the torque limit and the motors' highest speed.

    Writes planes.svg (lean and lean rate in the worst direction), directions.svg, heights.svg and results.json.

    Example: ballbot limits found/robot.toml none full --twin --out limits

    Parameters
    ----------
    robot
        A preset's name or a robot file, with its friction.
    controllers
        Controller files, or none, full and partial: the nominal gain with that compensation.
    grip
        Friction coefficient of the wheels on the ball.
    refinements
        Times that the planes' coarse grid is halved along the edge; 5 make a million points, 0 to 6.
    twin
        Find the limits on the twin as well, in four directions.
    scenario
        Of the twin.
    seed
        Of the twin's runs.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    chosen = {one.name: _law(one.name, one.controller(described)) for one in entrants_of(controllers)}
    if not grip > 0.0:
        raise InputError(
            f"--grip is {grip:g}; it must be a positive friction coefficient, 1 for rubber on rubber."
        )
    if not 0 <= refinements <= _MOST_REFINEMENTS:
        raise InputError(f"--refinements is {refinements}; it must be 0 to {_MOST_REFINEMENTS}.")
    folder, console, found = check_folder(out), standard_output(), _Found()
    with progress_bar(console, "limits") as bar:
        for place, (name, controller) in enumerate(chosen.items()):

            def tell(share: float, place: int = place, name: str = name) -> None:
                bar.show((place + share) / len(chosen), note=name)

            loop = Loop(robot=described, controller=controller, grip=grip)
            found.model[name] = find_limits(loop, refinements=refinements, tell=tell)
            if twin:
                bar.show((place + 1) / len(chosen), note=f"{name}, on the twin")
                found.twin[name] = _on_twin(loop, scenario, found.model[name], seed)
    words = [
        "ballbot",
        "limits",
        robot,
        *controllers,
        "--grip",
        repr(grip),
        "--refinements",
        str(refinements),
    ]
    words += [*(["--twin"] if twin else []), "--scenario", scenario, "--seed", str(seed), "--out", str(out)]
    files = [Path(word) for word in (robot, *controllers) if Path(word).is_file()]
    _write(found, described, grip, provenance(command=shlex.join(words), files=files, seed=seed), folder)
    _show(found, console)
    console.print(str(folder / "results.json"), soft_wrap=True)


def _law(name: str, controller: object) -> Controller:
    if not isinstance(controller, Controller):
        raise InputError(f"{name} is a controller of your own; limits are found for controller files only.")
    return controller


def _on_twin(loop: Loop, scenario: str, found: RobotLimits, seed: int) -> Sequence[TwinEdge]:
    from ballbot.experiments.limits.twin_edges import twin_edges  # MuJoCo is an extra
    from ballbot.twin import Scenario

    truth = Scenario.load(scenario, loop.robot)
    return twin_edges(loop.robot, loop.controller, truth, found, directions=_ON_TWIN, seed=seed)


def _write(found: _Found, robot: Robot, grip: float, made: Provenance, folder: Path) -> None:
    by_controller = {
        name: one.to_dict()
        | {"twin": [asdict(edge) | {"agrees": edge.agrees} for edge in found.twin.get(name, ())]}
        for name, one in found.model.items()
    }
    results = {"robot": robot.name, "grip": grip, "controllers": by_controller, "provenance": made.to_dict()}
    write_text(folder / "results.json", as_json(results))
    write_text(folder / "planes.svg", drawn(lambda: planes_figure(found.model), name="planes"))
    write_text(
        folder / "directions.svg",
        drawn(lambda: directions_figure(found.model, found.twin), name="directions"),
    )
    write_text(folder / "heights.svg", drawn(lambda: heights_figure(found.model), name="heights"))


def _show(found: _Found, console: Console) -> None:
    framed = console.is_terminal
    headings = ("controller", "lean at rest (degrees)", "blow (N s)")
    title = "Survived from every direction: no wheel lets go / if the wheels always hold"
    console.print(table(title, headings, limit_rows(found.model), framed=framed))
    if found.twin:
        headings = ("controller", "limit", "towards", "no wheel lets go", "on the twin", "wheels always hold")
        console.print(table("On the twin", headings, twin_rows(found.twin), framed=framed))


def limit_rows(found: Mapping[str, RobotLimits]) -> list[list[str]]:
    """Return a row for each controller: least lean and blow at the centre of mass over all directions."""
    rows = []
    for name, one in found.items():
        leans = [np.degrees(edge.sizes.min()) for edge in (one.lean.sure, one.lean.most)]
        blows = [one.blow_at_center(edge).min() for edge in (one.blow.sure, one.blow.most)]
        rows.append([name, f"{leans[0]:.1f} / {leans[1]:.1f}", f"{blows[0]:.1f} / {blows[1]:.1f}"])
    return rows


def twin_rows(on_twin: Mapping[str, Sequence[TwinEdge]]) -> list[list[str]]:
    """Return a row for each limit that was found on the twin."""
    rows = []
    for name, edges in on_twin.items():
        for edge in edges:
            unit, word = (180.0 / np.pi, "lean (degrees)") if edge.kind == "lean" else (1.0, "blow (N s)")
            sizes = [f"{unit * size:.1f}" for size in (edge.sure, edge.twin, edge.most)]
            rows.append([name, word, f"{np.degrees(edge.direction):.0f}°", *sizes])
    return rows
