"""The standard deviations, correlations and intervals in the file of an identified robot.

The robot's numbers y follow from the estimated parameters p. With the covariance C of p and the derivatives G = dy/dp,
the delta method gives the covariance G C G^T of y. A number that depends on a parameter without a standard error has
none either: its standard deviation is infinite, and its interval is the range of its values over that parameter's
interval or, without one, its bounds. A number that depends on no estimated parameter counts as exact.

Stages that estimate the same quantities may disagree, and differ from the file. With estimates x and y of k quantities
and their covariances, chi^2 = (x - y)^T (P_x + P_y)^-1 (x - y) is chi-squared distributed with k degrees of freedom if
both estimate the same values. A p-value below `LEAST_P_VALUE` gives a warning. Balancing is known to differ from freely
turning wheels (docs/generated/evidence.md, "Friction by the three stages"). Only b, c and C_rr are compared. s, v_s and
delta compensate for each other far beyond the range in which their errors are normally distributed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.special import chdtrc

from ballbot.arrays import Floats
from ballbot.control.overcompensation import stated_covariance
from ballbot.errors import InputError
from ballbot.findings import Finding, warning
from ballbot.fitting.intervals import HALF_WIDTH, Uncertainty
from ballbot.identification.quantities import BY_NAME as QUANTITIES
from ballbot.identification.quantities import FRICTION, Layout
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME, Correlation
from ballbot.robot.parameters import Value, value_of

_TORQUE = "drive.torque_constant"
#: finite difference for derivatives, in standard deviations
_STEP = 0.1
#: least relative change of a number that depends on a parameter
_UNCHANGED = 1e-12


def ends_without_error(uncertainty: Uncertainty) -> dict[int, tuple[float, float]]:
    """Return the interval, or else the bounds, of each estimated parameter without a standard error, by index."""
    space, ends = uncertainty.coordinates, dict[int, tuple[float, float]]()
    values, errors = space.physical(uncertainty.point), uncertainty.standard_errors
    for i in np.flatnonzero((space.upper > space.lower) & ~np.isfinite(errors)).tolist():
        known = uncertainty.intervals.get(space.labels[i])
        least, most, value = float(space.lower[i]), float(space.upper[i]), float(values[i])
        if known is not None:
            least, most = max(known.lower, least), min(known.upper, most)
        ends[i] = (min(least, value), max(most, value))
    return ends


def found_robot(
    robot: Robot,
    layout: Layout,
    uncertainty: Uncertainty,
    *,
    torque: tuple[float, Floats],
    log_count: int,
    asymmetric: bool = False,
) -> Robot:
    """Return the robot with friction and rigid body from an estimate; its sources state the standard errors.

    `torque` is the torque constant's deviation and its covariance with the scaled estimate (p,), both for the file:
    what is compensated is a friction in the torques that are commanded.

    Gains, offsets, delays and biases are only in the result: a robot file has no such numbers. With the laws
    "asymmetric" and "directed" the offsets are friction.
    """
    values, errors = uncertainty.coordinates.physical(uncertainty.point), uncertainty.standard_errors
    logs, sources = "1 log" if log_count == 1 else f"{log_count} logs", dict[str, str]()
    for name in layout.names:
        part = layout.part(name, errors)
        offset = asymmetric and name == "torque_offset"
        lines = ("friction.coulomb_asymmetry",) if offset else QUANTITIES[name].lines
        if part is not None and (name in FRICTION or np.isfinite(part).any()):
            numbers = ", ".join(f"{error:.2g}" if np.isfinite(error) else "none" for error in part)
            of = " of S_x, S_y, S_z" if name == "second_moment" else ""
            sources |= dict.fromkeys(lines, f"identified: from {logs}, standard error{of} {numbers}")

    def robot_of(parameters: Floats) -> Robot:
        found = layout.robot_of(robot, parameters[:-1], asymmetric=asymmetric)
        # a resistance without an error may be any that the ball does not overcome
        arm = (found if "friction.pivoting" in sources else robot).friction.pivoting
        return found.replace({_TORQUE: float(parameters[-1]), "friction.pivoting": arm})

    (deviation, scaled), space = torque, uncertainty.coordinates
    joint_values = np.array([*values, robot.drive.torque_constant])
    joint = np.pad(uncertainty.correlation * np.outer(errors, errors), (0, 1))
    joint[-1] = joint[:, -1] = [*(scaled * space.slopes(uncertainty.point))[space.first], deviation**2]
    return with_uncertainty(
        robot_of(joint_values).annotated(sources={**robot.sources, **sources}),
        robot_of,
        joint_values,
        joint,
        names=[*sources, *([_TORQUE] if deviation > 0.0 else [])],
        ends=ends_without_error(uncertainty),
    )


def with_uncertainty(
    robot: Robot,
    robot_of: Callable[[Floats], Robot],
    values: Floats,
    covariance: Floats,
    *,
    names: Collection[str],
    ends: Mapping[int, tuple[float, float]] = MappingProxyType({}),
) -> Robot:
    """Return the robot with standard deviations, correlations and intervals of its parameters `names`, dotted.

    `robot_of` returns the robot of estimated parameters (p,), SI units, and `robot` is that of `values`. `covariance`
    (p, p) is zero or NaN for parameters without a standard error, whose `ends` `ends_without_error` returns.
    """
    names = [name for name in BY_NAME if name in set(names) and value_of(robot, BY_NAME[name]) != ()]
    covariance, numbers = np.nan_to_num(covariance), _numbers(robot, names)

    def with_value(index: int, value: float) -> Floats | None:
        """Return the numbers with another value of one parameter; None if no robot has it."""
        moved = values.copy()
        moved[index] = value
        try:
            return _numbers(robot_of(moved), names)
        except InputError:
            return None

    G = np.zeros((len(numbers), len(values)))
    for index in np.flatnonzero(covariance.diagonal() > 0.0).tolist():
        step, value = _STEP * float(np.sqrt(covariance[index, index])), float(values[index])
        sides = [(by, at) for by in (step, -step) if (at := with_value(index, value + by)) is not None]
        sides += [(0.0, numbers)] * (len(sides) == 1)  # one-sided if no robot has the other value
        if sides:
            (ahead, high), (behind, low) = sides
            differs = np.abs(high - low) > _UNCHANGED * np.abs(high)
            G[:, index] = np.where(differs, (high - low) / (ahead - behind), 0.0)
    spread = G @ covariance @ G.T
    sizes = np.sqrt(np.maximum(spread.diagonal(), 0.0))
    at_ends = [with_value(index, end) for index, interval in ends.items() for end in interval]
    reached = np.stack([numbers, *(row for row in at_ends if row is not None)])
    least, most = reached.min(axis=0), reached.max(axis=0)
    unknown = most - least > _UNCHANGED * np.abs(numbers)
    least, most = least - HALF_WIDTH * sizes, most + HALF_WIDTH * sizes
    sizes[unknown] = np.inf
    stated, labels = dict[str, Value](), list[str]()
    for name in names:
        value, first = value_of(robot, BY_NAME[name]), len(labels)
        labels += [f"{name}[{i}]" for i in range(len(value))] if isinstance(value, tuple) else [name]
        rounded = tuple(float(f"{size:.4g}") for size in sizes[first : len(labels)])
        if any(size > 0.0 for size in rounded):
            stated[name] = rounded if isinstance(value, tuple) else rounded[0]
    intervals = {label: (float(least[i]), float(most[i])) for i, label in enumerate(labels) if unknown[i]}
    kept = np.flatnonzero((sizes > 0.0) & ~unknown)
    R = spread[np.ix_(kept, kept)] / np.outer(sizes[kept], sizes[kept])
    related = np.flatnonzero((np.abs(R - np.diag(R.diagonal())) > 5e-6).any(axis=1))
    return robot.annotated(
        standard_deviations={**robot.standard_deviations, **stated},
        intervals={**robot.intervals, **intervals},
        correlation=Correlation.of_matrix([labels[i] for i in kept[related]], R[np.ix_(related, related)]),
    )


def _numbers(robot: Robot, names: Collection[str]) -> Floats:
    """Return the numbers of these parameters, one after another."""
    values = [np.atleast_1d(np.asarray(value_of(robot, BY_NAME[name]), dtype=np.float64)) for name in names]
    return np.concatenate([np.empty(0), *values])


#: that of three standard deviations. At two, one comparison in twenty would be a false alarm, and one in nine if a
#: standard error is too small by a fifth, which is about how well it is known
LEAST_P_VALUE = 0.0027
#: symbols whose errors are close to normal
_COMPARED = ("b", "c", "C_rr")


@dataclass(frozen=True, eq=False)
class StageEstimate:
    """Estimates of k quantities by one stage."""

    source: str  #: the stage in words, as "the sweep"
    labels: tuple[str, ...]  #: (k,) "b1", "c1", ..., "C_rr"
    values: Floats  #: (k,), SI units
    covariance: Floats  #: (k, k); NaN, infinite or zero for a number without standard error

    def among(self, labels: list[str]) -> tuple[Floats, Floats]:
        """Return the estimates of these labels, in their order, and their covariance."""
        rows = [self.labels.index(label) for label in labels]
        return self.values[rows], self.covariance[np.ix_(rows, rows)]

    @property
    def errors(self) -> Floats:
        """Standard errors (k,)."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def known(self) -> list[str]:
        """Labels that have a standard error and are compared."""
        labels = np.array(self.labels)[(self.errors > 0.0) & np.isfinite(self.errors)].tolist()
        return [label for label in labels if label.rstrip("0123456789") in _COMPARED]


