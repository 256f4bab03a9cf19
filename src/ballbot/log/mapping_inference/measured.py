"""What the sensors of a foreign log show with certain units, and the units that the motion confirms.

Units are assumed by names, sizes and steps; with them, the response of the lean to the wheels, and the turning of the
heading with the wheels, say which units they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.log.checks.stuck_encoders import Balancing, StuckEncoder, stuck_encoders
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.file_signals import GyroTest, Raw, Signals, gyro_of, signals_of
from ballbot.log.mapping_inference.frame import HeadingTest, heading_test
from ballbot.log.mapping_inference.placement import LeanTest, lean_test
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.units import (
    TURNING_CORRELATION,
    Scale,
    UnitEvidence,
    fastest,
    heading_units,
    lean_units,
    likeliest_units,
    speed_units,
    wheel_units,
)
from ballbot.log.signals import REACH, repaired_noise, sampling_times, speed_noise, without_resets
from ballbot.robot import Robot

#: the repair is applied if it leaves less than this fraction of the speed's noise
WORTH_REPAIRING = 0.7
#: rows that this is judged by, a minute at 100 Hz: every wheel is repaired by the others, which takes most of the time
REPAIR_ROWS = 6000
#: times whose intervals differ by less than this part of them need no repair
EVEN_TIMES = 0.01
#: a wheel faster than this many times the drive's own limit was not turning: its encoder was reset
IMPOSSIBLE_SPEED = 3.0
#: filters that the test of the lean tries [s]: the quick robots move at 1 to 3 Hz, and noise of the angles asks for
#: more
LEAN_WIDTHS = (0.05, 0.08, 0.12, 0.2)
#: and the widest that leaves enough of a quick robot's motion to separate gravity's part from the wheels' [s]
SLOWEST_FOR_GRAVITY = 0.12


@dataclass(frozen=True, kw_only=True)
class TimingRepair:
    """What the encoders show about the rows' times."""

    before: float | None  #: speed noise by the rows' own times [rad/s]; None if the wheels are too slow
    after: float | None  #: and by those of the encoders, each wheel validated on the others
    worth_it: bool


