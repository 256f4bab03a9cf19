"""What duties and voltages give at standstill, and what their motors' resistance is expected to be.

A robot file has a torque limit and no resistance. Full duty at standstill is taken to give that limit. Of a motor that
could do more than its robot asks of it, the resistance is less: its duties give more torque at standstill, and the
back-EMF brakes it more, both by the same factor.

The motion shows the resistance over the masses alone: gain and back-EMF change with either by the same factor, and the
viscous friction beside the back-EMF is not known. Whether it is asked for depends on the prior and on the error of the
masses.
"""

from __future__ import annotations

import math

from ballbot.log.mapping_inference.evidence import TINY, normal_log_weight
from ballbot.robot import Robot

#: prior probabilities that full duty gives more torque than the robot file's limit, as with many motors, and that it
#: gives less, so that the file is wrong; and the standard deviation of the resistance then [log]. All chosen: of 142
#: logs of duties of the development halves, 4 % are asked for the resistance though full duty gives the limit. With
#: motors of 1.26 times that torque 87 % would be, and with 0.79 times 76 %
STRONGER, WEAKER, OTHER_RESISTANCE = 0.1, 0.03, 0.3
GIVES_LIMIT = 1.0 - STRONGER - WEAKER
#: torque at standstill over the torque limit of the strongest motor that must be expected, and its inverse that of the
#: weakest: chosen. On the preset rob311 it is 1.3 by data sheets, and 0.38 by the motion of another robot of its kind
STRONGEST = 6.0
#: viscous friction and its deviation, over the torque limit [s/rad]; the medians of the development halves' robots are
#: 0.001 to 0.011
_VISCOUS, _VISCOUS_DEVIATION = 0.005, 0.006


def stall_resistance(robot: Robot) -> float:
    """Return the winding resistance [ohm] with which full duty at standstill gives the robot's torque limit."""
    drive = robot.drive
    return drive.gear_ratio * drive.torque_constant * drive.supply_voltage / drive.torque_limit


def back_emf_damping(robot: Robot) -> float:
    """Return n^2 k_t k_e / R [N m s/rad], with the resistance at which full duty gives the torque limit."""
    drive = robot.drive
    return drive.gear_ratio**2 * drive.torque_constant / drive.speed_constant / stall_resistance(robot)


def resistance_confidence(ratio: float, error: float) -> float:
    """Return the confidence that full duty at standstill gives the torque limit, by `DriveEvidence.torque_ratio`."""
    off, wider = math.log(ratio), math.hypot(error, OTHER_RESISTANCE)

    def density(deviation: float) -> float:
        return math.exp(-0.5 * (off / deviation) ** 2) / deviation

    # the sum of a normal error and a resistance on one side, half of a normal distribution
    weaker = 0.5 * math.erfc(-off * OTHER_RESISTANCE / (error * wider * math.sqrt(2.0)))
    other = 2.0 * (STRONGER * (1.0 - weaker) + WEAKER * weaker) * density(wider)
    assumed = GIVES_LIMIT * density(error)
    return assumed / max(assumed + other, TINY)


def damping_log_weight(damping: float, error: float, robot: Robot, *, emf: float) -> float:
    """Return the logarithm of how well a damping fits a back-EMF's [N m s/rad] and usual viscous friction."""
    if not math.isfinite(error):
        return 0.0
    limit = robot.drive.torque_limit
    deviation = math.sqrt(error**2 + (_VISCOUS_DEVIATION * limit) ** 2 + (0.3 * emf) ** 2)
    return normal_log_weight(damping - emf - _VISCOUS * limit, deviation, outlier=0.01)


def with_other_motors(
    weight: float, off: float, deviation: float, damping: tuple[float, float], robot: Robot
) -> float:
    """Return the logarithm of how well a duty or voltage fits the motion, of motors of any strength.

    Parameters
    ----------
    weight : float
        If full duty gives the torque limit.
    off, deviation : float
        Logarithm of that torque over the one that the motion needs, and its deviation. Less is a stronger motor, more
        a weaker one, up to `STRONGEST` and down to its inverse, each strength (its logarithm) as likely.
    damping : tuple of float
        As the motion shows it, and its standard error [N m s/rad].
    robot : Robot
    """
    most = math.log(STRONGEST)

    def below(bound: float) -> float:
        return 0.5 * math.erfc((off - bound) / (deviation * math.sqrt(2.0)))

    density = math.sqrt(2.0 * math.pi) / most
    stronger, weaker = (density * (below(high) - below(low)) for low, high in ((-most, 0.0), (0.0, most)))
    emf = back_emf_damping(robot) * math.exp(-min(max(off, -most), most))
    other = (STRONGER * stronger + WEAKER * weaker) * math.exp(damping_log_weight(*damping, robot, emf=emf))
    return math.log(GIVES_LIMIT * math.exp(weight) + other + TINY)
