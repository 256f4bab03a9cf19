"""Overcompensation: compensation that exceeds the friction injects energy. Measure it, refuse it, avoid it.

At wheel speed w the compensation gives at most (`ballbot.control.parts.compensation`, the feedback pushing along)

    k(w) = b w + (c + s exp(-(w/v_s)^delta)) ramp(w),       w > 0

of the friction that it assumes, and friction takes tau(w) of its own. A wheel that turns
steadily at w is driven faster where k(w) > tau(w). A wheel that swings, w = A sin(phi), is given <k(w) w> and loses
<tau(w) w>, means over a swing [W]: the describing function's view, in which the compensation injects energy where it
gives more. A late torque gives less, not more (what it pushes after the wheel has turned round, it takes), and gear
play gives none: the check leaves out both and is on the safe side. Partial compensation counts as full where it
works, and rolling friction has a fraction of its own.

A friction that is safe to compensate (`cautious_friction`) is no more than what is certain of it. Identification
gives a covariance; at a confidence level with the normal quantile z, wheel i's curve is at least

    tau(w) - z sigma(w),      sigma^2 = g^T P g,   g = d tau / d (b, c, s, v_s, delta, d, e)

and the wheel's torques are scaled by the least ratio of that to tau over the speeds, and over both directions if the
friction has terms by direction, so that the curve keeps its shape. b, c and s by themselves are known far worse than
the curve: they trade against each other. C_rr and the load term mu have bounds of their own, mu - z sigma_mu.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ballbot.control.controller import Controller
from ballbot.errors import InputError
from ballbot.mechanics.friction import friction_terms, stribeck_decay, wheel_friction
from ballbot.results import reported
from ballbot.robot import Friction, Robot
from ballbot.robot.components import scaled_friction

#: speeds of a wheel over which the curve is evaluated [rad/s]; below the first it is the break-away torque's
_CONFIDENCE_SPEEDS = np.geomspace(0.02, 8.0, 60)
#: step of the central differences, over each parameter (over 1 if it is zero)
_DIFFERENCE_STEP = 1e-5


def cautious_friction(friction: Friction, covariance: ArrayLike, *, confidence: float = 0.95) -> Friction:
    """Return the friction scaled down to what it exceeds with that confidence.

    Parameters
    ----------
    friction : Friction
        As identified, n wheels.
    covariance : array_like (3 n + 3, 3 n + 3) or (6 n + 3, 6 n + 3)
        Of b, c, s of each wheel, v_s, delta and C_rr in this order, and perhaps d, e and mu of each wheel, SI units. A
        row and column of NaN is of a parameter without standard error, which counts as certain; so do d, e and mu
        without rows.
    confidence : float
        One-sided, for each wheel's curve and for the rolling friction.

    Returns
    -------
    Friction
        Each wheel's torques times a number from 0 to 1, and so C_rr; v_s and delta unchanged.

    Raises
    ------
    InputError
        If the covariance's shape is wrong, or the confidence is not from 0.5 to 1.
    """
    n = len(friction.coulomb)
    P = np.nan_to_num(np.asarray(covariance, dtype=np.float64))
    if P.shape not in ((3 * n + 3, 3 * n + 3), (6 * n + 3, 6 * n + 3)):
        raise InputError(
            f"The covariance of the friction has the shape {P.shape}; {n} wheels have {3 * n + 3} parameters, and "
            f"{6 * n + 3} with the terms by direction and by load."
        )
    P = np.pad(P, (0, 6 * n + 3 - len(P)))
    if not 0.5 <= confidence < 1.0:
        raise InputError(f"The confidence is {confidence:g}; it must be at least 0.5 and below 1.")
    z = float(scipy.stats.norm.ppf(confidence))
    fractions = [_certain_fraction(friction, wheel, P, z) for wheel in range(n)]
    C_rr = 3 * n + 2  # its place, after v_s and delta
    rolling_error = float(np.sqrt(P[C_rr, C_rr]))
    rolling = max(friction.rolling - z * rolling_error, 0.0)
    cautious = replace(scaled_friction(friction, fractions, rolling_factor=1.0), rolling=rolling)
    if not friction.load:
        return cautious
    least = np.maximum(np.asarray(friction.load) - z * np.sqrt(P.diagonal()[5 * n + 3 :]), 0.0)
    return replace(cautious, load=tuple(np.minimum(cautious.load, least).tolist()))


def stated_covariance(robot: Robot) -> NDArray[np.float64] | None:
    """Return the covariance (6 n + 3, 6 n + 3) of the friction in a robot's file, None if it states no deviations.

    It is of the joint errors if the file states them, else of its standard deviations. Where the file states no
    correlations, b, c and s count as independent; the result is then more cautious.
    """
    n = robot.wheel_count
    spans = {
        "viscous": n,
        "coulomb": n,
        "stribeck": n,
        "stribeck_speed": 1,
        "stribeck_exponent": 1,
        "rolling": 1,
        "coulomb_asymmetry": n,
        "stribeck_asymmetry": n,
        "load": n,
    }
    stated = robot.standard_deviations
    if not any(f"friction.{name}" in stated for name in spans):
        return None
    deviations = [
        np.broadcast_to(np.asarray(stated.get(f"friction.{name}", 0.0), dtype=np.float64), count)
        for name, count in spans.items()
    ]
    sizes = np.concatenate(deviations)
    covariance = np.diag(sizes**2)
    places = {
        f"friction.{name}[{wheel}]" if count == n else f"friction.{name}": first + wheel
        for (name, count), first in zip(spans.items(), np.cumsum([0, *spans.values()]).tolist(), strict=False)
        for wheel in range(count)
    }
    known = robot.correlation.among(places)
    if known.of:
        at = [places[label] for label in known.of]
        errors = np.asarray(known.standard_errors) if known.standard_errors else sizes[at]
        covariance[np.ix_(at, at)] = known.matrix() * np.outer(errors, errors)
    return covariance


def _certain_fraction(friction: Friction, wheel: int, P: NDArray[np.float64], z: float) -> float:
    """Return the least ratio of a wheel's lower bound to its curve over speeds and directions, from 0 to 1."""
    n, terms = len(friction.coulomb), friction_terms(friction)
    places = [wheel, n + wheel, 2 * n + wheel, 3 * n, 3 * n + 1]
    values = [friction.viscous[wheel], friction.coulomb[wheel], friction.stribeck[wheel]]
    values += [friction.stribeck_speed, friction.stribeck_exponent]
    if friction.is_plain:
        return _certain_fraction_in_direction(np.array(values), P[np.ix_(places, places)], z, 1.0)
    places += [3 * n + 3 + wheel, 4 * n + 3 + wheel]
    values += [terms.coulomb_asymmetry[wheel], terms.stribeck_asymmetry[wheel]]
    return min(
        _certain_fraction_in_direction(np.array(values), P[np.ix_(places, places)], z, direction)
        for direction in (1.0, -1.0)
    )