_NO_REPAIR = TimingRepair(before=None, after=None, worth_it=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class AssumedUnits:
    """The units of lean, wheels and heading, and what else they may be."""

    wheel: Scale
    lean: Scale | None
    heading: Scale | None  #: None without a yaw
    wheels: dict[Scale, float]  #: logarithms of weights
    leans: dict[Scale, float]
    headings: Callable[[Scale], dict[Scale, float]]  #: with a unit of the lean

    @staticmethod
    def assumed(raw: Raw, roles: Roles, robot: Robot) -> AssumedUnits:
        """Return the units by name and size."""
        wheel_name, lean_name = roles.reading(roles.angles), roles.reading(roles.attitude)
        named_wheel = wheel_name.unit if wheel_name else None
        wheels = (
            wheel_units(raw.angles, robot, named_wheel, wrap=roles.wrap)
            if raw.speeds is None
            else speed_units(raw.speeds, robot, named_wheel, interval=float(np.median(np.diff(raw.t))))
        )
        if raw.attitude is None:
            wheel = max(wheels, key=lambda one: wheels[one])
            return AssumedUnits(
                wheel=wheel, lean=None, heading=None, wheels=wheels, leans={}, headings=lambda one: {one: 0.0}
            )
        lean_named = lean_name.unit if lean_name else None
        leans = lean_units(raw.attitude[:, :2], lean_named)

        def headings(lean: Scale) -> dict[Scale, float]:
            if raw.attitude is None or raw.attitude.shape[1] < 3 or roles.quaternion:
                return {lean: 0.0}
            named = roles.reading(roles.attitude[2:])
            return heading_units(raw.attitude[:, 2], named.unit if named else None, lean, lean_named)

        pairs = {
            (lean, heading): weight + own
            for lean, weight in leans.items()
            for heading, own in headings(lean).items()
        }
        lean, heading = max(pairs, key=lambda one: pairs[one])
        return AssumedUnits(
            wheel=max(wheels, key=lambda one: wheels[one]),
            lean=lean,
            heading=heading if raw.attitude.shape[1] > 2 else None,
            wheels=wheels,
            leans=leans,
            headings=headings,
        )

    @property
    def factors(self) -> tuple[float, float, float]:
        """Factors of roll and pitch, wheels and yaw."""
        lean = self.lean.factor if self.lean else 1.0
        return lean, self.wheel.factor, self.heading.factor if self.heading else lean

    def in_radians(self, attitude: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return roll, pitch and, if there is one, yaw (N, 2 or 3) [rad]."""
        lean, _, heading = self.factors
        return attitude * np.array([lean, lean, heading])[: attitude.shape[1]]

    def judged_by(self, tested: LeanTest | None, heading: HeadingTest | None) -> AssumedUnits:
        """Return the likeliest units, given the response of the lean to the wheels, and the heading's."""
        if self.lean is None:
            # without a lean the wheels' units come from names and steps
            lean = Scale(unit="rad", factor=1.0, reason="")
            nothing = UnitEvidence(assumed=(lean, self.wheel, lean), gain=None, gain_error=0.0, turning=None)
            return replace(self, wheel=likeliest_units({lean: 0.0}, self.wheels, self.headings, nothing)[1])
        agree = heading is not None and abs(heading.correlation) > TURNING_CORRELATION and heading.significant
        motion = UnitEvidence(
            assumed=(self.lean, self.wheel, self.heading or self.lean),
            gain=tested.gain if tested else None,
            gain_error=tested.gain_error if tested else 0.0,
            turning=abs(heading.gain) if heading and agree else None,
        )
        lean, wheel, turned = likeliest_units(self.leans, self.wheels, self.headings, motion)
        return replace(self, lean=lean, wheel=wheel, heading=turned if self.heading else None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """What the sensors show with certain units."""

    angles: NDArray[np.float64]  #: (M, n) of the wheels [rad], continued across resets
    largest_speed: float | None
    sampled: NDArray[np.float64]  #: (M,) [s]
    timing: TimingRepair
    signals: Signals
    gyro: GyroTest | None
    unused_gyro: str
    lean_test: LeanTest | None


def measured_with(raw: Raw, units: AssumedUnits, robot: Robot, stuck: Sequence[StuckEncoder]) -> Measured:
    """Return what the sensors show with units; rows in which an encoder is stuck are not used."""
    limit = IMPOSSIBLE_SPEED * fastest(robot)
    angles = raw.angles * units.wheel.factor
    # integrals have no resets, and their steps are made of the rows' own times
    measured_angles = raw.speeds is None
    carried = without_resets(raw.t, angles, limit) if measured_angles else angles
    timing, sampled = _timing(raw.t, carried) if measured_angles else (_NO_REPAIR, raw.t)
    attitude = None if raw.attitude is None or units.lean is None else units.in_radians(raw.attitude)
    signals = _without(stuck, signals_of(raw, carried, sampled, attitude, width=LEAN_WIDTHS[0]))
    gyro, unused_gyro = gyro_of(raw, signals, sampled, attitude), ""
    if gyro is not None and gyro.confidence < CONFIDENT:
        gyro, unused_gyro = None, gyro.unusable  # the angles are differentiated
    tested = None
    if attitude is not None:
        tests = [
            (width, seen, lean_test(robot, seen.lean, seen.wheels, seen.heading, seen.usable))
            for width in LEAN_WIDTHS
            for seen in [_without(stuck, signals_of(raw, carried, sampled, attitude, width=width, gyro=gyro))]
            if seen.lean is not None
        ]
        known = [(width, seen, one) for width, seen, one in tests if one is not None]
        if known:
            _, signals, tested = min(known, key=lambda tried: _doubt(tried[2]))
            by_gravity = min(
                (one for width, _, one in known if width <= SLOWEST_FOR_GRAVITY), key=_doubt, default=tested
            )
            tested = replace(tested, time_ratio=by_gravity.time_ratio, time_error=by_gravity.time_error)
    return Measured(
        angles=carried,
        largest_speed=None if np.allclose(carried, angles, atol=1e-6) else limit,
        sampled=sampled,
        timing=timing,
        signals=signals,
        gyro=gyro,
        unused_gyro=unused_gyro,
        lean_test=tested,
    )


def _without(stuck: Sequence[StuckEncoder], signals: Signals) -> Signals:
    """Return signals of which the rows near an encoder's hold are not usable."""
    usable, reach = signals.usable.copy(), REACH * LEAN_WIDTHS[-1]
    for one in stuck:
        usable &= (signals.rows < one.start - reach) | (signals.rows > one.end + reach)
    return replace(signals, usable=usable) if stuck else signals


def stuck_in(raw: Raw, units: AssumedUnits, measured: Measured) -> tuple[StuckEncoder, ...]:
    """Return the holds of encoders during which the rest of the motion says that their wheels turned."""
    if raw.attitude is None or units.lean is None:
        return ()
    late = measured.lean_test.lag if measured.lean_test else 0.0
    angles = units.in_radians(raw.attitude)
    angles[:, 2:] = np.unwrap(angles[:, 2:], axis=0)
    angles = np.column_stack([np.interp(raw.t + late, raw.t, column) for column in angles.T])
    motion = Balancing(
        t=raw.t,
        wheels=measured.angles,
        lean=angles[:, :2],
        heading=angles[:, 2] if angles.shape[1] > 2 else None,
    )
    return tuple(stuck_encoders(motion))


def _doubt(tested: LeanTest) -> float:
    """Return how little a test shows: the error of the phase, more if the placement is in doubt."""
    error = tested.phase_error if tested.phase_error is not None else math.pi
    return error / max(tested.confidence, 0.05)


def _timing(t: NDArray[np.float64], angles: NDArray[np.float64]) -> tuple[TimingRepair, NDArray[np.float64]]:
    judged = slice(0, REPAIR_ROWS)
    before = speed_noise(t[judged], angles[judged])
    steps = np.diff(t[judged])
    # a loop that keeps its time to a hundredth of a row reads its sensors in time, too
    kept = float(np.ptp(steps)) < EVEN_TIMES * float(np.median(steps))
    after = repaired_noise(t[judged], angles[judged]) if before is not None and not kept else None
    worth_it = before is not None and after is not None and after < WORTH_REPAIRING * before
    repair = TimingRepair(before=before, after=after, worth_it=worth_it)
    return repair, sampling_times(t, angles) if worth_it else t


def _test_heading(signals: Signals, tested: LeanTest | None, robot: Robot) -> HeadingTest | None:
    if signals.heading is None or tested is None:
        return None
    return heading_test(robot, signals.wheels, signals.heading, tested)


def settled_units(
    raw: Raw, units: AssumedUnits, robot: Robot, stuck: Sequence[StuckEncoder] = ()
) -> tuple[AssumedUnits, Measured, HeadingTest | None]:
    """Return the units that the motion confirms, with what the sensors show with them and with the heading's test."""
    measured = measured_with(raw, units, robot, stuck)
    heading = _test_heading(measured.signals, measured.lean_test, robot)
    for _ in range(2):
        changed = units.judged_by(measured.lean_test, heading)
        if changed.factors == units.factors:
            break
        units, measured = changed, measured_with(raw, changed, robot, stuck)
        heading = _test_heading(measured.signals, measured.lean_test, robot)
    return units.judged_by(measured.lean_test, heading), measured, heading
