"""Measure `ballbot check-log` on logs of other people's making: twin logs renamed, permuted, scaled, turned and cut.

.venv/bin/python -m campaigns.evidence mapping_corpus
.venv/bin/python -m campaigns.mapping_corpus development 200     that half, that many variants, with each failure

A variant is a stretch of a recorded log, written as a team might write it (`campaigns.foreign_logs`). Ballbot proposes
a mapping, and the log that this mapping makes is compared with the recorded one. A result is

right           the log is the recorded one, up to a transformation that leaves every measured signal and the robot's
                dynamics unchanged, or a dead band counted as less dry friction (`differences`)
undetermined    a conclusion is below the confidence that `check-log` asks for, so that it names the line to fill in
doubtful        wrong, with a stated confidence below 0.9
wrong           wrong, and confident

The development halves are for work on the inference, and its calibration is fitted on them. The test half has other
robots, motions and seeds and is run once to judge it (`campaigns.mapping_recordings`); looked at, it becomes a
development half, and another test half is made for the next version.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.checks.torque_balance import smoothed_wheel_speeds
from ballbot.log.formats import is_foreign
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.frame import TURNING_BY_WHEELS
from ballbot.log.mapping_inference.proposal import propose
from ballbot.log.mapping_inference.report import Evaluation, evaluate
from ballbot.processes import worker_pool
from ballbot.robot import Robot
from campaigns.course_robot import SOURCE, SOURCES, log_file
from campaigns.foreign_logs import Habits, columns_of, commands, draw, row_times, write
from campaigns.mapping_recordings import HABITS_SEED, MOTIONS, ROBOTS, Half, dead_band, recording, robot_named
from campaigns.section import DataMissingError, Section

#: length of the Hann window [s] that smooths both logs before they are compared. Its first zero is at 8 Hz: noise of
#: the lean and chatter of the commands, which differ after an error of a millisecond in a delay, are above that
SMOOTHED = 0.25
#: largest error of the lean's size [-] and turn [rad], and of the wheels' angles and torques over their size [-]
LEAN_ERROR, TURN_ERROR, WHEEL_ERROR, TORQUE_ERROR = 0.1, np.radians(12.0), 0.03, 0.2
#: a torque's size counts as at least this part of all wheels' (root mean square): a wheel that hardly drives has little
#: but the noise of its speed, in a torque that is too small to matter
LEAST_TORQUE = 0.5

Result = Literal["right", "undetermined", "doubtful", "wrong"]


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What a proposed mapping is worth."""

    result: Result
    answered: Result  #: the same once the user gives the firmware's dead band, if only that was asked
    reason: str  #: what is undetermined or wrong
    confidence: float  #: the least of the conclusions


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one variant."""

    half: Half
    seed: int
    robot: str
    motion: str
    duration: float  #: [s]
    judgement: Judgement


def outcome(half: Half, seed: int) -> Outcome:
    """Write the variant of a seed as a foreign log, let Ballbot propose its mapping, and judge it."""
    name = ROBOTS[half][seed % len(ROBOTS[half])]
    motion = MOTIONS[half][seed // len(ROBOTS[half]) % len(MOTIONS[half])]
    robot, log = robot_named(name), recording(half, name, motion)
    band = dead_band(robot) if motion == "dead_band" else 0.0
    habits = draw(HABITS_SEED[half] + seed, robot, dead_band=bool(band), whole=float(log.t[-1]))
    return Outcome(
        half=half,
        seed=seed,
        robot=name,
        motion=motion,
        duration=habits.duration,
        judgement=judged(log, robot, habits, dead_band=band),
    )


def judged(truth: Log, robot: Robot, habits: Habits, *, dead_band: float) -> Judgement:
    """Write a log as a team of these habits does, and return what its proposed mapping is worth."""
    with tempfile.TemporaryDirectory() as folder:
        table = columns_of(truth, habits, robot, dead_band=dead_band)
        path, given = write(Path(folder) / "log", table, habits)
        if given is None and not is_foreign(path):  # the command would take it for a log of Ballbot's
            return Judgement(result="wrong", answered="wrong", reason="not taken for foreign", confidence=1.0)
        try:
            proposal = propose(path, robot, columns=given)
            found = evaluate(proposal, robot, file=path)
            asked = [one.name for one in found.undetermined]
            result, reason, confidence = _worth(found, truth, robot, habits, dead_band=dead_band)
            answered = result
            if asked == ["dead band"]:
                known = evaluate(replace(proposal, dead_band=dead_band), robot, file=path)
                answered, _, _ = _worth(known, truth, robot, habits, dead_band=dead_band)
        except InputError as error:
            result, answered, confidence = "undetermined", "undetermined", 0.0
            reason = str(error)[:160].replace(str(path), "")
        except Exception as error:  # a user would see a traceback
            result, answered, confidence, reason = "wrong", "wrong", 1.0, f"crash: {error!r}"
    return Judgement(result=result, answered=answered, reason=reason, confidence=confidence)


def _worth(
    found: Evaluation, truth: Log, robot: Robot, habits: Habits, *, dead_band: float
) -> tuple[Result, str, float]:
    """Return what an evaluation is worth, what is undetermined or wrong, and its least confidence."""
    confidence = min(one.confidence for one in found.conclusions)
    if found.log is None or found.refusal:
        return "undetermined", found.refusal[:200], confidence
    wrong = differences(found, truth, robot, habits, dead_band=dead_band)
    if not wrong:
        return "right", "", confidence
    return ("wrong" if confidence >= CONFIDENT else "doubtful"), wrong, confidence


def differences(found: Evaluation, truth: Log, robot: Robot, habits: Habits, *, dead_band: float) -> str:
    """Return in what the mapped log differs from the truth under the best of the transformations; empty if in nothing.

    The transformations leave every measured signal and the robot's dynamics unchanged:

    - the robot turned by the angle between two wheels, with the wheels renamed in a circle;
    - the robot mirrored in the plane of wheel 1: the lean mirrored, heading, wheels and torques negated, the wheels'
      order reversed;
    - another origin of the heading, and of each wheel's angle;
    - if the file has no heading, and the robot hardly turns: all wheels and torques negated and the lean turned by half
      a turn.

    Besides, a dead band that the mapping does not state counts as so much less dry friction, which is the same while
    wheels turn the way their duties drive them. The torques are compared with the truth's in this form, so that what
    wheels that turn against their duties make of it is an error.
    """
    log = found.log
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
    not_stated = dead_band - (found.proposal.added_duty or 0.0)
    real["torques"] = _as_written(truth, truth.torques - _less_friction(truth, robot, not_stated), habits, t)
    still = not habits.yaw and float(np.std(real["heading"])) < TURNING_BY_WHEELS
    equivalents = _equivalents(real, robot, half_turn=still)
    return min((_compared(mapped, one, habits.yaw, log.sample_time) for one in equivalents), key=len)


#: a robot is in motion while a wheel turns faster [rad/s]
IN_MOTION = 0.1


def _seconds_in_motion(log: Log) -> float:
    return float((np.abs(log.wheel_speeds) > IN_MOTION).any(axis=1).sum()) * log.sample_time


Signals = dict[str, NDArray[np.float64]]


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
        places = [(-k) % n for k in range(n)] if mirrored else list(range(n))
        for k in range(n):
            turned = z * np.exp(-2j * np.pi * k / n)
            moved = [places[(i + k) % n] for i in range(n)]
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
    z, y = (np.array([1.0, 1j]) @ _smoothed(one["lean"], interval) for one in (mapped, real))
    z, y = z - z.mean(), y - y.mean()
    gain = np.vdot(y, z) / np.vdot(y, y)
    if abs(abs(gain) - 1.0) > LEAN_ERROR or abs(np.angle(gain)) > TURN_ERROR:
        wrong.append(f"lean {abs(gain):.2f} at {np.degrees(np.angle(gain)):.0f} deg")
    turned, turning = (_smoothed(one["heading"], interval) for one in (mapped, real))
    if heading and _size_error(turned, turning) > LEAN_ERROR:
        wrong.append("heading")
    errors = [_size_error(a[None], b[None]) for a, b in zip(mapped["wheels"], real["wheels"], strict=True)]
    if max(errors) > WHEEL_ERROR:
        wrong.append(f"wheels {max(errors):.2f}")
    a, b = (_smoothed(one["torques"], interval) for one in (mapped, real))
    least = LEAST_TORQUE * float(np.sqrt(b.var(axis=1).mean()))
    errors = [float(np.std(x - y) / max(np.std(y), least)) for x, y in zip(a, b, strict=True)]
    if max(errors) > TORQUE_ERROR:
        wrong.append(f"torques {max(errors):.2f}")
    return ", ".join(wrong)


def _less_friction(truth: Log, robot: Robot, dead_band: float) -> NDArray[np.float64]:
    """Return the torques (M, n) by which dry friction is less if a dead band that nobody states counts as such."""
    speeds = smoothed_wheel_speeds(truth, robot)
    duty = commands(robot, truth.torques, truth.wheel_speeds, "duty")
    return dead_band * robot.drive.torque_limit * np.where(speeds == 0.0, np.sign(duty), np.sign(speeds))


def _as_written(
    truth: Log, torques: NDArray[np.float64], habits: Habits, t: NDArray[np.float64]
) -> NDArray[np.float64]:
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
    places = [np.clip(np.searchsorted(start, part, side="right") - 1, 0, None) for part in parts]
    return np.mean([held[place] for place in places], axis=0).T


def _size_error(mapped: NDArray[np.float64], real: NDArray[np.float64]) -> float:
    """Return the root mean square of the difference, without its mean, over that of the signal."""
    difference = (mapped - real) - (mapped - real).mean()
    return float(np.std(difference) / max(float(np.std(real)), 0.01))


def _smoothed(values: NDArray[np.float64], interval: float) -> NDArray[np.float64]:
    window = np.hanning(round(SMOOTHED / interval) + 2)[1:-1]
    return np.array([np.convolve(row, window / window.sum(), mode="valid") for row in values])


def outcomes(half: Half, seeds: Sequence[int], *, processes: int = 1) -> Iterator[Outcome]:
    """Yield the outcomes of seeds as they come."""
    if processes == 1:
        yield from (outcome(half, seed) for seed in seeds)
        return
    with worker_pool(processes) as pool:
        runs = [pool.submit(outcome, half, seed) for seed in seeds]
        try:
            yield from (run.result() for run in as_completed(runs))
        finally:
            # whoever takes no more of them does not wait for the rest
            pool.shutdown(cancel_futures=True)


#: variants of each half
VARIANTS = 1000
RESULTS: tuple[Result, ...] = ("right", "undetermined", "doubtful", "wrong")
#: environment variables: variants of each half, the most minutes of the halves in turn, "4,4,4,4,4,20", and processes
COUNT, MINUTES, PROCESSES = "BALLBOT_VARIANTS", "BALLBOT_MINUTES", "BALLBOT_PROCESSES"


def campaign() -> Section:
    """Judge all halves and return the section of docs/generated/evidence.md."""
    count = int(os.environ.get(COUNT, VARIANTS))
    found = [one for half in ROBOTS for one in _followed(half, range(count))]
    return written(found)


def written(found: Sequence[Outcome]) -> Section:
    """Return the section with what else is said of recordings and real logs."""
    return section(found, dead_bands=dead_band_parts(), remarks=f"{time_in_motion()} {course_logs()}")


def time_in_motion() -> str:
    """Return a sentence on the part of the test half's recordings in which a wheel turns."""
    logs = [recording("test", robot, motion) for robot in ROBOTS["test"] for motion in MOTIONS["test"]]
    parts = [100.0 * _seconds_in_motion(one) / one.t[-1] for one in logs]
    return f"In the test half's recordings a wheel turns {min(parts):.0f} to {max(parts):.0f} % of the time."


