"""Measure `ballbot check-log` on logs as other teams write them: renamed, permuted, scaled, turned and cut.

BALLBOT_VARIANTS=200 .venv/bin/python -m campaigns.evidence mapping_corpus    that many variants, each failure named

A variant is a stretch of a recorded log, written as a team might write it (`tests.support.foreign_logs`), with the kind
of its command stated, and the columns' names if the file has no header. The log that the proposed mapping makes is
compared with the recorded one. A result is

right    the log is the recorded one, up to a transformation that leaves every measured signal and the robot's dynamics
         unchanged, or a dead band counted as less dry friction (`differences`)
asked    something is asked for, or the log is refused
wrong    anything else
"""

import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.run import Processes
from ballbot.log import Log
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.placement import TURNING_BY_WHEELS
from ballbot.log.proposal import Proposal, evaluate, propose
from ballbot.log.torque_balance import smoothed_wheel_speeds
from ballbot.robot import Robot
from campaigns.mapping_recordings import MOTIONS, ROBOTS, dead_band, recording, robot_named
from campaigns.section import Section, finished, share_words
from tests.support.foreign_logs import (
    POLLED,
    STYLES,
    Command,
    Habits,
    Layout,
    columns_of,
    commands,
    row_times,
    write,
)

Floats = NDArray[np.float64]

#: length of the Hann window [s] that smooths both logs before they are compared. Its first zero is at 8 Hz: noise of
#: the lean and chatter of the commands, which differ after an error of a millisecond in a delay, are above that
SMOOTHED = 0.25
#: largest error of the lean's size [-] and turn [rad], and of the wheels' angles and torques over their size [-]
LEAN_ERROR, TURN_ERROR, WHEEL_ERROR, TORQUE_ERROR = 0.1, np.radians(12.0), 0.03, 0.2
#: a torque's size counts as at least this part of all wheels' (root mean square): a wheel that hardly drives has little
#: but the noise of its speed, in a torque that is too small to matter
LEAST_TORQUE = 0.5

