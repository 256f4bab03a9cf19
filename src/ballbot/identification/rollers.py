"""Rollers in a log: where they are on each wheel, and the log as of wheels that touch the ball in a point.

What rollers do (`ballbot.simulation.rollers`) is mostly a torque on the wheels, by the wheels' angles and speeds. The
log has both, but for the angle from a roller to where the encoder counts zero: a wheel's phase. With the torque added
to those logged, everything is as with wheels that touch in a point.

Phases and softness of the contacts are those that explain best what the motors' torques lost,

    u - B^+ (w' - A x)        w: the body's rates, a gyro's; A and B of the linearised exact model, heading frame

once each wheel's friction, a sum of terms in its speed, has explained what it can of both. Wheels take turns in finding
their phases, since rollers of one brake the ball's turning for all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.control.lqr import frictionless_model
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names, wheel_angle_names, wheel_speed_names
from ballbot.log.torque_balance import BLOCK, FALLING, SIGN, block_sums, clarity
from ballbot.robot import Robot
from ballbot.simulation.imperfections import Imperfections, RollerContacts, loop_record
from ballbot.simulation.rollers import touch_rows

#: phases tried within a pitch
_TRIED = 16
#: softness of the contacts that is tried, over the twin's
_SOFTNESS = np.geomspace(0.5, 2.0, 9)
#: pitches that each wheel must turn through: in few, other forces that depend on the place look like rollers. With a
#: log of standing (14 pitches) beside a square, C_rr of the stand-in robot ended at zero
_TURNED = 20.0
#: standard errors by which rollers must explain lost torques: the best of a thousand phases by chance has 3.3
_CLEARLY = 3.3


def _rolled(log: Log, robot: Robot, contacts: RollerContacts, phases: Floats) -> Floats:
    """Return the rollers' torques (N, n) between each row and the next; zero where the log lacks angle or speed."""
    play = robot.drive.backlash if robot.drive.reflected_inertia > 0.0 else 0.0
    own = Imperfections(contacts=contacts, backlash=play)
    record = loop_record(own, robot, estimator=None, sample_time=robot.sensors.sample_time)
    names = wheel_angle_names(robot.wheel_count), wheel_speed_names(robot.wheel_count)
    columns = (np.column_stack([log[name] for name in of]) for of in names)
    angles, speeds = (0.5 * (now + np.concatenate([now[1:], now[-1:]])) for now in columns)
    torques, rings = np.empty_like(angles), np.empty_like(angles)
    touch_rows(record.view(np.float64), angles + phases, speeds, torques, rings)
    return np.nan_to_num(torques)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lost:
    """The torques that a log's motors lost, without what each wheel's friction explains."""

    log: Log
    robot: Robot
    rows: Bools  #: (N,), those with every value
    friction: list[Floats]  #: of each wheel an orthonormal basis of its friction
    moving: Floats  #: (n, n), from torques to those that move the body
    torques: Floats  #: (rows, n) [N m]

    @staticmethod
    def of(log: Log, robot: Robot) -> "_Lost":
        linear, x = frictionless_model(robot).linearize(), np.column_stack([log[n] for n in STATE_NAMES])
        back = np.linalg.pinv(linear.B[7:])
        rates = np.diff(x[:, 7:], axis=0, append=np.nan) / np.diff(log.t, append=np.inf)[:, None]
        into = np.exp(-1j * x[:, 4])  # the heading frame
        lean, change = ((pair[:, 0] + 1j * pair[:, 1]) * into for pair in (x[:, 2:4], rates))
        needed = np.column_stack([change.real, change.imag, rates[:, 2]])
        needed = needed - np.column_stack([lean.real, lean.imag]) @ linear.A[7:, 2:4].T
        lost = log.torques - needed @ back.T
        speeds = np.column_stack([log[name] for name in wheel_speed_names(robot.wheel_count)])
        rows = np.asarray(np.isfinite(np.hstack([lost, speeds])).all(axis=1))
        w = speeds[rows]
        sign = np.tanh(w / SIGN)
        terms = np.stack([np.ones_like(w), w, sign, sign * np.exp(-np.abs(w) / FALLING)])
        bases = [np.linalg.qr(terms[..., i].T)[0] for i in range(robot.wheel_count)]
        moving, left = back @ linear.B[7:], _without(bases, lost[rows])
        return _Lost(log=log, robot=robot, rows=rows, friction=bases, moving=moving, torques=left)

    def explained(self, contacts: RollerContacts, phases: Floats) -> Floats:
        """Return by how much rollers lower the squares (rows,), over the mean ones of each wheel."""
        rolled = _rolled(self.log, self.robot, contacts, phases)[self.rows] @ self.moving.T
        squares = self.torques**2 - (self.torques + _without(self.friction, rolled)) ** 2
        return squares @ (1.0 / (self.torques**2).mean(axis=0))

    def phases(self, contacts: RollerContacts) -> Floats:
        """Return the phases (n,) that explain most."""
        wheels = np.arange(self.robot.wheel_count)
        found = np.zeros(len(wheels))
        for wheel in (*wheels, *wheels):
            tried = [np.where(wheels == wheel, k / _TRIED * _pitch(contacts), found) for k in range(_TRIED)]
            found = max(tried, key=lambda phases: self.explained(contacts, phases).sum())
        return found