def course_logs() -> str:
    """Return a sentence on the public logs of the course's robots; that they are missing, without them."""
    try:
        files = {name: log_file(name) for name in SOURCES}
    except DataMissingError as missing:
        return f"Real logs: {missing}."
    robot, said = Robot.load("rob311"), []
    for name, path in files.items():
        found = evaluate(propose(path, robot), robot, file=path)
        asked = ", ".join(one.name for one in found.undetermined)
        drive = found.proposal.drive
        read = f"read as {drive.unit.description}" if drive else "without commands"
        said.append(f"{name} ({SOURCES[name].sha256[:12]}): {f'asks for the {asked}' if asked else read}")
    return f"Real logs of the course's robots ({SOURCE}), whose commands are duties of full scale 1: {'; '.join(said)}."


def dead_band_parts() -> list[float]:
    """Return the part of the torques that the dead band is, smoothed as `differences` does, for every robot."""
    found = []
    for half, names in ROBOTS.items():
        for name in names:
            robot, log = robot_named(name), recording(half, name, "dead_band")
            duty = commands(robot, log.torques, log.wheel_speeds, "duty")
            added = dead_band(robot) * robot.drive.torque_limit * np.sign(duty)
            sizes = [_smoothed(one.T, log.sample_time).std(axis=1).mean() for one in (added, log.torques)]
            found.append(float(sizes[0] / sizes[1]))
    return found