def _certain_fraction_in_direction(
    values: NDArray[np.float64], P: NDArray[np.float64], z: float, direction: float
) -> float:
    curve = _wheel_curve(values, direction)
    if not curve.min() > 0.0:
        return 1.0  # no friction was identified
    steps = _DIFFERENCE_STEP * np.where(values == 0.0, 1.0, np.abs(values))
    slopes = [
        (_wheel_curve(values + step, direction) - _wheel_curve(values - step, direction)) / (2.0 * step.max())
        for step in np.diag(steps)
    ]
    g = np.array(slopes)
    sigma = np.sqrt(np.maximum(np.einsum("ik,ij,jk->k", g, P, g), 0.0))
    return float(np.clip(1.0 - z * sigma / curve, 0.0, 1.0).min())


def _wheel_curve(values: NDArray[np.float64], direction: float) -> NDArray[np.float64]:
    """Return a wheel's friction against its motion at the speeds; `values` are b, c, s, v_s, delta, perhaps d, e."""
    b, c, s, v_s, delta = values[:5]
    if len(values) > 5:
        c, s = c + direction * values[5], s + direction * values[6]
    return b * _CONFIDENCE_SPEEDS + c + s * stribeck_decay(_CONFIDENCE_SPEEDS / v_s, delta)


#: amplitudes of a wheel's swing [rad/s]
AMPLITUDES = (0.1, 0.3, 1.0, 3.0)
#: speeds of a wheel at which the fractions are computed [rad/s]
_SPEEDS = np.geomspace(0.02, 8.0, 120)
#: phases of a quarter of a swing, the middles of equal parts: means to 1e-4
_PHASES = (np.arange(200) + 0.5) / 200 * 0.5 * np.pi
#: excess of a fraction that is ignored: what rounding adds, and no energy to speak of
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Swing:
    """The power of compensation and friction at one amplitude of the wheels' swing, a number for each wheel."""

    amplitude: float  #: of the speed [rad/s]
    given: tuple[float, ...]  #: by the compensation, at most, mean over a swing [W]
    taken: tuple[float, ...]  #: by the friction [W]

    @property
    def fraction(self) -> float:
        """The compensation's power over the friction's, of the wheel where it is largest."""
        return max(_fraction(given, taken) for given, taken in zip(self.given, self.taken, strict=True))


