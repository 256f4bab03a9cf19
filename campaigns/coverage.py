"""Count how often 95 % intervals contain the truth: 200 noisy logs, simulated and identified.

.venv/bin/python -m campaigns.evidence coverage

Finished repeats are kept in build/coverage and are not repeated: an interrupted campaign continues.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import square
from ballbot.fitting.fit import fit
from ballbot.fitting.intervals import Interval
from ballbot.fitting.run import Run, Threads
from ballbot.identification.identify import IdentificationOptions, prepare
from ballbot.identification.quantities import scale_between
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from benchmarks.workloads import nominal_robot
from campaigns.section import Section, finished

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