def section(found: Sequence[Outcome], *, dead_bands: Sequence[float], remarks: str) -> Section:
    """Return the section of docs/generated/evidence.md.

    Parameters
    ----------
    found : sequence of Outcome
    dead_bands : sequence of float
        Of `dead_band_parts`.
    remarks : str
        Sentences on the test half's recordings and on real logs.
    """
    rows = []
    for half in ROBOTS:
        judged_ones = [one.judgement for one in found if one.half == half]
        total, counts = len(judged_ones), Counter(one.result for one in judged_ones)
        answered = Counter(one.answered for one in judged_ones)
        wrong_then = answered["doubtful"] + answered["wrong"]
        rows.append(
            [
                half.replace("_", " "),
                f"{total}",
                *(_share(counts[result], total) for result in RESULTS),
                f"{_share(answered['right'], total)}; wrong {_share(wrong_then, total)}",
            ]
        )
    wrong = "; ".join(
        f"{one.half.replace('_', ' ')} {one.seed} ({one.robot}, {one.motion}): {one.judgement.reason}"
        for one in found
        if one.judgement.result == "wrong"
    )
    asked = Counter(
        one.judgement.reason.split(";")[0].split("(")[0][:70].strip()
        for one in found
        if one.judgement.result == "undetermined"
    ).most_common(6)
    return Section(
        title="Mappings proposed for foreign logs",
        before="Stretches of 5 to 60 s of simulated logs, written as other teams write them"
        " (`campaigns/foreign_logs.py`): renamed, permuted, scaled, turned, mirrored, late, noisy, in several formats."
        " The inference was worked on with the development halves; the third to the fifth judged earlier versions."
        " The test half has other robots, motions and seeds. It was first run, unseen, for the version of commit"
        " b5b4f763; nothing was changed for what it showed. The first two halves are"
        " logs of the twin, the others of the equations of motion with the twin's sensors, play and friction. Right is"
        " the recorded log up to the transformations of"
        " `campaigns.mapping_corpus.differences`; the last column is with the firmware's dead band given if only that"
        " was asked. Intervals are of 95 % by Clopper and Pearson.",
        columns=[
            "half",
            "variants",
            "right",
            "undetermined",
            "wrong, confidence below 0.9",
            "confidently wrong",
            "right with the dead band given",
        ],
        rows=rows,
        after=f"{_by_duration(found)} Confidently wrong: {wrong or 'none'}. Undetermined most often: "
        + "; ".join(f"{reason} ({count})" for reason, count in asked)
        + f". The firmware's dead band is {100 * min(dead_bands):.0f} to {100 * max(dead_bands):.0f} % of the torques"
        f" of its logs. A mapping that does not state it is compared with torques less so much dry friction, and may"
        f" differ by {100 * TORQUE_ERROR:.0f} % of them. {remarks}"
        f" {MINUTES} limits the minutes of a half, and with them the number of its variants.",
    )


