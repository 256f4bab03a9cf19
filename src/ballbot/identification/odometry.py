"""The wheels' radius and their turn against the IMU, on which odometry depends.

The regression of `ballbot.identification.rolling`, given the ball's velocity as the wheels have it by the robot file,
gives the complex gain of that velocity. Its size is the true radius over the file's; its angle is the turn of the
wheels about the vertical against the IMU, by which odometry in the world is turned the other way. Slip that is in
proportion to the motion counts as radius.

The robot found has the mean of the logs' number and the file's, weighed by their variances. On 35 simulated robots
whose file is off by 1.2 % and 1.0 degrees (root mean square) it is off by 0.8 % and 0.26 degrees; with the file's
number unless the logs refute it, it was by 0.9 % and 0.40 degrees.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbot.arrays import Floats
from ballbot.findings import Finding, warning
from ballbot.identification.file_values import with_file_errors
from ballbot.identification.rolling import RollingMotion
from ballbot.log import Log
from ballbot.log.columns import wheel_speed_names
from ballbot.log.pose import with_odometry
from ballbot.results import reported
from ballbot.robot import Robot
from ballbot.robot.parameters import Value
from ballbot.robot.variations import propagate
from ballbot.rounding import digits

_RADIUS, _AZIMUTHS = "wheels.radius", "wheels.azimuths"
#: deviation of the turn of an IMU that is screwed on by hand, by its case's edges [rad]
MOUNTED = math.radians(1.0)
#: errors of the logs' own estimate beyond which a finding names it: of 95 % of right numbers none does
REFUTED = 2.0
#: bumps of `rolling` that are needed: in logs of 24 s chance refuted 14 % of right turns, in those of 32 s 2 %
_LEAST = 30
#: by how much the turns of twelve simulated robots were further off than their standard errors (root mean square)
_PULLS = 1.4


@dataclass(frozen=True, kw_only=True)
class Deviating:
    """By how much a number of the robot differs from its file."""

    deviation: float  #: of the file's
    own: float  #: by the logs
    own_error: float  #: of that, with the errors of the file's other numbers

    @reported
    def correction(self) -> float:
        """By how much the robot found differs."""
        return self.own * self.deviation**2 / (self.deviation**2 + self.own_error**2)

    @property
    def refuted(self) -> bool:
        """Whether the logs refute the file."""
        return abs(self.own) > REFUTED * self.own_error

    @property
    def error(self) -> float:
        """Standard deviation of what is corrected."""
        return self.deviation * self.own_error / math.hypot(self.deviation, self.own_error)


@dataclass(frozen=True, kw_only=True)
class WheelFrame:
    """By how much the wheels differ from the robot file, as far as odometry depends on it."""

    radius: Deviating  #: relative
    turn: Deviating  #: about the vertical, against the IMU, from forward towards the left [rad]

    @staticmethod
    def of(logs: Sequence[Log], robot: Robot) -> "WheelFrame | None":
        """Return what logs show; None if they lack a wheel's speed or are too short."""
        if not all({*wheel_speed_names(robot.wheel_count)} <= set(log.names) for log in logs):
            return None
        motion = RollingMotion.of([with_odometry(log, robot) for log in logs], robot)
        if motion is None or len(motion.log) < _LEAST:
            return None
        known = with_file_errors(robot, ())
        of_radius = float(np.sum(known.standard_deviations.get(_RADIUS, 0.0))) / robot.wheels.radius
        others = {name: size for name, size in known.standard_deviations.items() if name != _RADIUS}
        rest, (own, errors) = robot.annotated(standard_deviations=others), _gain(motion, robot)

        def by_file(k: int) -> float:
            return propagate(rest, lambda moved: float(_gain(motion, moved)[0][k])).deviation

        errors = np.hypot(_PULLS * errors, [by_file(k) for k in (0, 1)])
        radius, turn = (
            Deviating(deviation=deviation, own=float(own[k]), own_error=float(errors[k]))
            for k, deviation in enumerate((of_radius, MOUNTED))
        )
        return WheelFrame(radius=radius, turn=turn)

    def corrected(self, robot: Robot) -> Robot:
        """Return a robot with the corrections."""
        radius = robot.wheels.radius * math.exp(self.radius.correction)
        turned = np.add(robot.wheels.azimuths, self.turn.correction)
        azimuths = tuple((turned - 2.0 * np.pi * (turned > 2.0 * np.pi)).tolist())
        values: dict[str, Value] = {_RADIUS: radius, _AZIMUTHS: azimuths}
        found = "identified: from the ball's acceleration, weighed with the file before"
        return robot.replace(values).annotated(
            sources={**robot.sources, **dict.fromkeys(values, found)},
            standard_deviations={**robot.standard_deviations, _RADIUS: radius * self.radius.error},
        )

    def findings(self, robot: Robot) -> list[Finding]:
        """Return a warning for each number that the logs refute; `robot` has the corrections."""
        findings = list[Finding]()
        if self.turn.refuted:
            own, error, by = (
                math.degrees(abs(x)) for x in (self.turn.own, self.turn.own_error, self.turn.correction)
            )
            side = "left" if self.turn.own > 0.0 else "right"
            text = (
                f"The IMU is mounted turned about the vertical: the wheels are turned to the {side} by {own:.2f} +- "
                f"{error:.2f} degrees against it, and positions would be turned by as much. The robot found has all "
                f"azimuths turned by {by:.2f} degrees."
            )
            findings.append(warning("geometry", text))
        if self.radius.refuted:
            size = "larger" if self.radius.own > 0.0 else "smaller"
            text = (
                f"By the ball's acceleration wheels.radius is {100.0 * abs(self.radius.own):.1f} +- "
                f"{100.0 * self.radius.own_error:.1f} % {size} than in the robot file, and distances are too. The "
                f"robot found has {digits(robot.wheels.radius)} m."
            )
            findings.append(warning("geometry", text))
        return findings


def _gain(motion: RollingMotion, robot: Robot) -> tuple[Floats, Floats]:
    """Return the logarithm of the gain's size and its angle, and their standard errors from the logs."""
    found, covariance = motion.solved(robot)
    (re, im), square = found[:2], float(found[:2] @ found[:2])
    slopes = np.array([[re, im], [-im, re]]) / square
    errors = np.sqrt((slopes @ covariance[:2, :2] @ slopes.T).diagonal())
    return np.array([0.5 * np.log(square), np.arctan2(im, re)]), errors
