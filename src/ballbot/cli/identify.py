"""`ballbot identify`: a robot's friction, and other parameters on request, from balancing logs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from ballbot.cli.context import (
    RUN_HERE,
    CommandResult,
    LongResult,
    RunOptions,
    WholeNumber,
    input_files,
    named_files,
    names_listed,
    open_long_result,
    read_balancing_log,
)
from ballbot.cli.findings import Accept, check_input
from ballbot.cli.output import Bar, table
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.fitting.checkpoint import identity
from ballbot.fitting.model_selection import Gain, ModelSelection
from ballbot.identification import (
    Bounds,
    HoldoutResult,
    Identification,
    Progress,
    cross_validate,
    read_bounds,
    select_law,
)
from ballbot.identification import identify as find
from ballbot.identification.holdout import InitialStates
from ballbot.identification.laws import LAWS, LawName, law_named, law_results
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.stages import IdentificationOptions
from ballbot.identification.sweep import SweepFriction, read_sweep
from ballbot.identification.windows import back_emf_of
from ballbot.log import Log
from ballbot.log.checks import CheckedLogs
from ballbot.log.pose import causal_states
from ballbot.report.friction import ladder_figure
from ballbot.report.style import drawn
from ballbot.report.tables import digits
from ballbot.robot import Robot
from ballbot.robot.file import write_robot


def parameter_table(found: Identification, *, framed: bool) -> Table:
    """Return each parameter with its standard error, 95 % interval and unit."""
    units = [
        BY_NAME[name].unit
        for name in found.layout.names
        for _ in BY_NAME[name].labels(found.layout.wheel_count)
    ]
    values, errors = _flat(found.parameters), _flat(found.standard_errors)
    rows = [
        (label, digits(value), digits(error, 2), _interval(found, label), unit)
        for label, value, error, unit in zip(found.labels, values, errors, units, strict=True)
    ]
    headings = ("parameter", "value", "standard error", "95 % interval", "unit")
    return table("found", headings, rows, framed=framed)


def error_table(found: Identification, holdouts: Sequence[HoldoutResult], *, framed: bool) -> Table:
    """Return the open-loop errors of each state: on windows held out, and their ratios on other logs."""
    ours = found.held_out
    rows = [
        (
            state,
            digits(ours.with_friction[state]),
            digits(ours.without_friction[state]),
            f"{ratio:.2f}",
            *(f"{one.errors.ratios[state]:.2f}" for one in holdouts),
        )
        for state, ratio in ours.ratios.items()
    ]
    title = f"Open-loop error (4.1) on {ours.windows} held-out windows" + (
        "; ratio on other logs" * bool(holdouts)
    )
    headings = ("state", "with friction", "without", "ratio", *(one.name for one in holdouts))
    return table(title, headings, rows, framed=framed)


def horizon_table(holdout: HoldoutResult, *, framed: bool) -> Table:
    """Return the errors of the wheels' speeds and of the lean by horizon, on another log."""
    rows = [
        (
            f"{one.horizon:.3g}",
            digits(one.wheel_speed.with_friction),
            digits(one.wheel_speed.viscous_part),
            digits(one.wheel_speed.without_friction),
            digits(one.wheel_speed.share, 2),
            digits(math.degrees(one.lean.with_friction)),
            digits(math.degrees(one.lean.without_friction)),
            digits(one.lean.share, 2),
        )
        for one in holdout.horizons
    ]
    known = "past rows" if holdout.causal else "its rows"
    title = f"{holdout.name}, RMSE of {holdout.horizons[0].starts} predictions from {known}"
    headings = (
        "after, s",
        "wheel speed, rad/s",
        "viscous part",
        "without friction",
        "friction wanted",
        "lean, deg",
        "without friction",
        "friction wanted",
    )
    return table(title, headings, rows, framed=framed)


def selection_table(selection: ModelSelection[Identification], *, framed: bool) -> Table:
    """Return the laws with their errors and gains on windows held out."""
    rows = [
        (
            one.name,
            law_named(one.name).formula,
            f"{one.error:.3f}",
            one.within or "no friction",
            _gain(one.gain) if one.gain else "",
            "best" if one is selection.best else "taken" if one.accepted else "not selected",
        )
        for one in selection.candidates
    ]
    headings = ("law", "friction", "error", "compared with", "gain, 95 % interval", "")
    return table(
        "Friction laws on held-out windows: error relative to no friction", headings, rows, framed=framed
    )


def _flat(values: dict[str, list[float] | float]) -> list[float]:
    return [one for value in values.values() for one in (value if isinstance(value, list) else [value])]


def _interval(found: Identification, label: str) -> str:
    interval = found.intervals.get(label)
    return "" if interval is None else f"{digits(interval.lower)} .. {digits(interval.upper)}"