def _without(friction: list[Floats], torques: Floats) -> Floats:
    """Return torques (rows, n) without what bases of each wheel's friction explain."""
    pairs = zip(friction, torques.T, strict=True)
    return np.column_stack([torque - basis @ (basis.T @ torque) for basis, torque in pairs])


def _pitch(contacts: RollerContacts) -> float:
    return 2.0 * np.pi / (contacts.rollers.rows * contacts.rollers.per_row)


def on_points(logs: Sequence[Log], robot: Robot) -> tuple[list[Log], float]:
    """Return logs with the torques of wheels that touch in a point, and how soft the contacts are, over the twin's.

    Zero, and the logs as they are, if they lack a wheel's angle or speed or another column, the wheels hardly turn, or
    in a log the rollers do not explain lost torques by `_CLEARLY` standard errors, or as soft or as hard as was tried.
    """
    contacts, same = RollerContacts(rollers=robot.wheels.rollers), (list(logs), 0.0)
    wheels = robot.wheel_count
    names, angles = torque_names(wheels), wheel_angle_names(wheels)
    needed = {*STATE_NAMES, *names, *angles, *wheel_speed_names(wheels)}
    if contacts.rollers.rows > 2 or not all(needed <= set(log.names) for log in logs):
        return same
    of_wheels = [log[name] for log in logs for name in angles]
    turned = [np.nanmax(of, initial=-np.inf) - np.nanmin(of, initial=np.inf) for of in of_wheels]
    if min(turned) < _TURNED * _pitch(contacts):
        return same
    lost = [_Lost.of(log, robot) for log in logs]
    phases = [of.phases(contacts) for of in lost]
    tried = [replace(contacts, softness=softness) for softness in _SOFTNESS.tolist()]
    of_logs = [[of.explained(one, at) for of, at in zip(lost, phases, strict=True)] for one in tried]
    best = int(np.argmax([sum(of.sum() for of in explained) for explained in of_logs]))
    clear = [
        clarity(block_sums(by_row, ((of.log.t[of.rows] - of.log.t[0]) / BLOCK).astype(np.intp)))
        for of, by_row in zip(lost, of_logs[best], strict=True)
    ]
    if best in (0, len(tried) - 1) or not min(clear) > _CLEARLY:
        return same  # whatever passes there, it is not these rollers
    acting = [
        log.torques + _rolled(log, robot, tried[best], at) for log, at in zip(logs, phases, strict=True)
    ]
    columns = (dict(zip(names, torques.T, strict=True)) for torques in acting)
    return [log.with_columns(of) for log, of in zip(logs, columns, strict=True)], tried[best].softness


def as_its_friction(log: Log, robot: Robot) -> Log:
    """Return the log as what the robot's friction predicts: of wheels that touch in a point if it is without rollers.

    It stays where the rollers are not found.
    """
    return on_points([log], robot)[0][0] if robot.friction.roller_softness else log