def _by_duration(found: Sequence[Outcome]) -> str:
    """Return a sentence on the share of the test half that is right, by the logs' durations."""
    shares = []
    for shortest, longest in pairwise((5.0, 10.0, 15.0, 60.0)):
        own = [one for one in found if one.half == "test" and shortest <= one.duration < longest]
        right = sum(one.judgement.result == "right" for one in own)
        shares.append(f"{_share(right, len(own))} of {shortest:.0f} to {longest:.0f} s")
    return f"Right in the test half, by the logs' durations: {'; '.join(shares)}."


def _share(count: int, total: int) -> str:
    if not total:
        return "-"
    low = 0.0 if count == 0 else float(beta.ppf(0.025, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(0.975, count + 1, total - count))
    return f"{count} ({100 * count / total:.1f} %, {100 * low:.1f} to {100 * high:.1f} %)"


def _followed(half: Half, seeds: Sequence[int]) -> Iterator[Outcome]:
    """Yield the outcomes of a half; those that are not right are named on standard error."""
    limits = dict(
        zip(ROBOTS, os.environ.get(MINUTES, ",".join(["inf"] * len(ROBOTS))).split(","), strict=True)
    )
    started, minutes = perf_counter(), float(limits[half])
    processes = int(os.environ.get(PROCESSES, os.cpu_count() or 1))
    for one in outcomes(half, seeds, processes=processes):
        judgement = one.judgement
        if judgement.result != "right":
            print(
                f"{half} {one.seed} {one.robot} {one.motion} {one.duration:.0f} s {judgement.result}, "
                f"with the dead band {judgement.answered}: {judgement.reason}",
                file=sys.stderr,
                flush=True,
            )
        yield one
        if perf_counter() - started > 60.0 * minutes:
            return


if __name__ == "__main__":
    halves: dict[str, Half] = {str(half): half for half in ROBOTS}
    chosen = halves[sys.argv[1]]
    outcomes_found = list(_followed(chosen, range(int(sys.argv[2]))))
    print(written(outcomes_found).markdown())
