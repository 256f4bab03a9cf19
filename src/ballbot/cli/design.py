"""`ballbot design`: a controller file for a robot; with `--robust` the weights are searched on perturbed robots."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from ballbot.cli.context import RunOptions, WholeNumber, input_files, open_long_result, open_result
from ballbot.cli.controllers import warn_of_idle_compensation
from ballbot.cli.findings import Accept, check_robot
from ballbot.cli.output import matrix_text, table
from ballbot.control.controller import Compensation, Controller
from ballbot.control.file import controller_text, write_controller
from ballbot.control.lqr import LqrDesign
from ballbot.control.overcompensation import (
    CompensationMargin,
    certain_friction,
    compensation_margin,
    refuse_overcompensation,
)
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import (
    NOMINAL_STATE_WEIGHTS,
    NOMINAL_TORQUE_WEIGHT,
    PRECISE_STATE_WEIGHTS,
    IntegralDesign,
    design_gain,
    design_integral_gain,
    precise_controller,
)
from ballbot.control.presets import adaptive as with_adaptations
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.fitting.checkpoint import identity
from ballbot.mechanics.model import Model
from ballbot.report.design import robust_figure
from ballbot.report.style import drawn
from ballbot.results import to_results
from ballbot.robot import Friction, Robot
from ballbot.robot.components import scaled_friction
from ballbot.robot.variations import Propagated, propagate
from ballbot.workflows.perturbed_robots import PerturbationRanges
from ballbot.workflows.robot_check import linearization_results, state_order
from ballbot.workflows.robust_design import Effort, RobustDesign, robust_design

#: of a design with and without a search
DESIGN_FILES = ("controller.toml", "results.json", "robust.svg")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RobustOptions:
    """Options of the search for robust weights; without --robust they have no effect."""

    perturb: str = ""
    """Ranges of the perturbed robots: mass=0.2,height=0.2,friction=0.2 (fractions), delay=2 (samples), tilt=1 (degrees
    of the floor). What is not named keeps these values."""

    robots: WholeNumber = Effort.robots
    """Number of perturbed robots on which each candidate is tested."""

    generations: WholeNumber = Effort.generations
    """Largest number of generations of the search."""

    population: WholeNumber = Effort.population
    """Candidates in each generation."""

    fresh: WholeNumber = Effort.fresh
    """Number of other robots on which the result is compared with the nominal weights and a plain LQR."""

    seed: WholeNumber = 0
    """Random seed. The same seed gives the same result."""

    resume: Annotated[bool, Parameter(negative="")] = False
    """Continue an interrupted search in the same folder."""


def design_robustly(
    robot: Robot,
    *,
    compensation: Compensation,
    options: RobustOptions,
    inputs: Sequence[Path],
    out: Path,
) -> None:
    """Search for the weights, and write controller.toml, results.json and robust.svg."""
    spread = spread_of(options.perturb)
    effort = Effort(
        robots=options.robots,
        generations=options.generations,
        population=options.population,
        fresh=options.fresh,
    )
    depends_on = {"compensation": compensation, "seed": options.seed, **asdict(spread), **asdict(effort)}
    with (
        open_long_result(
            out,
            command="design",
            writes=DESIGN_FILES,
            inputs=inputs,
            belongs_to=identity(robot, [], depends_on),
            seed=options.seed,
            run=RunOptions(resume=options.resume),
        ) as result,
        result.progress("robust design") as bar,
    ):
        found = robust_design(
            robot,
            compensation=compensation,
            spread=spread,
            effort=effort,
            run=result.run_with(lambda now: bar.show(now.share, note=now.note)),
        )
        results = {
            "robot": robot.name,
            "sample_time": found.controller.sample_time,
            "compensation": compensation,
            "gain": found.controller.gain,
            "poles": found.design.poles,
            "linearization": linearization_results(_designed_on(robot)),
            **to_results(found),
        }
        with result.replaced() as new:
            origin = _origin_comment(found, result.origin.command)
            write_text(new / "controller.toml", origin + controller_text(found.controller))
            write_text(new / "robust.svg", drawn(lambda: robust_figure(found), name="robust"))
            result.write_json(results, new)
    _show_robust(found, result.console)
    result.show_file("controller.toml")


def spread_of(text: str) -> PerturbationRanges:
    """Return the ranges that a text such as mass=0.2,tilt=1 states.

    Raises
    ------
    InputError
        If a name or a number is not valid.
    """
    names = [one.name for one in fields(PerturbationRanges)]
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
    return replace(PerturbationRanges(), **given)


def _origin_comment(found: RobustDesign, command: str) -> str:
    """Return the comment on how the gain was found."""
    weights = ", ".join(f"{weight:.4g}" for weight in found.state_weights)
    designs = {name: f"{one.worst_tenth:.3g}" for name, one in found.compared.items()}
    return (
        f"# Found by: {command}\n"
        f"# Q = diag({weights}), R = {found.torque_weight:g} I\n"
        f"# worst tenth of J on {found.fresh} fresh robots: {designs['robust']}; nominal gain {designs['nominal']}, "
        f"plain LQR {designs['plain']}\n\n"
    )


def _show_robust(found: RobustDesign, console: Console) -> None:
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
        for name, one in found.compared.items()
    ]
    title = f"On {found.fresh} perturbed robots that the search did not use"
    console.print(table(title, headings, rows, framed=console.is_terminal))
    weights = ", ".join(f"{weight:.4g}" for weight in found.state_weights)
    console.print(f"Q = diag({weights}), R = {found.torque_weight:g} I", soft_wrap=True)


Kind = Literal["nominal", "precise"]

_SEARCH = RobustOptions()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class GainOptions:
    """How the gain is designed."""

    kind: Kind = "nominal"
    """nominal: the thesis's soft gain; precise: a stiff one that holds its position."""

    q: str | None = None
    """Weights of x y theta phi psi and of their rates: ten numbers separated by commas. If not given, those of the
    kind."""

    r: float = NOMINAL_TORQUE_WEIGHT
    """Weight of each wheel's torque."""

    sample_time: float | None = None
    """Time between two updates [s]; the robot's own if not given."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PartOptions:
    """What the controller has beside its gain."""

    compensation: Compensation | None = None
    """none; full (all friction); partial (only while friction works against the intended motion). If not given, none
    for the nominal kind and full for the precise one."""

    compensation_gain: float = 1.0
    """Factor on the compensated friction, below 1 if it is uncertain."""

    notch: float | None = None
    """A frequency [Hz] to remove from the torques, such as a resonance that `ballbot validate` reports."""

    delay: float | None = None
    """Time from a measurement until the torque computed from it acts [s]. The controller feeds back the state
    predicted for that time. `ballbot identify --estimate delays` estimates it."""

    adaptive: Annotated[bool, Parameter(negative="")] = False
    """Adapt the precise kind to the floor's friction, within limits."""

    allow_overcompensation: Annotated[bool, Parameter(negative="")] = False
    """Write the controller even if it compensates more friction than is certain."""


