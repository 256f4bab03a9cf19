"""What the checks make of logs with one fault and of sound ones, and what friction comes of those that pass.

.venv/bin/python -m campaigns.evidence log_faults

The logs are cut at random from the recordings of `campaigns.log_recordings`, which set no threshold: of the twin and of
the equations of motion over all presets, and, if BALLBOT_DATA names their folder, of the logs `bbr`. A fault of `KINDS`
begins at a random instant and has a random size. Results are kept in build/log_faults, each as soon as it is there.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, replace

import numpy as np

from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.findings import Finding
from ballbot.fitting.run import Run, Threads
from ballbot.identification import identify
from ballbot.log import Log
from ballbot.log.checks import check_logs
from ballbot.log.columns import torque_names
from ballbot.log.pose import with_odometry
from ballbot.mechanics.friction import wheel_friction
from ballbot.processes import worker_pool
from ballbot.robot import Friction, Robot
from campaigns.log_recordings import KEPT, RECORDINGS, drawn, recording
from campaigns.section import DataMissingError, Section, data_folder

COUNT = 400
LENGTHS = (16.0, 32.0)  # [s]
#: public recordings of the preset alten, below BALLBOT_DATA
PUBLIC = ("bbr/square_soft.csv", "bbr/hold_soft.csv", "bbr/thesis_step_soft.csv")
#: shortest part with a fault, and without one, as a fraction of the log
LEAST_PART = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Logs of one robot as a user would give them, and the fault that they have."""

    robot: Robot
    logs: Mapping[str, Log]
    friction: Friction | None = None  #: the true one, if known
    column: str = ""  #: at fault
    size: str = ""  #: of the fault, and its instant

    @property
    def log(self) -> Log:
        """The log at fault."""
        return self.logs["log"]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of fault: how it is made, and the codes of which one must name it."""

    make: Callable[[Case, np.random.Generator], Case]
    codes: tuple[str, ...]


def _with(case: Case, log: Log, column: str, size: str) -> Case:
    return replace(case, logs={**case.logs, "log": log}, column=column, size=size)


def _scaled(case: Case, column: str, factor: float, start: float = -np.inf) -> Case:
    """Scale a torque from an instant on."""
    log = case.log
    values = np.where(log.t >= start, factor, 1.0) * log[column]
    since = "" if start == -np.inf else f" from {start - log.t[0]:.1f} s"
    return _with(case, log.with_columns({column: values}), column, f"times {factor:.2f}{since}")


def _torque(case: Case, random: np.random.Generator) -> str:
    return str(random.choice(torque_names(case.robot.wheel_count)))


def _instant(log: Log, random: np.random.Generator) -> float:
    return float(log.t[0] + random.uniform(LEAST_PART, 1.0 - LEAST_PART) * (log.t[-1] - log.t[0]))


def _factor(random: np.random.Generator) -> float:
    return float(random.uniform(0.3, 0.7) if random.random() < 0.5 else random.uniform(1.4, 2.5))


def _zero(case: Case, random: np.random.Generator) -> Case:
    return _scaled(case, _torque(case, random), 0.0, _instant(case.log, random))


def _negated(case: Case, random: np.random.Generator) -> Case:
    return _scaled(case, _torque(case, random), -1.0)


def _other_scale(case: Case, random: np.random.Generator) -> Case:
    return _scaled(case, _torque(case, random), _factor(random))


def _held(case: Case, random: np.random.Generator) -> Case:
    """Hold a torque for 1.5 to 5 s."""
    log, column = case.log, _torque(case, random)
    start = _instant(log, random)
    rows = (log.t >= start) & (log.t < start + random.uniform(1.5, 5.0))
    values = np.where(rows, log[column][rows][0], log[column])
    return _with(case, log.with_columns({column: values}), column, f"{rows.sum()} rows from {start:.1f} s")


def _stuck_encoder(case: Case, random: np.random.Generator) -> Case:
    """Hold the angle of an encoder for 3 to 8 s, and count on afterwards."""
    log, column = case.log, f"wheel{random.integers(case.robot.wheel_count) + 1}"
    start = _instant(log, random)
    rows = (log.t >= start) & (log.t < start + random.uniform(3.0, 8.0))
    missed = log[column][rows][-1] - log[column][rows][0]
    values = np.where(rows, log[column][rows][0], log[column] - np.where(log.t > start, missed, 0.0))
    held = {column: values, f"{column}_dot": np.where(rows, 0.0, log[f"{column}_dot"])}
    return _with(case, log.with_columns(held), column, f"{rows.sum()} rows from {start:.1f} s")


def _reversed_wheel(case: Case, random: np.random.Generator) -> Case:
    """Give a wheel the wrong sign in the mapping of a log whose path is that of the wheels."""
    wheel = int(random.integers(case.robot.wheel_count)) + 1
    log = Log({name: case.log[name] for name in case.log if name not in ("x", "y", "x_dot", "y_dot")})
    names = (f"wheel{wheel}", f"wheel{wheel}_dot")
    log = with_odometry(log.with_columns({name: -log[name] for name in names}), case.robot)
    return _with(case, log, names[1], f"wheel {wheel}")


def _two_robots(case: Case, random: np.random.Generator) -> Case:
    """Add a log of the same robot that is 1.4 to 1.6 times as heavy, and needs so much more torque."""
    factor = random.uniform(1.4, 1.6)
    names = torque_names(case.robot.wheel_count)
    heavy = case.logs["other"]
    heavy = heavy.with_columns({name: factor * heavy[name] for name in names})
    return replace(case, logs={**case.logs, "other": heavy}, size=f"{factor:.2f} times as heavy")


def _counts(case: Case, random: np.random.Generator) -> Case:
    """Write other counts into the robot file."""
    factor = random.choice([0.25, 0.5, 2.0, 4.0])
    sensors = replace(case.robot.sensors, encoder_counts=round(factor * case.robot.sensors.encoder_counts))
    return replace(case, robot=case.robot.replace(sensors=sensors), size=f"{factor:g} times the counts")


def _sample_time(case: Case, random: np.random.Generator) -> Case:
    """Write another sample time into the robot file."""
    factor = random.choice([0.5, 2.0, 4.0])
    sensors = replace(case.robot.sensors, sample_time=factor * case.robot.sensors.sample_time)
    return replace(case, robot=case.robot.replace(sensors=sensors), size=f"{factor:g} times the period")


def _gap(case: Case, random: np.random.Generator) -> Case:
    """Lose the rows of 0.2 to 2 s."""
    log, start = case.log, _instant(case.log, random)
    kept = (log.t < start) | (log.t > start + random.uniform(0.2, 2.0))
    return _with(
        case, Log({name: log[name][kept] for name in log}), "", f"{(~kept).sum()} rows from {start:.1f} s"
    )


def _frozen(case: Case, random: np.random.Generator) -> Case:
    """Freeze an angle of the IMU for 0.6 to 3 s."""
    log, column = case.log, str(random.choice(["theta", "phi"]))
    start = _instant(log, random)
    rows = (log.t >= start) & (log.t < start + random.uniform(0.6, 3.0))
    values = np.where(rows, log[column][rows][0], log[column])
    return _with(case, log.with_columns({column: values}), column, f"{rows.sum()} rows from {start:.1f} s")


KINDS: dict[str, Kind] = {
    "a torque zero from an instant on": Kind(make=_zero, codes=("stuck", "dead-motor")),
    "a torque negated": Kind(make=_negated, codes=("torque-sign",)),
    "a torque scaled": Kind(make=_other_scale, codes=("torque-scale",)),
    "a torque held": Kind(make=_held, codes=("stuck",)),
    "logs of two robots": Kind(make=_two_robots, codes=("robots", "torque-scale")),
    "a wheel's sign in the mapping": Kind(make=_reversed_wheel, codes=("encoders",)),
    "an encoder stuck": Kind(make=_stuck_encoder, codes=("stuck", "glitch")),
    "an angle frozen": Kind(make=_frozen, codes=("stuck",)),
    "rows lost": Kind(make=_gap, codes=("gap",)),
    "encoder_counts of the robot file": Kind(make=_counts, codes=("robot-sensors",)),
    "sample_time of the robot file": Kind(make=_sample_time, codes=("robot-sensors",)),
}
SOUND = "sound"
#: findings that say that the log does not show order, sign and scale of the torques
UNSHOWN = ("torque-bound", "physics")


def public_logs() -> dict[str, Log]:
    """Return the public recordings that are there, by name."""
    try:
        folder = data_folder()
    except DataMissingError:
        return {}
    return {name: Log.read(folder / name) for name in PUBLIC if (folder / name).exists()}


def case_of(kind: str, number: int) -> Case:
    """Return the case of a number: a cut of a recording, with a fault of the kind."""
    random = np.random.default_rng([47, number, sorted([*KINDS, SOUND]).index(kind)])
    public = public_logs()
    source = int(random.integers(RECORDINGS + len(public)))
    friction = None
    if source < RECORDINGS:
        draw = drawn(source)
        log, robot, friction = recording(source), Robot.load(draw.preset), draw.scenario.friction
    else:
        log, robot = list(public.values())[source - RECORDINGS], Robot.load("alten")
    duration = LENGTHS[number % len(LENGTHS)]
    starts = random.uniform(log.t[0], max(log.t[-1] - duration, log.t[0]), 2)
    cuts = [log.between(float(start), float(start) + duration) for start in starts]
    case = Case(robot=robot, logs={"log": cuts[0]}, friction=friction)
    if kind == "logs of two robots" or (kind == SOUND and random.random() < 0.25):
        case = replace(case, logs={"log": cuts[0], "other": cuts[1]})
    return case if kind == SOUND else KINDS[kind].make(case, random)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the checks make of one case."""

    kind: str
    number: int
    size: str
    refused: bool
    named: bool  #: with the right cause, and the column at fault
    said: bool  #: that the log does not show it, in place of that
    findings: tuple[str, ...]  #: errors and warnings, each its code and its columns
    #: of the wheel that is farthest off, the friction identified at `SPEED` minus the true one, over its stated error;
    #: None if the log is refused, or nothing is stated or known
    off: float | None


