"""`ballbot identify`: a robot's friction, and other parameters on request, from balancing logs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from ballbot.cli.context import long_run, named_files, names_listed, read_balancing_log
from ballbot.cli.findings import Accept, accept_argv, check_input
from ballbot.cli.output import Bar, progress_bar, standard_output, table
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.fitting.checkpoint import identity
from ballbot.fitting.run import Run
from ballbot.identification import (
    Bounds,
    HoldoutResult,
    Identification,
    ModelSelection,
    Progress,
    cross_validate,
    read_bounds,
    select_model,
)
from ballbot.identification import identify as find
from ballbot.identification.holdout import InitialStates
from ballbot.identification.laws import LAWS, Gain, LawName
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.stages import IdentificationOptions
from ballbot.identification.sweep import SweepFriction, read_sweep
from ballbot.identification.windows import back_emf_of
from ballbot.log import Log
from ballbot.log.apply_mapping import causal_states
from ballbot.log.checks import CheckedLogs
from ballbot.printable import shell_line
from ballbot.report.friction import ladder_figure
from ballbot.report.page import as_json, provenance
from ballbot.report.style import drawn
from ballbot.report.tables import digits
from ballbot.result_folder import result_folder
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


def error_table(found: Identification, judged: Sequence[HoldoutResult], *, framed: bool) -> Table:
    """Return the open-loop errors of each state: on windows held out, and their ratios on other logs."""
    ours = found.held_out
    rows = [
        (
            state,
            digits(ours.with_friction[state]),
            digits(ours.without_friction[state]),
            f"{ratio:.2f}",
            *(f"{one.errors.ratios[state]:.2f}" for one in judged),
        )
        for state, ratio in ours.ratios.items()
    ]
    title = f"Open-loop error (4.1) on {ours.windows} held-out windows" + (
        "; ratio on other logs" * bool(judged)
    )
    headings = ("state", "with friction", "without", "ratio", *(one.name for one in judged))
    return table(title, headings, rows, framed=framed)


def horizon_table(judged: HoldoutResult, *, framed: bool) -> Table:
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
        for one in judged.horizons
    ]
    known = "past rows" if judged.causal else "its rows"
    title = f"{judged.name}, RMSE of {judged.horizons[0].starts} predictions from {known}"
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


def ladder_table(ladder: ModelSelection, *, framed: bool) -> Table:
    """Return the laws with their errors and gains on windows held out."""
    rows = [
        (
            rung.law.name,
            rung.law.formula,
            f"{rung.error:.3f}",
            rung.law.within or "no friction",
            _gain(rung.gain),
            "best" if rung is ladder.best else "taken" if rung.taken else "not selected",
        )
        for rung in ladder.rungs
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


def identify(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    free: str = "friction",
    law: Literal["viscous", "coulomb", "stribeck", "asymmetric", "load", "best"] = "stribeck",
    judge_on: Annotated[list[Path] | None, Parameter(negative="")] = None,
    leave_out: str = "",
    mapping: Annotated[list[Path] | None, Parameter(negative="")] = None,
    bounds: Path | None = None,
    sweep: Path | None = None,
    seed: int = 0,
    window: float = 0.25,
    accept: Accept = None,
    resume: bool = False,
    cluster: str | None = None,
) -> None:
    """Identify a robot's friction from its logs: b, c, s of each wheel, v_s, delta and C_rr; with --free also more.

    Writes robot.toml (the robot with the identified values) and results.json; with --law best also ladder.svg.

    While it runs, checkpoint.jsonl in the same folder holds the results so far. --resume continues an interrupted
    or killed run from there and gives the same result, byte for byte.

    Example: ballbot identify alten square.csv hold.csv --out found

    Example: ballbot identify alten square.csv --free friction,delay,torque_gain --law best --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    logs
        One or more logs of the robot balancing, with torques and states.
    out
        The folder to write into.
    free
        What is estimated, separated by commas: friction, rigid_body (center_of_mass, second_moment), ball_inertia,
        wheel_inertia, rotor_inertia, torque (torque_gain, torque_offset, delay), delays (delay, imu_delay,
        velocity_delay), bias (lean_bias, gyro_bias), pivoting (resistance of the floor to turning on the spot), or
        single quantities of friction, such as viscous.
    law
        The friction law of the wheels. best fits each in turn, shows how much each improves the prediction of held-out
        windows, and keeps the law that improves it clearly.
    judge_on
        A log that is not fitted, on which the result is validated. May be given more than once.
    leave_out
        States whose errors do not count in the fit, separated by commas, such as psi,psi_dot if the ball pivots on the
        floor.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it: one for all
        logs, or one for each, in the order of the logs and then of those of --judge-on.
    bounds
        A TOML file with lower and upper bounds, such as: coulomb = [0.0, 0.5]. Equal bounds fix a value.
    sweep
        results.json of `ballbot identify-driveline`: its b and c are combined with what the logs show, weighted by
        their uncertainties. With --free torque_gain only the ratios between the wheels count.
    seed
        Random seed. The same seed gives the same result.
    window
        Length of the predicted windows, in seconds.
    resume
        Continue an interrupted run in the same folder.
    cluster
        The address of a Dask scheduler on which the work runs, such as tcp://10.0.0.5:8786.
    """
    asked = _Asked(
        robot=robot,
        logs=logs,
        out=out,
        free=free,
        law=law,
        judge_on=tuple(judge_on or ()),
        leave_out=leave_out,
        mappings=tuple(mapping or ()),
        bounds=bounds,
        sweep=sweep,
        seed=seed,
        window=window,
        accept=tuple(accept or ()),
    )
    described = Robot.load(robot)
    free_wheels = read_sweep(sweep, wheel_count=described.wheel_count) if sweep else None
    named, others = _logs(asked, described)
    within = read_bounds(bounds) if bounds else Bounds()
    checked = _checked(asked, described, named, others)
    console = standard_output()
    others_given = {"bounds": within, "sweep": None if free_wheels is None else free_wheels.digest}
    belongs_to = identity(described, [one.log for one in named.values()], asked.options | others_given)
    with (
        result_folder(out, command="identify", names=_WRITTEN, inputs=asked.files, resumes=True) as folder,
        long_run(
            folder.path, words=asked.words, belongs_to=belongs_to, resume=resume, cluster=cluster
        ) as run,
    ):
        with progress_bar(console, "identifying") as bar:
            found, ladder = _find(
                asked,
                described,
                checked,
                within,
                free_wheels,
                run=run,
                bar=bar,
            )
        judged = [
            cross_validate(found, one.log, name=name, starts=one.starts(described))
            for name, one in others.items()
        ]
        with folder.replaced() as new:
            written = _write(asked, found, ladder, judged, new)
    _show(found, ladder, judged, console)
    for name in written:
        console.print(str(folder.path / name), soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """The command line."""

    robot: str
    logs: tuple[Path, ...]
    out: Path
    free: str
    law: LawName | Literal["best"]
    judge_on: tuple[Path, ...]
    leave_out: str
    mappings: tuple[Path, ...]  #: none, one for all logs, or one for each of `logs` and of `judge_on`
    bounds: Path | None
    sweep: Path | None
    seed: int
    window: float
    accept: tuple[str, ...]

    @property
    def back_emf(self) -> float:
        """What the motors brake with [N m s/rad]; InputError where the mappings differ in it."""
        found = {round(back_emf_of(mapping), 12) for mapping in self.mappings}
        if len(found) > 1:
            raise InputError(
                "The motors of the mappings have back-EMF damping of "
                f"{', '.join(f'{b:g}' for b in sorted(found))} N m s/rad; logs of one "
                "robot must have the same supply voltage, resistance and motor constants."
            )
        return found.pop() if found else 0.0

    @property
    def options(self) -> dict[str, object]:
        """What the numbers depend on besides robot, logs and bounds."""
        return {
            "free": self.free,
            "law": self.law,
            "leave_out": self.leave_out,
            "back_emf": self.back_emf,
            "seed": self.seed,
            "window": self.window,
        }

    @property
    def words(self) -> list[str]:
        """The command line that makes this again."""
        words = ["ballbot", "identify", self.robot, *map(str, self.logs), "--out", str(self.out)]
        words += ["--free", self.free] if self.free != "friction" else []
        words += ["--law", self.law] if self.law != "stribeck" else []
        words += [word for path in self.judge_on for word in ("--judge-on", str(path))]
        words += ["--leave-out", self.leave_out] if self.leave_out else []
        words += [word for path in self.mappings for word in ("--mapping", str(path))]
        words += ["--bounds", str(self.bounds)] if self.bounds else []
        words += ["--sweep", str(self.sweep)] if self.sweep else []
        words += ["--seed", str(self.seed), "--window", str(self.window)]
        return [*words, *accept_argv(self.accept)]

    @property
    def files(self) -> list[Path]:
        """The files that the result is made from."""
        robot = [] if self.robot in Robot.presets() else [Path(self.robot)]
        more = [path for path in (self.bounds, self.sweep) if path]
        return [*robot, *self.logs, *self.judge_on, *self.mappings, *more]


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


def _logs(asked: _Asked, robot: Robot) -> tuple[dict[str, _Named], dict[str, _Named]]:
    """Read the logs to fit and those to judge on; a log without a position gets that of its wheels."""
    named = named_files(asked.logs)
    others = named_files(asked.judge_on) if asked.judge_on else {}
    mappings, count = asked.mappings, len(named) + len(others)
    if len(mappings) not in (0, 1, count):
        raise InputError(
            f"--mapping is given {len(mappings)} times for {count} "
            "logs; give one for all logs, or one for each."
        )
    of_each = iter(mappings if len(mappings) == count else (mappings or (None,)) * count)

    def read(path: Path) -> _Named:
        mapping = next(of_each)
        return _Named(log=read_balancing_log(path, mapping, robot), path=path, mapping=mapping)

    fitted = {name: read(path) for name, path in named.items()}
    return fitted, {name: read(path) for name, path in others.items()}


def _checked(
    asked: _Asked, robot: Robot, named: Mapping[str, _Named], others: Mapping[str, _Named]
) -> CheckedLogs:
    """Check all logs together, as they are one robot's; return those to fit, with the findings of all."""
    both = (*named.values(), *others.values())
    findings = check_input(
        robot,
        {one.path: one.log for one in both},
        accept=asked.accept,
        source=asked.robot,
        mappings={one.path: one.mapping for one in both},
    )
    return CheckedLogs(logs={name: one.log for name, one in named.items()}, findings=findings)


