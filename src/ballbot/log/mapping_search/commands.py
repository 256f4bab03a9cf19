"""Identify the commands of a foreign log: the wheel that each drives, its sign, its scale and its delay.

Which wheel each drives, and with which sign: `ballbot.log.torque_balance`.

A dead band that the firmware adds is counted as less dry friction, which is the same while a wheel turns the way its
duty drives it. A log cannot distinguish the two: the dry friction of a sticking wheel also has the sign of the duty. It
shows how often wheels turn against their duties, and so by how much a dead band of a likely size would change the
torques (`likely_dead_band`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations

import numpy as np

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import FACTORS
from ballbot.log.evidence import (
    CONFIDENT,
    RELATED,
    correlations,
    probabilities,
    vertex_with_error,
)
from ballbot.log.mapping import DutyTable
from ballbot.log.mapping_search.motion import Columned, SensedMotion
from ballbot.log.mapping_search.names import INPUT_OF_UNIT, UNIT_OF_INPUT, InputKind
from ballbot.log.placement import SensorFrame
from ballbot.log.signals import INTERVAL, new_messages, smooth
from ballbot.log.torque_balance import (
    TURNED_POWER,
    CommandOrder,
    Driving,
    Motion,
    assign,
    by_wheel,
    driving_of,
    gains_of,
    motion_of,
    sizes_of,
)
from ballbot.results import left_out
from ballbot.robot import Drive, Robot

KINDS: tuple[InputKind, ...] = ("torque", "current", "voltage", "duty")
#: delays of the commands that are tried [s], and the filter of the wheels for it [s]: delays show in what is quick
DELAYS, DELAY_WIDTH = INTERVAL * np.arange(-1.0, 9.0), 0.02
#: part of the signals' own size that is added to the normal equations: commands sum to nearly zero
RIDGE = 1e-3
#: a delay is accepted if the commands explain this share of the wheels' accelerations, in so many seconds
LEAST_ACCELERATION, LEAST_DELAY_TIME = 0.4, 3.0
#: full scales of a duty in use; 1000 and 1023 differ by 2 %, and the largest command separates them
FULL_SCALES = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)
#: masses, torque constants and friction make a log's torques differ by this [log] from those that its motion needs
RATIO_DEVIATION = 0.25
#: a share of rows beyond full duty, which the driver clips, that lowers the logarithm of a full scale's weight by one;
#: and a command just beyond full duty is rounded
CLIPPED, ROUNDED = 0.05, 1.01
#: a full scale that nobody states must fit the motion this well [log]: others, 400 or 500, are in use, too
FULL_SCALE_FITS = 0.35
#: a dead band as firmware has it [of full duty], and as a part of the dry friction that the log shows besides: with
#: both, each of 10 logs of the campaign whose torques one made wrong by more than a fifth is asked for, none of 9
#: without one, and none of 35 with one that changed less
LEAST_BAND, BAND_OF_FRICTION = 0.008, 0.31
#: factors that convert a unit to N m, A or V
_SCALES: dict[InputKind, dict[str, float]] = {kind: FACTORS[unit] for kind, unit in UNIT_OF_INPUT.items()}


@dataclass(frozen=True, kw_only=True)
class CommandDrive:
    """Assignment, kind, scale and delay of the commands."""

    assigned: CommandOrder | None  #: None if the motion cannot be compared with them
    kind: InputKind | None  #: None if nobody states it
    scales: tuple[str, ...]  #: names of scales that fit alike, the likeliest first; empty if one is clear
    #: by kind, the likeliest factor from the file's number to N m, A, V or a duty, and how many times as large as the
    #: motion needs the torques then are (nan if that is not known)
    ratios: dict[InputKind, tuple[float, float]]
    delay: float  #: [s]
    delay_error: float
    #: of each of the scales, how many times as large as the motion needs the torques are
    misfits: tuple[float, ...] = field(metadata=left_out)

    @property
    def scale(self) -> float:
        """The factor from the file's number to N m, A, V or a duty."""
        return self.ratios[self.kind][0] if self.kind in self.ratios else 1.0

    @property
    def ratio(self) -> float:
        """How many times as large as the motion needs the torques are; nan if that is not known."""
        return self.ratios[self.kind][1] if self.kind in self.ratios else math.nan


_Needs = tuple[Motion, Driving]


def needs_of(log: Log, robot: Robot) -> _Needs | None:
    """Return the motion of a log, and its torques with the needs of each wheel; None without any."""
    moved = motion_of(log, robot)
    driving = None if moved is None else driving_of(log, moved, robot)
    return None if moved is None or driving is None else (moved, driving)


