"""Logs whose columns contradict each other, or were not read, each with a sound twin, drawn by a seed.

python -m tests.support.contradicting_logs SEED COUNT    the outcomes of so many logs of each kind, and of their twins

A kind writes a log, gives it to what its command calls, and returns the outcome: "right" if the result is the truth,
"refused" if an error names what is wrong, "wrong" otherwise. A sound twin has no fault of its kind, and must be right.
Foreign logs have the names of a drawn team.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.findings import stop_on_errors
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.clock import clock_findings
from ballbot.log.columns import FACTORS
from ballbot.log.formats.text import write_text_table
from ballbot.log.mapping import ColumnTable, LogMapping
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.proposal import Proposal, evaluate, propose
from ballbot.validation.alignment import align
from tests.support.alignment_examples import Setup, record
from tests.support.axis_machines import Logging, Machine, record_of
from tests.support.foreign_log_examples import (
    COURSE,
    foreign_columns,
    small_robot,
    swaying_log,
    write_foreign,
)
from tests.support.foreign_logs import STYLES, Habits

Outcome = Literal["right", "refused", "wrong"]
Random = np.random.Generator
Kind = Callable[[Path, Random, bool], Outcome]
#: units of motions, by Ballbot's, in which people log
_MOTION_UNITS = {
    "rad": ("deg", "turn", "mrad"),
    "rad/s": ("rpm", "deg/s", "turn/s"),
    "m": ("mm", "cm"),
    "m/s": ("mm/s", "cm/s"),
}
#: how names that are a unit alone write it
_SPELLED = {"deg/s": "dps", "turn/s": "revs_per_s", "mm/s": "mm/s", "cm/s": "cm/s"}


def _axis(random: Random) -> tuple[Literal["m", "rad"], dict[str, Floats]]:
    """Return the unit of a drawn axis, and its time, position, velocity and force."""
    slides = random.random() < 0.4
    size = float(np.exp(random.uniform(np.log(0.3), np.log(3.0))))
    machine = Machine(kind="cart", inertia=20.0 * size, viscous=40.0, coulomb=6.0)
    if not slides:
        machine = Machine(kind="wheel", inertia=2e-3 * size, viscous=3e-3, coulomb=0.02)
    reach = 0.2 if slides else float(random.uniform(0.5, 6.0))
    logging = Logging(duration=8.0, rate=float(random.choice([100.0, 250.0])), amplitude=reach)
    drawn = record_of(machine, logging, int(random.integers(1000)))
    velocity = np.gradient(drawn.position, drawn.t)
    unit = "m" if slides else "rad"
    return unit, {"t": drawn.t, "position": drawn.position, "velocity": velocity, "force": drawn.force}


def _judged_axis(path: Path, by: AxisColumns | LogMapping, truth: dict[str, Floats]) -> Outcome:
    """Return the outcome of reading a record whose position and force are known."""
    try:
        read = (
            read_axis_record(path, by) if isinstance(by, AxisColumns) else read_axis_record(path, mapping=by)
        )
        stop_on_errors(record_findings(read))
    except InputError as error:
        headless = isinstance(by, AxisColumns) and by.columns is None and "--columns" in str(error)
        named = headless or "--accept unit" in str(error) or "in a --mapping" in str(error)
        return "refused" if named else "wrong"
    sizes = [
        (np.std(position), np.std(force))
        for position, force in ((read.position, read.force), (truth["position"], truth["force"]))
    ]
    return "right" if np.allclose(*sizes, rtol=0.02) else "wrong"


def named_by_its_unit(folder: Path, random: Random, sound: bool) -> Outcome:
    """Write a column whose name is its unit, or which has its unit at the end of its name."""
    unit, motion = _axis(random)
    kind = str(random.choice(["position", "velocity"]))
    ballbots = unit if kind == "position" else f"{unit}/s"
    other = str(random.choice(_MOTION_UNITS[ballbots]))
    name = f"{kind}_{other}" if sound else _SPELLED.get(other, other)
    values = motion[kind] / FACTORS[ballbots][other]
    write_text_table(folder / "a.csv", {"t": motion["t"], name: values, "force": motion["force"]})
    columns = AxisColumns(**{kind: name}, unit=unit)  # pyright: ignore[reportArgumentType]
    return _judged_axis(folder / "a.csv", columns, motion)


def beside_another_unit(folder: Path, random: Random, sound: bool) -> Outcome:
    """Write a position, or a velocity, that is in another unit than the column of the same motion beside it."""
    unit, motion = _axis(random)
    kind, beside = random.permutation(["position", "velocity"]).tolist()
    ballbots = unit if kind == "position" else f"{unit}/s"
    other = str(random.choice(_MOTION_UNITS[ballbots]))
    used = motion[kind] / (1.0 if sound else FACTORS[ballbots][other])
    size = float(np.std(motion[beside]))
    rest = motion[beside] + random.uniform(0.0, 0.01) * size * random.standard_normal(len(used))
    table = {"t": motion["t"], "used": used, "rest": rest, "force": motion["force"]}
    if random.random() < 0.5:  # the motor's, before its gear
        table["motor"] = motion["velocity"] * random.uniform(3.0, 40.0)
    write_text_table(folder / "a.csv", table)
    columns = AxisColumns(**{kind: "used"}, unit=unit)  # pyright: ignore[reportArgumentType]
    return _judged_axis(folder / "a.csv", columns, motion)


def without_a_factor(folder: Path, random: Random, sound: bool) -> Outcome:
    """Write a position in counts, or a force that is a current, with and without its factor."""
    unit, motion = _axis(random)
    factor = float(random.uniform(1e-4, 1e-2))
    name, key = ("position_counts", "position") if random.random() < 0.5 else ("motor_amps", "force")
    table = {"t": motion["t"], "position": motion["position"], "force": motion["force"]}
    table[name] = table.pop(key) / factor
    write_text_table(folder / "a.csv", table)
    named = {"position": "position", "force": "force", key: name}
    if not sound:
        return _judged_axis(folder / "a.csv", AxisColumns(unit=unit, **named), motion)
    own = {"position": "axis_position", "force": "axis_force"}
    own = own if unit == "m" else {"position": "axis_angle", "force": "axis_torque"}
    scales = {"position": 1.0, "force": 1.0, key: factor}
    columns = {own[k]: ColumnTable(source=named[k], scale=scales[k]) for k in own}
    return _judged_axis(
        folder / "a.csv", LogMapping(columns={"t": ColumnTable(source="t"), **columns}), motion
    )


def _filmed(random: Random) -> tuple[Log, Log]:
    """Return a drawn run's log and motion capture, in any frame and with any lever arm."""
    turn = (Rotation.from_rotvec(random.uniform(-1.0, 1.0, 3)) for _ in range(2))
    return record(
        Setup(
            seed=int(random.integers(1000)),
            duration=25.0,
            offset=float(random.uniform(-20.0, 20.0)),
            camera_world=next(turn),
            body_marker=next(turn),
            lever=(0.0, 0.0, float(random.uniform(0.0, 0.5))),
            heading_drift=float(random.uniform(-1e-3, 1e-3)),
            wheel_scale=float(random.uniform(0.85, 1.15)),
        )
    )