#: at which friction is compared [rad/s]
SPEED = 1.0


def outcome(kind: str, number: int) -> Outcome:
    """Return what the checks and identification make of a case; neither may end in an error of its own."""
    case = case_of(kind, number)
    found = [one for one in check_logs(case.logs, robot=case.robot) if one.severity != "note"]
    refused = any(one.severity == "error" for one in found)
    return Outcome(
        kind=kind,
        number=number,
        size=case.size,
        refused=refused,
        off=None if refused or case.friction is None else friction_off(case, case.friction),
        named=any(_names(one, kind, case.column) for one in found),
        said=any(one.code in UNSHOWN for one in found),
        findings=tuple(f"{one.severity} {one.code} {' '.join(one.where.columns)}" for one in found),
    )


def friction_off(case: Case, friction: Friction) -> float | None:
    """Return `Outcome.off` of a case whose true friction is known."""
    try:
        found = identify(case.robot, case.logs, law="coulomb", run=Run(executor=Threads(count=1)))
    except InputError:  # too few windows, or nothing to fit
        return None
    n = case.robot.wheel_count
    b, c = found.values[:n], found.values[n : 2 * n]
    errors = (np.array(found.standard_errors[name]) for name in ("b", "c"))
    # a parameter without an error, as b at its bound of zero, adds none: the deviation then counts as larger
    error_b, error_c = (np.nan_to_num(error) for error in errors)
    between = np.nan_to_num(found.correlation[:n, n : 2 * n].diagonal())
    variance = (SPEED * error_b) ** 2 + error_c**2 + 2.0 * between * SPEED * error_b * error_c
    variance[variance == 0.0] = np.nan
    off = np.abs(SPEED * b + c - wheel_friction(np.full(n, SPEED), friction)) / np.sqrt(variance)
    return float(np.nanmax(off)) if np.isfinite(off).any() else None


