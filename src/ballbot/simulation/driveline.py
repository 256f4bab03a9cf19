"""One driveline, the wheel free: (j_w + j_r) w_dot = T(u, w) - tau(w), under any friction law (thesis 3.1 to 3.4).

Many drivelines run at once, each with its own inertia, friction, speed limit and torques. Torques are held over a
sample. The supply's speed limit is a torque-speed curve, or the thesis's clamp (3.2) as it stands, for comparison:
it limits the output x_1 and not the state x_2, which winds up and leaves the limit late.

The classical law is the one that identification runs by the thousand. Its lanes are stepped side by side with the
signs of their start, in a loop that becomes vector instructions; a lane that rests, or whose speed would pass zero,
takes the law's own step instead. Other laws are stepped one lane after another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import index_array, positive_number, real_array, whole_number
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.engine.lanes import LANES, entry
from ballbot.mechanics.engine.run import over_threads
from ballbot.mechanics.friction import WheelTerms, friction_terms, sign
from ballbot.mechanics.friction_laws.classical import Classical, ClassicalNumbers
from ballbot.mechanics.friction_laws.interface import (
    UNLIMITED,
    FrictionLaw,
    Inertia,
    clamped,
    move,
    slide,
)
from ballbot.mechanics.friction_laws.smoothed import Smoothed
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia

# Rows of a block: five numbers of the law, four of the inertia, then
_SPEED, _ANGLE, _TORQUE, _END, _TRAVEL, _KEPT = 9, 10, 11, 12, 13, 14
_ROWS = 15

_VECTOR = 8  # lanes are filled up to whole vectors, so that a lane rounds alike in every company


@compiled
def run_lane(law, inertia, state, speed, torques, sample_time, steps, every, out):
    """Turn one driveline; `out` (3, records) takes speed, angle and integrated speed.

    Parameters
    ----------
    law, inertia : named tuple
    state : ndarray (m,)
        The law's; it is changed.
    speed : float
        At the start [rad/s].
    torques : ndarray (samples,)
    sample_time : float
    steps : int
        Inner steps a sample.
    every : int
    out : ndarray (3, samples // every)
    """
    h, angle = sample_time / steps, 0.0
    for sample in range(len(torques)):
        for _ in range(steps):
            speed, travel = move(law, inertia, torques[sample], state, speed, h)
            angle += travel
        if (sample + 1) % every == 0:
            record = (sample + 1) // every - 1
            out[0, record] = clamped(inertia, speed)
            out[1, record] = angle
            out[2, record] = speed


@inlined
def _law(work, lane):
    return ClassicalNumbers(
        entry(work, 0, lane),
        entry(work, 1, lane),
        entry(work, 2, lane),
        entry(work, 3, lane),
        entry(work, 4, lane),
    )


@inlined
def _inertia(work, lane):
    return Inertia(entry(work, 5, lane), entry(work, 6, lane), entry(work, 7, lane), entry(work, 8, lane))


@inlined
def _try_sliding(work, filled, h):
    """Step every lane with the sign of its start, and note whether the speed has kept it."""
    for lane in range(filled):
        speed = entry(work, _SPEED, lane)
        direction = sign(speed)
        torque = entry(work, _TORQUE, lane)
        end, travel = slide(_law(work, lane), _inertia(work, lane), torque, speed, direction, h)
        work[_END * LANES + lane] = end
        work[_TRAVEL * LANES + lane] = travel
        work[_KEPT * LANES + lane] = direction * end


@inlined
def _take_step(work, state, width, filled, h):
    _try_sliding(work, filled, h)
    for lane in range(width):
        if not entry(work, _KEPT, lane) > 0.0:
            speed, torque = entry(work, _SPEED, lane), entry(work, _TORQUE, lane)
            end, travel = move(_law(work, lane), _inertia(work, lane), torque, state, speed, h)
            work[_END * LANES + lane] = end
            work[_TRAVEL * LANES + lane] = travel
    for lane in range(width):
        work[_SPEED * LANES + lane] = entry(work, _END, lane)
        work[_ANGLE * LANES + lane] += entry(work, _TRAVEL, lane)


@compiled
def run_classical_block(laws, inertias, speeds, torques, torque_of, sample_time, steps, every, out):
    """Turn up to `LANES` drivelines under the classical law side by side.

    Parameters
    ----------
    laws, inertias : ndarray (width, 5), (width, 4)
        Rows of `ClassicalNumbers` and `Inertia`.
    speeds : ndarray (width,)
        At the start [rad/s].
    torques : ndarray (inputs, samples)
    torque_of : ndarray (width,)
        Row of torques of each lane.
    sample_time : float
    steps : int
    every : int
    out : ndarray (3, width, samples // every)
        Visible speed, angle and integrated speed.
    """
    width, h = len(laws), sample_time / steps
    filled = (width + _VECTOR - 1) // _VECTOR * _VECTOR
    work = np.zeros(_ROWS * LANES)
    state = np.empty(0)
    for lane in range(width):
        for i in range(5):
            work[i * LANES + lane] = laws[lane, i]
        for i in range(4):
            work[(5 + i) * LANES + lane] = inertias[lane, i]
        work[_SPEED * LANES + lane] = speeds[lane]
    for sample in range(torques.shape[1]):
        for lane in range(width):
            work[_TORQUE * LANES + lane] = torques[torque_of[lane], sample]
        for _ in range(steps):
            _take_step(work, state, width, filled, h)
        if (sample + 1) % every == 0:
            record = (sample + 1) // every - 1
            for lane in range(width):
                out[0, lane, record] = clamped(_inertia(work, lane), entry(work, _SPEED, lane))
                out[1, lane, record] = entry(work, _ANGLE, lane)
                out[2, lane, record] = entry(work, _SPEED, lane)


_LARGEST_RATE_STEP = 0.5  # explicit steps are at most this part of the driveline's fastest time constant
_MAX_STEPS = 100_000  # a sample


def speed_clamp(speed: ArrayLike, limit: float) -> NDArray[np.float64]:
    """Return max(min(x_2, l), -l), the thesis's (3.2) as printed.

    With the text's l = -27.7 rad/s it is +27.7 at every speed; l = 27.7 is meant.
    """
    return np.maximum(np.minimum(np.asarray(speed, dtype=float), limit), -limit)


@dataclass(frozen=True, kw_only=True)
class SpeedClamp:
    """The thesis's limit (3.2): friction and sensors see the speed within it, the integrated speed runs on."""

    limit: float  #: l [rad/s]

    def __post_init__(self) -> None:
        if not 0.0 < self.limit < np.inf:
            raise InputError(
                f"The speed clamp's limit is {self.limit:g} rad/s; it must be above zero. With the thesis's "
                "negative limit, (3.2) gives the same speed for every state."
            )


@dataclass(frozen=True, kw_only=True)
class TorqueSpeedCurve:
    """The torques that a supply lets through: T from -T_stall (1 + w/w_0) to T_stall (1 - w/w_0)."""

    no_load_speed: float  #: w_0 [rad/s]
    stall_torque: float  #: T_stall [N m] at full supply, whatever the driver's own limit

    def __post_init__(self) -> None:
        for name, value in (("no-load speed", self.no_load_speed), ("stall torque", self.stall_torque)):
            if not 0.0 < value < np.inf:
                raise InputError(f"The torque-speed curve's {name} is {value:g}; it must be above zero.")


@dataclass(frozen=True, kw_only=True)
class Driveline:
    """Motor, gearbox and wheel, free to turn.

    Raises
    ------
    InputError
        If the inertia is not above zero, or the thesis's clamp meets a friction law that has a state or a dead
        zone.
    """

    inertia: float  #: j_w + j_r [kg m^2]
    friction: FrictionLaw
    speed_limit: TorqueSpeedCurve | SpeedClamp | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.inertia < np.inf:
            raise InputError(f"The driveline's inertia is {self.inertia:g} kg m^2; it must be above zero.")
        if isinstance(self.speed_limit, SpeedClamp) and not isinstance(self.friction, Classical | Smoothed):
            raise InputError(
                f"The thesis's speed clamp needs the classical friction law, not {type(self.friction).__name__}; "
                "use a torque-speed curve instead."
            )

    @staticmethod
    def of_wheel(
        robot: Robot, wheel: int, *, speed_limit: TorqueSpeedCurve | SpeedClamp | None = None
    ) -> Driveline:
        """Return the driveline of a robot's wheel (0 for the first) with the robot's friction.

        Raises
        ------
        InputError
            If the robot has no such wheel.
        """
        if not 0 <= wheel < robot.wheel_count:
            raise InputError(
                f"{robot.name} has no wheel {wheel}; its wheels are numbered 0 to {robot.wheel_count - 1}."
            )
        drive, friction = robot.drive, robot.friction
        rotor = reflected_rotor_inertia(
            gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
        )
        law = Classical(
            viscous=friction.viscous[wheel],
            coulomb=friction.coulomb[wheel],
            stribeck=friction.stribeck[wheel],
            stribeck_speed=friction.stribeck_speed,
            stribeck_exponent=friction.stribeck_exponent,
            terms=WheelTerms(*friction_terms(friction).columns()[wheel].tolist()),
        )
        return Driveline(inertia=robot.wheels.inertia + rotor, friction=law, speed_limit=speed_limit)

    def fastest_rate(self) -> float:
        """Return the fastest rate [1/s] that an explicit step has to resolve."""
        slope = self.friction.explicit_slope()
        if isinstance(self.speed_limit, TorqueSpeedCurve):
            slope += self.speed_limit.stall_torque / self.speed_limit.no_load_speed
        return slope / self.inertia

    def numbers(self) -> Inertia:
        """Return inertia and speed limit as compiled code reads them."""
        limit = self.speed_limit
        curve = limit if isinstance(limit, TorqueSpeedCurve) else None
        return Inertia(
            inv_J=1.0 / self.inertia,
            clamp=limit.limit if isinstance(limit, SpeedClamp) else UNLIMITED,
            stall=curve.stall_torque if curve else UNLIMITED,
            inv_no_load=1.0 / curve.no_load_speed if curve else 0.0,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivelineMotion:
    """The result of `simulate_drivelines`: a row for each lane, a column after every recorded sample."""

    t: NDArray[np.float64]  #: (records,) [s]
    speeds: NDArray[np.float64]  #: (lanes, records) as an encoder has them, the thesis's x_1_dot [rad/s]
    angles: NDArray[np.float64]  #: (lanes, records) [rad], 0 at the start
    integrated_speeds: NDArray[np.float64]  #: (lanes, records) x_2, which (3.2) lets run on [rad/s]


def simulate_drivelines(
    drivelines: Driveline | Sequence[Driveline],
    torques: ArrayLike,
    *,
    sample_time: float,
    step: float = 1e-3,
    initial_speeds: ArrayLike = 0.0,
    torque_of: ArrayLike | None = None,
    every: int = 1,
    threads: int | None = None,
) -> DrivelineMotion:
    """Turn many drivelines by torques held over each sample.

    Parameters
    ----------
    drivelines : Driveline or sequence of Driveline
        One for each lane, or one for all; their friction laws are of one kind.
    torques : array_like (samples,) or (inputs, samples)
        u [N m].
    sample_time : float
        [s]
    step : float
        Longest inner step [s]; a lane takes shorter ones where its fastest rate asks for that.
    initial_speeds : array_like () or (lanes,)
        [rad/s]; the friction starts as after a long rest.
    torque_of : array_like of int, optional
        The row of `torques` that each lane takes; without it lane i takes row i, or the only one.
    every : int
        Record every so many samples.
    threads : int, optional
        All cores by default. The result does not depend on it.

    Raises
    ------
    InputError
        If numbers of lanes disagree, laws are of different kinds, or a time is not allowed.
    """
    lines = [drivelines] if isinstance(drivelines, Driveline) else list(drivelines)
    inputs = np.atleast_2d(real_array(torques, ("...", "samples"), "The array of torques"))
    starts = np.atleast_1d(real_array(initial_speeds, ("...",), "The array of initial speeds"))
    _check(lines, inputs, starts)
    sample_time, step = positive_number(sample_time, "The sample time"), positive_number(step, "The step")
    every = whole_number(every, "every", least=1)
    rows = np.arange(len(inputs)) if torque_of is None else np.atleast_1d(torque_of)
    rows = index_array(rows, "torque_of", count=len(inputs), length=rows.size)
    lanes = _lane_count(len(lines), len(starts), len(rows))
    batch = _Batch(
        lines=lines * (lanes // len(lines)),
        starts=np.broadcast_to(starts, lanes),
        torques=inputs,
        torque_of=np.ascontiguousarray(np.broadcast_to(rows, lanes)),
        sample_time=sample_time,
        every=every,
        out=np.empty((3, lanes, inputs.shape[1] // every)),
    )
    steps = np.array([_steps(line, sample_time, step) for line in batch.lines])
    plain = all(isinstance(line.friction, Classical) and line.friction.is_plain for line in lines)
    run = _run_classical if plain else _run_one_by_one
    run(batch, steps, threads)
    speeds, angles, integrated = batch.out
    t = np.arange(1.0, speeds.shape[1] + 1.0) * (every * sample_time)
    return DrivelineMotion(t=t, speeds=speeds, angles=angles, integrated_speeds=integrated)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Batch:
    """The checked inputs of all lanes, one row or entry for each, and the array for their results."""

    lines: list[Driveline]
    starts: NDArray[np.float64]
    torques: NDArray[np.float64]
    torque_of: NDArray[np.int64]
    sample_time: float
    every: int
    out: NDArray[np.float64]


def _run_classical(batch: _Batch, steps: NDArray[np.int64], threads: int | None) -> None:
    """Run lanes of equal inner steps in blocks."""
    laws = np.array([line.friction.numbers() for line in batch.lines])
    inertias = np.array([line.numbers() for line in batch.lines])
    for count in np.unique(steps):
        alike = np.flatnonzero(steps == count)

        def run(first: int, alike: NDArray[np.intp] = alike, count: int = count) -> None:
            lanes = alike[first : first + LANES]
            part = np.empty((3, len(lanes), batch.out.shape[2]))
            inputs = (batch.starts[lanes], batch.torques, batch.torque_of[lanes])
            run_classical_block(
                laws[lanes], inertias[lanes], *inputs, batch.sample_time, count, batch.every, part
            )
            batch.out[:, lanes] = part

        over_threads(run, len(alike), threads)


def _run_one_by_one(batch: _Batch, steps: NDArray[np.int64], threads: int | None) -> None:
    def run(first: int) -> None:
        for lane in range(first, min(first + LANES, len(batch.lines))):
            line, count = batch.lines[lane], steps[lane]
            law, inertia = line.friction.numbers(), line.numbers()
            run_lane(
                law,
                inertia,
                line.friction.initial_state(batch.sample_time / count),
                batch.starts[lane],
                batch.torques[batch.torque_of[lane]],
                batch.sample_time,
                count,
                batch.every,
                batch.out[:, lane],
            )

    over_threads(run, len(batch.lines), threads)


def _steps(line: Driveline, sample_time: float, step: float) -> int:
    """Return the inner steps in a sample: none longer than `step`, nor than the fastest rate allows."""
    wanted = max(sample_time / step, sample_time * line.fastest_rate() / _LARGEST_RATE_STEP)
    if wanted > _MAX_STEPS:
        raise InputError(
            f"A sample of {sample_time:g} s takes {wanted:.0f} inner steps, because the fastest rate of the "
            f"driveline is {line.fastest_rate():.3g}/s: its inertia of {line.inertia:g} kg m^2 is too small "
            f"for its friction, or the step of {step:g} s is too short."
        )
    return math.ceil(wanted * (1.0 - 1e-9))


def _check(
    lines: Sequence[Driveline],
    inputs: NDArray[np.float64],
    starts: NDArray[np.float64],
) -> None:
    kinds = sorted({type(line.friction).__name__ for line in lines})
    if len(kinds) != 1:
        raise InputError(
            f"The drivelines have the friction laws {kinds}; all drivelines of one call must have the same "
            "law."
        )
    if inputs.ndim != 2 or inputs.size == 0:
        raise InputError(
            f"The torque array has the shape {inputs.shape}; it must be a row of numbers, or one for each input."
        )
    if starts.ndim != 1:
        raise InputError(
            f"The array of initial speeds has the shape {starts.shape}; it must be one number, or one for each lane."
        )


def _lane_count(*counts: int) -> int:
    lanes = max(counts)
    if any(count not in (1, lanes) for count in counts):
        lines, starts, inputs = counts
        raise InputError(
            f"There are {lines} drivelines, {starts} initial speeds and {inputs} rows of torques; each "
            "number must be one or the number of lanes."
        )
    return lanes
