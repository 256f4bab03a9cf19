"""The standard deviations and correlations that an identified robot's file states.

The robot's numbers y follow from the parameters p that were estimated. With a covariance C of these and the derivatives
G = dy/dp, the delta method gives the numbers' covariance G C G^T. There are two of them:

- *Of each number.* The standard deviations contain the variation between logs where it was estimated. With the errors E
  under the logs' conditions, their correlation R and a part D for the variation, C = E R E + D. By itself, b, c or s
  of another log will be that far away.
- *Of all numbers together*, C = E R E: the standard errors and correlations. From log to log b, c, s, v_s and delta
  move along directions in which they make up for one another, far beyond the range in which the friction is linear in
  them. D would give the Coulomb equivalent a deviation of 20 to 60 %; over ten logs it varies by 3 to 5 %
  (`python -m campaigns.evidence coulomb_variation`), and by E R E of one such log it has an error of 3 to 5 %. So
  what uses the friction that the numbers give together uses this one: compensation, Monte Carlo, predictions. For
  C_rr no other number makes up, so that E has its deviation with the variation between logs.

A robot that is written and read again has the same covariance within the digits of its file: deviations and errors have
four, and correlations five decimals.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.intervals import Uncertainty
from ballbot.identification.quantities import Layout
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME, Correlation
from ballbot.robot.parameters import Value, value_of

#: derivatives are differences over this share of a deviation
_STEP = 0.1
#: a number that changes by less, relative to its size, does not depend on a parameter
_UNCHANGED = 1e-12


def stated_covariances(
    layout: Layout, uncertainty: Uncertainty, *, of_robot: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the covariances (p, p) of each number by itself and of all together, SI units; see the module's text.

    `of_robot` (p,) are the deviations of what all logs of the robot have in common, NaN where not estimated.
    """
    errors, R = uncertainty.standard_errors, uncertainty.correlation
    deviations = deviations_of(layout.labels, uncertainty, of_robot=of_robot)
    return parameter_covariance(deviations, errors, R), joint_covariance(
        joint_errors(layout, errors, of_robot), R
    )