_GAIN, _PARTS = GainOptions(), PartOptions()


def design(
    robot: str,
    /,
    *,
    weights: GainOptions = _GAIN,
    parts: PartOptions = _PARTS,
    robust: Annotated[bool, Parameter(negative="")] = False,
    search: RobustOptions = _SEARCH,
    accept: Accept = None,
    out: Path,
) -> None:
    """Design a controller: sampled LQR on the exact model, with friction compensation.

    Example: ballbot design alten --q 20,20,500,500,5,30,30,20,20,2 --r 30 --compensation full --out soft

    Example: ballbot design found/robot.toml --kind precise --out precise

    Example: ballbot design found/robot.toml --kind precise --delay 0.016 --adaptive --out precise

    Example: ballbot design found/robot.toml --robust --compensation full --out robust

    Writes controller.toml and results.json (gain, closed-loop poles, A and B). The precise kind is stiff and has
    integral action, smoothed references with feed-forward and a disturbance observer;
    it needs the Kalman filter's state. Standard deviations in the robot's file are carried through to each entry of the
    gain; those of its friction limit the compensation to the friction that is present with 95 % confidence. More than
    that injects energy and can destabilise the robot: it is refused, and the margin is shown.

    Parameters
    ----------
    robot
        A preset's name or a robot file. Its friction is compensated; the gain is designed without it.
    robust
        Search for the weights on perturbed simulated robots, for the worst tenth of them. Takes minutes; --resume
        continues an interrupted search.
    out
        The folder to write into.
    """
    if not 0.0 <= parts.compensation_gain < math.inf:
        raise InputError(
            f"--compensation-gain is {parts.compensation_gain:g}; it must be zero or more, such as 0.8."
        )
    described = Robot.load(robot)
    check_robot(described, robot, accept=accept)
    inputs = input_files(robot)
    if robust:
        _refuse_with_robust(weights, parts)
        if weights.sample_time is not None:
            sensors = replace(described.sensors, sample_time=weights.sample_time)
            described = described.replace(sensors=sensors)
        design_robustly(
            described, compensation=parts.compensation or "none", options=search, inputs=inputs, out=out
        )
        return
    designed = _designer(weights)
    with open_result(out, command="design", writes=DESIGN_FILES, inputs=inputs) as result:
        found = designed(described)
        spread = propagate(described, lambda one: designed(one).gain)
        certain = certain_friction(described)
        compensated = described.replace(friction=scaled_friction(certain, parts.compensation_gain))
        controller = _with_parts(_controller(compensated, found, parts.compensation), parts)
        if not parts.allow_overcompensation:
            refuse_overcompensation(controller, certain)
        margin = compensation_margin(controller, certain)
        results = _results(controller, found, spread) | {"compensation_margin": margin}
        with result.replaced() as new:
            write_controller(controller, new / "controller.toml")
            result.write_json(results, new)
    console = result.console
    _show(console, controller.robot, found, spread)
    if certain is not described.friction:
        console.print(_certain(described.friction, certain), soft_wrap=True)
    if controller.compensation != "none":
        console.print(_margin(margin), markup=False, soft_wrap=True)
    warn_of_idle_compensation({"controller.toml": controller}, console)
    result.show_file("controller.toml")