def _judged_film(log: Log, film: Log, code: str) -> Outcome:
    """Return the outcome of an alignment: right only if its path is the log's."""
    try:
        stop_on_errors(clock_findings(film.t, "--mocap-mapping"))
        found = align(log, film)
        stop_on_errors(found.doubts)
    except InputError as error:
        return "refused" if f"--accept {code}" in str(error) else "wrong"
    return "right" if found.path and 0.8 < found.path.scale < 1.2 else "wrong"


def film_in_another_unit(_: Path, random: Random, sound: bool) -> Outcome:
    """Film the positions in mm or cm."""
    log, film = _filmed(random)
    factor = 1.0 if sound else float(random.choice([100.0, 1000.0]))
    return _judged_film(log, film.with_columns({name: factor * film[name] for name in "xyz"}), "unit")


def film_with_another_clock(_: Path, random: Random, sound: bool) -> Outcome:
    """Film with a clock in ms or us."""
    log, film = _filmed(random)
    factor = 1.0 if sound else float(random.choice([1e3, 1e6]))
    try:
        film = film.with_columns({"t": factor * film.t})
    except InputError as error:  # a week or more in seconds
        return "refused" if "t is in seconds; convert it" in str(error) else "wrong"
    return _judged_film(log, film, "time-scale")


def film_in_a_mirror(_: Path, random: Random, sound: bool) -> Outcome:
    """Film with one axis of the positions negated, and in half of the films the orientations of that frame, too."""
    log, film = _filmed(random)
    axis = str(random.choice([*"xyz"]))
    if not sound:
        turned = random.random() < 0.5
        others = [f"q{other}" for other in "xyz" if other != axis and turned]
        film = film.with_columns({name: -film[name] for name in (axis, *others)})
    return _judged_film(log, film, "mirrored")