def _find(
    asked: _Asked,
    robot: Robot,
    logs: CheckedLogs,
    bounds: Bounds,
    sweep: SweepFriction | None,
    *,
    run: Run,
    bar: Bar,
) -> tuple[Identification, ModelSelection | None]:
    """Fit the law asked for, or climb the ladder."""
    laws = [law.name for law in LAWS] if asked.law == "best" else [asked.law]

    def fit(law: LawName, start: Identification | None) -> Identification:
        def tell(progress: Progress) -> None:
            share = (laws.index(law) + progress.share) / len(laws)
            bar.show(share, note=f"{law}, error x {math.exp(progress.cost):.3f}")

        return find(
            robot,
            logs,
            free=names_listed(asked.free),
            law=law,
            bounds=bounds,
            window=asked.window,
            options=IdentificationOptions(
                excluded_states=tuple(names_listed(asked.leave_out)),
                back_emf=asked.back_emf,
                warm_start=start,
                sweep=sweep,
            ),
            run=replace(run, progress=tell),
        )

    if asked.law == "best":
        ladder = select_model(fit)
        return ladder.best.found, ladder
    return fit(asked.law, None), None


def _write(
    asked: _Asked,
    found: Identification,
    ladder: ModelSelection | None,
    judged: Sequence[HoldoutResult],
    folder: Path,
) -> list[str]:
    """Write the results and return the names of what people read."""
    made = provenance(command=shell_line(asked.words), files=asked.files, seed=asked.seed)
    results = found.to_dict()
    if ladder:
        results["ladder"] = ladder.to_dict()
    if judged:
        results["judged_on"] = {one.name: one.to_dict() for one in judged}
    write_robot(found.robot, folder / "robot.toml")
    write_text(folder / "results.json", as_json(results | {"provenance": made.to_dict()}))
    if ladder is None:
        return ["robot.toml"]
    write_text(folder / "ladder.svg", drawn(lambda: ladder_figure(ladder), name="ladder"))
    return ["robot.toml", "ladder.svg"]


def _show(
    found: Identification, ladder: ModelSelection | None, judged: Sequence[HoldoutResult], console: Console
) -> None:
    framed = console.is_terminal
    if ladder:
        console.print(ladder_table(ladder, framed=framed))
    console.print(parameter_table(found, framed=framed))
    console.print(error_table(found, judged, framed=framed))
    for one in judged:
        if one.horizons:
            console.print(horizon_table(one, framed=framed))
    for sentence in (*found.warnings, *(remark for one in judged for remark in one.remarks)):
        console.print(sentence, markup=False, soft_wrap=True)
