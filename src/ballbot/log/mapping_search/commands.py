"""Identify the commands of a foreign log: the wheel that each drives, its sign, its scale and its delay.

Ball and wheels pass each other the torques that the motion needs (`ballbot.log.torque_balance`): about upright,
wheel i needs n_i. What drives it is a command d_j of unknown order, sign, kind and scale:

    s_j d_j = a n_i + b w_i + h mean(w) + friction's terms in the sign of w_i        w_i speed of the wheel [rad/s]

Every order and every choice of signs is tried; those that explain all commands best, with one a and one b, are the
answer. The commands are on the left: commands that sum to zero are no difficulty there, while a regression of all
wheels on all commands would be collinear, and a wheel's sign would be decided by noise.

A dead band that the firmware adds is counted as less dry friction, which is the same while a wheel turns the way its
duty drives it. A log cannot distinguish the two: the dry friction of a sticking wheel also has the sign of the duty. It
shows how often wheels turn against their duties, and so by how much a dead band of a likely size would change the
torques (`likely_dead_band`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from scipy.optimize import nnls

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.balancing_motion import Motion, motion_of
from ballbot.log.columns import FACTORS
from ballbot.log.mapping import DutyTable
from ballbot.log.mapping_search.evidence import (
    CONFIDENT,
    MOST,
    TINY,
    behind,
    correlations,
    gains_over,
    posterior,
    probabilities,
    vertex_with_error,
)
from ballbot.log.mapping_search.motion import Columned, SensedMotion
from ballbot.log.mapping_search.names import INPUT_OF_UNIT, UNIT_OF_INPUT, InputKind
from ballbot.log.mapping_search.placement import SensorFrame
from ballbot.log.signals import INTERVAL, Smooth, new_messages, smooth
from ballbot.log.torque_balance import TURNED_POWER, Driving, driving_of, gains_of
from ballbot.robot import Drive, Robot

KINDS: tuple[InputKind, ...] = ("torque", "current", "voltage", "duty")
#: assignments whose torques differ by less than this part of their size count as one: half of what torques may be off
SAME_TORQUES = 0.1
#: before the log is seen, motors are numbered as encoders, and have usual signs, with these probabilities
OWN_ORDER, EQUAL_SIGNS = 0.9, 0.75
#: weight for each second of the logarithm of the ratio of squared errors, twice that of rolling and once that of
#: turning (`behind`), set on half of the robots of the campaign (135 logs); of the 121 logs of the others 97 % then
#: have an order with confidence, and none a wrong one
EACH_SECOND = 1.0
#: shares of the commands' power that are left anyway: of rolling and turning, and of what does neither
LEAST_LEFT, LEAST_IDLE = 1e-3, 3e-4
#: share of the commands that must be explained, and from which on nothing is in doubt. Commands that are torques about
#: axes are mixtures of all wheels': single ones leave 0.38 of them, and at most 0.35 where they are right, of robots
#: whose wheels mostly stick (campaigns/mapping_corpus.py)
LEAST_EXPLAINED, EXPLAINED = 0.55, 0.65
#: correlation of a free wheel's speed with its command
FOLLOWED = 0.8
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
#: a full scale that nobody states must fit the motion this well [log]: others, 400 or 500, are in use, too
FULL_SCALE_FITS = 0.35
#: a dead band as firmware has it [of full duty], and as a part of the dry friction that the log shows besides: with
#: both, each of 6 logs of the campaign whose torques one made wrong by more than a fifth is asked for, and none of 9
#: without one. A wheel's torque counts as at least this part of all wheels' (root mean square)
LEAST_BAND, BAND_OF_FRICTION, LEAST_TORQUE = 0.01, 0.25, 0.5
#: factors that convert a unit to N m, A or V
_SCALES: dict[InputKind, dict[str, float]] = {kind: FACTORS[unit] for kind, unit in UNIT_OF_INPUT.items()}


@dataclass(frozen=True, kw_only=True)
class CommandOrder:
    """Which wheel each command drives."""

    wheels: tuple[int, ...]  #: for the file's commands in turn, the robot's wheel (from 0)
    signs: tuple[int, ...]  #: of the file's commands in turn
    explained: float  #: share of the commands' variance
    advantage: float  #: over the next best assignment, in standard errors over blocks of a second
    next_best: str  #: in words
    confidence: float

    @property
    def description(self) -> str:
        """The assignment in words."""
        return f"for wheels {[wheel + 1 for wheel in self.wheels]}, signs {list(self.signs)}"


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
        assigned=assigned, kind=kind, scales=alike, ratios=ratios, delay=delay, delay_error=delay_error
    )


def turned_by(base: Columned, motion: SensedMotion) -> CommandOrder | None:
    """Return which command turns which free wheel, by their speeds; None if they do not follow the commands."""
    held = base.held_commands(motion.signals.rows)
    R = correlations(held, motion.signals.wheels.rate)
    size, rows = np.abs(R), range(len(R))
    sums = {order: float(size[rows, order].sum()) for order in permutations(rows)}
    # of commands that are alike, the file's own order
    best, other = sorted(sums, key=lambda order: (-round(sums[order], 6), order))[:2]
    if size[rows, best].min() < FOLLOWED:
        return None
    return CommandOrder(
        wheels=best,
        signs=tuple(1 if R[j, wheel] > 0.0 else -1 for j, wheel in enumerate(best)),
        explained=(sums[best] / len(R)) ** 2,
        advantage=sums[best] - sums[other],
        next_best=f"for wheels {[i + 1 for i in other]}",
        confidence=1.0,
    )


_Order = tuple[tuple[int, ...], tuple[int, ...]]  #: wheels and signs of an `CommandOrder`


def assign(driving: Driving, counted: Sequence[int]) -> CommandOrder:
    """Return the likeliest order and signs of the commands: by what the motion leaves of them, and by what is usual.

    That which fits best is likelier than what is less usual; what is more usual does not make up for a worse fit. Those
    that make nearly the same torques, as opposite wheels of four do while the heading stands still, are one, and the
    most usual of them is taken. `counted` are the signs with which the encoders count, of the robot's wheels in turn.
    """
    left = _left(driving)
    every, totals = list(left), np.array(list(left.values())).sum(axis=2)
    floors = np.array([LEAST_LEFT, LEAST_LEFT, LEAST_IDLE])[: totals.shape[1]]
    weights = np.array([2.0, 1.0, 1.0])[: len(floors)]
    score = np.log(totals + floors) @ weights
    without = totals[None] - np.moveaxis(np.array(list(left.values())), 2, 0)
    gained, z = gains_over(score, np.log(np.maximum(without, 0.0) + floors) @ weights)
    usual, least = [_usual(order, counted) for order in every], int(np.argmin(score))
    odds = behind(z, gained, len(without), each_second=EACH_SECOND)
    probability = posterior([min(probability_of_order, usual[least]) for probability_of_order in usual], odds)
    torques = {h: by_wheel(driving.torque, every[h]) for h, p in probability.items() if p > 1e-3}
    likeliest = next(iter(torques.values()))
    size = SAME_TORQUES * float(np.std(likeliest))
    alike = [h for h, u in torques.items() if float(np.std(u - likeliest, axis=0).max()) <= size]
    best = max(alike, key=lambda h: usual[h])
    other = next((h for h in probability if h not in alike), best)
    explained = 1.0 - float(totals[best, :2].sum())
    enough = min(max((explained - LEAST_EXPLAINED) / (EXPLAINED - LEAST_EXPLAINED), 0.0), 1.0)
    (wheels, signs), (next_wheels, next_signs) = every[best], every[other]
    return CommandOrder(
        wheels=wheels,
        signs=signs,
        explained=explained,
        advantage=float(z[other] - z[best]),
        next_best=f"for wheels {[i + 1 for i in next_wheels]}, signs {list(next_signs)}",
        confidence=min(sum(probability[h] for h in alike), MOST) * enough,
    )


def _usual(wheels: _Order, counted: Sequence[int]) -> float:
    """Return the probability of an order before the motion is seen.

    Motors are numbered as encoders, and turn all alike or as these count, in most robots.
    """
    order, signs = wheels
    n, relative = len(order), {sign * counted[wheel] for wheel, sign in zip(order, signs, strict=True)}
    own, even = order == tuple(range(n)), len(set(signs)) == 1 or len(relative) == 1
    p = OWN_ORDER if own else (1.0 - OWN_ORDER) / (math.factorial(n) - 1)
    return p * (EQUAL_SIGNS / 2.0 if even else (1.0 - EQUAL_SIGNS) / (2**n - 2))


def by_wheel(commands: Floats, wheels: _Order) -> Floats:
    """Return the commands (N, n) of the robot's wheels in turn, by the wheels (from 0) and signs of the file's."""
    order, signs = wheels
    return (commands * np.asarray(signs, dtype=np.float64))[:, np.argsort(order)]


def _left(driving: Driving) -> dict[_Order, Floats]:
    """Return the shares (k, B) of the commands' power that each order and choice of signs leaves, by seconds.

    They are those of what rolls the ball, of what turns it, and, of four wheels or more, of what does neither. Of the
    last nothing is explained: a controller has no reason to command it. The first two are fitted together.

    The motors are alike: a and b are common to all wheels, and only dry friction is each wheel's own. None of them can
    be negative. A controller damps the turning of the heading, which something else drives: commands alike have a part
    that goes against the wheels' common speed, and would pass for friction of motors with the opposite sign. It is
    fitted, with either sign. A motor weaker than the others by more than a third can be taken for another if the robot
    moves along one line.
    """
    u, speed = driving.torque - driving.torque.mean(axis=0), driving.friction[:, :, 1]
    n = u.shape[1]
    heading = np.broadcast_to(speed.mean(axis=1, keepdims=True), u.shape)
    dry = np.einsum("tik,ij->tijk", driving.friction[:, :, [0, 2]], np.eye(n)).reshape(len(u), n, -1)
    # (N, n, k), the terms of each wheel
    terms = np.concatenate([np.stack([driving.needed, speed, heading, -heading], axis=-1), dry], axis=-1)
    terms, count = terms - terms.mean(axis=0), terms.shape[-1]
    plane = np.column_stack([np.ones(n), np.cos(driving.azimuths), np.sin(driving.azimuths)])
    basis = np.linalg.qr(plane, mode="complete")[0]
    parts = np.einsum("im,tik->mtk", basis[:, :3], terms)
    parts = parts / np.maximum(np.sqrt(np.square(parts).sum(axis=(0, 1))), 1e-30)
    table = np.concatenate([u, *parts], axis=1)
    seconds = [table[driving.block == b] for b in range(int(driving.block[-1]) + 1)]
    products = np.array([rows.T @ rows for rows in seconds])
    power = products[:, :n, :n]
    crossed = products[:, :n, n:].reshape(-1, n, 3, count)
    own = np.array([products[:, k : k + count, k : k + count] for k in range(n, n + 3 * count, count)])
    whole, together = float(np.trace(power.sum(axis=0))), crossed.sum(axis=0)
    # the same sums of squares, by a triangular matrix in place of all rows
    root = np.linalg.cholesky(own.sum(axis=(0, 1)) + 1e-9 * np.eye(count)).T
    unexplained = {}
    for order in permutations(range(n)):
        for signs in product((1, -1), repeat=n):
            way = basis[list(order)].T * np.asarray(signs)  # parts of each command
            right = np.einsum("mj,jmk->k", way[:3], together)
            factors, _ = nnls(root, np.linalg.solve(root.T, right))
            left = np.einsum("mj,bjl,ml->mb", way, power, way)
            left[:3] -= 2.0 * np.einsum("mj,bjmk,k->mb", way[:3], crossed, factors)
            left[:3] += np.einsum("k,mbkl,l->mb", factors, own, factors)
            left = np.maximum(left, 0.0) / max(whole, TINY)
            idle = [left[3:].sum(axis=0)] if n > 3 else []
            unexplained[order, signs] = np.array([left[1] + left[2], left[0], *idle])
    return unexplained


def _delay(
    base: Columned, motion: SensedMotion, frame: SensorFrame, assigned: CommandOrder
) -> tuple[float, float]:
    """Return how late the wheels answer to the commands [s], and its standard error; nan, inf if unknown."""
    driven = np.zeros((len(frame.order), len(frame.order)))
    for j, wheel in enumerate(assigned.wheels):  # in the order of the log that was compared
        position = frame.order[wheel] - 1
        driven[frame.order[j] - 1, position] = assigned.signs[j] * frame.signs[position]
    rows, kept = motion.signals.rows, new_messages(motion.sampled)
    wheels = smooth(rows, motion.sampled[kept], motion.angles[kept], width=DELAY_WIDTH)
    commands = smooth(rows, rows, base.held_commands(rows), width=DELAY_WIDTH).value
    usable = motion.tested.balancing if motion.tested else motion.signals.usable
    return command_delay(wheels, commands, usable, driven)


def command_delay(wheels: Smooth, commands: Floats, usable: Bools, driven: Floats) -> tuple[float, float]:
    """Return how late the wheels (N, n) answer to commands (N, k) [s], and its standard error; nan, inf if unknown.

    The lean is not among what explains them: commands are made of it, and would share its gain. Commands that chatter
    fit half a period later, too, with all signs turned: `driven` (k, n), 1 or -1 where a command drives a wheel and 0
    elsewhere, distinguishes the two.
    """
    if usable.sum() * INTERVAL < LEAST_DELAY_TIME:
        return math.nan, math.inf
    y = wheels.acceleration[usable] - wheels.acceleration[usable].mean(axis=0)
    blocks = (np.arange(len(usable)) // round(1.0 / INTERVAL))[usable]
    rows, left = np.arange(len(usable), dtype=np.float64), []
    for delay in DELAYS:
        late = np.column_stack([np.interp(rows - delay / INTERVAL, rows, command) for command in commands.T])
        speed = wheels.rate
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
    size = np.maximum(torque.std(axis=0), LEAST_TORQUE * np.sqrt(torque.var(axis=0).mean()))
    dry = []
    for i, weight in enumerate(driving.turning.T**TURNED_POWER):
        table = np.column_stack([driving.friction[:, i], np.ones(len(weight))]) * weight[:, None]
        factors = np.linalg.lstsq(table, weight * (torque[:, i] - driving.needed[:, i]), rcond=1e-6)[0]
        dry.append(factors[0] + 0.5 * factors[2])
    likely = max(LEAST_BAND, BAND_OF_FRICTION * float(np.median(dry)) / full)
    return likely, likely * full * float((against.std(axis=0) / size).max())


def assumed_resistance(motor: Drive) -> float:
    """Return R [ohm]; if nobody states it, the one with which full duty at standstill gives the torque limit."""
    stall = motor.gear_ratio * motor.torque_constant * motor.supply_voltage / motor.torque_limit
    return motor.resistance or stall


def _scale_of(
    base: Columned, gain: float, error: float
) -> tuple[InputKind | None, dict[InputKind, tuple[float, float]], tuple[str, ...]]:
    """Return the kind that is stated, the likeliest scale and ratio of each kind, and scales of it that fit alike.

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
    drive, ratios, alike = base.robot.drive, dict[InputKind, tuple[float, float]](), ()
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
        if not scales:
            continue
        size = gain * torque
        logs = {name: math.log(max(size * scale, 1e-12)) for name, scale in scales.items()}
        deviation = math.hypot(error, RATIO_DEVIATION)
        likely = probabilities({name: -0.5 * (off / deviation) ** 2 for name, off in logs.items()})
        # without a motion that shows it, the smallest number that holds them all
        ranked = list(likely) if math.isfinite(size) else sorted(scales, key=lambda name: -scales[name])
        scale = scales[ranked[0]]
        ratios[candidate] = scale, size * scale
        if candidate == kind:
            others = [name for name in ranked[1:] if abs(math.log(scales[name] / scale)) > math.log(1.2)]
            fits = candidate != "duty" or abs(logs[ranked[0]]) < FULL_SCALE_FITS
            if others and not (sum(likely[name] for name in others) <= 1.0 - CONFIDENT and fits):
                alike = (ranked[0], *others[:3])
    return kind, ratios, alike


def _scales(kind: InputKind, base: Columned) -> dict[str, float]:
    """Return by name the scales that the commands may have, by their largest and the unit of their heading."""
    named, full = base.roles.unit(base.roles.commands), base.stated.full_scale
    if kind != "duty":
        return {named: _SCALES[kind][named]} if named in _SCALES[kind] else _SCALES[kind]
    commands = base.stacked(base.roles.commands)
    fitting = [full_scale for full_scale in FULL_SCALES if float(np.abs(commands).max()) <= 1.01 * full_scale]
    if full is not None:
        fitting = [full]
    elif named == "%":
        fitting = [100.0]
    elif fitting[:1] == [1.0] and not np.array_equal(commands, np.round(commands)):
        fitting = [1.0]  # no robot balances with a hundredth of its voltage
    return {f"{full_scale:g}": 1.0 / full_scale for full_scale in fitting}
