"""Estimates of the same quantities by several stages: whether they agree, and one estimate from logs and a sweep.

Agreement. With estimates x and y of k quantities and their covariances, chi^2 = (x - y)^T (P_x + P_y)^-1 (x - y) is
chi-squared distributed with k degrees of freedom if both estimate the same values. A p-value below `LEAST_P_VALUE`
gives a warning. Balancing is known to differ from freely turning wheels (docs/generated/evidence.md, "Friction by the
three stages"). Only b, c and C_rr are compared. s, v_s and delta compensate for each other far beyond the range in
which their errors are normally distributed.

Sweep. A sweep of the free wheels determines b and c of each wheel far better than balancing does, but relative to the
torque in its log. With g_i the gain of motor i, which is the acting torque over the logged one (1 if it is not
estimated), and b', c' the values of the sweep,

    b_i - g_i b'_i = 0 +- g_i (error of b'_i)        c_i - g_i c'_i = 0 +- g_i (error of c'_i)

are two more measurements a wheel. Logs and sweep are independent, so generalised least squares gives the best linear
estimate from both: with x and C the estimate from the logs and its covariance, r the left-hand sides, H their
derivatives and S their covariance from the sweep,

    K = C H^T (H C H^T + S)^-1        x' = x - K r        C' = C - K H C

Friction under the robot's weight may differ from that of a free wheel. A measurement that contradicts the logs by more
than `CONTRADICTS` standard errors is left out, with a warning.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from scipy.special import chdtrc

from ballbot.arrays import Floats
from ballbot.control.overcompensation import stated_covariance
from ballbot.errors import InputError
from ballbot.file_formats import read_results
from ballbot.findings import Finding, warning
from ballbot.fitting.intervals import HALF_WIDTH, Interval, Uncertainty
from ballbot.identification.quantities import Coordinates, Layout
from ballbot.robot import Robot

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

    def among(self, labels: list[str]) -> StageEstimate:
        """Return the estimates of these labels, in their order."""
        rows = [self.labels.index(label) for label in labels]
        return StageEstimate(
            self.source, tuple(labels), self.values[rows], self.covariance[np.ix_(rows, rows)]
        )

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
    x, y = first.among(both), second.among(both)
    covariance = x.covariance + y.covariance
    errors = np.sqrt(covariance.diagonal())
    deviations = (y.values - x.values) / errors
    inverse = np.linalg.pinv(covariance / np.outer(errors, errors), hermitian=True)
    chi_squared = float(deviations @ inverse @ deviations)
    if not both or chdtrc(len(both), chi_squared) > LEAST_P_VALUE:
        return []
    named = ", ".join(
        f"{both[i]} {x.values[i]:.3g} and {y.values[i]:.3g} ({abs(deviations[i]):.1f} standard errors)"
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


#: largest difference between sweep and logs, in its standard errors
CONTRADICTS = 3.0
_SYMBOLS = ("b", "c")
_QUANTITIES = ("viscous", "coulomb")


def sweep_of(values: Floats, covariances: Floats) -> StageEstimate:
    """Return the estimate of a sweep from b [N m s/rad] and c [N m] (n, 2) and their covariances (n, 2, 2)."""
    n = len(values)
    C = np.zeros((2 * n, 2 * n))
    for i, own in enumerate(covariances):
        C[np.ix_([i, n + i], [i, n + i])] = own
    labels = tuple(f"{symbol}{i}" for symbol in _SYMBOLS for i in range(1, n + 1))
    return StageEstimate("the sweep", labels, values.T.ravel(), C)


def read_sweep(path: str | Path, *, wheel_count: int) -> StageEstimate:
    """Read the friction from a results.json of `ballbot identify-driveline`; InputError if it is another file."""
    results = cast("dict[str, dict]", read_results(path))
    try:
        tables = [results[name] for name in ("parameters", "standard_errors")]
        values, errors = (np.array([table[s] for s in _SYMBOLS], dtype=float).T for table in tables)
        rows = [results["correlation"]["labels"].index(symbol) for symbol in _SYMBOLS]
        correlations = np.array(results["correlation"]["matrices"], dtype=float)
        correlations = correlations[:, rows][:, :, rows]
    except (ValueError, KeyError, TypeError, IndexError, AttributeError):
        raise InputError(
            f"{path} is not a results.json of `ballbot identify-driveline`. Give that file with --sweep."
        ) from None
    if values.shape != (wheel_count, 2) or correlations.shape != (wheel_count, 2, 2):
        raise InputError(f"{path} has {len(values)} wheels, but the robot has {wheel_count}.")
    with np.errstate(over="ignore", invalid="ignore"):
        covariances = correlations * errors[:, :, None] * errors[:, None, :]
    if not np.isfinite(values).all() or np.isinf(covariances).any():
        raise InputError(f"{path} has a number that is not finite; run `ballbot identify-driveline` again.")
    return sweep_of(values, covariances)


def with_sweep(
    coordinates: Coordinates, uncertainty: Uncertainty, sweep: StageEstimate
) -> tuple[Uncertainty, tuple[Finding, ...]]:
    """Return the estimate from logs and sweep together, within the bounds, and findings.

    The larger of the logs' two errors counts, clustered or bootstrap.
    """
    values, slopes = coordinates.physical(uncertainty.point), coordinates.slopes(uncertainty.point)
    logs = np.fmax(uncertainty.scaled_errors, uncertainty.bootstrap) * slopes
    C = uncertainty.correlation * np.outer(logs, logs)
    moved, C, findings = combine(coordinates.layout, values, C, sweep)
    if moved is values:
        return uncertainty, findings
    moved, errors = np.clip(moved, coordinates.lower, coordinates.upper), np.sqrt(C.diagonal())
    lower = np.maximum(moved - HALF_WIDTH * errors, coordinates.lower)
    upper = np.minimum(moved + HALF_WIDTH * errors, coordinates.upper)
    intervals = {
        coordinates.labels[i]: Interval(lower=float(lower[i]), upper=float(upper[i]), method="with sweep")
        for i in np.flatnonzero(np.isfinite(errors))
    }
    point = coordinates.scaled(moved)
    slopes = np.where(np.isfinite(errors), coordinates.slopes(point), 1.0)
    C, intervals = C / np.outer(slopes, slopes), {**uncertainty.intervals, **intervals}
    return replace(uncertainty, point=point, covariance=C, intervals=intervals), findings


def combine(
    layout: Layout, values: Floats, covariance: Floats, sweep: StageEstimate
) -> tuple[Floats, Floats, tuple[Finding, ...]]:
    """Return the estimate from logs and sweep together, its covariance, and findings.

    `covariance` (p, p) is that of the logs' `values` (p,), NaN for parameters without a standard error, which the sweep
    does not change. If nothing of the sweep is used, `values` itself is returned.
    """
    known, n = np.isfinite(covariance.diagonal()), layout.wheel_count
    C, indices = np.where(np.outer(known, known), covariance, 0.0), np.arange(len(values))
    at = np.concatenate([indices[layout.columns(name)] for name in _QUANTITIES])
    # b of all wheels, then c: the sweep's values, and the gain from its torque to the acting one
    sweep = sweep.among([layout.labels[i] for i in at])
    numbers, scale, H = sweep.values, np.ones(2 * n), np.zeros((2 * n, len(values)))
    H[np.arange(2 * n), at] = 1.0
    if (gains := layout.columns("torque_gain")) is not None:
        gain_of = np.tile(indices[gains], 2)
        scale = values[gain_of]
        H[np.arange(2 * n), gain_of] = np.where(known[gain_of], -numbers, 0.0)
    S = sweep.covariance
    used = np.flatnonzero(known[at] & np.isfinite(S.diagonal()))
    labels, theirs = tuple(layout.labels[i] for i in at[used]), (scale * numbers)[used]
    H, S, r = H[used], (S * np.outer(scale, scale))[np.ix_(used, used)], values[at[used]] - theirs
    of_logs = H @ C @ H.T
    findings = agreement_findings(
        StageEstimate("the sweep", labels, theirs, S),
        StageEstimate("the balancing logs", labels, theirs + r, of_logs),
    )
    apart = np.abs(r) / np.sqrt((of_logs + S).diagonal())
    agrees = apart <= CONTRADICTS
    for row in np.flatnonzero(~agrees):
        text = (
            f"{labels[row]} of the sweep, {theirs[row]:.3g}, and of the balancing logs, {theirs[row] + r[row]:.3g}, "
            f"differ by {apart[row]:.1f} standard errors, so the value of the sweep is not used. A wheel under the "
            "robot's weight may have other friction."
        )
        findings.append(warning("sweep", text))
    if not agrees.any():
        findings.append(warning("sweep", "No value of the sweep could be combined with these logs."))
        return values, covariance, tuple(findings)
    H, S, r = H[agrees], S[np.ix_(agrees, agrees)], r[agrees]
    K = np.linalg.solve(H @ C @ H.T + S, H @ C).T
    together = np.where(np.outer(known, known), C - K @ H @ C, np.nan)
    return values - K @ r, together, tuple(findings)