def _gain(gain: Gain) -> str:
    return f"{100 * gain.share:.1f} % ({100 * gain.lower:.1f} .. {100 * gain.upper:.1f})"


_WRITTEN = ("robot.toml", "results.json", "ladder.svg")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """What is estimated, and how."""

    estimate: str = "friction"
    """What to estimate, separated by commas: friction, rigid_body (center_of_mass, second_moment), ball_inertia,
    wheel_inertia, rotor_inertia, torque (torque_gain, torque_offset, delay), delays (delay, imu_delay,
    velocity_delay), bias (lean_bias, gyro_bias), pivoting (resistance of the floor to turning on the spot), or
    single quantities of friction, such as viscous."""

    law: Literal["viscous", "coulomb", "stribeck", "asymmetric", "directed", "load", "best"] = "stribeck"
    """The friction law of the wheels. best fits each in turn, shows how much each improves the prediction of held-out
    windows, and keeps the law that improves it clearly."""

    exclude_states: str = ""
    """States whose errors do not count in the fit, separated by commas, such as psi,psi_dot if the ball pivots on the
    floor."""

    bounds: Path | None = None
    """A TOML file with lower and upper bounds, such as: coulomb = [0.0, 0.5]. Equal bounds fix a value."""

    sweep: Path | None = None
    """results.json of `ballbot identify-driveline`: its b and c are combined with what the logs show, weighted by
    their uncertainties. With --estimate torque_gain only the ratios between the wheels count."""

    window: float = 0.25
    """Length of the predicted windows, in seconds."""

    seed: WholeNumber = 0
    """Random seed. The same seed gives the same result."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """How the logs are read, and those that are not fitted."""

    holdout: Annotated[list[Path] | None, Parameter(negative="")] = None
    """A log that is not fitted, on which the result is validated. May be given more than once."""

    mapping: Annotated[list[Path] | None, Parameter(negative="")] = None
    """A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it: one for all
    logs, or one for each, in the order of the logs and then of those of --holdout."""


_FIT, _READING = FitOptions(), LogOptions()


def identify(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    fit: FitOptions = _FIT,
    reading: LogOptions = _READING,
    accept: Accept = None,
    run: RunOptions = RUN_HERE,
) -> None:
    """Identify a robot's friction from its logs: b, c, s of each wheel, v_s, delta and C_rr; with --estimate also more.

    Writes robot.toml (the robot with the identified values) and results.json; with --law best also ladder.svg.

    While it runs, checkpoint.jsonl in the same folder holds the results so far. --resume continues an interrupted
    or killed run from there and gives the same result, byte for byte.

    Example: ballbot identify alten square.csv hold.csv --out found

    Example: ballbot identify alten square.csv --estimate friction,delay,torque_gain --law best --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    logs
        One or more logs of the robot balancing, with torques and states.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    sweep = read_sweep(fit.sweep, wheel_count=described.wheel_count) if fit.sweep else None
    mappings = reading.mapping or []
    named, others = _logs(logs, reading.holdout or [], mappings, described)
    bounds = read_bounds(fit.bounds) if fit.bounds else Bounds()
    checked = _checked(robot, described, named, others, accept)
    back_emf = _back_emf(mappings)
    depends_on = {
        "free": fit.estimate,
        "law": fit.law,
        "leave_out": fit.exclude_states,
        "back_emf": back_emf,
        "seed": fit.seed,
        "window": fit.window,
        "bounds": bounds,
        "sweep": None if sweep is None else sweep.digest,
    }
    with open_long_result(
        out,
        command="identify",
        writes=_WRITTEN,
        inputs=input_files(robot, logs, reading.holdout, mappings, fit.bounds, fit.sweep),
        belongs_to=identity(described, [one.log for one in named.values()], depends_on),
        seed=fit.seed,
        run=run,
    ) as result:
        with result.progress("identifying") as bar:
            task = _Task(
                robot=described, logs=checked, fit=fit, bounds=bounds, sweep=sweep, back_emf=back_emf
            )
            found, selection = _find(task, result=result, bar=bar)
        holdouts = [
            cross_validate(found, one.log, name=name, starts=one.starts(described))
            for name, one in others.items()
        ]
        with result.replaced() as new:
            written = _write(found, selection, holdouts, result, new)
    _show(found, selection, holdouts, result.console)
    result.show_file(*written)


@dataclass(frozen=True, kw_only=True)
class _Task:
    """What is to be identified, from what."""

    robot: Robot
    logs: CheckedLogs
    fit: FitOptions
    bounds: Bounds
    sweep: SweepFriction | None
    back_emf: float  #: what the motors brake with [N m s/rad]


