"""What the commands of a foreign log are: which wheel each drives, with which sign, in which scale, and how late."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np

from ballbot.errors import InputError
from ballbot.log.checks.lean import motion_of, usable_rows
from ballbot.log.checks.torque_balance import driving_of, gravity_need
from ballbot.log.mapping_search.commands import (
    DELAY_WIDTH,
    Assignment,
    Response,
    assign,
    command_delay,
    response,
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
#: what turns a number in a unit into N m, A, V or a duty
_SCALES: dict[InputKind, dict[str, float]] = {
    "torque": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2},
    "current": {"A": 1.0, "mA": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "duty": {"%": 0.01},
}


def drive_of(proposal: Proposal, base: Columned, motion: Motion) -> Drive:
    """Return what the commands are: the torques that the motion needs against them, in every order and sign."""
    roles, frame, robot = base.roles, proposal.frame, base.robot
    assigned, found, log, rows = None, None, None, None
    if roles.attitude and motion.tested is not None:
        try:
            log = with_odometry(raw_log(proposal, robot), robot)
            rows = usable_rows(log, robot)
        except InputError:  # too short, or rows without a value
            log = None
        if log is not None and rows is not None:
            moved = motion_of(log, rows)
            driving = driving_of(log, rows, moved, robot)
            if driving is not None:
                expected = [(wheel, frame.signs[place - 1]) for wheel, place in enumerate(frame.order)]
                assigned = assign(driving, expected)
                found = response(driving, assigned, gravity_need(moved, robot))
    if not roles.attitude:
        assigned = turned_by(base, motion)
    kind, scale, reason, ratios = _scale_of(base, found, motion)
    delay, error = _delay(base, motion, frame, assigned)
    return Drive(
        assigned=assigned,
        response=found,
        kind=kind,
        scale=scale,
        reason=reason,
        ratios=ratios,
        delay=delay,
        delay_error=error,
    )


def turned_by(base: Columned, motion: Motion) -> Assignment | None:
    """Return which command turns which free wheel, by their speeds; None if they do not follow the commands."""
    signals = motion.signals
    held = base.stacked(base.roles.commands)
    held = held[np.maximum(np.searchsorted(base.t, signals.rows, side="right") - 1, 0)]
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


def _delay(base: Columned, motion: Motion, frame: Frame, assigned: Assignment | None) -> tuple[float, float]:
    if assigned is None:
        return math.nan, math.inf
    driven = np.zeros((len(frame.order), len(frame.order)))
    for j, wheel in enumerate(
        assigned.wheels
    ):  # commands and wheels in the order of the log that was compared
        place = frame.order[wheel] - 1
        driven[frame.order[j] - 1, place] = assigned.signs[j] * frame.signs[place]
    commands = base.stacked(base.roles.commands)
    rows, kept = motion.signals.rows, new_messages(motion.sampled)
    held = commands[np.maximum(np.searchsorted(base.t, rows, side="right") - 1, 0)]
    usable = motion.tested.balancing if motion.tested else motion.signals.usable
    if not np.all(held[usable].std(axis=0) > 0.0):
        return math.nan, math.inf
    if np.allclose(held, held[:, :1]):
        held, driven = held[:, :1], driven.sum(axis=0, keepdims=True)
    wheels = smooth(rows, motion.sampled[kept], motion.angles[kept], width=DELAY_WIDTH)
    return command_delay(wheels, smooth(rows, rows, held, width=DELAY_WIDTH).value, usable, driven)


def standstill(kind: InputKind, robot: Robot) -> float:
    """Return the torque [N m] at standstill of one N m, A, V or full duty: full duty gives the torque limit."""
    drive = robot.drive
    return {
        "torque": 1.0,
        "current": drive.gear_ratio * drive.torque_constant,
        "voltage": drive.torque_limit / drive.supply_voltage,
        "duty": drive.torque_limit,
    }[kind]


def _scale_of(
    base: Columned, found: Response | None, motion: Motion
) -> tuple[InputKind | None, float, str, dict[InputKind, tuple[float, float]]]:
    """Return the kind that is stated, its scale and why, and the likeliest scale and ratio of every kind."""
    named = base.roles.unit(base.roles.commands)
    of_unit = INPUT_OF_UNIT.get(named or "")
    kind = base.stated.command or of_unit
    if of_unit is not None and kind != of_unit:
        raise InputError(
            f"{base.path}: the heading of {base.roles.commands[0]} has the unit {named}, which is a {of_unit}; "
            f"--command says {kind}. Correct one of them."
        )
    commands = base.stacked(base.roles.commands)
    largest = float(np.abs(commands).max())
    gain = found.gain if found is not None and math.isfinite(found.gain) else math.nan
    nearer = CLEARLY_NEARER + (NEARER_ERRORS * found.gain_error if found is not None else 0.0)
    if not base.roles.attitude and largest > 0.0:
        # a free wheel turns at the speed whose back-EMF is the voltage: of a full duty, the supply's
        turned = float(np.abs(motion.signals.wheels.rate).max()) / fastest(base.robot) / largest
        free: dict[InputKind, float] = {
            "duty": 1.0 / turned,
            "voltage": base.robot.drive.supply_voltage / turned,
        }
        gains = {one: value / standstill(one, base.robot) for one, value in free.items() if turned > 0.0}
    else:
        gains = dict.fromkeys(KINDS, gain)
    ratios: dict[InputKind, tuple[float, float]] = {}
    words = ""
    for one in KINDS:
        scales = dict(_SCALES[one])
        if one == "duty":
            fitting = [full for full in FULL_SCALES if largest <= 1.01 * full]
            # no robot balances with a hundredth of its voltage
            fractions = bool(np.any(commands != np.round(commands))) and largest <= 1.01
            scales = {f"{full:g}": 1.0 / full for full in (fitting[:1] if fractions else fitting)}
            if base.stated.full_scale is not None:
                scales = {f"{base.stated.full_scale:g}": 1.0 / base.stated.full_scale}
            elif named == "%":
                scales = {"100": 0.01}
        elif named in scales:
            scales = {named or "": scales[named or ""]}
        if not scales:
            continue
        gain = gains.get(one, math.nan)
        by_motion = {
            name: abs(math.log(max(gain * scale * standstill(one, base.robot), 1e-12)))
            for name, scale in scales.items()
        }
        # without a motion that shows it, the smallest number that holds them all
        ranked = sorted(scales, key=lambda name: by_motion[name] if math.isfinite(gain) else -scales[name])
        scale = scales[ranked[0]]
        ratios[one] = scale, gain * scale * standstill(one, base.robot)
        if one != kind:
            continue
        others = [name for name in ranked[1:] if abs(math.log(scales[name] / scale)) > math.log(1.2)]
        clear = bool(others) and by_motion[others[0]] - by_motion[ranked[0]] > nearer
        if others and not (clear and (one != "duty" or by_motion[ranked[0]] < FULL_SCALE_FITS)):
            words = " or ".join([ranked[0], *others[:3]])
    scale, _ = ratios.get(kind, (1.0, math.nan)) if kind else (1.0, math.nan)
    return kind, scale, words, ratios
