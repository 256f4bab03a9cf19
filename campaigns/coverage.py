"""Count how often 95 % intervals contain the truth, and how often a right robot file is refused: 200 logs each.

.venv/bin/python -m campaigns.evidence coverage
.venv/bin/python -m campaigns.evidence file_values

Finished repeats are kept in build/coverage and build/file_values and are not repeated: an interrupted campaign
continues.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import cast

import numpy as np
from scipy.stats import binom

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain, nominal_controller
from ballbot.control.references import square
from ballbot.errors import every
from ballbot.fitting.fit import fit
from ballbot.fitting.intervals import Interval
from ballbot.fitting.run import Run, Threads
from ballbot.identification.file_values import DEVIATIONS, WRONG
from ballbot.identification.identify import IdentificationOptions, identify, prepare
from ballbot.identification.quantities import scale_between
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.robot.components import BY_NAME
from ballbot.robot.parameters import value_of
from ballbot.robot.variations import draw_robots, with_default_errors
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from ballbot.twin.imperfections import imperfections_of, true_model
from benchmarks.workloads import nominal_robot
from campaigns.section import Section, finished, share_words
from campaigns.twin_logs import NOMINAL, ROBOT

DURATION = 32.0  # [s] of each log, twice around the square
STEP = 2.5e-3  # [s], inner step of the truth and of the fits
ATTITUDE_NOISE, GYRO_NOISE = 6e-4, 4e-3  # [rad], [rad/s]: those of a robot with an AHRS and a gyro

#: all of it at work; and without break-away friction, where v_s and delta have no influence
TRUTHS = {
    "all": nominal_robot().friction,
    "no break-away": replace(nominal_robot().friction, stribeck=(0.0, 0.0, 0.0)),
}
REPEATS = {"all": 200, "no break-away": 40}

#: where the fits begin, far from any of the truths, so that reaching them is their own work
BEGIN = np.array([0.03] * 3 + [0.08] * 3 + [0.03] * 3 + [1.0, 1.5, 0.004])


@dataclass(frozen=True, kw_only=True)
class Repeat:
    """The result of one log."""

    estimates: Mapping[str, float | None]  #: by label; None where the parameter was given no number
    intervals: Mapping[str, Interval]  #: of those that have one


def noisy_log(truth: Friction, *, seed: int) -> Log:
    """Return a log of a robot with that friction, balanced around a square on its sensors' readings."""
    robot = Robot.load("alten")
    random = np.random.default_rng([seed, 1])
    start = np.zeros(10)
    start[2:4] = 0.01 * random.standard_normal(2)  # lean: N(0, 0.01 rad)
    start[5:7] = 0.05 * random.standard_normal(2)  # velocity: N(0, 0.05 m/s)
    sensors = replace(robot.sensors, attitude_noise=ATTITUDE_NOISE, gyro_noise=GYRO_NOISE, heading_drift=0.0)
    batch = simulate_batch(
        Model(robot.replace(friction=truth), step=STEP),
        Controller(robot, design_gain(robot).gain),
        square(side=0.5, period=DURATION / 2),
        duration=DURATION,
        initial_states=start,
        imperfections=Imperfections(sensors=sensors, known=robot, seed=seed),
        threads=1,
    )
    return batch.log(0).without_truth()


def repeat(truth: Friction, *, seed: int) -> Repeat:
    """Simulate a log and identify it, in one thread."""
    robot = Robot.load("alten")
    coordinates = scale_between(robot)
    options, run = IdentificationOptions(held_out=0.02, step=STEP), Run(seed=seed, executor=Threads(count=1))
    prepared = prepare(
        robot, coordinates, [noisy_log(truth, seed=seed)], window=0.25, options=options, run=run
    )
    estimate = fit(
        prepared.experiment,
        coordinates.scaled(BEGIN),
        refused=prepared.refused,
        options=options,
        run=run,
    )
    numbers = zip(coordinates.labels, estimate.values.tolist(), estimate.unknown, strict=True)
    return Repeat(
        estimates={label: None if unknown else value for label, value, unknown in numbers},
        intervals=estimate.uncertainty.intervals,
    )


def _repeat_of(run: tuple[str, int]) -> Repeat:
    name, seed = run
    return repeat(TRUTHS[name], seed=seed)


def truth_of(name: str) -> dict[str, float]:
    """Return the true parameters by label."""
    robot = Robot.load("alten").replace(friction=TRUTHS[name])
    coordinates = scale_between(robot)
    return dict(zip(coordinates.labels, coordinates.nominal.tolist(), strict=True))


def held(label: str, done: Sequence[Repeat], truth: Mapping[str, float]) -> list[bool]:
    """Return whether the interval held the truth, for each repeat that gave the parameter one."""
    known = [run.intervals[label] for run in done if label in run.intervals]
    return [interval.lower <= truth[label] <= interval.upper for interval in known]