def drive_of(base: Columned, motion: SensedMotion, frame: SensorFrame, needs: _Needs | None) -> CommandDrive:
    """Return what the commands are, by what they are as torques in the frame's order of the wheels (`needs_of`)."""
    assigned, gain, error = None, math.nan, math.inf
    if not base.roles.attitude:
        assigned = turned_by(base, motion)
    elif needs is not None:
        driving = needs[1]
        assigned = assign(driving, [frame.signs[position - 1] for position in frame.order])
        ordered = replace(driving, torque=by_wheel(driving.torque, (assigned.wheels, assigned.signs)))
        gain, error = gains_of(ordered).common()
    delay, delay_error = (math.nan, math.inf) if assigned is None else _delay(base, motion, frame, assigned)
    kind, ratios, alike = _scale_of(base, gain if math.isfinite(error) else math.nan, error)
    return CommandDrive(
        assigned=assigned,
        kind=kind,
        scales=tuple(alike),
        ratios=ratios,
        delay=delay,
        delay_error=delay_error,
        misfits=tuple(alike.values()),
    )


def turned_by(base: Columned, motion: SensedMotion) -> CommandOrder | None:
    """Return which command turns which free wheel, by their speeds; None if they do not follow the commands."""
    held = base.held_commands(motion.signals.rows)
    R = correlations(held, motion.signals.wheels.rate)
    size, rows = np.abs(R), range(len(R))
    sums = {order: float(size[rows, order].sum()) for order in permutations(rows)}
    # of commands that are alike, the file's own order
    best, other = sorted(sums, key=lambda order: (-round(sums[order], 6), order))[:2]
    # a slow sweep has few independent samples, but nothing else turns a free wheel
    if size[rows, best].min() < RELATED:
        return None
    return CommandOrder(
        wheels=best,
        signs=tuple(1 if R[j, wheel] > 0.0 else -1 for j, wheel in enumerate(best)),
        explained=(sums[best] / len(R)) ** 2,
        advantage=sums[best] - sums[other],
        next_best=f"for wheels {[i + 1 for i in other]}",
        confidence=1.0,
    )