def _back_emf(mappings: Sequence[Path]) -> float:
    """Return what the motors brake with [N m s/rad].

    Raises
    ------
    InputError
        If the mappings differ in it.
    """
    found = {round(back_emf_of(mapping), 12) for mapping in mappings}
    if len(found) > 1:
        raise InputError(
            "The motors of the mappings have back-EMF damping of "
            f"{', '.join(f'{b:g}' for b in sorted(found))} N m s/rad; logs of one "
            "robot must have the same supply voltage, resistance and motor constants."
        )
    return found.pop() if found else 0.0


@dataclass(frozen=True, kw_only=True)
class _Named:
    """A log and where it came from."""

    log: Log
    path: Path
    mapping: Path | None

    def starts(self, robot: Robot) -> InitialStates | None:
        """Return what gives the states known at times of its rows; None where its rows are the file's own."""
        mapping = self.mapping
        if mapping is None:
            return None
        return lambda moments: causal_states(self.path, mapping=mapping, robot=robot, moments=moments)


def _logs(
    fitted: Sequence[Path], held_out: Sequence[Path], mappings: Sequence[Path], robot: Robot
) -> tuple[dict[str, _Named], dict[str, _Named]]:
    """Read the logs to fit and those to validate on; a log without a position gets that of its wheels."""
    named = named_files(fitted)
    others = named_files(held_out) if held_out else {}
    count = len(named) + len(others)
    if len(mappings) not in (0, 1, count):
        raise InputError(
            f"--mapping is given {len(mappings)} times for {count} "
            "logs; give one for all logs, or one for each."
        )
    of_each = iter(mappings if len(mappings) == count else (*mappings, None)[:1] * count)

    def read(path: Path) -> _Named:
        mapping = next(of_each)
        return _Named(log=read_balancing_log(path, mapping, robot), path=path, mapping=mapping)

    return {name: read(path) for name, path in named.items()}, {
        name: read(path) for name, path in others.items()
    }


def _checked(
    source: str,
    robot: Robot,
    named: Mapping[str, _Named],
    others: Mapping[str, _Named],
    accept: list[str] | None,
) -> CheckedLogs:
    """Check all logs together, as they are one robot's; return those to fit, with the findings of all."""
    both = (*named.values(), *others.values())
    findings = check_input(
        robot,
        {one.path: one.log for one in both},
        accept=accept,
        source=source,
        mappings={one.path: one.mapping for one in both},
    )
    return CheckedLogs(logs={name: one.log for name, one in named.items()}, findings=findings)


def _find(
    task: _Task, *, result: LongResult, bar: Bar
) -> tuple[Identification, ModelSelection[Identification] | None]:
    """Fit the given law, or each law and select one."""
    options = task.fit
    laws = [law.name for law in LAWS] if options.law == "best" else [options.law]

    def fit(law: LawName, start: Identification | None) -> Identification:
        def show(progress: Progress) -> None:
            share = (laws.index(law) + progress.share) / len(laws)
            bar.show(share, note=f"{law}, error x {math.exp(progress.cost):.3f}")

        return find(
            task.robot,
            task.logs,
            free=names_listed(options.estimate),
            law=law,
            bounds=task.bounds,
            window=options.window,
            options=IdentificationOptions(
                excluded_states=tuple(names_listed(options.exclude_states)),
                back_emf=task.back_emf,
                warm_start=start,
                sweep=task.sweep,
            ),
            run=result.run_with(show),
        )

    if options.law == "best":
        selection = select_law(fit)
        return selection.best.model, selection
    return fit(options.law, None), None


def _write(
    found: Identification,
    selection: ModelSelection[Identification] | None,
    holdouts: Sequence[HoldoutResult],
    result: CommandResult,
    folder: Path,
) -> list[str]:
    """Write the results and return the names of what people read."""
    results = found.to_dict()
    if selection:
        results["ladder"] = law_results(selection)
    if holdouts:
        results["judged_on"] = {one.name: one.to_dict() for one in holdouts}
    write_robot(found.robot, folder / "robot.toml")
    result.write_json(results, folder)
    if selection is None:
        return ["robot.toml"]
    write_text(folder / "ladder.svg", drawn(lambda: ladder_figure(selection), name="ladder"))
    return ["robot.toml", "ladder.svg"]


def _show(
    found: Identification,
    selection: ModelSelection[Identification] | None,
    holdouts: Sequence[HoldoutResult],
    console: Console,
) -> None:
    framed = console.is_terminal
    if selection:
        console.print(selection_table(selection, framed=framed))
    console.print(parameter_table(found, framed=framed))
    console.print(error_table(found, holdouts, framed=framed))
    for one in holdouts:
        if one.horizons:
            console.print(horizon_table(one, framed=framed))
    for finding in (*found.warnings, *(remark for one in holdouts for remark in one.remarks)):
        console.print(finding.text, markup=False, soft_wrap=True)