def campaign() -> Section:
    """Run the missing repeats and return the section of docs/generated/evidence.md."""
    runs = {f"{name} {seed}": (name, seed) for name, count in REPEATS.items() for seed in range(count)}
    packages = ("fitting", "identification", "mechanics", "simulation", "control", "robot", "log")
    repeats = finished("coverage", _repeat_of, runs, packages=packages)
    done = {name: [run for key, run in repeats.items() if runs[key][0] == name] for name in REPEATS}
    truth, everything = truth_of("all"), done["all"]
    least, most = binom.interval(0.95, len(everything), 0.95)
    rows = [_row(label, everything, truth) for label in truth]
    bare = done["no break-away"]
    given = {label: sum(run.estimates[label] is not None for run in bare) for label in ("v_s", "delta")}
    false = {label: f"{given[label]} of {len(bare)}" for label in given}
    return Section(
        title="Coverage of identification's intervals",
        before=f"{len(everything)} logs of {DURATION:g} s of the exact model around a square, balanced with noisy "
        f"sensors (attitude {ATTITUDE_NOISE:g} rad and gyro {GYRO_NOISE:g} rad/s, white; encoder counts; on-board "
        "state), each identified from a start far from the truth. Correct 95 % intervals contain the "
        f"truth in {least:.0f} to {most:.0f} of {len(everything)}.",
        columns=["", "truth", "bias / deviation", "deviation / half width x 1.96", "truth held", "from"],
        rows=rows,
        after=f"Without breakaway friction v_s and delta have no effect; they got a number in {false['v_s']} "
        f"and {false['delta']} repeats.",
    )


def _row(label: str, done: Sequence[Repeat], truth: Mapping[str, float]) -> list[str]:
    values = np.array([value for run in done if (value := run.estimates[label]) is not None])
    inside = held(label, done, truth)
    widths = [
        run.intervals[label].upper - run.intervals[label].lower for run in done if label in run.intervals
    ]
    methods = Counter(run.intervals[label].method for run in done if label in run.intervals)
    deviation = values.std(ddof=1)
    return [
        label,
        f"{truth[label]:g}",
        f"{(values.mean() - truth[label]) / deviation:+.2f}",
        f"{deviation / (np.median(widths) / 2 / 1.96):.2f}",
        f"{sum(inside)} of {len(inside)}",
        ", ".join(f"{method} {count}" for method, count in methods.most_common()),
    ]


#: of robot files: logs of the nominal scenario, of which each has so many files drawn, and how long each is [s]
FILE_LOGS, DRAWN, FILE_LOG = 50, 4, 20.0
#: of the logs, on which large errors are tried too, of the draws' seed, and what is wrong by how much
FEW, FILE_SEED = 6, 7151
WRONG_FILES = {
    "torques x 1.25": "",
    "clock 5 % fast": "",
    "body mass / 1.4": "body.mass",
    "ball radius x 1.05": "ball.radius",
}
FILE_COURSES = ("square", "figure_eight", "circle")


@dataclass(frozen=True, kw_only=True)
class ByFile:
    """What a log gives by a robot file."""

    estimates: Mapping[str, float]
    intervals: Mapping[str, Interval]
    farthest: tuple[str, float]  #: the value farthest from the log's own estimate, and by how many deviations
    named: tuple[str, ...]  #: values that the log refutes, and what the checks warn of in the robot file


def rollers_log(seed: int) -> Log:
    """Return a log of the nominal scenario in the compiled loop, with rollers, play and its pivoting ball."""
    model, imperfections = true_model(ROBOT, NOMINAL), imperfections_of(NOMINAL, known=ROBOT)
    pivoting = replace(model, pivoting=NOMINAL.pivoting * ROBOT.weight)
    batch = simulate_batch(
        pivoting,
        nominal_controller(ROBOT),
        FILE_COURSES[seed % len(FILE_COURSES)],
        duration=FILE_LOG,
        imperfections=replace(imperfections, seed=FILE_SEED + seed),
        threads=1,
    )
    return batch.log(0).without_truth()


def wrong_by(log: Log, *, torque: float = 1.0, clock: float = 1.0) -> Log:
    """Return a log with scaled torques and times."""
    return log.with_columns({"t": clock * log.t, **{name: torque * log[name] for name in ("u1", "u2", "u3")}})