def drawn_habits(random: Random, habits: Habits = COURSE) -> Habits:
    """Return how a drawn team places wheels and IMU of the swaying robot."""
    order = tuple(random.permutation(3).tolist())
    turn = float(np.radians(random.choice([0.0, 30.0, 90.0, -60.0])))
    sign = int(random.choice([-1, 1]))
    return replace(habits, order=order, signs=(sign,) * 3, turn=turn)


def _foreign(random: Random) -> dict[str, Floats]:
    """Return the columns of a drawn team's log of the swaying robot, with the course's names."""
    return foreign_columns(drawn_habits(random))


def team_names(names: Sequence[str], random: Random) -> dict[str, str]:
    """Return a drawn team's names of columns by those of the course, of which a kind may lack some."""
    style = STYLES[random.integers(1, len(STYLES) - 1)]  # the last one calls every command a torque
    own = {"t_now": style.time, **dict(zip(("theta_x", "theta_y", "theta_z"), style.lean, strict=True))}
    own |= {f"gyro_{axis}": style.gyro.format(axis) for axis in "xyz"}
    for k in (1, 2, 3):
        number = k - 1 + style.first
        own |= {f"psi_{k}": style.angle.format(number), f"u{k}": style.command.format(number, kind="pwm")}
    return {name: own.get(name, name) for name in names}


def _judged_foreign(folder: Path, table: dict[str, Floats], random: Random) -> tuple[Outcome, Proposal]:
    """Return the outcome of a proposed mapping: right if lean, speeds and torques of its log have their true sizes."""
    names = team_names([*table], random)
    path = write_foreign(folder / "run.txt", {names[name]: values for name, values in table.items()})
    found = evaluate(propose(path, small_robot(), Stated(command="duty")))
    if found.refusal or found.log is None:
        return "refused", found
    log, truth = found.log, swaying_log()
    inside = truth.between(float(log.t[0]), float(log.t[-1]))
    sizes = [
        (np.hypot(one["theta"], one["phi"]).std(), one.wheel_speeds.std(), one.torques.std())
        for one in (log, inside)
    ]
    return ("right" if np.allclose(*sizes, rtol=0.25) else "wrong"), found


