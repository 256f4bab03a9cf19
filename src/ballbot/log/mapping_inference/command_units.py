"""What the commands are: torques, currents, voltages or duties, and in which unit.

The kind follows from gain a and damping b / a (`ballbot.log.mapping_inference.commands`). With the robot's data, a
torque has a = 1 and b / a = the viscous friction; a current a = 1 / (n k_t) and the same b / a; a duty a = R / (n k_t
V) and in b / a the back-EMF, too, n^2 k_t k_e / R. a comes from gravity's part of the need as an instrument: the need
is differentiated, and its noise would make a too small. Names, sizes and whole numbers add to the evidence; every kind
with every unit and full scale has a weight, and the weights together are the confidence.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.commands import Response
from ballbot.log.mapping_inference.evidence import normal_log_weight, probabilities
from ballbot.log.mapping_inference.names import InputKind
from ballbot.log.mapping_inference.stall import back_emf_damping, damping_log_weight, with_other_motors
from ballbot.robot import Robot

#: largest numbers that drivers and libraries call full duty
FULL_DUTIES = (1.0, 100.0, 127.0, 255.0, 400.0, 1000.0, 1023.0, 4095.0, 32639.0, 32767.0, 65535.0)


@dataclass(frozen=True)
class Unit:
    """A kind of command with its unit: what one of the file's numbers is."""

    kind: InputKind
    unit: str  #: "N m", "N m of the motor", "A", "V", ..; of a duty "full scale 255"
    scale: float  #: into N m, A, V or a duty of 1

    @property
    def description(self) -> str:
        """The kind and its unit, in words."""
        return f"{self.kind} in {self.unit}" if self.kind != "duty" else f"duty of {self.unit}"


#: a torque before the gear, which gears beyond this ratio change
OF_THE_MOTOR, LEAST_GEAR = " of the motor", 1.5


def units_of(robot: Robot, full_duties: Iterable[float] | None = None) -> dict[Unit, float]:
    """Return the units that a command may have, with the torque [N m] at standstill of one in the file.

    Duties may have other full scales than `FULL_DUTIES`.
    """
    drive = robot.drive
    per_ampere = drive.gear_ratio * drive.torque_constant
    found = {
        Unit("torque", "N m", 1.0): 1.0,
        Unit("torque", "mN m", 1e-3): 1e-3,
        Unit("torque", "N cm", 1e-2): 1e-2,
        Unit("current", "A", 1.0): per_ampere,
        Unit("current", "mA", 1e-3): 1e-3 * per_ampere,
        Unit("voltage", "V", 1.0): drive.torque_limit / drive.supply_voltage,
        Unit("voltage", "mV", 1e-3): 1e-3 * drive.torque_limit / drive.supply_voltage,
    }
    if drive.gear_ratio > LEAST_GEAR:
        for unit, scale in (("N m", drive.gear_ratio), ("mN m", 1e-3 * drive.gear_ratio)):
            found[Unit("torque", unit + OF_THE_MOTOR, scale)] = scale
    for full in FULL_DUTIES if full_duties is None else full_duties:
        found[Unit("duty", f"full scale {full:g}", 1.0 / full)] = drive.torque_limit / full
    return found


#: before names and numbers are seen
_PRIOR: dict[InputKind, float] = {"duty": 0.5, "torque": 0.3, "current": 0.15, "voltage": 0.05}
_RARE_UNITS = {
    "N cm": 0.05,
    "mN m": 0.3,
    "mA": 0.3,
    "mV": 0.2,
    f"N m{OF_THE_MOTOR}": 0.1,
    f"mN m{OF_THE_MOTOR}": 0.1,
}
_RARE_DUTIES = {127.0: 0.15, 400.0: 0.15, 1023.0: 0.5, 4095.0: 0.3, 32639.0: 0.1, 32767.0: 0.3, 65535.0: 0.2}
#: how much rarer than duties torques, currents and voltages are whose zero is another number; chosen
_OTHER_WITH_ZERO = 0.05
#: a name that says the kind, or the unit, is believed so much; where it is wrong of one, so often of the other, too
#: (mA under a name in N m; 0.02 took them for mN m, 16 % off). Both chosen
_NAMED, _WRONG_TOO = 0.98, 0.3
#: what the robot file gives a gain to [log]: masses for a torque, the torque constant as well for a current, and the
#: torque at standstill for a duty or voltage
_GAIN_DEVIATION: dict[InputKind, float] = {"torque": 0.13, "current": 0.16, "duty": 0.2, "voltage": 0.2}
#: of wheels that turn free, whose inertia hardly anyone knows
_FREE_DEVIATION = 1.5
#: friction that the terms do not contain makes the gain too large by this [log]: mean of 115 logs of the development
#: halves, whose standard deviation is 0.09 for torques and currents
GAIN_BIAS = 0.07