def by_file(piece: tuple[int, str]) -> ByFile:
    """Identify a log by a file, which is right, of a number of those drawn, or wrong, in one thread."""
    seed, name = piece
    log, known = rollers_log(seed), ROBOT
    if name in WRONG_FILES:
        key, factor = WRONG_FILES[name], 1.05 if "radius" in name else 1.0 / 1.4
        torque, clock = 1.25 if "torque" in name else 1.0, 1.05 if "clock" in name else 1.0
        log = wrong_by(log, torque=torque, clock=clock)
        known = ROBOT.replace({key: factor * cast("float", value_of(ROBOT, BY_NAME[key]))}) if key else ROBOT
    elif name != "right":
        number = DRAWN * seed + int(name)
        sizes = np.array([DEVIATIONS[name] for name in ("drive.torque_constant", "sensors.sample_time")])
        torque, clock = 1.0 + sizes * np.random.default_rng([FILE_SEED, number]).standard_normal(2)
        log, known = wrong_by(log, torque=torque, clock=clock), _drawn_files()[number]
    options, run = IdentificationOptions(most_profiles=0), Run(seed=0, executor=Threads(count=1))
    found = identify(known, log, options=options, run=run)
    farthest = max(found.file_values, key=lambda value: abs(value.apart))
    return ByFile(
        estimates=dict(zip(found.labels, found.values.tolist(), strict=True)),
        intervals=dict(found.intervals),
        farthest=(farthest.label, farthest.apart),
        named=(
            *(value.label for value in found.file_values if abs(value.apart) > WRONG),
            *(one.code for one in found.log_findings if one.code.startswith("robot-")),
        ),
    )


@cache
def _drawn_files() -> list[Robot]:
    """Return the robots of the files; those that no body has are drawn again."""
    return draw_robots(with_default_errors(ROBOT), FILE_LOGS * DRAWN, seed=FILE_SEED)


def file_values() -> Section:
    """Run the missing logs and return a section on robot files."""
    names = {seed: ["right", *map(str, range(DRAWN))] for seed in range(FILE_LOGS)}
    names |= {seed: [*names[seed], *WRONG_FILES] for seed in range(FEW)}
    runs = {f"{seed:02d} {name.replace('/', 'over')}": (seed, name) for seed in names for name in names[seed]}
    packages = ("fitting", "identification", "mechanics", "simulation", "control", "robot", "log")
    done = dict(
        zip(runs.values(), finished("file_values", by_file, runs, packages=packages).values(), strict=True)
    )
    drawn = [piece for piece in done if piece[1].isdigit()]
    kinds = {"drawn from its deviations": drawn}
    kinds |= {name: [piece for piece in done if piece[1] == name] for name in WRONG_FILES}
    return Section(
        title="Robot files that are wrong",
        before=f"{FILE_LOGS} logs of {FILE_LOG:g} s in the compiled loop with the nominal scenario's rollers, play and "
        f"pivoting ball, each identified by the right file, by {DRAWN} that are drawn from its deviations, with "
        f"torques and times scaled by theirs, and {FEW} of them by files that are wrong by more. A value is "
        "named if it is more than four deviations from the log's own estimate, or if a check of the log warns of it. "
        "Estimates of the right file "
        "should lie within the 95 % intervals of the others.",
        columns=[
            "file",
            "logs",
            "named",
            "farthest value: median",
            "most",
            "outside",
            "logs with any outside",
        ],
        rows=[_file_row(name, pieces, done) for name, pieces in kinds.items()],
        after="Named, or outside without being named: "
        + "; ".join(
            f"{name}: {', '.join(words) or 'none'}"
            for name, words in ((name, _named_or_outside(name, done)) for name in WRONG_FILES)
        )
        + ".",
    )


def _outside(piece: tuple[int, str], done: Mapping[tuple[int, str], ByFile]) -> tuple[list[str], int]:
    """Return the labels whose interval by a file lacks what the right file gives, and how many are compared."""
    truth, found = done[piece[0], "right"].estimates, done[piece].intervals
    lacking = [label for label, ends in found.items() if not ends.lower <= truth[label] <= ends.upper]
    return lacking, len(found)


def _file_row(
    name: str, pieces: Sequence[tuple[int, str]], done: Mapping[tuple[int, str], ByFile]
) -> list[str]:
    apart = np.sort([abs(done[piece].farthest[1]) for piece in pieces])
    lacking = [_outside(piece, done) for piece in pieces]
    return [
        name,
        str(len(pieces)),
        share_words(sum(bool(done[piece].named) for piece in pieces), len(pieces)),
        *(f"{value:.1f}" for value in (np.median(apart), apart[-1])),
        share_words(sum(len(labels) for labels, _ in lacking), sum(count for _, count in lacking)),
        share_words(sum(bool(labels) for labels, _ in lacking), len(pieces)),
    ]


def _named_or_outside(name: str, done: Mapping[tuple[int, str], ByFile]) -> list[str]:
    words: list[str] = []
    for piece in (piece for piece in done if piece[1] == name):
        lacking, named = _outside(piece, done)[0], done[piece].named
        if named or lacking:
            words.append(f"log {piece[0]} {'named ' + every(named) if named else every(lacking)}")
    return words