Result = Literal["right", "asked", "wrong"]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The result of one variant."""

    seed: int
    robot: str
    motion: str
    duration: float  #: [s]
    result: Result
    reason: str  #: what is asked or wrong


def outcome(seed: int) -> Outcome:
    """Write the variant of a seed as a foreign log, let Ballbot propose its mapping, and judge it."""
    name, motion = _recorded(seed)
    robot, log = robot_named(name), recording(name, motion)
    habits = habits_of(seed)
    result, reason = judged(log, robot, habits, dead_band=dead_band(robot) if motion == "dead_band" else 0.0)
    return Outcome(
        seed=seed, robot=name, motion=motion, duration=habits.duration, result=result, reason=reason
    )


def _recorded(seed: int) -> tuple[str, str]:
    return ROBOTS[seed % len(ROBOTS)], MOTIONS[seed // len(ROBOTS) % len(MOTIONS)]


def habits_of(seed: int) -> Habits:
    """Return how the team of a seed writes its log."""
    name, motion = _recorded(seed)
    whole = float(recording(name, motion).t[-1])
    return draw(HABITS_SEED + seed, robot_named(name), dead_band=motion == "dead_band", whole=whole)


def draw(seed: int, robot: Robot, *, dead_band: bool, whole: float, longest: float = 60.0) -> Habits:
    """Return the habits of a seed for a log of `whole` seconds; stretches of 5 s to `longest`."""
    random = np.random.default_rng([16, seed])
    n = robot.wheel_count
    duration = float(np.exp(random.uniform(np.log(5.0), np.log(longest))))
    layouts: tuple[Layout, ...] = (
        *("comma", "comma", "semicolon", "tab", "blanks", "decimal_comma", "json", "mat"),
        *("no_header", "given_columns"),
    )  # fmt: skip
    command, unit, scale = _command(random, duty=dead_band)
    names = STYLES[random.integers(len(STYLES))]
    layout = layouts[random.integers(len(layouts))]
    reversed_axis = random.random() < 0.15
    drawn = Habits(
        start=float(random.uniform(0.0, whole - duration)),
        duration=duration,
        names=names,
        layout=layout,
        time_unit=("s", "s", "ms", "us")[random.integers(4)]
        if names.units
        else ("s", "s", "s", "ms")[random.integers(4)],
        time_offset=float(random.choice([0.0, random.uniform(1.0, 3000.0)])),
        order=tuple(random.permutation(n).tolist()) if random.random() < 0.5 else tuple(range(n)),
        signs=_signs(random, n),
        command_order=tuple(random.permutation(n).tolist()) if random.random() < 0.2 else (),
        command_signs=_signs(random, n),
        turn=_turn(random),
        pitch_sign=-1 if reversed_axis else 1,
        yaw_sign=-1 if random.random() < 0.05 else 1,
        swapped=random.random() < 0.08,
        lean_unit=("rad", "deg")[random.integers(2)],
        wheel_unit=("rad", "rad", "deg", "counts", "counts", "turn")[random.integers(6)],
        gyro_unit=(None, None, "rad/s", "rad/s", "deg/s")[random.integers(5)],
        yaw=random.random() < 0.8,
        command=command,
        command_unit=unit,
        command_scale=scale,
        sensor_delay=float(random.choice([0.0, random.uniform(0.0, 0.02)])),
        command_delay=float(random.choice([0.0, random.uniform(0.0, 0.015)])),
        noise=float(random.choice([0.0, random.uniform(1e-4, 1e-3)])),
        interval=float(random.choice([0.0, 0.0, 0.01, POLLED])),
        extras=random.random() < 0.5,
        seed=seed,
    )
    if drawn.interval == POLLED:
        drawn = replace(drawn, messages=0.005)
    if random.random() < 0.15:  # tilts need the heading that they do not turn with
        drawn = replace(drawn, tilts=True, yaw=True)
    if random.random() < 0.1:  # the first two wheels' cables are exchanged
        drawn = replace(drawn, order=(1, 0, *range(2, n)), turn=0.0)
    return drawn


def _command(random: np.random.Generator, *, duty: bool) -> tuple[Command, str, float]:
    others: tuple[tuple[Command, str, float], ...] = (
        ("torque", "N m", 1.0),
        ("torque", "mN m", 1e3),
        ("current", "A", 1.0),
        ("current", "mA", 1e3),
    )
    if not duty and random.random() < 0.45:
        return others[random.choice(4, p=[0.5, 0.15, 0.25, 0.1])]
    if not duty and random.random() < 0.1:
        return ("voltage", "V", 1.0)
    full = float(random.choice([1.0, 100.0, 255.0, 1000.0], p=[0.5, 0.2, 0.2, 0.1]))
    return ("duty", "%" if full == 100.0 else "", full)


def _signs(random: np.random.Generator, n: int) -> tuple[int, ...]:
    kind = random.random()
    if kind < 0.5:
        return (1,) * n
    if kind < 0.75:
        return (-1,) * n
    return tuple(int(sign) for sign in random.choice([-1, 1], n))


def _turn(random: np.random.Generator) -> float:
    kind = random.random()
    if kind < 0.4:
        return 0.0
    if kind < 0.8:
        return float(np.radians(random.choice([30.0, 45.0, 60.0, 90.0, 180.0, -30.0, -45.0, -90.0, -120.0])))
    return float(random.uniform(-np.pi, np.pi))


def judged(truth: Log, robot: Robot, habits: Habits, *, dead_band: float) -> tuple[Result, str]:
    """Write a log as a team of these habits does, and return what its proposed mapping is worth, and why."""
    with tempfile.TemporaryDirectory() as folder:
        table = columns_of(truth, habits, robot, dead_band=dead_band)
        path, given = write(Path(folder) / "log", table, habits)
        try:
            proposal = evaluate(propose(path, robot, Stated(command=habits.command, columns=given)))
        except InputError as error:
            return "asked", str(error)[:160].replace(str(path), "")
        except Exception as error:  # a user would see a traceback
            return "wrong", f"crash: {error!r}"
    if proposal.log is None or proposal.refusal:
        return "asked", proposal.refusal[:200]
    wrong = differences(proposal, truth, robot, habits, _less_friction(truth, robot, dead_band))
    return ("wrong" if wrong else "right"), wrong


def differences(proposal: Proposal, truth: Log, robot: Robot, habits: Habits, unstated: Floats) -> str:
    """Return how the mapped log differs from the truth under the best of the transformations; empty if it does not.

    The transformations leave every measured signal and the robot's dynamics unchanged:

    - the robot turned by the angle between two wheels, with the wheels renamed in a circle;
    - the robot mirrored in the plane of wheel 1: the lean mirrored, heading, wheels and torques negated, the wheels'
      order reversed;
    - another origin of the heading, and of each wheel's angle;
    - if the file has no heading, and the robot hardly turns: all wheels and torques negated and the lean turned by half
      a turn.

    Besides, a dead band that the mapping does not state counts as so much less dry friction, which is the same while
    wheels turn the way their duties drive them. The torques are compared with the truth's less these (M, n),
    `unstated`, so that what wheels that turn against their duties make of it is an error.
    """
    log = proposal.log
    if log is None:
        return "no log"
    t = log.t - habits.time_offset
    # a mapping leaves out what stands still
    least = 0.5 * _seconds_in_motion(truth.between(habits.start, habits.start + habits.duration)) - 3.0
    if t[0] < truth.t[0] - 0.1 or t[-1] > truth.t[-1] + 0.1 or t[-1] - t[0] < least:
        return "time"
    if "u1" not in log:
        return "no commands"
    mapped, real = _body_frame(log), _body_frame(truth)
    real = {name: np.array([np.interp(t, truth.t, row) for row in values]) for name, values in real.items()}
    real["torques"] = _as_written(truth, truth.torques - unstated, habits, t)
    still = not habits.yaw and float(np.std(real["heading"])) < TURNING_BY_WHEELS
    equivalents = _equivalents(real, robot, half_turn=still)
    return min((_compared(mapped, form, habits.yaw, log.sample_time) for form in equivalents), key=len)


#: a robot is in motion while a wheel turns faster [rad/s]
IN_MOTION = 0.1


def _seconds_in_motion(log: Log) -> float:
    return float((np.abs(log.wheel_speeds) > IN_MOTION).any(axis=1).sum()) * log.sample_time


Signals = dict[str, Floats]


def _body_frame(log: Log) -> Signals:
    """Return lean (2, N) in the body's frame, heading (1, N), wheel angles and torques (n, N)."""
    lean = (log["theta"] + 1j * log["phi"]) * np.exp(-1j * log["psi"])
    return {
        "lean": np.array([lean.real, lean.imag]),
        "heading": log["psi"][None],
        "wheels": log.wheel_angles.T,
        "torques": log.torques.T,
    }