@dataclass(frozen=True, kw_only=True)
class CompensationMargin:
    """The compensated fraction of a friction; infinite if that friction is zero."""

    wheel_fractions: tuple[float, ...]  #: of each wheel's friction, at the speed where it is largest
    at_speeds: tuple[float, ...]  #: that speed [rad/s]
    rolling_fraction: float  #: of the rolling friction
    swings: tuple[Swing, ...]  #: at `AMPLITUDES`

    @property
    def largest(self) -> float:
        """The largest fraction of all."""
        return max(*self.wheel_fractions, self.rolling_fraction)

    @reported
    def overcompensates(self) -> bool:
        """Whether the compensation may inject energy."""
        return self.largest > 1.0 + _NEGLIGIBLE

    @property
    def sentence(self) -> str:
        """The place at which the compensation exceeds the friction most, or that it does not exceed it."""
        if not self.overcompensates:
            return f"the compensation is at most {_percent(self.largest)} of the friction"
        if self.rolling_fraction == self.largest:
            return f"the compensation of the rolling friction is {_percent(self.rolling_fraction)} of it"
        worst = int(np.argmax(self.wheel_fractions))
        return (
            f"the compensation of wheel {worst + 1} is {_percent(self.wheel_fractions[worst])} of its friction at "
            f"{self.at_speeds[worst]:.2g} rad/s"
        )


def compensation_margin(controller: Controller, friction: Friction) -> CompensationMargin:
    """Return which fraction of a friction a controller compensates.

    Parameters
    ----------
    controller : Controller
    friction : Friction
        The true one, of as many wheels: a robot file's, or what is certain of it (`certain_friction`).
    """
    n = len(controller.gain)
    directions = _directions(controller, friction)
    signed = np.concatenate([direction * _SPEEDS for direction in directions])
    given = np.concatenate([compensation_curve(controller, _SPEEDS, one) for one in directions])
    taken = np.concatenate([_curve(friction, _SPEEDS, one) for one in directions])
    ratio = _ratio(given, taken)
    worst = ratio.argmax(axis=0)
    on = controller.compensation != "none"
    rolling = _fraction(controller.robot.friction.rolling if on else 0.0, friction.rolling)
    return CompensationMargin(
        wheel_fractions=tuple(ratio[worst, np.arange(n)].tolist()),
        at_speeds=tuple(signed[worst].tolist()),
        rolling_fraction=rolling,
        swings=tuple(_swing(controller, friction, amplitude) for amplitude in AMPLITUDES),
    )


def _directions(controller: Controller, friction: Friction) -> tuple[float, ...]:
    """Return the directions of turning in which the compensation or the friction differ."""
    return (1.0,) if controller.robot.friction.is_plain and friction.is_plain else (1.0, -1.0)