def _names(finding: Finding, kind: str, column: str) -> bool:
    if kind == SOUND or finding.code not in KINDS[kind].codes:
        return False
    return not column or column in finding.where.columns


def jobs(count: int) -> list[tuple[str, int]]:
    """Return kinds and numbers of as many faulty cases, kinds in turn, and of as many sound ones."""
    names = list(KINDS)
    return [*((names[k % len(names)], k) for k in range(count)), *((SOUND, k) for k in range(count))]


def outcomes(count: int = COUNT, *, processes: int = 1) -> Iterator[Outcome]:
    """Yield the outcomes of cases as they come."""
    if processes == 1:
        yield from (outcome(*job) for job in jobs(count))
        return
    with worker_pool(processes) as pool:
        runs = [pool.submit(outcome, *job) for job in jobs(count)]
        yield from (run.result() for run in as_completed(runs))


def campaign() -> Section:
    """Check all cases and return the section of docs/generated/evidence.md."""
    for source in range(RECORDINGS):
        recording(source)  # on file before processes look for it
    found = []
    for one in outcomes(processes=min(2, os.cpu_count() or 1)):
        found.append(one)
        write_text(KEPT / "outcomes.json", json.dumps([asdict(each) for each in found]))
        if len(found) % 20 == 0:
            print(f"{len(found)} of {2 * COUNT} cases checked", file=sys.stderr, flush=True)
    return section(found)


