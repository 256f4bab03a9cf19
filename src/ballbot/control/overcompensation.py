"""Overcompensation: compensation that exceeds the friction injects energy. It is measured, refused and avoided.

At wheel speed w, with the feedback in the direction of motion, the compensation is at most

    k(w) = b w + (c + s exp(-(w/v_s)^delta)) ramp(w),       w > 0

by the assumed friction (`ballbot.control.parts.compensation`), and the true friction is tau(w). A wheel that turns
steadily at w accelerates if k(w) > tau(w). Delay and gear play reduce the compensation; the check ignores both and is
conservative. Partial compensation counts as full, and rolling friction has a fraction of its own.

Friction that is safe to compensate (`cautious_friction`) does not exceed a lower confidence bound. With 95 %
confidence (z = 1.64), wheel i's curve is at least

    tau(w) - z sigma(w) - u(w),      sigma^2 = g^T P g,   g = d tau / d (b, c, s, v_s, delta, d, e)

at every speed, and in both directions if the friction depends on direction. (Single parameters are far less certain
than the curve: b, c and s are strongly correlated.) The compensation scales b by one factor and the dry part by
another: the pair that stays below this bound and has the largest mean fraction of tau. C_rr and the load term mu have
bounds of their own, mu - z sigma_mu. A parameter's variance decides how it enters:

- finite: in P, with its correlations;
- infinite or NaN, of a parameter that the logs do not separate or that is at a bound: in u, the distance down to the
  lowest curve over the parameter's likelihood interval or, without one, its range.;
- zero, of a parameter that the friction law fixes or a user states without an error: the stated value is exact.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.control.controller import Controller
from ballbot.errors import InputError
from ballbot.mechanics.friction import wheel_friction
from ballbot.results import reported
from ballbot.robot import Friction, Robot
from ballbot.robot.components import BY_NAME, deviation_labels, scaled_friction
from ballbot.robot.parameters import Value, numbers_of

#: the normal quantile of one-sided 95 % confidence
_Z = 1.6448536269514722
#: speeds of a wheel over which the curve is evaluated [rad/s]; below the first it is the break-away torque's
_CONFIDENCE_SPEEDS = np.geomspace(0.02, 8.0, 60)
#: fractions of b that are tried
_VISCOUS_SHARES = np.linspace(0.0, 1.0, 201)[:, None]
#: step of the central differences, over each parameter (over 1 if it is zero)
_DIFFERENCE_STEP = 1e-5


def cautious_friction(
    friction: Friction,
    covariance: ArrayLike,
    *,
    intervals: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Friction:
    """Return the largest scaled friction that the true friction exceeds with 95 % confidence, at each speed by itself.

    The covariance, SI units, is of b, c, s of each wheel, v_s, delta and C_rr in this order, then of d, e and mu of
    each wheel and the parameters of a registered law; parameters without a row are exact. `intervals` are likelihood
    intervals of parameters of infinite variance, by label, as "friction.stribeck[2]".
    """
    n = len(friction.coulomb)
    labels, values = zip(*_numbers(friction).items(), strict=True)
    values = np.array(values)
    P = np.asarray(covariance, dtype=np.float64)
    P = np.pad(P, (0, len(labels) - len(P)))
    unknown = ~np.isfinite(P.diagonal())
    P[unknown], P[:, unknown] = 0.0, 0.0
    ends = {
        index: intervals.get(label) or BY_NAME[label.partition("[")[0]].usual
        for index, label in enumerate(labels)
        if unknown[index]
    }
    directions = (1.0,) if friction.is_plain else (1.0, -1.0)
    speeds = np.tile(_CONFIDENCE_SPEEDS, len(directions))

    def curves(values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each wheel's friction against its motion, (k, n), first of one direction of turning."""
        changed = _with_numbers(friction, dict(zip(labels, values.tolist(), strict=True)))
        return np.concatenate([_curve(changed, direction, _CONFIDENCE_SPEEDS) for direction in directions])

    curve = lowest = curves(values)
    steps = np.diag(_DIFFERENCE_STEP * np.where(values == 0.0, 1.0, np.abs(values)))
    changes = np.array([curves(values + step) - curves(values - step) for step in steps])
    g = changes / (2.0 * steps.diagonal()[:, None, None])
    sigma = np.sqrt(np.maximum(np.einsum("ikn,ij,jkn->kn", g, P, g), 0.0))
    # at each speed the curve is monotonic in each parameter, so its minimum over a box is at a corner
    for wheel in range(n):
        own = [index for index in ends if _is_of(wheel, labels[index])]
        for corner in itertools.product(*(ends[index] for index in own)):
            moved = values.copy()
            moved[own] = corner
            lowest = np.where(np.arange(n) == wheel, np.minimum(lowest, curves(moved)), lowest)
    bound = np.maximum(lowest - _Z * sigma, 0.0)
    shares = [_certain_shares(values[wheel] * speeds, curve[:, wheel], bound[:, wheel]) for wheel in range(n)]
    least = values - _Z * np.sqrt(P.diagonal())  # of each parameter by itself
    for index, (low, _) in ends.items():
        least[index] = min(low, least[index])
    least = np.maximum(least, 0.0)
    cautious = replace(
        scaled_friction(friction, [dry for _, dry in shares], rolling_factor=1.0),
        viscous=tuple(share * b for (share, _), b in zip(shares, friction.viscous, strict=True)),
        rolling=float(least[labels.index("friction.rolling")]),
    )
    if not friction.load:
        return cautious
    first = labels.index("friction.load[0]")
    return replace(cautious, load=tuple(np.minimum(cautious.load, least[first : first + n]).tolist()))


