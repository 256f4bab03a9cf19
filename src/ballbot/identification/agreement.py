"""Whether two methods or stages agree on the same quantities.

With estimates x and y of k quantities and their covariances, which are independent of each other,

    chi^2 = (x - y)^T (P_x + P_y)^-1 (x - y)

is the squared difference in units of its errors. If both estimate the same values, it is chi-squared distributed with k
degrees of freedom. A difference with a p-value below `LEAST_P_VALUE` is reported, with the effect that may be missing:

- *One factor.* If y is x times one factor within the errors, the two logs' torques differ in scale.
- *Losses of rollers, ball and floor.* On the nominal twin, balancing finds 1.9 times the b and 0.8 times the c of a
  sweep of the free wheels (docs/generated/evidence.md, "Friction by the three stages"), and twice the floor's C_rr
  ("What the identified parameters represent"). If the parameters that differ do so in these directions, the finding
  names what each of them represents in balancing besides its own friction (`Quantity.stands_for`).

Only b, c and C_rr are compared. s, v_s and delta trade against each other far beyond the range in which their errors
are normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.control.overcompensation import stated_covariance
from ballbot.findings import Finding, warning
from ballbot.identification.quantities import BY_NAME, Layout
from ballbot.robot import Robot

#: three standard deviations of one number. Standard errors are known to a fifth or so: at two, one comparison in
#: twenty would be a false alarm, and one in nine with an error underestimated by a fifth
LEAST_P_VALUE = 0.0027
#: the symbols whose errors are near to normal, and the sign of what losses of rollers, ball and floor add to them
_ROLLERS = {"b": 1, "c": -1, "C_rr": 1}
_WORDS = {"more": 1, "less": -1}
#: a parameter differs in one direction if the sum over the wheels does by so many of its errors
_DIRECTION = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class StageEstimate:
    """Estimates of k quantities by one stage."""

    source: str  #: in words, as "the sweep"
    labels: tuple[str, ...]  #: (k,) "b1", "c1", ..., "C_rr"
    values: NDArray[np.float64]  #: (k,), SI units
    covariance: NDArray[np.float64]  #: (k, k); NaN, infinite or zero for a number without standard error

    def among(self, labels: list[str]) -> StageEstimate:
        """Return the estimates of these quantities, in their order."""
        places = [self.labels.index(label) for label in labels]
        return StageEstimate(
            source=self.source,
            labels=tuple(labels),
            values=self.values[places],
            covariance=self.covariance[np.ix_(places, places)],
        )

    @property
    def known(self) -> list[str]:
        """The quantities that are compared and have a standard error."""
        return [
            label
            for label, variance in zip(self.labels, self.covariance.diagonal(), strict=True)
            if 0.0 < variance < np.inf and label.rstrip("0123456789") in _ROLLERS
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Agreement:
    """The comparison of two estimates of k quantities."""

    first: StageEstimate
    second: StageEstimate

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of the difference (k, k)."""
        return self.first.covariance + self.second.covariance

    @property
    def difference(self) -> NDArray[np.float64]:
        """The second less the first (k,)."""
        return self.second.values - self.first.values

    @property
    def chi_squared(self) -> float:
        """The squared difference in its errors."""
        return _squared(self.difference, self.covariance)

    @property
    def p_value(self) -> float:
        """Probability of so large a difference if both estimate the same values."""
        return float(scipy.stats.chi2.sf(self.chi_squared, len(self.difference)))

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Each difference in its own errors (k,)."""
        return self.difference / np.sqrt(self.covariance.diagonal())

    @property
    def signs(self) -> dict[str, int]:
        """Of each symbol, 1 if the second is larger over all wheels, -1 if smaller, 0 if within the errors."""
        symbols = [label.rstrip("0123456789") for label in self.first.labels]
        found: dict[str, int] = {}
        for symbol in dict.fromkeys(symbols):
            mine = np.array([name == symbol for name in symbols], dtype=float)
            total = float(mine @ self.difference)
            known = abs(total) > _DIRECTION * float(np.sqrt(mine @ self.covariance @ mine))
            found[symbol] = int(np.sign(total)) if known else 0
        return found

    @property
    def factor(self) -> float | None:
        """The one factor on the first that explains the second within the errors, None if none does."""
        count = len(self.difference)
        if count < 2:
            return None
        x, y = self.first.values, self.second.values
        k = 1.0
        for _ in range(20):  # the covariance depends on k: a few repetitions settle it
            weight = np.linalg.pinv(k**2 * self.first.covariance + self.second.covariance, hermitian=True)
            k = float(x @ weight @ y) / float(x @ weight @ x)
        misfit = _squared(y - k * x, k**2 * self.first.covariance + self.second.covariance)
        return k if k > 0.0 and scipy.stats.chi2.sf(misfit, count - 1) > LEAST_P_VALUE else None


def _squared(difference: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    sizes = np.sqrt(covariance.diagonal())
    scaled = difference / sizes
    inverse = np.linalg.pinv(covariance / np.outer(sizes, sizes), hermitian=True)
    return float(scaled @ inverse @ scaled)


def compare(first: StageEstimate, second: StageEstimate) -> Agreement | None:
    """Return the comparison of the quantities that both estimate, None if they have none in common."""
    both = [label for label in first.known if label in second.known]
    return Agreement(first=first.among(both), second=second.among(both)) if both else None


def agreement_findings(first: StageEstimate, second: StageEstimate) -> list[Finding]:
    """Return a warning if two stages differ by more than their errors, with the effect that may be missing."""
    found = compare(first, second)
    if found is None or found.p_value > LEAST_P_VALUE:
        return []
    order = np.argsort(-np.abs(found.deviations))[:3]
    named = ", ".join(
        f"{found.first.labels[i]} {found.first.values[i]:.3g} and {found.second.values[i]:.3g} "
        f"({abs(found.deviations[i]):.1f} standard errors)"
        for i in order
    )
    text = (
        f"{first.source[0].upper()}{first.source[1:]} and {second.source} differ by more than their errors: {named}; "
        f"chi-squared {found.chi_squared:.3g} of {len(found.difference)} numbers. {_effect(found)}"
    )
    return [warning("methods-differ", text)]


def _effect(found: Agreement) -> str:
    """Return the likely missing effect of stages that differ; see the module's text."""
    if (factor := found.factor) is not None:
        return (
            f"One factor of {factor:.3g} on all of them explains it: the torques of the two logs differ in scale "
            "(torque constant, supply, unit). Estimate torque_gain, or correct the scale."
        )
    signs = found.signs
    differing = [symbol for symbol, sign in signs.items() if sign]
    directions = {signs[symbol] * _ROLLERS[symbol] for symbol in differing}
    against = [
        deviation * _ROLLERS[label.rstrip("0123456789")] * direction < -_DIRECTION
        for label, deviation in zip(found.first.labels, found.deviations, strict=True)
        for direction in directions
    ]
    if len(directions) == 1 and not any(against):
        # the stage that has these losses is the second, or the first if the second has less of them
        rolls = found.second if directions == {1} else found.first
        groups = {word: [one for one in differing if _ROLLERS[one] == sign] for word, sign in _WORDS.items()}
        shown = " and ".join(f"{word} {' and '.join(group)}" for word, group in groups.items() if group)
        also = "; ".join(f"{symbol} also represents {_stands_for(symbol)}" for symbol in differing)
        return (
            f"{shown[0].upper()}{shown[1:]} by {rolls.source} is what losses of rollers, ball and floor cause, "
            f"which the model lacks: {also}. Use the numbers of the stage that is nearest to the use: balancing for "
            "control, free wheels for motors and gears."
        )
    return (
        "Losses of the rollers would make b and C_rr larger and c smaller, so they do not explain it. Check that both "
        "logs are of this robot as it is, at the same temperature and supply."
    )


def _stands_for(symbol: str) -> str:
    return next(one.stands_for for one in BY_NAME.values() if one.symbol == symbol) or "nothing else"


def of_robot_file(robot: Robot) -> StageEstimate | None:
    """Return the friction in a robot's file, None if it states no standard deviations of it."""
    covariance = stated_covariance(robot)
    if covariance is None:
        return None
    layout = Layout(wheel_count=robot.wheel_count)
    count = len(layout.labels)
    return StageEstimate(
        source="the robot file",
        labels=layout.labels,
        values=layout.nominal(robot),
        covariance=covariance[:count, :count],
    )


def file_findings(robot: Robot, found: StageEstimate) -> list[Finding]:
    """Return a warning if a stage and the friction in the robot's file differ by more than their errors."""
    stated = of_robot_file(robot)
    return [] if stated is None else agreement_findings(stated, found)
