"""`ballbot design`: a controller file for a robot; with `--robust` the weights are searched on perturbed robots."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ballbot.arguments import numbers_listed
from ballbot.cli import options
from ballbot.cli.context import open_result, robot_words
from ballbot.cli.controllers import warn_of_idle_compensation
from ballbot.cli.findings import checked_robot
from ballbot.control.file import controller_text
from ballbot.control.presets import KINDS, NOMINAL_TORQUE_WEIGHT
from ballbot.errors import InputError
from ballbot.fitting.run import Run
from ballbot.report.design import controller_design_report, robust_design_report, search_comment
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.controller_design import DEFAULT_PARTS, GainOptions, PartOptions, design_controller
from ballbot.workflows.robust_design import Effort, PerturbationRanges, robust_design

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
    r: float = NOMINAL_TORQUE_WEIGHT,
    sample_time: float | None = None,
    parts: Annotated[PartOptions, Parameter(name="*", negative="")] = DEFAULT_PARTS,
    robust: Annotated[bool, Parameter(negative="")] = False,
    perturb: str = "",
    scenario: options.Scenario = "nominal",
    robots: options.WholeNumber = Effort.robots,
    generations: options.WholeNumber = Effort.generations,
    population: options.WholeNumber = Effort.population,
    fresh: options.WholeNumber = Effort.fresh,
    seed: options.Seed = 0,
    accept: options.Accept = None,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Design a controller: sampled LQR on the exact model, with friction compensation.

    Example: ballbot design alten --q 20,20,500,500,5,30,30,20,20,2 --r 30 --compensation full --out soft

    Example: ballbot design found/robot.toml --kind precise --out precise

    Example: ballbot design found/robot.toml --kind precise --delay 0.016 --out precise

    Example: ballbot design found/robot.toml --robust --compensation full --out robust

    Writes report.html, controller.toml and results.json (gain, closed-loop poles, stability margins, A and B). The
    precise kind is stiff and has integral action, smoothed references with feed-forward and a disturbance observer; it
    needs the Kalman filter's state. Standard deviations in the robot's file are propagated to each entry of the
    gain; those of its friction limit the compensation to the friction that is present with 95 % confidence. More than
    that injects energy and can destabilise the robot: it is refused, and the margin is shown.

    Parameters
    ----------
    q
        Weights of x y theta phi psi and of their rates: ten numbers separated by commas. If not given, those of the
        kind.
    r
        Weight of each wheel's torque.
    sample_time
        Time between two updates [s]; the robot's own if not given.
    robust
        Search for the weights on perturbed simulated robots, to minimise the mean cost of the worst tenth of them.
        Takes minutes. The options that follow have no effect without it.
    perturb
        Ranges of the perturbed robots: mass=0.2,height=0.2,friction=0.2 (fractions), delay=2 (samples), tilt=1 (degrees
        of the floor). Ranges that are not named keep these values.
    robots
        Number of perturbed robots on which each candidate is tested.
    generations
        Largest number of generations of the search.
    population
        Candidates in each generation.
    fresh
        Number of other robots on which the result is compared with the nominal weights.
    """
    described, findings = checked_robot(robot, change, accept=accept)
    ten = "ten numbers with commas between"
    gain = GainOptions(
        kind=kind,
        state_weights=None if q is None else numbers_listed(q, "--q", count=10, wanted=ten),
        torque_weight=r,
        sample_time=sample_time,
    )
    if robust:
        own = replace(gain, sample_time=None), replace(parts, allow_overcompensation=False)
        if own != (GainOptions(), replace(DEFAULT_PARTS, compensation=parts.compensation)):
            raise InputError(
                "--robust searches for the weights of the nominal kind; remove --kind, "
                "--q, --r, --compensation-gain, --notch and --delay."
            )
        if gain.sample_time is not None:
            described = described.replace(sensors=replace(described.sensors, sample_time=gain.sample_time))
    effort = Effort(robots=robots, generations=generations, population=population, fresh=fresh)
    spread, truth = PerturbationRanges.parse(perturb), load_scenario(scenario, described)
    doing = "robust design" if robust else "designing the controller"
    with open_result(out, doing=doing, writes=_WRITTEN, seed=seed if robust else 0) as result:
        if robust:
            designed = robust_design(
                described,
                compensation=parts.compensation or "none",
                spread=spread,
                scenario=truth,
                effort=effort,
                run=Run(seed=seed, progress=result.report),
            )
            page = robust_design_report(designed, findings)
            text = search_comment(designed, result.origin.command)
        else:
            designed = design_controller(described, gain=gain, parts=parts)
            page, text = controller_design_report(designed, findings), ""
        files = {"controller.toml": text + controller_text(designed.controller)}
        step = f"`ballbot compare {robot_words(robot, change)} none {result.path('controller.toml')} --out compared`"
        result.write(page, files=files, named=_WRITTEN, next_step=step)
    warn_of_idle_compensation({"controller.toml": designed.controller})
