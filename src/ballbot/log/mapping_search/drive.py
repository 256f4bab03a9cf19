"""What the commands of a foreign log are: which wheel each drives, with which sign, in which scale, and how late."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.checks.lean import motion_of, usable_rows
from ballbot.log.checks.torque_balance import Driving, driving_of, gravity_need
from ballbot.log.mapping_search.commands import (
    DELAY_WIDTH,
    Assignment,
    assign,
    command_delay,
    gain_of,
)
from ballbot.log.mapping_search.found import KINDS, Drive, Proposal
from ballbot.log.mapping_search.frame import Frame
from ballbot.log.mapping_search.motion import Columned, Motion
from ballbot.log.mapping_search.names import INPUT_OF_UNIT, InputKind
from ballbot.log.mapping_search.text import raw_log
from ballbot.log.mapping_search.units import fastest
from ballbot.log.pose import with_odometry
from ballbot.log.signals import new_messages, smooth
from ballbot.robot import Robot

#: full scales of a duty in use; 1000 and 1023 differ by 2 %, and the largest command separates them
FULL_SCALES = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)
#: a scale is taken by the motion if it is this much [log], and this many standard errors, nearer than the next one
CLEARLY_NEARER, NEARER_ERRORS = 0.5, 3.0
#: a full scale that nobody states must fit the motion this well [log]: others, 400 or 500, are in use, too
FULL_SCALE_FITS = 0.35
#: correlation of a free wheel's speed with its command
FOLLOWED = 0.8
#: what turns a number in a unit into N m, A or V
_SCALES: dict[InputKind, dict[str, float]] = {
    "torque": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2},
    "current": {"A": 1.0, "mA": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3},
}


def drive_of(proposal: Proposal, motion: Motion) -> Drive:
    """Return what the commands are: the torques that the motion needs against them, in every order and sign."""
    base, frame = proposal.base, proposal.frame
    assigned, gain, error = None, math.nan, 0.0
    if not base.roles.attitude:
        assigned = turned_by(base, motion)
    elif motion.tested is not None:
        driving, pulled = _needed(proposal)
        if driving is not None:
            expected = [(wheel, frame.signs[place - 1]) for wheel, place in enumerate(frame.order)]
            assigned = assign(driving, expected)
            gain, error = gain_of(driving, assigned, pulled)
    kind, scale, scales, ratios = _scale_of(base, gain, error, motion)
    delay, delay_error = (math.nan, math.inf) if assigned is None else _delay(base, motion, frame, assigned)
    return Drive(
        assigned=assigned,
        kind=kind,
        scale=scale,
        scales=scales,
        ratios=ratios,
        delay=delay,
        delay_error=delay_error,
    )


def _needed(proposal: Proposal) -> tuple[Driving | None, NDArray[np.float64]]:
    """Return the commands and the needs of each wheel, and gravity's part of these; None if little is shown."""
    robot, nothing = proposal.base.robot, np.zeros(0)
    try:
        log = with_odometry(raw_log(proposal, robot), robot)
        rows = usable_rows(log, robot)
    except InputError:  # too short, or rows without a value
        return None, nothing
    if rows is None:
        return None, nothing
    moved = motion_of(log, rows)
    return driving_of(log, rows, moved, robot), gravity_need(moved, robot)


def turned_by(base: Columned, motion: Motion) -> Assignment | None:
    """Return which command turns which free wheel, by their speeds; None if they do not follow the commands."""
    signals = motion.signals
    held = base.held_commands(signals.rows)
    x, y = (one - one.mean(axis=0) for one in (held, signals.wheels.rate))
    size = np.outer(np.linalg.norm(x, axis=0), np.linalg.norm(y, axis=0))
    R = np.divide(x.T @ y, size, out=np.zeros_like(size), where=size > 1e-12)
    own = tuple(range(len(R)))
    sums = {one: sum(abs(R[j, wheel]) for j, wheel in enumerate(one)) for one in permutations(own)}
    best, other = sorted(sums, key=lambda one: (-round(sums[one], 6), one))[:2]
    alike = np.allclose(held, held[:, :1])
    best = own if alike else best
    if min(abs(R[j, wheel]) for j, wheel in enumerate(best)) < FOLLOWED:
        return None
    return Assignment(
        wheels=best,
        signs=tuple(1 if R[j, wheel] > 0.0 else -1 for j, wheel in enumerate(best)),
        explained=(sums[best] / len(R)) ** 2,
        advantage=math.nan if alike else sums[best] - sums[other],
        next_best="none, all commands are alike" if alike else f"commands for wheels {other}",
        confidence=1.0,
    )