def compensation_curve(
    controller: Controller, speeds: NDArray[np.float64], direction: float = 1.0
) -> NDArray[np.float64]:
    """Return the largest compensation of each wheel along its motion without load, (k, n) [N m].

    Parameters
    ----------
    controller : Controller
    speeds : ndarray (k,)
        Above zero [rad/s].
    direction : float
        1 for a wheel that turns forward, -1 for backward.
    """
    friction = controller.robot.friction
    if controller.compensation == "none":
        return np.zeros((len(speeds), len(controller.gain)))
    ramp = np.minimum(1.0, speeds / controller.speed_band)[:, None]
    viscous = speeds[:, None] * np.asarray(friction.viscous)
    dry = _curve(friction, speeds, direction) - viscous
    return viscous + dry * ramp


def certain_friction(robot: Robot) -> Friction:
    """Return the friction of a robot's file, or what is certain of it if the file has standard deviations."""
    covariance = stated_covariance(robot)
    return robot.friction if covariance is None else cautious_friction(robot.friction, covariance)


def refuse_overcompensation(controller: Controller, friction: Friction) -> None:
    """Raise InputError if a controller may inject energy.

    Raises
    ------
    InputError
        If it does, with the place and the size of the largest excess.
    """
    margin = compensation_margin(controller, friction)
    if margin.overcompensates:
        raise InputError(
            f"{margin.sentence[0].upper()}{margin.sentence[1:]}; the excess injects energy and can "
            f"destabilise the robot. Multiply the compensation by {1.0 / margin.largest:.2g} or less, or "
            "continue with --allow-overcompensation."
        )


def overcompensation_warning(controller: Controller, robot: Robot) -> str | None:
    """Return a sentence if a controller compensates more than is certain of a robot's friction, otherwise None.

    Parameters
    ----------
    controller : Controller
        As read from a file: its friction is the file's.
    robot : Robot
        As described. A robot without friction in its file has unknown friction.
    """
    if not has_friction(robot.friction):
        return None
    margin = compensation_margin(controller, certain_friction(robot))
    return (
        f"More friction is compensated than is certain: {margin.sentence}; the excess injects energy and can "
        "destabilise the robot."
        if margin.overcompensates
        else None
    )


def has_friction(friction: Friction) -> bool:
    """Return whether there is any; a robot file without friction has unknown friction."""
    return any((*friction.viscous, *friction.coulomb, *friction.stribeck, friction.rolling))


def _swing(controller: Controller, friction: Friction, amplitude: float) -> Swing:
    speeds = amplitude * np.sin(_PHASES)
    directions = _directions(controller, friction)
    given = np.mean(
        [(compensation_curve(controller, speeds, one) * speeds[:, None]).mean(axis=0) for one in directions],
        axis=0,
    )
    taken = np.mean(
        [(_curve(friction, speeds, one) * speeds[:, None]).mean(axis=0) for one in directions], axis=0
    )
    return Swing(amplitude=amplitude, given=tuple(given.tolist()), taken=tuple(taken.tolist()))


def _curve(friction: Friction, speeds: NDArray[np.float64], direction: float = 1.0) -> NDArray[np.float64]:
    """Return the friction (k, n) against a direction of turning at speeds (k,) > 0, without load."""
    turning = np.repeat(direction * speeds[:, None], len(friction.coulomb), axis=1)
    return direction * wheel_friction(turning, friction)


def _ratio(given: NDArray[np.float64], taken: NDArray[np.float64]) -> NDArray[np.float64]:
    known = taken > 0.0
    unknown = np.where(given > 0.0, np.inf, 0.0)
    return np.where(known, given / np.where(known, taken, 1.0), unknown)


def _fraction(given: float, taken: float) -> float:
    return float(_ratio(np.array(given), np.array(taken)))


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return "an infinite share"
    # an excess is shown, however small
    return f"{100.0 * share:.{1 if 1.0 + _NEGLIGIBLE < share < 1.01 else 0}f} %"
