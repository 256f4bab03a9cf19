"""How often `check-log` is right about wheels and commands on short windows of three development halves.

.venv/bin/python -m campaigns.mapping_windows 60       variants of each

Whole logs hardly ever have wrong placements, and no constant could be fitted to them. So each log is judged on windows
of a few seconds, cut out at random, as if the rest had not been recorded. `LEAST_RATIO` and `EACH_SECOND` of
`ballbot.log.mapping_inference.commands` and of `ballbot.log.mapping_inference.placements` were chosen
on such windows, so that an answer of confidence 0.9 or more is hardly ever wrong. An assignment is judged only if the
whole log's frame is right.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.mapping_inference.drive import drive_evidence
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.placement import lean_test
from ballbot.log.mapping_inference.placements import Placement, even_azimuths
from ballbot.log.mapping_inference.proposal import Proposal, log_mapping, propose
from ballbot.robot import Robot
from campaigns.foreign_logs import Habits, columns_of, draw, write
from campaigns.mapping_corpus import TORQUE_ERROR, WHEEL_ERROR
from campaigns.mapping_recordings import (
    BY_EQUATIONS,
    HABITS_SEED,
    MOTIONS,
    ROBOTS,
    Half,
    dead_band,
    recording,
    robot_named,
)

#: lengths of the windows [s], and windows of each length of a log
LENGTHS, EACH = (4.0, 6.0, 8.0, 12.0), 2

Question = Literal["wheels", "commands"]


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The answer to one question from one window."""

    question: Question
    half: Half
    seed: int
    length: float  #: [s]
    confidence: float
    right: bool


def answers(half: Half, seed: int) -> Iterator[Answer]:
    """Yield the answers of the windows of one variant."""
    name = ROBOTS[half][seed % len(ROBOTS[half])]
    motion = MOTIONS[half][seed // len(ROBOTS[half]) % len(MOTIONS[half])]
    robot, log = robot_named(name), recording(half, name, motion)
    band = dead_band(robot) if motion == "dead_band" else 0.0
    habits = draw(HABITS_SEED[half] + seed, robot, dead_band=bool(band), whole=float(log.t[-1]))
    habits = replace(habits, layout="comma")
    with tempfile.TemporaryDirectory() as folder:
        path, _ = write(Path(folder) / "log", columns_of(log, habits, robot, dead_band=band), habits)
        try:
            proposal = propose(path, robot)
        except InputError:
            return
    random = np.random.default_rng([19, seed])
    for length in LENGTHS:
        for start in random.uniform(
            0.0, max(habits.duration - length, 0.0), EACH if habits.duration > length else 0
        ):
            window = float(proposal.signals.rows[0] + start), length
            found = (_wheels(proposal, robot, habits, window), _commands(proposal, robot, habits, window))
            for question, one in zip(("wheels", "commands"), found, strict=True):
                if one is not None:
                    yield Answer(
                        question=question,
                        half=half,
                        seed=seed,
                        length=length,
                        confidence=one[0],
                        right=one[1],
                    )


def _wheels(
    proposal: Proposal, robot: Robot, habits: Habits, window: tuple[float, float]
) -> tuple[float, bool] | None:
    """Return the confidence in the placement of a window and whether it is right; None without one."""
    signals, (start, length) = proposal.signals, window
    if signals.lean is None:
        return None
    inside = (signals.rows >= start) & (signals.rows < start + length)
    tested = lean_test(robot, signals.lean, signals.wheels, signals.heading, signals.usable & inside)
    if tested is None:
        return None
    true = _true_placement(robot, habits)
    return tested.confidence, _same(robot, signals.wheels.value[inside], tested.placements[0], true)


def _true_placement(robot: Robot, habits: Habits) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the wheels (from 0) and signs of the file, seen in the IMU's handedness."""
    n, positions = robot.wheel_count, list(habits.order)
    if even_azimuths(robot):
        positions = [(place - positions[0]) % n for place in positions]
    if habits.pitch_sign * (-1 if habits.swapped else 1) < 0:
        positions = [-place % n for place in positions]
    return tuple(positions), habits.signs


def _same(
    robot: Robot,
    angles: NDArray[np.float64],
    found: Placement,
    true: tuple[tuple[int, ...], tuple[int, ...]],
) -> bool:
    """Return whether a placement gives the robot's wheels their angles, up to a turn of the robot and all signs."""
    moved, places = angles - angles.mean(axis=0), np.array(found.positions) - 1
    mine = (moved * np.asarray(found.signs))[:, np.argsort(places)]
    real = (moved * np.asarray(true[1]))[:, np.argsort(true[0])]
    size = np.maximum(real.std(axis=0), 1e-9)
    return any(
        float((np.std(mine - sign * np.roll(real, turn, axis=1), axis=0) / size).max()) < WHEEL_ERROR
        for turn in range(robot.wheel_count)
        for sign in (1.0, -1.0)
    )


def _commands(
    proposal: Proposal, robot: Robot, habits: Habits, window: tuple[float, float]
) -> tuple[float, bool] | None:
    """Return the confidence in the assignment of a window and whether it is right; None without one."""
    frame, roles, (start, length) = proposal.frame, proposal.roles, window
    placed = proposal.lean_test.placements[0] if proposal.lean_test else None
    if placed is None or not roles.commands or roles.time is None:
        return None
    if not _same(robot, proposal.signals.wheels.value, placed, _true_placement(robot, habits)):
        return None
    n = robot.wheel_count
    expected = [(frame.order.index(wheel), frame.signs[wheel - 1]) for wheel in range(1, n + 1)]
    t = proposal.table.columns[roles.time] * proposal.time.factor
    inside = (t >= start) & (t < start + length)
    table = {name: values[inside] for name, values in proposal.table.columns.items()}
    commands = np.column_stack([table[name] for name in roles.commands])
    mapping = log_mapping(proposal, delay=proposal.command_delay.applied)
    mapping = replace(mapping, timing=replace(mapping.timing, keep=None))
    found = drive_evidence(mapping, table, commands, robot, reading=None, expected=expected).assigned
    if found is None:
        return None
    order = habits.command_order or habits.order
    true = [expected[habits.order.index(place)] for place in order]
    signs = [
        sign * habits.signs[habits.order.index(place)] * own
        for place, (_, sign), own in zip(order, true, habits.command_signs, strict=True)
    ]
    mine = (commands * np.asarray(found.signs))[:, np.argsort(found.wheels)]
    real = (commands * np.asarray(signs))[:, np.argsort([wheel for wheel, _ in true])]
    return found.confidence, float(np.std(mine - real, axis=0).max() / np.std(real)) < TORQUE_ERROR


if __name__ == "__main__":
    count = int(sys.argv[1])
    every = [
        one for half in BY_EQUATIONS if half != "test" for seed in range(count) for one in answers(half, seed)
    ]
    for question in ("wheels", "commands"):
        for length in LENGTHS:
            windows = [one for one in every if (one.question, one.length) == (question, length)]
            sure = [one for one in windows if one.confidence >= CONFIDENT]
            wrong = [f"{one.half} {one.seed} ({one.confidence:.3f})" for one in sure if not one.right]
            print(
                f"{question}, {length:.0f} s: {len(windows)} windows, best right in {sum(o.right for o in windows)}, "
                f"confident in {len(sure)}, of these wrong {len(wrong)} {' '.join(wrong)}"
            )
