"""Estimates of the same quantities by several stages: whether they agree.

With estimates x and y of k quantities and their covariances, chi^2 = (x - y)^T (P_x + P_y)^-1 (x - y) is
chi-squared distributed with k degrees of freedom if both estimate the same values. A p-value below `LEAST_P_VALUE`
gives a warning. Balancing is known to differ from freely turning wheels (docs/generated/evidence.md, "Friction by the
three stages"). Only b, c and C_rr are compared. s, v_s and delta compensate for each other far beyond the range in
which their errors are normally distributed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from ballbot.arrays import Floats
from ballbot.control.overcompensation import stated_covariance
from ballbot.findings import Finding, warning
from ballbot.identification.quantities import Layout
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