def agreement_findings(first: StageEstimate, second: StageEstimate) -> list[Finding]:
    """Return a warning if two stages differ by more than their errors in the quantities that both estimate."""
    both = [label for label in first.known if label in second.known]
    (x, P_x), (y, P_y) = first.among(both), second.among(both)
    covariance = P_x + P_y
    errors = np.sqrt(covariance.diagonal())
    deviations = (y - x) / errors
    inverse = np.linalg.pinv(covariance / np.outer(errors, errors), hermitian=True)
    chi_squared = float(deviations @ inverse @ deviations)
    if not both or chdtrc(len(both), chi_squared) > LEAST_P_VALUE:
        return []
    named = ", ".join(
        f"{both[i]} {x[i]:.3g} and {y[i]:.3g} ({abs(deviations[i]):.1f} standard errors)"
        for i in np.argsort(-np.abs(deviations))[:3]
    )
    text = (
        f"{first.source[0].upper()}{first.source[1:]} and {second.source} differ by more than their errors: {named}; "
        f"chi-squared {chi_squared:.3g} for {len(both)} values. A wrong torque scale changes all values by one factor; "
        "losses of rollers, ball and floor occur only in balancing, and raise its b and C_rr and lower its c. Use the "
        "values of the stage that matches the purpose: balancing for control, free wheels for motors and gears."
    )
    return [warning("methods-differ", text)]


def of_robot_file(robot: Robot) -> StageEstimate | None:
    """Return the friction in the robot's file, None if the file has no standard deviations of it."""
    covariance = stated_covariance(robot)
    if covariance is None:
        return None
    layout = Layout(wheel_count=robot.wheel_count)
    count = len(layout.labels)
    return StageEstimate("the robot file", layout.labels, layout.nominal(robot), covariance[:count, :count])


def file_findings(robot: Robot, estimate: StageEstimate) -> list[Finding]:
    """Return a warning if an estimate and the friction in the robot's file differ by more than their errors."""
    stated = of_robot_file(robot)
    return [] if stated is None else agreement_findings(stated, estimate)