def deviations_of(
    labels: tuple[str, ...], uncertainty: Uncertainty, *, of_robot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the standard deviation of each parameter (p,), SI units; NaN if nothing is known of it.

    It is that of what all logs of the robot have in common, `of_robot` (p,), where that was estimated; else the larger
    of the clustered error and that by bootstrap. A parameter at a bound has that of its interval.
    """
    largest = np.fmax(uncertainty.standard_errors, uncertainty.bootstrap_errors)
    largest = np.where(np.isfinite(of_robot), of_robot, largest)
    intervals = [uncertainty.intervals.get(label) for label in labels]
    by_interval = np.array([np.nan if one is None else one.deviation for one in intervals])
    return np.where(np.isfinite(largest), largest, by_interval)


def parameter_covariance(
    deviations: NDArray[np.float64], errors: NDArray[np.float64], correlation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return E R E + D (p, p), zero for parameters without deviation; see the module's text.

    Parameters
    ----------
    deviations : ndarray (p,)
        Of the robot's parameters; NaN if unknown.
    errors : ndarray (p,)
        Of the estimate under the logs' conditions, which the correlation is of; NaN if undetermined.
    correlation : ndarray (p, p)
    """
    sizes = np.nan_to_num(deviations)
    known = np.isfinite(errors) & (sizes > 0.0) & np.isfinite(correlation.diagonal())
    own = np.where(known, np.minimum(np.nan_to_num(errors), sizes), 0.0)
    R = np.where(np.outer(known, known), np.nan_to_num(correlation), 0.0)
    common = R * np.outer(own, own)
    return common + np.diag(sizes**2 - common.diagonal())


def joint_covariance(errors: NDArray[np.float64], correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return E R E (p, p) of errors (p,) and correlations (p, p); zero for parameters without error."""
    known = np.nan_to_num(errors)
    return known[:, None] * np.nan_to_num(correlation) * known


def joint_errors(
    layout: Layout, errors: NDArray[np.float64], of_robot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the errors (p,) of all numbers together out of those under the logs' conditions, SI units; NaN if unknown.

    That of C_rr is its deviation of what all logs of the robot have in common, out of `of_robot` (p,), if that is more.
    """
    together = errors.copy()
    rolling = layout.columns("rolling")
    if rolling is not None:
        together[rolling] = np.maximum(errors[rolling], np.nan_to_num(of_robot[rolling]))
    return together


def with_uncertainty(
    found: Robot,
    robot_of: Callable[[NDArray[np.float64]], Robot],
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    *,
    names: Collection[str],
    joint: NDArray[np.float64] | None = None,
) -> Robot:
    """Return a robot with the standard deviations and correlations of the numbers that parameters determine.

    Parameters
    ----------
    found : Robot
        The one of `values`.
    robot_of : callable
        From parameters (p,), SI units, to the robot of them.
    values : ndarray (p,)
    covariance : ndarray (p, p)
        Of them; zero for those without standard deviation.
    names : collection of str
        The robot's parameters to state it of, by dotted name. A list in which a number has no deviation states none.
    joint : ndarray (p, p), optional
        The covariance of all together, if it is another one; see the module's text.
    """
    names = [name for name in BY_NAME if name in set(names) and value_of(found, BY_NAME[name]) != ()]
    deviations = np.sqrt(covariance.diagonal())
    G = np.zeros((len(_numbers(found, names)), len(values)))
    for place in np.flatnonzero(deviations > 0.0):
        G[:, place] = _derivative(robot_of, values, int(place), _STEP * float(deviations[place]), names)
    spread = G @ covariance @ G.T
    sizes = np.sqrt(np.maximum(spread.diagonal(), 0.0))
    stated: dict[str, Value] = {}
    labels: list[str] = []
    kept: list[int] = []
    first = 0
    for name in names:
        value = value_of(found, BY_NAME[name])
        count = len(value) if isinstance(value, tuple) else 1
        part = sizes[first : first + count]
        if np.all(part > 0.0):
            rounded = [float(f"{one:.4g}") for one in part]
            stated[name] = tuple(rounded) if isinstance(value, tuple) else rounded[0]
            labels += [f"{name}[{i}]" for i in range(count)] if isinstance(value, tuple) else [name]
            kept += range(first, first + count)
        first += count
    together = (spread if joint is None else G @ joint @ G.T)[np.ix_(kept, kept)]
    errors = np.sqrt(np.maximum(together.diagonal(), 0.0))
    scale = np.where(errors > 0.0, errors, 1.0)
    R = together / np.outer(scale, scale)
    related = [i for i in range(len(kept)) if joint is not None or np.any(np.abs(np.delete(R[i], i)) > 5e-6)]
    return found.annotated(
        standard_deviations={**found.standard_deviations, **stated},
        correlation=Correlation.of_matrix(
            [labels[i] for i in related],
            R[np.ix_(related, related)],
            [] if joint is None else [float(f"{one:.4g}") for one in errors[related]],
        ),
    )


def _derivative(
    robot_of: Callable[[NDArray[np.float64]], Robot],
    values: NDArray[np.float64],
    place: int,
    step: float,
    names: Collection[str],
) -> NDArray[np.float64]:
    """Return the derivatives of the robot's numbers by one parameter; one-sided next to what no robot has."""
    ends = []
    for sign in (1.0, -1.0):
        moved = values.copy()
        moved[place] += sign * step
        try:
            ends.append((sign * step, _numbers(robot_of(moved), names)))
        except InputError:
            continue
    if not ends:
        return np.zeros(len(_numbers(robot_of(values), names)))
    if len(ends) == 1:
        ends.append((0.0, _numbers(robot_of(values), names)))
    (ahead, high), (behind, low) = ends
    slope = (high - low) / (ahead - behind)
    return np.where(np.abs(high - low) > _UNCHANGED * np.abs(high), slope, 0.0)


def _numbers(robot: Robot, names: Collection[str]) -> NDArray[np.float64]:
    """Return the numbers of these parameters, one after another."""
    return np.concatenate(
        [np.atleast_1d(np.asarray(value_of(robot, BY_NAME[name]), dtype=np.float64)) for name in names]
        or [np.empty(0)]
    )
