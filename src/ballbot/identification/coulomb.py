"""An equivalent Coulomb friction, to compare logs and robots whose friction law has a Stribeck part.

Balancing logs hardly separate c from s, whose errors compensate each other. What a log determines is the curve at the
speeds driven. So the dry friction c + s E(w) is replaced by the straight line c_e + a w that is closest to it in least
squares from rest to the speed W, the 95 % quantile of the log's speeds. With x = w / W from 0 to 1,

    c_e = c + s (4 A - 6 B)        A = int E dx,  B = int x E dx        E = exp(-|W x / v_s|^delta)

The standard error follows from those of c, s, v_s and delta and their correlations. W and parameters without a standard
error, such as v_s or delta at a bound, count as exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.identification.quantities import Layout
from ballbot.mechanics.friction import stribeck_curve
from ballbot.results import key, left_out, reported
from ballbot.robot.friction_law import FrictionLaw
from ballbot.rounding import plus_minus

#: quantile of the speeds driven that is W
SHARE = 0.95
#: points in x; more change c_e by less than 4e-5 s, for v_s of 0.05 to 3 rad/s, delta of 0.1 to 10 and W to 3 rad/s
_POINTS = 2000
#: finite difference for derivatives, as a share of a parameter
_STEP = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class CoulombEquivalent:
    """Equivalent Coulomb friction of each wheel."""

    values: Floats  #: c_e (n,) [N m]
    standard_errors: Floats  #: (n,) [N m]; NaN if c has none
    speeds: Floats = field(metadata=key("up_to_speed"))  #: W (n,) [rad/s]
    coulomb: Floats = field(metadata=left_out)  #: c itself (n,) [N m]
    coulomb_errors: Floats = field(metadata=left_out)  #: its errors (n,) [N m]

    @reported
    def compared(self) -> Literal["c", "c_e"]:
        """Which of the two is better determined, and should be compared with other logs and robots."""
        c, c_e = (
            np.median(np.nan_to_num(errors / np.maximum(values, np.finfo(float).tiny), nan=np.inf))
            for values, errors in ((self.coulomb, self.coulomb_errors), (self.values, self.standard_errors))
        )
        # without a Stribeck part they are equal but for rounding
        return "c" if c < c_e * (1.0 + 1e-6) else "c_e"


def coulomb_equivalent(
    layout: Layout,
    values: Floats,
    *,
    covariance: Floats,
    wheel_speeds: Floats,
    law: FrictionLaw | None = None,
) -> CoulombEquivalent:
    """Return each wheel's c_e.

    `covariance` (p, p) is of the estimates `values` (p,), NaN for those without a standard error; `wheel_speeds`
    (..., n) [rad/s] are those driven; `law` is a registered friction law, None for the classical one.
    """
    n = layout.wheel_count
    speeds = np.quantile(np.abs(wheel_speeds.reshape(-1, n)), SHARE, axis=0)
    x = (np.arange(_POINTS) + 0.5) / _POINTS
    driven = speeds[:, None] * x

    def at(parameters: Floats) -> Floats:
        """Return c_e (n,): the integral of (4 - 6 x) times the dry friction, by the midpoint rule."""
        if law:
            parts = {name: layout.part(name, parameters) for name in law.takes}
            numbers = {name: part[:, None] for name, part in parts.items() if part is not None}
            dry = law.size(driven, 0.0 * x, **numbers)
        else:
            (c, s), (v_s, delta) = parameters[n : 3 * n].reshape(2, n, 1), parameters[3 * n : 3 * n + 2]
            dry = stribeck_curve(c, s, driven / v_s, delta)
        return (dry * (4.0 - 6.0 * x)).mean(axis=1)

    C = np.nan_to_num(covariance)
    steps, G = _STEP * np.maximum(np.abs(values), 1e-6), np.zeros((n, len(values)))
    for i in np.flatnonzero(C.diagonal() > 0.0):
        step = steps[i] * np.eye(len(values))[i]
        G[:, i] = (at(values + step) - at(values - step)) / (2.0 * steps[i])
    errors = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", G, C, G, optimize=False), 0.0))
    own = np.sqrt(covariance.diagonal()[n : 2 * n])
    return CoulombEquivalent(
        values=at(values),
        standard_errors=np.where(np.isfinite(own), errors, np.nan),
        speeds=speeds,
        coulomb=values[n : 2 * n],
        coulomb_errors=own,
    )


def coulomb_sentence(equivalent: CoulombEquivalent, names: Sequence[str]) -> str:
    """Return the sentences of a report, given the quantities `names` of the law; empty without dry friction."""
    if "coulomb" not in names:
        return ""
    if "stribeck" not in names:  # then c_e is c, which is in the table
        return "Compare the Coulomb friction c of each wheel with other logs and robots."
    c, c_e = (
        f"{', '.join(map(plus_minus, values.tolist(), errors.tolist()))} N m"
        for values, errors in (
            (equivalent.coulomb, equivalent.coulomb_errors),
            (equivalent.values, equivalent.standard_errors),
        )
    )
    compared, other = f"c of each wheel, {c}", f"the Coulomb equivalent, {c_e},"
    if equivalent.compared == "c_e":
        compared, other = f"the Coulomb equivalent of each wheel, {c_e}", f"c, {c},"
    top = ", ".join(f"{speed:.2g}" for speed in equivalent.speeds)
    return (
        f"Compare {compared}, with other logs and robots: {other} is less well determined. The Coulomb equivalent is "
        f"the value at rest of the straight line that fits the dry friction best up to {top} rad/s. Its standard error "
        "takes v_s or delta at a bound as exact."
    )
