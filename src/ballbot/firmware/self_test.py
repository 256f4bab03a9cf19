"""The numbers of the firmware's self-test: how hard, how long and how far it pushes each wheel of a robot.

The robot is held upright on its ball. The torque rises until the wheel has turned far enough, and the same push follows
backward, so that the wheel comes to rest where friction lets it. The wheel that is pushed must turn the most; through
the ball the others turn with it, by up to 0.94 of its turn (preset cmu).
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ballbot.control.safety import UNKNOWN_FRICTION
from ballbot.errors import InputError
from ballbot.mechanics.held_ball import wheel_mobility
from ballbot.records import number, whole
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

#: least turn of a wheel that counts [rad]: 3 mm of a wheel of 60 mm, more than the hand that holds it moves meanwhile
_LEAST_TURN = 0.05
#: time in which the torque rises, longest one [s]: a hand follows a slower push
_RAMP, _LONGEST_RAMP = 0.1, 0.5
#: ratio to the known friction, for what the file does not have exactly
_MARGIN = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class SelfTestRecord:
    """A push of the self-test."""

    #: to which the push rises
    torque: float = field(metadata=number("N m"))
    #: samples in which it does, and then again of its longest duration
    ramp: int = field(metadata=whole())
    #: of the wheel that turns most, at which the push ends
    counts: int = field(metadata=whole())


def self_test_record(robot: Robot, *, sample_time: float) -> SelfTestRecord:
    """Return the self-test of a robot, whose controller has a sample time [s].

    The controller's torque limit may be lower: it guards the grip, and a wheel that slips turns its encoder as well.

    InputError if the motors cannot move a wheel far enough for its encoder.
    """
    mobility = wheel_mobility(robot)
    own = mobility.diagonal()
    turned = np.abs(mobility) / own  # wheel i over wheel j, which is pushed
    others = float((turned - np.eye(len(own))).max())
    # a count less or more of either wheel leaves the pushed one ahead
    counts = math.ceil(max(_LEAST_TURN / encoder_step(robot), 1.0 + 2.0 / (1.0 - others)))
    turn = (counts + 1) * encoder_step(robot)
    motors, breakaway = robot.drive.torque_limit, np.array(robot.friction.breakaway)
    friction = float((breakaway @ turned).max())  # through the ball, that of all wheels
    # a file's friction may be another robot's, and a push ends as soon as its wheel has turned
    unsure = max(_MARGIN * friction, UNKNOWN_FRICTION * motors * float(turned.sum(axis=0).max()))
    inertial = 2.0 * turn / (float(own.min()) * _RAMP**2)
    torque = min(motors, unsure + inertial)
    spare = max(torque - friction, 1e-9 * motors)
    ramp = max(_RAMP, math.sqrt(2.0 * turn / (float(own.min()) * spare)))
    if ramp > _LONGEST_RAMP:
        raise InputError(
            f"The self-test cannot move a wheel of {robot.name} by the {counts} counts that it needs: the motors give "
            f"{motors:.3g} N m, and the friction of all wheels holds it with {friction:.3g} N m."
        )
    return SelfTestRecord(torque=torque, ramp=math.ceil(ramp / sample_time - 1e-9), counts=counts)
