"""Rollers in a log: where they are on each wheel, and the log as of wheels that touch the ball in a point.

What rollers do (`ballbot.simulation.imperfections`) is a torque on the wheels, and another row of A, by the wheels'
angles and speeds. The log has both, but for the angle from a roller to where the encoder counts zero: a wheel's phase.
So `on_points` adds the torque to the logged ones and gives the ball's velocity by the rows that touched. On such a log
everything is as with wheels that touch in a point: a prediction by the true friction is as near as one in which the
rollers follow the predicted angles (RMSE of the lean's rate on the nominal twin without play: 3.5 mrad/s by both,
15.4 without rollers).

Phases within a pitch, and how soft the contacts are. To first order the residuals of a log's windows are

    r_0 + J dp + sum_i a_i(phase_i)          J: by the free parameters, a_i: by the rollers of wheel i

with weights of one over the root mean square of each state. With J projected out, the squares for all phases together
follow from one Gram matrix, so that the friction's errors do not move them. Which of two rings a roller belongs to does
not change its torque, but the ball's velocity: of all choices, that whose windows are predicted best. The phases count
if they reduce the squares of windows by `_CLEARLY` standard errors, in every log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.identification.balancing import Balancing
from ballbot.identification.prediction import Predictor, windows_for
from ballbot.identification.quantities import scale_between
from ballbot.identification.windows import Windows
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names, wheel_speed_names
from ballbot.log.pose import with_wheel_speeds, without_encoder_lag
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot
from ballbot.simulation.imperfections import LOOP, Imperfections, RollerContacts, loop_record
from ballbot.simulation.rollers import touch_rows

#: places within a sample whose mean is its torque
_WITHIN = (0.25, 0.75)
#: phases tried within a pitch, and how often a third of their distance is tried on both sides of the best ones
_TRIED, _REFINED = 10, 3
#: softness of the contacts that is tried, over the twin's
_SOFTNESS = np.geomspace(0.35, 2.83, 13)
#: length of the windows where nobody chose one [s]
_WINDOW = 0.25
#: pitches that each wheel must turn through: in few, other forces that depend on the place look like rollers. With a
#: log of standing (14 pitches) beside a square, C_rr of the stand-in robot ended at zero
_TURNED = 20.0
#: scaled step of the derivatives by parameters
_STEP = 1e-3
#: standard errors by which rollers must reduce the squares of windows: the best of a thousand phases by chance has 3.3
_CLEARLY = 3.3


@dataclass(frozen=True, kw_only=True, eq=False)
class RollersFound:
    """Where the rollers are in logs, and how soft their contacts are."""

    contacts: RollerContacts
    phases: Floats  #: (logs, n), angle of each wheel's roller of the first ring where the encoder shows zero [rad]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"phases": self.phases.tolist(), "softness": self.contacts.softness}


def on_points(log: Log, robot: Robot, contacts: RollerContacts, phases: Floats) -> Log:
    """Return the log with torques, wheel speeds and position of wheels that touch in a point; phases (n,) [rad].

    Speeds and position stay if the position is not the wheels'.
    """
    angles, speeds = _turning(log, robot)
    rolled, rings = _rolled(robot, contacts, angles + phases, speeds)
    names = (f"u{i}" for i in range(1, robot.wheel_count + 1))
    log = log.with_columns(dict(zip(names, (log.torques + rolled).T, strict=True)))
    A, record = transforms(robot).T_owb, _record(robot, contacts)
    touching = A + rings[..., None] * record["off_middle"][0, : robot.wheel_count]
    relative = np.linalg.pinv(np.nan_to_num(touching)) @ speeds[..., None]
    return with_wheel_speeds(log, robot, relative[..., 0] @ A.T)


def shows_wheels(log: Log, robot: Robot) -> bool:
    """Return whether a log has the angle and the speed of every wheel."""
    names = {*wheel_angle_names(robot.wheel_count), *wheel_speed_names(robot.wheel_count)}
    return names <= set(log.names)


def _turning(log: Log, robot: Robot) -> tuple[Floats, Floats]:
    names = wheel_angle_names(robot.wheel_count), wheel_speed_names(robot.wheel_count)
    angles, speeds = (np.column_stack([log[name] for name in columns]) for columns in names)
    return angles, speeds


def _record(robot: Robot, contacts: RollerContacts):
    play = robot.drive.backlash if robot.drive.reflected_inertia > 0.0 else 0.0
    own = Imperfections(contacts=contacts, backlash=play)
    return loop_record(own, robot, estimator=None, sample_time=robot.sensors.sample_time).view(LOOP.dtype())


def _rolled(robot: Robot, contacts: RollerContacts, angles: Floats, speeds: Floats) -> tuple[Floats, Floats]:
    """Return the rollers' mean torques (N, n) from each row to the next, and the rings that bear at the rows (N, n)."""
    record = _record(robot, contacts).view(np.float64)
    torques, rings, unused = (np.empty_like(angles) for _ in range(3))
    total = np.zeros_like(angles)
    later = np.minimum(np.arange(len(angles)) + 1, len(angles) - 1)
    for share in _WITHIN:
        angle, speed = (now + share * (now[later] - now) for now in (angles, speeds))
        touch_rows(record, angle, speed, torques, unused)
        total += torques / len(_WITHIN)
    touch_rows(record, angles, speeds, torques, rings)
    return total, rings