#: the friction's parameters, in the order of a covariance; of one number each or one a wheel
_NAMES = (
    *("viscous", "coulomb", "stribeck", "stribeck_speed", "stribeck_exponent", "rolling"),
    *("coulomb_asymmetry", "stribeck_asymmetry", "load"),
)


def _numbers(friction: Friction) -> dict[str, float]:
    """Return the friction's numbers by label: those of `_NAMES`, then those of its law's own."""
    none = (0.0,) * len(friction.coulomb)
    named = {f"friction.{name}": getattr(friction, name) for name in _NAMES}
    named |= {f"friction.own.{name}": value for name, value in friction.own}
    return {
        f"{name}[{wheel}]" if BY_NAME[name].shape == "list" else name: number
        for name, value in named.items()
        for wheel, number in enumerate(numbers_of(none if value == () else value))
    }


def _with_numbers(friction: Friction, numbers: Mapping[str, float]) -> Friction:
    """Return a friction with other numbers, by the labels of `_numbers`."""
    values: dict[str, Value] = {}
    for label, number in numbers.items():
        name = label.partition("[")[0]
        if BY_NAME[name].shape == "list":
            number = (*numbers_of(values.get(name, ())), number)
        values[name] = number
    own = tuple((name, values[f"friction.own.{name}"]) for name, _ in friction.own)
    return replace(friction, **{name: values[f"friction.{name}"] for name in _NAMES}, own=own)


def _is_of(wheel: int, label: str) -> bool:
    """Return whether a wheel's curve without load depends on a parameter."""
    name, _, index = label.partition("[")
    return name not in ("friction.rolling", "friction.load") and index in ("", f"{wheel}]")


def _certain_shares(
    viscous: NDArray[np.float64], curve: NDArray[np.float64], least: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the shares of a wheel's viscous part and of the rest of its curve (k,) that stay below a bound (k,)."""
    if (least >= curve).all():
        return 1.0, 1.0
    dry, left = curve - viscous, least - _VISCOUS_SHARES * viscous
    with np.errstate(divide="ignore", invalid="ignore"):
        of_dry = np.clip(
            np.where(dry > 0.0, left / dry, np.where(left >= 0.0, 1.0, -1.0)).min(axis=1), -1.0, 1.0
        )
    given = np.mean(
        (_VISCOUS_SHARES * viscous + of_dry[:, None] * dry) / np.where(curve > 0.0, curve, np.inf), axis=1
    )
    given[of_dry < 0.0] = -1.0  # this share of b alone exceeds the lower bound somewhere
    best = int(given.argmax())
    return float(_VISCOUS_SHARES[best, 0]), float(of_dry[best])


def stated_covariance(robot: Robot) -> NDArray[np.float64] | None:
    """Return the covariance of the friction in a robot's file as `cautious_friction` takes it, None without deviations.

    A variance is zero if the file states no deviation of that parameter, and infinite if it states that it is unknown.
    """
    covariance = _stated(robot, [*_numbers(robot.friction)])
    return covariance if covariance.any() else None


def _stated(robot: Robot, labels: list[str]) -> NDArray[np.float64]:
    stated = {label: size for label, *_, size in deviation_labels(robot.standard_deviations)}
    sizes = np.array([stated.get(label, 0.0) for label in labels])
    covariance = np.diag(sizes**2)
    known = robot.correlation.among(labels)
    at = [labels.index(label) for label in known.of]
    covariance[np.ix_(at, at)] = known.matrix() * np.outer(sizes[at], sizes[at])
    return covariance


def _commanded_covariance(robot: Robot) -> NDArray[np.float64]:
    """Return the covariance of the friction over the factor by which the motors' torques are those commanded.

    Whatever that factor is, a torque is compensated by what was commanded against it in the logs.
    """
    numbers, torque = _numbers(robot.friction), "drive.torque_constant"
    joint = _stated(robot, [*numbers, torque])
    scaled = [name == "friction.rolling" or "N m" in BY_NAME[name.partition("[")[0]].unit for name in numbers]
    slope = np.where(scaled, [*numbers.values()], 0.0) / robot.drive.torque_constant
    shared = np.outer(slope, joint[-1, :-1])
    return joint[:-1, :-1] - shared - shared.T + joint[-1, -1] * np.outer(slope, slope)


#: speeds of a wheel at which the fractions are computed [rad/s]
_SPEEDS = np.geomspace(0.02, 8.0, 120)
#: excess of a fraction that is ignored: rounding, and negligible energy
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, kw_only=True)
class CompensationMargin:
    """The compensated fraction of a friction; infinite if that friction is zero."""

    wheel_fractions: tuple[float, ...]  #: of each wheel's friction, at the speed where it is largest
    at_speeds: tuple[float, ...]  #: that speed [rad/s]
    rolling_fraction: float  #: of the rolling friction

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
        """A clause: where the compensation exceeds the friction most, or that it does not."""
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
    """Return the fraction of a friction, true or certain, that a controller compensates."""
    n = len(controller.gain)
    plain = controller.robot.friction.is_plain and friction.is_plain
    directions = (1.0,) if plain else (1.0, -1.0)
    signed = np.concatenate([direction * _SPEEDS for direction in directions])
    given = np.concatenate([_given(controller, direction) for direction in directions])
    taken = np.concatenate([_curve(friction, direction) for direction in directions])
    ratio = _ratio(given, taken)
    worst = ratio.argmax(axis=0)
    on = controller.compensation != "none"
    rolling = np.array(controller.robot.friction.rolling if on else 0.0)
    return CompensationMargin(
        wheel_fractions=tuple(ratio[worst, np.arange(n)].tolist()),
        at_speeds=tuple(signed[worst].tolist()),
        rolling_fraction=float(_ratio(rolling, np.array(friction.rolling))),
    )