def _delay(
    base: Columned, motion: SensedMotion, frame: SensorFrame, assigned: CommandOrder
) -> tuple[float, float]:
    """Return how late the wheels answer to the commands [s], and its standard error; nan, inf if unknown.

    The lean is not among what explains them: commands are made of it, and would share its gain. Commands that chatter
    fit half a period later, too, with all signs turned: `driven` (k, n), 1 or -1 where a command drives a wheel and 0
    elsewhere, distinguishes the two.
    """
    driven = np.zeros((len(frame.order), len(frame.order)))
    for j, wheel in enumerate(assigned.wheels):  # in the order of the log that was compared
        position = frame.order[wheel] - 1
        driven[frame.order[j] - 1, position] = assigned.signs[j] * frame.signs[position]
    rows, kept = motion.signals.rows, new_messages(motion.sampled)
    wheels = smooth(rows, motion.sampled[kept], motion.angles[kept], width=DELAY_WIDTH)
    commands = smooth(rows, rows, base.held_commands(rows), width=DELAY_WIDTH).value
    usable = motion.tested.balancing if motion.tested else motion.signals.usable
    if usable.sum() * INTERVAL < LEAST_DELAY_TIME:
        return math.nan, math.inf
    y = wheels.acceleration[usable] - wheels.acceleration[usable].mean(axis=0)
    blocks = (np.arange(len(usable)) // round(1.0 / INTERVAL))[usable]
    left, speed = [], wheels.rate
    for delay in DELAYS:
        late = np.column_stack([np.interp(rows - delay, rows, command) for command in commands.T])
        X = np.column_stack([late, speed, np.tanh(speed / 0.3), np.ones(len(late))])[usable]
        size = np.sqrt((X**2).mean(axis=0)) + 1e-12
        normal = (X / size).T @ (X / size) + RIDGE * len(X) * np.eye(X.shape[1])
        factors = np.linalg.solve(normal, (X / size).T @ y)
        backwards = float((factors[: len(driven)] / size[: len(driven), None] * driven).sum()) <= 0.0
        rest = y if backwards else y - X / size @ factors
        left.append(np.bincount(blocks, weights=(rest**2).sum(axis=1)) / float((y**2).sum()))
    if 1.0 - min(float(remainder.sum()) for remainder in left) < LEAST_ACCELERATION:
        return math.nan, math.inf
    return vertex_with_error(DELAYS, np.array(left))


def likely_dead_band(log: Log, robot: Robot, drive: DutyTable) -> tuple[float, float]:
    """Return a dead band of a likely size [of full duty], and what it is worth; zeros if one is stated or none shows.

    It is worth the share of their size by which it changes the torques if it does not count as less dry friction.
    """
    needs = needs_of(log, robot) if drive.dead_band is None else None
    if needs is None:
        return 0.0, 0.0
    moved, driving = needs
    resistance, torque = robot.drive.resistance, driving.torque
    full = float(drive.torque(np.ones(1), np.zeros(1), resistance)[0])
    duty_sign = np.sign(log.torques + drive.back_emf(resistance) * log.wheel_speeds)
    against = moved.filtered(log, duty_sign, late=0.5 * log.sample_time) - driving.friction[:, :, 0]
    dry = []
    for i, weight in enumerate(driving.turning.T**TURNED_POWER):
        table = np.column_stack([driving.friction[:, i], np.ones(len(weight))]) * weight[:, None]
        factors = np.linalg.lstsq(table, weight * (torque[:, i] - driving.needed[:, i]), rcond=1e-6)[0]
        dry.append(factors[0] + 0.5 * factors[2])
    likely = max(LEAST_BAND, BAND_OF_FRICTION * float(np.median(dry)) / full)
    return likely, likely * full * float((against.std(axis=0) / sizes_of(torque)).max())


def nearest_scale(base: Columned, log: Log, drive: DutyTable) -> tuple[str, float]:
    """Return the other full scale of the duty that is nearest to a mapping's, and what it would change.

    It would change the torques by that share of their size: little duty is left where the back-EMF takes most of it.
    """
    near = [scale for scale in _scales("duty", base).values() if 0.0 < abs(scale / drive.scale - 1.0) < 0.2]
    if not near:
        return "", 0.0
    other = min(near, key=lambda scale: abs(scale / drive.scale - 1.0))
    duty = log.torques + drive.back_emf(assumed_resistance(base.robot.drive)) * log.wheel_speeds
    share = float((duty.std(axis=0) / sizes_of(log.torques)).max())
    return f"{1.0 / other:.0f}", abs(other / drive.scale - 1.0) * share


def assumed_resistance(motor: Drive) -> float:
    """Return R [ohm]; if nobody states it, the one with which full duty at standstill gives the torque limit."""
    stall = motor.gear_ratio * motor.torque_constant * motor.supply_voltage / motor.torque_limit
    return motor.resistance or stall


def _scale_of(
    base: Columned, gain: float, error: float
) -> tuple[InputKind | None, dict[InputKind, tuple[float, float]], dict[str, float]]:
    """Return the kind that is stated, the likeliest scale and ratio of each kind, and the ratios of others as likely.

    `gain` is the command that the motion needs for 1 N m, and `error` that of its logarithm.
    """
    named = base.roles.unit(base.roles.commands)
    of_unit = INPUT_OF_UNIT.get(named or "")
    kind = base.stated.command or of_unit
    if of_unit is not None and kind != of_unit:
        raise InputError(
            f"{base.path}: the heading of {base.roles.commands[0]} has the unit {named}, which is a {of_unit}; "
            f"--command says {kind}. Correct one of them."
        )
    drive, ratios, alike = base.robot.drive, dict[InputKind, tuple[float, float]](), dict[str, float]()
    ampere = drive.gear_ratio * drive.torque_constant
    # torque [N m] at standstill of one N m, A, V or full duty
    standstill: dict[InputKind, float] = {
        "torque": 1.0,
        "current": ampere,
        "voltage": ampere / assumed_resistance(drive),
        "duty": ampere * drive.supply_voltage / assumed_resistance(drive),
    }
    for candidate, torque in standstill.items():
        scales = _scales(candidate, base)
        size = gain * torque
        logs = {name: math.log(max(size * scale, 1e-12)) for name, scale in scales.items()}
        deviation = math.hypot(error, RATIO_DEVIATION)
        beyond = {name: _beyond(candidate, base, scale) / CLIPPED for name, scale in scales.items()}
        likely = probabilities(
            {name: -0.5 * (off / deviation) ** 2 - beyond[name] for name, off in logs.items()}
        )
        # without a motion that shows it, the smallest number that holds them all
        by_size = sorted(scales, key=lambda name: (beyond[name] > 0.0, -scales[name]))
        ranked = list(likely) if math.isfinite(size) else by_size
        scale = scales[ranked[0]]
        ratios[candidate] = scale, size * scale
        if candidate == kind:
            others = [name for name in ranked[1:] if abs(math.log(scales[name] / scale)) > math.log(1.2)]
            fits = candidate != "duty" or abs(logs[ranked[0]]) < FULL_SCALE_FITS
            if others and not (sum(likely[name] for name in others) <= 1.0 - CONFIDENT and fits):
                alike = {name: size * scales[name] for name in (ranked[0], *others[:3])}
    return kind, ratios, alike


def _scales(kind: InputKind, base: Columned) -> dict[str, float]:
    """Return by name the scales that the commands may have, by their largest and the unit of their heading."""
    named, full = base.roles.unit(base.roles.commands), base.stated.full_scale
    if kind != "duty":
        return {named: _SCALES[kind][named]} if named in _SCALES[kind] else _SCALES[kind]
    commands = base.stacked(base.roles.commands)
    fitting: Sequence[float] = FULL_SCALES
    if full is not None:
        fitting = [full]
    elif named == "%":
        fitting = [100.0]
    elif _beyond("duty", base, 1.0) < CLIPPED and not np.array_equal(commands, np.round(commands)):
        fitting = [1.0]  # no robot balances with a hundredth of its voltage
    return {f"{full_scale:g}": 1.0 / full_scale for full_scale in fitting}


def _beyond(kind: InputKind, base: Columned, scale: float) -> float:
    """Return the share of the commands that are beyond full duty, if they are one, by this scale."""
    size = scale * np.abs(base.stacked(base.roles.commands))
    return float((size > ROUNDED).mean()) if kind == "duty" else 0.0