def section(found: Sequence[Outcome]) -> Section:
    """Return the section that outcomes make."""
    sound = [one for one in found if one.kind == SOUND]
    refused = [f"{one.number} ({'; '.join(one.findings)})" for one in sound if one.refused]
    faulty = [one for one in found if one.kind != SOUND]
    return Section(
        title="Logs with one fault, and sound ones",
        before=f"{len(faulty)} logs of {LENGTHS[0]:g} and {LENGTHS[1]:g} s with one fault each, at a random instant "
        f"and of a random size, and {len(sound)} sound ones, cut from {RECORDINGS} recordings over all presets and "
        "from public ones; `check_logs` with the preset. Named: a finding has the right cause and names the column. "
        "Said: the checks do not name it, but say that the log does not bound or show the torques' scale. "
        "Silent: neither. Of the logs that pass, and whose friction is known, `identify` with the Coulomb law: by how "
        f"many of its stated standard errors the friction at {SPEED:g} rad/s of the worst of the wheels is off.",
        columns=["fault", "logs", "named", "said", "silent", "fitted", "off, median", "off by more than 3"],
        rows=[
            *(_row(kind, [one for one in faulty if one.kind == kind]) for kind in KINDS),
            _row("all", faulty),
            ["none", f"{len(sound)}", "", "", "", *_off_cells(sound)],
        ],
        after=f"Sound logs refused: {len(refused)} of {len(sound)}{': ' if refused else ''}{', '.join(refused)}; "
        f"said that they do not bound or show the torques' scale: {sum(one.said for one in sound)}.",
    )


def _row(name: str, found: Sequence[Outcome]) -> list[str]:
    named = sum(one.named for one in found)
    said = sum(one.said and not one.named for one in found)
    return [
        name,
        f"{len(found)}",
        f"{named}",
        f"{said}",
        f"{len(found) - named - said}",
        *_off_cells(found),
    ]


def _off_cells(found: Sequence[Outcome]) -> list[str]:
    off = [one.off for one in found if one.off is not None]
    if not off:
        return ["0", "", ""]
    return [f"{len(off)}", f"{np.median(off):.1f}", f"{sum(one > 3.0 for one in off)}"]