def _given(controller: Controller, direction: float) -> NDArray[np.float64]:
    """Return the largest compensation of each wheel along its motion without load, at `_SPEEDS`, (k, n) [N m]."""
    friction = controller.robot.friction
    if controller.compensation == "none":
        return np.zeros((len(_SPEEDS), len(controller.gain)))
    ramp = np.minimum(1.0, _SPEEDS / controller.speed_band)[:, None]
    viscous = _SPEEDS[:, None] * np.asarray(friction.viscous)
    return viscous + (_curve(friction, direction) - viscous) * ramp


def certain_friction(robot: Robot) -> Friction:
    """Return the friction of a robot's file, or its lower confidence bound if the file has standard deviations."""
    if stated_covariance(robot) is None:
        return robot.friction
    return cautious_friction(robot.friction, _commanded_covariance(robot), intervals=robot.intervals)


def refuse_overcompensation(controller: Controller, friction: Friction) -> None:
    """Raise InputError if a controller compensates more than this friction and can inject energy."""
    margin = compensation_margin(controller, friction)
    if margin.overcompensates:
        raise InputError(
            f"{margin.sentence[0].upper()}{margin.sentence[1:]}; the excess injects energy and can "
            f"destabilise the robot. Multiply the compensation by {1.0 / margin.largest:.2g} or less, or "
            "continue with --allow-overcompensation."
        )


def overcompensation_warning(controller: Controller, robot: Robot) -> str | None:
    """Return a sentence if a controller compensates more than is certain of a described robot's friction, else None."""
    if not has_friction(robot.friction):
        return None
    margin = compensation_margin(controller, certain_friction(robot))
    if not margin.overcompensates:
        return None
    return (
        f"More friction is compensated than is certain: {margin.sentence}; the excess injects energy and can "
        "destabilise the robot."
    )


def has_friction(friction: Friction) -> bool:
    """Return whether any friction is given; the friction of a robot file without friction is unknown."""
    return any((*friction.viscous, friction.rolling, *friction.breakaway))


def _curve(
    friction: Friction, direction: float, speeds: NDArray[np.float64] = _SPEEDS
) -> NDArray[np.float64]:
    """Return the friction (k, n) against a direction of turning at speeds (k,), without load."""
    turning = np.repeat(direction * speeds[:, None], len(friction.coulomb), axis=1)
    return direction * wheel_friction(turning, friction)


def _ratio(given: NDArray[np.float64], taken: NDArray[np.float64]) -> NDArray[np.float64]:
    known = taken > 0.0
    unknown = np.where(given > 0.0, np.inf, 0.0)
    return np.where(known, given / np.where(known, taken, 1.0), unknown)


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return "an infinite share"
    # an excess is shown, however small
    return f"{100.0 * share:.{1 if 1.0 + _NEGLIGIBLE < share < 1.01 else 0}f} %"