def quaternion_by_number(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log a quaternion in numbered columns, its scalar first or last, or in columns that nothing names."""
    table = _foreign(random)
    names = [name for name in table if name.startswith("theta")]
    angles = np.radians(np.column_stack([table.pop(name) for name in names]))[:, ::-1]
    wxyz = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True)
    last = bool(random.random() < 0.5)
    named = ["q{}", "quat_{}", "orientation[{}]"][random.integers(3)]
    names = [named.format(k) for k in range(4)]
    if sound:
        names, last = [f"quat_{mark}" for mark in "wxyz"], False
    unnamed = not sound and random.random() < 0.3
    names = ["alpha", "bx", "gam", "del"] if unnamed else names
    table |= dict(zip(names, wxyz.T[[1, 2, 3, 0] if last else [0, 1, 2, 3]], strict=True))
    outcome, found = _judged_foreign(folder, table, random)
    said = any(finding.code == "unknown" and "quaternion" in finding.text for finding in found.findings)
    return "wrong" if outcome == "refused" and not said else outcome


def lean_of_a_full_turn(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log roll and pitch from zero to a full turn, in degrees or radians."""
    table = _foreign(random)
    radians = bool(random.random() < 0.4)
    for name in ("theta_x", "theta_y"):
        table[name] = table[name] if sound else np.mod(table[name], 360.0)
    for name in ("theta_x", "theta_y", "theta_z"):
        table[name] = np.radians(table[name]) if radians else table[name]
    return _judged_foreign(folder, table, random)[0]


def duty_beyond_full(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log commands that are a little beyond full duty in a few rows, where the driver clips them."""
    table = _foreign(random)
    full = float(random.choice([1.0, 255.0, 1000.0]))
    for name in ("u1", "u2", "u3"):
        table[name] = full * table[name]
        rows = random.integers(len(table[name]), size=int(random.integers(1, 8)))
        peak = full * (1.0 if sound else random.uniform(1.02, 1.3))
        table[name][rows] = np.sign(table[name][rows]) * peak
        table[name] = table[name] if full == 1.0 else np.round(table[name])
    return _judged_foreign(folder, table, random)[0]


def magnitudes_of_commands(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log the sizes of the commands alone, without their signs."""
    table = _foreign(random)
    if not sound:
        table |= {name: np.abs(table[name]) for name in ("u1", "u2", "u3")}
    outcome, found = _judged_foreign(folder, table, random)
    answers = [question.answers[0] for question in found.questions if question.key == "[input] zero"]
    return "wrong" if outcome == "refused" and not (answers and "direction" in answers[0]) else outcome


def lean_that_froze(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log an IMU that repeats its last values for a few seconds: they are left out, and named with their duration."""
    table, lasting = _foreign(random), float(random.choice([2.0, 3.0, 4.0]))
    first = table["t_now"][0] + random.uniform(5.0, 20.0)
    frozen = (table["t_now"] >= first) & (table["t_now"] < first + lasting)
    for name in () if sound else ("theta_x", "theta_y", "theta_z"):
        table[name] = np.where(frozen, table[name][frozen][0], table[name])
    outcome, found = _judged_foreign(folder, table, random)
    said = [finding.text for finding in found.findings if finding.code == "stuck"]
    named = len(said) == 1 and f"repeats one value for {lasting:.0f} s" in said[0]
    return outcome if named or (sound and not said) else "wrong"


def _judged_native(folder: Path, log: Log, code: str) -> Outcome:
    """Return the outcome of the checks of a log in Ballbot's format: refused if errors are of one code only."""
    log.without_truth().write(folder / "log.csv")
    found = check(Log.read(folder / "log.csv"), robot=small_robot())
    codes = {finding.code for finding in found if finding.severity == "error"}
    return "right" if not codes else "refused" if codes == {code} else "wrong"


def _native(random: Random) -> Log:
    """Return a stretch of the swaying robot's log."""
    first = float(random.uniform(0.0, 12.0))
    return swaying_log().between(first, first + float(random.uniform(12.0, 18.0)))


def native_path_in_another_unit(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log positions and velocities of the ball in mm or cm, which agree with each other."""
    log, factor = _native(random), 1.0 if sound else float(random.choice([100.0, 1000.0]))
    log = log.with_columns({name: factor * log[name] for name in ("x", "y", "x_dot", "y_dot")})
    outcome = _judged_native(folder, log, "lean-scale")
    return "wrong" if outcome == "right" and not sound else outcome


def native_changes_of_angles(folder: Path, random: Random, sound: bool) -> Outcome:
    """Log the changes of one wheel's angle, or of all, from row to row, beside right speeds."""
    log = _native(random)
    wheels = random.permutation(3)[: 0 if sound else random.choice([1, 3])] + 1
    changes = {f"wheel{i}": np.diff(log[f"wheel{i}"], prepend=log[f"wheel{i}"][:1]) for i in wheels}
    outcome = _judged_native(folder, log.with_columns(changes), "scale")
    return "wrong" if outcome == "right" and not sound else outcome


def axis_without_header(folder: Path, random: Random, sound: bool) -> Outcome:
    """Write the record of an axis as a serial monitor shows it; the twin has its columns' names given."""
    unit, motion = _axis(random)
    table = {name: motion[name] for name in random.permutation(["t", "position", "force"]).tolist()}
    write_text_table(folder / "a.csv", table)
    rows = (folder / "a.csv").read_text().splitlines()[1:]
    (folder / "a.csv").write_text("\n".join([*["connected"][: random.integers(2)], *rows]))
    columns = AxisColumns(unit=unit, position="position", columns=",".join(table) if sound else None)
    return _judged_axis(folder / "a.csv", columns, motion)


KINDS: dict[str, Kind] = {
    kind.__name__: kind
    for kind in (
        named_by_its_unit,
        beside_another_unit,
        without_a_factor,
        film_in_another_unit,
        film_with_another_clock,
        film_in_a_mirror,
        quaternion_by_number,
        lean_of_a_full_turn,
        duty_beyond_full,
        magnitudes_of_commands,
        lean_that_froze,
        native_path_in_another_unit,
        native_changes_of_angles,
        axis_without_header,
    )
}


def outcomes(name: str, *, seed: int, sound: bool) -> Outcome:
    """Return the outcome of a kind's log, or its sound twin, by a seed."""
    random = np.random.default_rng([*KINDS].index(name) * 1_000_003 + seed)
    with tempfile.TemporaryDirectory() as folder:
        return KINDS[name](Path(folder), random, sound)


def main(first: int, count: int) -> None:
    """Print the outcomes by kind, and the seeds of those that are wrong, or sound and refused."""
    for name in KINDS:
        for sound in (False, True):
            found = {seed: outcomes(name, seed=seed, sound=sound) for seed in range(first, first + count)}
            bad = [seed for seed, one in found.items() if one == "wrong" or (sound and one != "right")]
            print(name, "sound" if sound else "", dict(Counter(found.values())), bad or "", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