def _refuse_with_robust(weights: GainOptions, parts: PartOptions) -> None:
    """Raise InputError if options are given that a search for the weights decides itself."""
    plain = replace(
        parts,
        compensation=_PARTS.compensation,
        allow_overcompensation=_PARTS.allow_overcompensation,
    )
    if replace(weights, sample_time=None) != _GAIN or plain != _PARTS:
        raise InputError(
            "--robust searches for the weights of the nominal kind; remove --kind, "
            "--q, --r, --compensation-gain, --notch, --delay and --adaptive."
        )


def _designer(options: GainOptions) -> Callable[[Robot], LqrDesign | IntegralDesign]:
    """Return what designs a gain for a robot, with the kind's own weights if none are given."""
    weights = None if options.q is None else _weights(options.q)
    if options.kind == "precise":
        return partial(
            design_integral_gain,
            state_weights=weights or PRECISE_STATE_WEIGHTS,
            torque_weight=options.r,
            sample_time=options.sample_time,
        )
    return partial(
        design_gain,
        state_weights=weights or NOMINAL_STATE_WEIGHTS,
        torque_weight=options.r,
        sample_time=options.sample_time,
    )


def _with_parts(controller: Controller, options: PartOptions) -> Controller:
    """Return the controller with the requested parts.

    Raises
    ------
    InputError
        If a part is not possible, or an adaptation has nothing to follow.
    """
    if options.adaptive:
        plain, controller = controller, with_adaptations(controller)
        if controller.parts == plain.parts:
            raise InputError(
                "--adaptive has nothing to adapt: the nominal kind has no integral action. Add --kind precise."
            )
    parts = controller.parts
    if options.notch is not None:
        parts = replace(parts, notch=Notch(frequency=options.notch))
    if options.delay is not None:
        parts = replace(parts, prediction=DelayPrediction(delay=options.delay))
    return controller.with_parts(parts)