def _equivalents(real: Signals, robot: Robot, *, half_turn: bool) -> Iterator[Signals]:
    n, first = robot.wheel_count, robot.wheels.azimuths[0]
    lean = real["lean"][0] + 1j * real["lean"][1]
    for mirrored in (False, True):
        z = -np.exp(2j * first) * lean.conj() if mirrored else lean
        sign = -1.0 if mirrored else 1.0
        order = [(-k) % n for k in range(n)] if mirrored else list(range(n))
        for k in range(n):
            turned = z * np.exp(-2j * np.pi * k / n)
            moved = [order[(i + k) % n] for i in range(n)]
            for half in (1.0, -1.0) if half_turn else (1.0,):
                yield {
                    "lean": half * np.array([turned.real, turned.imag]),
                    "heading": sign * real["heading"],
                    "wheels": sign * half * real["wheels"][moved],
                    "torques": sign * half * real["torques"][moved],
                }


def _compared(mapped: Signals, real: Signals, heading: bool, interval: float) -> str:
    """Return the names of the signals that differ, with by how much."""
    wrong = []
    z, y = (np.array([1.0, 1j]) @ _smoothed(signals["lean"], interval) for signals in (mapped, real))
    z, y = z - z.mean(), y - y.mean()
    gain = np.vdot(y, z) / np.vdot(y, y)
    if abs(abs(gain) - 1.0) > LEAN_ERROR or abs(np.angle(gain)) > TURN_ERROR:
        wrong.append(f"lean {abs(gain):.2f} at {np.degrees(np.angle(gain)):.0f} deg")
    turned, turning = (_smoothed(signals["heading"], interval) for signals in (mapped, real))
    if heading and _size_error(turned, turning) > LEAN_ERROR:
        wrong.append("heading")
    errors = [_size_error(a[None], b[None]) for a, b in zip(mapped["wheels"], real["wheels"], strict=True)]
    if max(errors) > WHEEL_ERROR:
        wrong.append(f"wheels {max(errors):.2f}")
    a, b = (_smoothed(signals["torques"], interval) for signals in (mapped, real))
    least = LEAST_TORQUE * float(np.sqrt(b.var(axis=1).mean()))
    errors = [float(np.std(x - y) / max(np.std(y), least)) for x, y in zip(a, b, strict=True)]
    if max(errors) > TORQUE_ERROR:
        wrong.append(f"torques {max(errors):.2f}")
    return ", ".join(wrong)


def _less_friction(truth: Log, robot: Robot, dead_band: float) -> Floats:
    """Return the torques (M, n) by which dry friction is less if a dead band that nobody states counts as such."""
    duty, speeds = (
        commands(robot, truth.torques, truth.wheel_speeds, "duty"),
        smoothed_wheel_speeds(truth, robot),
    )
    return dead_band * robot.drive.torque_limit * np.sign(np.where(speeds == 0.0, duty, speeds))


