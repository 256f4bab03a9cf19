"""Count how often 95 % intervals contain the truth, and how often a right robot file is refused: 200 logs each.

.venv/bin/python -m campaigns.evidence coverage
.venv/bin/python -c "from campaigns.coverage import file_values; print(file_values().markdown())"

Finished repeats are kept in build/coverage and build/file_values and are not repeated: an interrupted campaign
continues.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.stats import binom

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import square
from ballbot.fitting.fit import fit
from ballbot.fitting.intervals import Interval
from ballbot.fitting.run import Run, Threads
from ballbot.identification.file_values import DEVIATIONS
from ballbot.identification.identify import IdentificationOptions, identify, prepare
from ballbot.identification.quantities import scale_between
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.robot.variations import draw_robots, with_default_errors
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from benchmarks.workloads import nominal_robot
from campaigns.section import Section, finished, share_words
from campaigns.twin_logs import ROBOT, twin_log

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


#: nominal twins whose file is drawn from its deviations, and the length of each one's log [s]
FILES, FILE_LOG = 200, 24.0


@dataclass(frozen=True, kw_only=True)
class DrawnFile:
    """What became of a twin's log by a file that is wrong by its deviations."""

    farthest: tuple[str, float]  #: the value farthest from the log's own estimate, and by how many deviations
    refused: bool
    outside: int  #: 95 % intervals without what the right file gives, of `intervals`
    intervals: int


@cache
def _drawn_robots() -> list[Robot]:
    """Return the robots of the files; those that no body has are drawn again."""
    return draw_robots(with_default_errors(ROBOT), FILES, seed=71)


def drawn_file(seed: int) -> DrawnFile:
    """Identify a nominal twin by its own file, and by one drawn from its deviations, in one thread."""
    course = ("square", "figure_eight", "circle")[seed % 3]
    return file_drawn(twin_log(course, duration=FILE_LOG, seed=seed), seed)


def file_drawn(log: Log, seed: int) -> DrawnFile:
    """Identify a log of the nominal twin by its own file, and by one drawn from its deviations, in one thread."""
    options, run = IdentificationOptions(most_profiles=0), Run(seed=0, executor=Threads(count=1))
    known = _drawn_robots()[seed]
    sizes = np.array([DEVIATIONS[name] for name in ("drive.torque_constant", "sensors.sample_time")])
    torque, clock = 1.0 + sizes * np.random.default_rng([seed, 71]).standard_normal(2)
    wrong = log.with_columns(
        {"t": clock * log.t, **{name: torque * log[name] for name in ("u1", "u2", "u3")}}
    )
    right, found = (
        identify(robot, one, options=options, run=run) for robot, one in ((ROBOT, log), (known, wrong))
    )
    farthest = max(found.file_values, key=lambda value: abs(value.apart))
    truth = dict(zip(right.labels, right.values.tolist(), strict=True))
    inside = [ends.lower <= truth[label] <= ends.upper for label, ends in found.intervals.items()]
    return DrawnFile(
        farthest=(farthest.label, farthest.apart),
        refused=bool(found.contradicted),
        outside=inside.count(False),
        intervals=len(inside),
    )


def file_values() -> Section:
    """Run the missing twins and return a section on robot files."""
    runs = {f"{seed:04d}": seed for seed in range(FILES)}
    packages = ("fitting", "identification", "mechanics", "twin", "control", "robot", "log")
    done = list(finished("file_values", drawn_file, runs, packages=packages).values())
    apart = np.sort([abs(one.farthest[1]) for one in done])
    outside, intervals = sum(one.outside for one in done), sum(one.intervals for one in done)
    return Section(
        title="Robot files that are wrong by their deviations",
        before=f"{FILES} logs of {FILE_LOG:g} s of the nominal twin, each identified by the twin's own file and by one "
        "drawn from its standard deviations, with torques and times scaled by theirs. A file is refused if a value is "
        "more than four deviations from the log's own estimate.",
        columns=[
            "refused",
            "farthest value: median",
            "95 %",
            "most",
            "right file's estimates outside the 95 % intervals",
        ],
        rows=[
            [
                share_words(sum(one.refused for one in done), len(done)),
                *(f"{apart[int(share * (len(apart) - 1))]:.1f}" for share in (0.5, 0.95, 1.0)),
                share_words(outside, intervals),
            ]
        ],
    )