def _delay(base: Columned, motion: Motion, frame: Frame, assigned: Assignment) -> tuple[float, float]:
    """Return how late the wheels answer to the commands [s], and its standard error; nan, inf if unknown."""
    driven = np.zeros((len(frame.order), len(frame.order)))
    for j, wheel in enumerate(
        assigned.wheels
    ):  # commands and wheels in the order of the log that was compared
        place = frame.order[wheel] - 1
        driven[frame.order[j] - 1, place] = assigned.signs[j] * frame.signs[place]
    rows, kept = motion.signals.rows, new_messages(motion.sampled)
    held = base.held_commands(rows)
    usable = motion.tested.balancing if motion.tested else motion.signals.usable
    if not np.all(held[usable].std(axis=0) > 0.0):
        return math.nan, math.inf
    if np.allclose(held, held[:, :1]):
        held, driven = held[:, :1], driven.sum(axis=0, keepdims=True)
    wheels = smooth(rows, motion.sampled[kept], motion.angles[kept], width=DELAY_WIDTH)
    return command_delay(wheels, smooth(rows, rows, held, width=DELAY_WIDTH).value, usable, driven)


def _standstill(kind: InputKind, robot: Robot) -> float:
    """Return the torque [N m] at standstill of one N m, A, V or full duty: full duty gives the torque limit."""
    drive = robot.drive
    return {
        "torque": 1.0,
        "current": drive.gear_ratio * drive.torque_constant,
        "voltage": drive.torque_limit / drive.supply_voltage,
        "duty": drive.torque_limit,
    }[kind]


def _scale_of(
    base: Columned, gain: float, error: float, motion: Motion
) -> tuple[InputKind | None, float, tuple[str, ...], dict[InputKind, tuple[float, float]]]:
    """Return the kind that is stated, its scale, scales that fit alike, and the likeliest scale and ratio of each kind.

    `gain` is the torque [N m] of the command that the motion needs 1 N m of, and `error` its logarithm's.
    """
    named, robot = base.roles.unit(base.roles.commands), base.robot
    of_unit = INPUT_OF_UNIT.get(named or "")
    kind = base.stated.command or of_unit
    if of_unit is not None and kind != of_unit:
        raise InputError(
            f"{base.path}: the heading of {base.roles.commands[0]} has the unit {named}, which is a {of_unit}; "
            f"--command says {kind}. Correct one of them."
        )
    commands = base.stacked(base.roles.commands)
    largest = float(np.abs(commands).max())
    # a free wheel turns at the speed whose back-EMF is the voltage: of a full duty, the supply's
    free = not base.roles.attitude and largest > 0.0
    turned = float(np.abs(motion.signals.wheels.rate).max()) / fastest(robot) / largest if free else 0.0
    ratios: dict[InputKind, tuple[float, float]] = {}
    alike: tuple[str, ...] = ()
    for one in KINDS:
        scales = _scales(one, base, largest, whole=bool(np.array_equal(commands, np.round(commands))))
        if not scales:
            continue
        size = gain * _standstill(one, robot)
        if free:
            of_full = {"duty": 1.0, "voltage": robot.drive.supply_voltage}.get(one, math.nan)
            size = of_full / turned if turned > 0.0 else math.nan
        known = math.isfinite(size)
        off = {name: abs(math.log(max(size * scale, 1e-12))) for name, scale in scales.items()}
        # without a motion that shows it, the smallest number that holds them all
        ranked = sorted(scales, key=lambda name: off[name] if known else -scales[name])
        scale = scales[ranked[0]]
        ratios[one] = scale, size * scale
        if one == kind:
            others = [name for name in ranked[1:] if abs(math.log(scales[name] / scale)) > math.log(1.2)]
            nearer = off[others[0]] - off[ranked[0]] if others else math.inf
            fits = one != "duty" or off[ranked[0]] < FULL_SCALE_FITS
            if others and not (nearer > CLEARLY_NEARER + NEARER_ERRORS * error and fits):
                alike = (ranked[0], *others[:3])
    return kind, ratios[kind][0] if kind in ratios else 1.0, alike, ratios


def _scales(kind: InputKind, base: Columned, largest: float, *, whole: bool) -> dict[str, float]:
    """Return by name the scales that numbers up to the largest, in the unit of the heading, may have."""
    named, full = base.roles.unit(base.roles.commands), base.stated.full_scale
    if kind != "duty":
        return {named: _SCALES[kind][named]} if named in _SCALES[kind] else _SCALES[kind]
    fitting = [one for one in FULL_SCALES if largest <= 1.01 * one]
    if full is not None:
        fitting = [full]
    elif named == "%":
        fitting = [100.0]
    elif not whole and largest <= 1.01:  # no robot balances with a hundredth of its voltage
        fitting = [1.0]
    return {f"{one:g}": 1.0 / one for one in fitting}