def _as_written(truth: Log, torques: Floats, habits: Habits, t: Floats) -> Floats:
    """Return torques (M, n) of the truth's rows as (n, N) at times t, as a true mapping makes them.

    Rows far apart miss what is between them.
    """
    written = row_times(truth.between(habits.start, habits.start + habits.duration), habits)
    last = np.clip(np.searchsorted(truth.t, written + habits.command_delay + 1e-9, side="right") - 1, 0, None)
    held = torques[last]
    # without an interval of its own the log has whole rows, and the delay, too
    late = habits.command_delay if habits.interval else 0.0
    start = written + late if habits.interval else truth.t[last]
    # means over a row of the mapped log, as a mapping makes them, so that chatter of the commands cancels
    parts = [t + part * float(np.median(np.diff(t))) for part in np.arange(0.05, 1.0, 0.1)]
    rows = [np.clip(np.searchsorted(start, part, side="right") - 1, 0, None) for part in parts]
    return np.mean([held[row] for row in rows], axis=0).T


def _size_error(mapped: Floats, real: Floats) -> float:
    """Return the root mean square of the difference, without its mean, over that of the signal."""
    difference = (mapped - real) - (mapped - real).mean()
    return float(np.std(difference) / max(float(np.std(real)), 0.01))


def _smoothed(values: Floats, interval: float) -> Floats:
    window = np.hanning(round(SMOOTHED / interval) + 2)[1:-1]
    return np.array([np.convolve(row, window / window.sum(), mode="valid") for row in values])


#: variants, and the first seed of their teams' habits. The conventions of angles were tuned on 71_000_000, and judged
#: once on 72_000_000, both on the first variants of robots of their own, alten and kugle
VARIANTS, HABITS_SEED = 2000, 425655256
#: environment variables: variants, and processes
COUNT, PROCESSES = "BALLBOT_VARIANTS", "BALLBOT_PROCESSES"
RESULTS: tuple[Result, ...] = ("right", "asked", "wrong")
#: the shortest log that `docs/first_log.md` asks for [s], and rows of the table: shortest and longest stretch [s]
SHORTEST = 15.0
DURATIONS = ((SHORTEST, 60.0), (SHORTEST, 30.0), (30.0, 60.0))


def campaign() -> Section:
    """Judge variants and return the section of docs/generated/evidence.md.

    Variants that were judged before by the same code, in build/mapping_outcomes, are not judged again.
    """
    long = (seed for seed in count() if habits_of(seed).duration >= SHORTEST)
    seeds = list(islice(long, int(os.environ.get(COUNT, VARIANTS))))
    workers = Processes(count=int(os.environ[PROCESSES]) if PROCESSES in os.environ else None)
    judged = finished(
        "mapping_outcomes", outcome, {f"{seed:05}": seed for seed in seeds}, packages=["log"], workers=workers
    )
    outcomes, rows = list(judged.values()), []
    for shortest, longest in DURATIONS:
        counts = Counter(case.result for case in outcomes if shortest <= case.duration <= longest)
        shares = [f"{counts[result]}: {share_words(counts[result], counts.total())}" for result in RESULTS]
        rows.append([f"{shortest:.0f} to {longest:.0f} s", f"{counts.total()}", *shares])
    wrong = [
        f"{case.seed} ({case.robot}, {case.motion}): {case.reason}"
        for case in outcomes
        if case.result == "wrong"
    ]
    asked = Counter(case.reason.split(";")[0][:90].strip() for case in outcomes if case.result == "asked")
    return Section(
        title="Mappings proposed for foreign logs",
        before=f"Stretches of 15 to 60 s of simulated logs of {len(ROBOTS)} robots, written as other teams write them"
        " (`tests/support/foreign_logs.py`): renamed, "
        "permuted, negated, scaled, turned, mirrored, late, noisy, in several"
        " formats, with the kind of the command stated. Right is the recorded log up to the transformations of"
        " `campaigns.mapping_corpus.differences`. 15 s is what `docs/first_log.md` asks for. (Of 918 stretches of 5 to"
        " 15 s, measured once at commit 2aa9aa1d, 526 were right and 3 wrong, without a question.) Intervals are of 95"
        " % by Clopper and Pearson.",
        columns=["duration", "variants", *RESULTS],
        rows=rows,
        after=f"Wrong: {'; '.join(wrong) or 'none'}. Asked most often: "
        + "; ".join(f"{reason} ({count})" for reason, count in asked.most_common(6))
        + f". {COUNT} limits the number of variants.",
    )