def unit_probabilities(
    robot: Robot,
    found: Response | None,
    commands: NDArray[np.float64],
    *,
    named_kind: InputKind | None,
    named_unit: str | None,
    known_inertia: bool = True,
    full_duties: Mapping[float, float] | None = None,
) -> dict[Unit, float]:
    """Return the probability of each kind and unit, the likeliest first.

    Parameters
    ----------
    robot : Robot
    found : Response, optional
        None if the log does not show how the wheels respond.
    commands : ndarray (N, n)
        As the file has them.
    named_kind, named_unit : str, optional
        What the columns' names have.
    known_inertia : bool
        Whether what the wheels need is that of a whole robot. Wheels that turn free have an inertia that no one knows
        well, so that the gain shows little, and the command that a speed needs instead.
    full_duties : mapping of float to float, optional
        The full scales that a duty about a zero of its own may have, with their weights by use.
    """
    weights = {}
    for unit, per_number in units_of(robot, full_duties).items():
        weight = math.log(_prior(unit, named_kind, named_unit, full_duties)) + _size_weight(
            unit, per_number, commands, robot
        )
        if found is not None and math.isfinite(found.gain) and found.gain_error < 0.5:
            off = math.log(found.gain * per_number)
            weight += _fits(unit, off, found, robot, named_kind=named_kind, known_inertia=known_inertia)
        weights[unit] = weight
    return probabilities(weights)


#: standard deviations by which a gain contradicts a unit; at 4 the robot file of one with three quarters of the body's
#: mass went through
_CONTRADICTED = 2.5


def contradicting_factor(
    unit: Unit, per_number: float, found: Response | None, *, known_inertia: bool
) -> float | None:
    """Return how many times as large as the motion needs the commands of a unit are; None if that is no contradiction.

    Parameters
    ----------
    unit : Unit
    per_number : float
        Torque [N m] at standstill of one in the file.
    found : Response, optional
    known_inertia : bool
        As `unit_probabilities` takes it.
    """
    if found is None or not math.isfinite(found.gain) or not known_inertia:
        return None
    off = math.log(found.gain * per_number) - GAIN_BIAS
    deviation = math.hypot(_GAIN_DEVIATION[unit.kind], found.gain_error)
    return math.exp(off) if abs(off) > _CONTRADICTED * deviation else None


#: largest whole number of torques, currents and voltages with too few steps for a driver; chosen
_COARSE = 100.0


def _prior(
    unit: Unit,
    named_kind: InputKind | None,
    named_unit: str | None,
    full_duties: Mapping[float, float] | None,
) -> float:
    prior = _PRIOR[unit.kind] * _RARE_UNITS.get(unit.unit, 1.0)
    if full_duties is not None:
        near = min(full_duties, key=lambda full: abs(full * unit.scale - 1.0))
        prior *= full_duties[near] if unit.kind == "duty" else _OTHER_WITH_ZERO
    elif unit.kind == "duty":
        prior *= _RARE_DUTIES.get(round(1.0 / unit.scale), 1.0)
    own_unit = "%" if unit.kind == "duty" and unit.scale == 0.01 else unit.unit.removesuffix(OF_THE_MOTOR)
    wrong_kind = named_kind is not None and unit.kind != named_kind
    wrong_unit = named_unit is not None and own_unit != named_unit
    if wrong_kind or wrong_unit:
        return prior * (1.0 - _NAMED) * (_WRONG_TOO if wrong_kind and wrong_unit else 1.0)
    return prior * _NAMED


def _size_weight(unit: Unit, per_number: float, commands: NDArray[np.float64], robot: Robot) -> float:
    """Return the logarithm of how well the size of the commands fits a unit."""
    known = np.abs(commands[np.isfinite(commands)])
    largest = float(known.max(initial=0.0))
    if unit.kind != "duty":
        share = largest * per_number / robot.drive.torque_limit
        coarse = largest < _COARSE and bool(np.all(known == np.round(known)))
        # beyond the limit: possible of a command that is limited later
        beyond = -2.0 * max(math.log(max(share, 1e-12) / 1.5), 0.0)
        return beyond + _too_small(share) + (math.log(0.3) if coarse else 0.0)
    full = 1.0 / unit.scale
    if largest > 1.1 * full:
        return -20.0
    whole = bool(np.all(known == np.round(known)))
    weight = _too_small(largest / full)
    if full == 1.0:
        weight += -20.0 if whole and largest > 0.0 else 0.0
    else:
        # firmware that counts to 255 has whole numbers
        weight += math.log(0.3 if whole else 0.15 if full == 100.0 else 0.03)
    # limited there, and does not just pass it
    at_full = int(np.sum(known == full)) if largest == full else 0
    return weight + (4.0 if at_full >= 3 and full > 1.0 else 0.0)


def _too_small(share: float) -> float:
    """Return the logarithm of how usual it is that commands use no more than this share of the range."""
    return math.log(1.0 if share > 0.05 else 0.4 if share > 0.01 else 0.02)


def _fits(
    unit: Unit,
    off: float,
    found: Response,
    robot: Robot,
    *,
    named_kind: InputKind | None,
    known_inertia: bool,
) -> float:
    """Return the logarithm of how well damping and a gain that is `off` by so much [log] fit a unit."""
    own = _GAIN_DEVIATION[unit.kind] if known_inertia else _FREE_DEVIATION
    deviation = math.hypot(own, found.gain_error)
    driven = unit.kind in ("duty", "voltage")
    emf = back_emf_damping(robot) if driven else 0.0
    # of wheels that turn free, the torque that a speed needs, by this unit
    factor = 1.0 if known_inertia else math.exp(off)
    damping = (factor * found.damping, factor * found.damping_error)
    weight = normal_log_weight(off - GAIN_BIAS, deviation, outlier=1e-4) - math.log(deviation)
    weight += damping_log_weight(*damping, robot, emf=emf)
    # a name of another kind, and other motors as well, would be two doubts at once
    if not (driven and known_inertia and named_kind in (None, unit.kind)):
        return weight
    return with_other_motors(weight, off - GAIN_BIAS, deviation, damping, robot)