@dataclass(frozen=True, kw_only=True, eq=False)
class _LogWindows:
    """A log's windows, and how torques move their residuals."""

    experiment: Balancing
    value: Floats  #: (1, p), SI units
    log: Log
    windows: Windows
    rows: Ints  #: (w,), of the log, where windows start
    weights: Floats  #: (10,)
    known: Floats  #: (M, q), an orthonormal basis of what parameters move
    residuals: Floats  #: (M,), weighted, the basis projected out

    @staticmethod
    def of(experiment: Balancing, point: Floats, log: Log, number: int) -> "_LogWindows":
        windows = experiment.windows.take(np.flatnonzero(experiment.block_log == number))
        columns = np.flatnonzero(experiment.coordinates.free)
        points = np.tile(point, (1 + len(columns), 1))
        points[1 + np.arange(len(columns)), columns] += np.where(point[columns] > 0.5, -_STEP, _STEP)
        values = experiment.coordinates.physical(points)
        found = experiment.predictor.residuals(values, windows, every=windows.comparison_interval)
        size = np.sqrt((found[0] ** 2).mean(axis=(0, 1)))
        weights = np.where(experiment.counted & (size > 0.0), 1.0 / np.maximum(size, 1e-300), 0.0)
        flat = (found * weights).reshape(len(found), -1)
        slopes = (flat[1:] - flat[0]).T
        known = np.linalg.qr(slopes[:, slopes.any(axis=0)])[0]
        return _LogWindows(
            experiment=experiment,
            value=values[:1],
            log=log,
            windows=windows,
            rows=np.searchsorted(log.t, [span.start - 1e-9 for span in windows.spans]),
            weights=weights,
            known=known,
            residuals=flat[0] - known @ (known.T @ flat[0]),
        )

    def moved(self, torques: Floats) -> Floats:
        """Return what further torques (c, N, n) add to the residuals (c, M)."""
        windows, count = self.windows, len(torques)
        within = torques[:, self.rows[:, None] + np.arange(windows.samples)]
        more = np.concatenate([windows.torques[None], windows.torques + within])
        every = np.tile(np.arange(len(windows)), 1 + count)
        lanes = replace(windows.take(every), torques=more.reshape(-1, *more.shape[2:]))
        predictor, interval = self.experiment.predictor, windows.comparison_interval
        found = predictor.residuals(self.value, lanes, every=interval)[0] * self.weights
        flat = found.reshape(1 + count, -1)
        change = flat[1:] - flat[0]
        return change - (change @ self.known) @ self.known.T

    def rolled(self, contacts: RollerContacts, phases: Floats) -> Floats:
        """Return the torques (N, n) by phases (n,)."""
        robot = self.experiment.predictor.robot
        angles, speeds = _turning(self.log, robot)
        return np.nan_to_num(_rolled(robot, contacts, angles + phases, speeds)[0])

    def best(self, contacts: RollerContacts, tried: Floats) -> Floats:
        """Return the best phases (n,) of those tried for each wheel (n, k)."""
        n, k = tried.shape
        angles, _ = _turning(self.log, self.experiment.predictor.robot)
        still = -angles  # the middle of a roller at every row: no torque, and what there is is common to all
        common = self.rolled(contacts, still)
        alone = [
            self.rolled(contacts, np.where(np.arange(n) == i, phase, still)) - common
            for i, phases in enumerate(tried)
            for phase in phases
        ]
        moved = self.moved(np.stack([common, *alone]))
        start, moved = self.residuals + moved[0], moved[1:]
        gram, along = moved @ moved.T, 2.0 * (moved @ start)
        choices = np.indices((k,) * n).reshape(n, -1).T + k * np.arange(n)
        squares = along[choices].sum(axis=1)
        for i, j in product(range(n), repeat=2):
            squares += gram[choices[:, i], choices[:, j]]
        return tried.ravel()[choices[squares.argmin()]]

    def squares(self, contacts: RollerContacts, phases: Floats) -> Floats:
        """Return the squares (w,) of each window less those without rollers."""
        moved = self.moved(self.rolled(contacts, phases)[None])[0]
        by_window = np.stack([self.residuals, self.residuals + moved]).reshape(2, len(self.windows), -1)
        return np.diff((by_window**2).sum(axis=2), axis=0)[0]

    def with_rings(self, contacts: RollerContacts, phases: Floats) -> Floats:
        """Return phases (n,) with the choice of rings whose windows are predicted best."""
        experiment, pitch = self.experiment, _pitch(contacts)
        if contacts.rollers.rows != 2:
            return phases
        robot = experiment.predictor.robot
        choices = phases + pitch * np.array([*product((0.0, 1.0), repeat=len(phases))])
        errors = []
        for choice in choices:
            windows = windows_for(
                experiment.predictor,
                experiment.coordinates.upper,
                [on_points(self.log, robot, contacts, choice)],
                duration=self.windows.samples * self.windows.sample_time,
            )
            found = experiment.predictor.residuals(self.value, windows, every=windows.comparison_interval)
            errors.append(float(np.log((found[0] ** 2).mean(axis=(0, 1)))[experiment.counted].sum()))
        return choices[int(np.argmin(errors))]