def _controller(
    robot: Robot, found: LqrDesign | IntegralDesign, compensation: Compensation | None
) -> Controller:
    """Return the controller of a design, the compensation its kind's own where none is given."""
    if isinstance(found, IntegralDesign):
        return precise_controller(robot, compensation=compensation or "full", design=found)
    return Controller(robot, found.gain, sample_time=found.sample_time, compensation=compensation or "none")


def _show(console: Console, robot: Robot, found: LqrDesign | IntegralDesign, spread: Propagated) -> None:
    """Print A and B, the gain, how well it is known, and the poles."""
    linear = _designed_on(robot).linearize()
    console.print("x_dot = A x + B u about upright, exact model without friction", style="bold")
    console.print(state_order(robot.wheel_count), markup=False, soft_wrap=True)
    for name, matrix in (("A", linear.A), ("B", linear.B)):
        console.print(matrix_text(name, matrix), markup=False, soft_wrap=True)
    console.print("\nGain", style="bold")
    console.print(matrix_text("K", found.gain), markup=False, soft_wrap=True)
    if spread.parts:
        causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in spread.largest())
        console.print(
            f"\nStandard deviation of the gain, from those in the robot file ({causes}):\n",
            markup=False,
            soft_wrap=True,
        )
        console.print(matrix_text("+-", spread.deviation), markup=False, soft_wrap=True)
    rows = [[f"{pole.real:.4f}", f"{pole.imag:.4f}"] for pole in found.poles]
    console.print(table("Closed-loop poles (rad/s)", ["real", "imaginary"], rows, framed=console.is_terminal))


def _designed_on(robot: Robot) -> Model:
    """Return the model that a gain is designed on: friction is the compensation's business."""
    return Model(robot.replace(friction=Friction.none(robot.wheel_count)))


def _margin(margin: CompensationMargin) -> str:
    """Return how near the compensation comes to the friction that is certain, and whether it exceeds it."""
    shares = ", ".join(
        f"{100.0 * share:.0f} %" for share in (*margin.wheel_fractions, margin.rolling_fraction)
    )
    amplitudes = ", ".join(f"{one.amplitude:g}" for one in margin.swings)
    returned = ", ".join(f"{100.0 * one.fraction:.0f} %" for one in margin.swings)
    text = (
        "Compensated at most, of each wheel's friction and of the rolling "
        f"friction: {shares}\nReturned at most, of the energy that friction "
        f"takes from a wheel that oscillates by {amplitudes} rad/s: {returned}"
    )
    return (
        f"{text}\nWARNING: {margin.sentence}; this injects energy and can destabilise the robot"
        if margin.overcompensates
        else text
    )


def _weights(text: str) -> list[float]:
    try:
        return [float(weight) for weight in text.split(",")]
    except ValueError:
        raise InputError(f"--q is {text!r}; it must be ten numbers separated by commas.") from None


def _certain(found: Friction, compensated: Friction) -> str:
    shares = [
        f"{100.0 * less / whole:.0f} %" if whole else "none"
        for less, whole in zip(compensated.coulomb, found.coulomb, strict=True)
    ]
    return (
        "\nOnly the friction that is certain is compensated, "
        f"as a fraction of each wheel's: {', '.join(shares)}"
    )


def _results(
    controller: Controller, found: LqrDesign | IntegralDesign, spread: Propagated
) -> dict[str, object]:
    return {
        "robot": controller.robot.name,
        "sample_time": controller.sample_time,
        "compensation": controller.compensation,
        "gain": controller.gain,
        "gain_standard_deviation": spread.deviation if spread.parts else None,
        "gain_variance_shares": dict(spread.largest(len(spread.parts))),
        "poles": found.poles,
        "linearization": linearization_results(_designed_on(controller.robot)),
    }