def _pitch(contacts: RollerContacts) -> float:
    return 2.0 * np.pi / (contacts.rollers.rows * contacts.rollers.per_row)


def find_rollers(
    experiment: Balancing, point: Floats, logs: Sequence[Log], *, clearly: float = _CLEARLY
) -> RollersFound | None:
    """Return where the rollers are, from predictions at a scaled point (p,).

    None if they do not reduce the squares of windows by so many standard errors in every log, are as soft or as hard
    as was tried, or hardly pass.
    """
    robot = experiment.predictor.robot
    of_logs = [_LogWindows.of(experiment, point, log, number) for number, log in enumerate(logs)]
    contacts = RollerContacts(rollers=robot.wheels.rollers)
    pitch = _pitch(contacts)
    turned = [
        np.ptp(angles[np.isfinite(angles).all(axis=1)], axis=0)
        for angles, _ in (_turning(log, robot) for log in logs)
    ]
    if np.min(turned) < _TURNED * pitch:
        return None
    grid = np.arange(_TRIED) / _TRIED * pitch
    phases = [windows.best(contacts, np.tile(grid, (robot.wheel_count, 1))) for windows in of_logs]
    softest = [replace(contacts, softness=softness) for softness in _SOFTNESS.tolist()]
    squares = [
        sum(windows.squares(one, phase).sum() for windows, phase in zip(of_logs, phases, strict=True))
        for one in softest
    ]
    best = int(np.argmin(squares))
    if best in (0, len(softest) - 1):
        return None  # whatever passes there, it is not these rollers
    contacts = softest[best]
    for level in range(1, 1 + _REFINED):
        beside = np.array([-1.0, 0.0, 1.0]) * pitch / (_TRIED * 3.0**level)
        phases = [
            windows.best(contacts, phase[:, None] + beside)
            for windows, phase in zip(of_logs, phases, strict=True)
        ]
    for windows, phase in zip(of_logs, phases, strict=True):
        less = -windows.squares(contacts, phase)
        if not less.mean() > clearly * less.std() / np.sqrt(len(less)):
            return None
    phases = [windows.with_rings(contacts, phase) for windows, phase in zip(of_logs, phases, strict=True)]
    return RollersFound(contacts=contacts, phases=np.array(phases))


def as_its_friction(log: Log, robot: Robot) -> Log:
    """Return the log as what the robot's friction predicts: of wheels that touch in a point if it is without rollers.

    It has no lag of its encoders then (`without_encoder_lag`). It stays where rollers make no prediction better.
    """
    if not (robot.friction.roller_softness and shows_wheels(log, robot)):
        return log
    log = without_encoder_lag(log, robot)
    coordinates = scale_between(robot)
    predictor = Predictor(robot=robot, step=log.sample_time, layout=coordinates.layout, threads=1)
    windows = windows_for(predictor, coordinates.upper, [log], duration=_WINDOW)
    experiment = Balancing(predictor=predictor, windows=windows, coordinates=coordinates)
    if not len(windows):
        return log
    found = find_rollers(experiment, coordinates.scaled(coordinates.nominal), [log], clearly=0.0)
    return on_points(log, robot, found.contacts, found.phases[0]) if found else log
