"""The residual force, tested for a dependence on position, speed, load, temperature and time.

The columns that a missing effect would need are added to those of the inverse model, and all are fitted together:
friction that depends on load or temperature is a change of c or b with it. Each group of columns is tested as a whole
(Hotelling's T^2, `ballbot.fitting.least_squares`). A dependence is reported if it is significant (`CHANCE`) and
explains enough of the residual's variance (`SHARE`); one that explains most of it needs less significance, which a
record of a few blocks cannot show.

The load is what the drive transmits: the forces over position of the model and the weight of a known load. Of a law
whose friction falls with speed the inverse model has that curve, too, with the law's Stribeck speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, note, warning
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.inverse import RegressionRows, break_away_column, regression_rows
from ballbot.identification.axis.record import AxisRecord, moved_by_one_load
from ballbot.identification.axis.structure import AxisModel

#: a dependence of the residual is significant below this p-value, and reported above this share of its variance
CHANCE, SHARE = 1e-3, 0.05
#: of a dependence that explains more than this share of the variance, the largest p-value
LARGE_SHARE, LARGE_CHANCE = 0.5, 1e-2
_ADVICE = {
    "position": "a force over position is missing: try --harmonics, --period or --spring",
    "speed": "friction is no straight line over speed: compare the laws, or try --law stribeck or asymmetric",
    "load": "friction depends on the load: try --load-friction; c and b hold for the loads of these records",
    "temperature": "friction depends on temperature, so that c and b hold for the temperatures of these records",
    "time": "friction changes within the record, so that c and b are averages over it",
    "record": "the records differ: try --separate offset, or --separate with the parameter that differs",
}


@dataclass(frozen=True, kw_only=True)
class ResidualTest:
    """Whether the residual force depends on a quantity."""

    quantity: str
    p_value: float  #: NaN if there are too few blocks
    share: float  #: of the residual's variance that it explains
    size: float  #: root mean square of the force that it explains [N]

    @property
    def dependent(self) -> bool:
        """Whether the dependence is reported."""
        return (self.p_value < CHANCE and self.share > SHARE) or self.large

    @property
    def large(self) -> bool:
        """Whether it explains most of the residual."""
        return self.p_value < LARGE_CHANCE and self.share > LARGE_SHARE

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "p_value": self.p_value,
            "share_of_variance": self.share,
            "force_rms": self.size,
            "dependent": self.dependent,
        }


def residual_tests(
    records: Sequence[AxisRecord],
    model: AxisModel,
    *,
    bandwidth: float | None = None,
    over_position: bool = True,
    stribeck_speed: float | None = None,
) -> tuple[ResidualTest, ...]:
    """Return the tests of each quantity that the records have, of the inverse model with a law's Stribeck speed [m/s].

    Not of the position if the open loop has refuted a force `over_position` that the inverse model would have, nor of
    an axis that only a load's weight moves, which has the shape of what an inertia requires.
    """
    rows = regression_rows(records, model, bandwidth=bandwidth, moving=True)
    base = np.column_stack(list(rows.columns.values()))
    if stribeck_speed is not None:
        curve = break_away_column(rows.seen["speed"], stribeck_speed)[:, None]
        kept = _independent(base, curve)
        base = base if kept is None else np.column_stack([base, kept])
    plain = fit_linear(base, rows.force, rows.block)
    tested = _columns(rows, model, records)
    if not over_position or moved_by_one_load(records):
        del tested["position"]
    total = float(np.mean(plain.residuals**2))
    found = []
    for quantity, columns in tested.items():
        kept = _independent(base, columns)
        if kept is None:
            continue
        fit = fit_linear(np.column_stack([base, kept]), rows.force, rows.block)
        places = list(range(base.shape[1], base.shape[1] + kept.shape[1]))
        remaining = float(np.mean(fit.residuals**2))
        found.append(
            ResidualTest(
                quantity=quantity,
                p_value=fit.p_value(places),
                share=1.0 - remaining / total if total > 0.0 else 0.0,
                size=float(np.sqrt(max(total - remaining, 0.0))),
            )
        )
    return tuple(found)


def _columns(
    rows: RegressionRows, model: AxisModel, records: Sequence[AxisRecord]
) -> dict[str, NDArray[np.float64]]:
    """Return by quantity the columns (n, k) that a dependence on it needs."""
    q, v, t = (rows.seen[name] for name in ("position", "speed", "time"))
    sign, fast = np.sign(v), np.abs(v) / np.sqrt(np.mean(v**2))
    place = _centred(q)
    # straight in q is a spring, and one wave over the travel is not far from gravity
    found = {
        "position": np.column_stack([place, place**2, np.cos(np.pi * place), np.sin(np.pi * place)]),
        "speed": np.column_stack([v * fast, sign * np.exp(-5.0 * fast), fast]),
        "time": np.column_stack([_centred(t) * sign, _centred(t) * v]),
    }
    if "offset" not in model.law.names:
        found["speed"] = found["speed"][:, :2]
    load = rows.seen.get("load")
    if load is None:
        load = _transmitted_load(rows, records)
    if load is not None:
        # dry friction under load is in the model, or tested; the former's filtered column differs where v changes sign
        dry = [] if model.load else [np.abs(load) * sign]
        found["load"] = np.column_stack([*dry, load * v])
    if "temperature" in rows.seen:
        warmth = _centred(rows.seen["temperature"])
        found["temperature"] = np.column_stack([warmth * sign, warmth * v])
    if len(records) > 1:
        number = rows.seen["record"]
        found["record"] = np.column_stack([(number == i).astype(float) for i in range(1, len(records))])
    return found


def _transmitted_load(rows: RegressionRows, records: Sequence[AxisRecord]) -> NDArray[np.float64] | None:
    """Return the force over position and the known loads' weights, which load the gears; None if there are none."""
    names = [name for name in rows.columns if name.startswith(("sin_", "cos_", "spring"))]
    known = [one.known_load for one in records]
    if not names and not any(one.weight for one in known):
        return None
    X = np.column_stack(list(rows.columns.values()))
    found = dict(zip(rows.columns, np.linalg.lstsq(X, rows.force, rcond=None)[0], strict=True))
    load = np.sum([found[name] * rows.columns[name] for name in names], axis=0) + np.zeros(len(rows.force))
    own = rows.seen["record"].astype(int)
    weight, hanging = (np.array([getattr(one, name) for one in known])[own] for name in ("weight", "hanging"))
    return load + weight * np.sin(rows.seen["position"] - hanging)


def _centred(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values from -1 to 1."""
    low, high = float(values.min()), float(values.max())
    return (2.0 * values - low - high) / max(high - low, np.finfo(float).tiny)


def _independent(base: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the columns that are not nearly sums of the others; None if there are no such columns."""
    kept, known = [], base
    for column in columns.T:
        size = np.linalg.norm(column)
        if size == 0.0:
            continue
        off = column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
        if np.linalg.norm(off) > 0.05 * size:
            kept.append(column)
            known = np.column_stack([known, column])
    return np.column_stack(kept) if kept else None


def residual_findings(
    tests: Sequence[ResidualTest], model: AxisModel, records: Sequence[AxisRecord]
) -> list[Finding]:
    """Return a finding for each quantity that the residual force depends on and that the model does not explain."""
    law = model.law
    advice = _ADVICE | ({} if law.symmetric else {"speed": _ADVICE["speed"].removesuffix(" or asymmetric")})
    if model.load:
        advice |= {
            "load": "friction depends on the load otherwise than by mu: another --load-friction may suit it"
        }
    loads = {one.known_load.weight for one in records}
    if len(loads) > 1 and not any(one.known_load.hanging for one in records):
        advice |= {
            "record": f"the load hangs straight down at another angle (--hanging), or {advice['record']}"
        }
    unit = records[0].force_unit
    # a friction that falls with speed is in the law; the inverse model has only its Stribeck speed
    explained = {"speed"} if "stribeck" in law.names else set[str]()
    found = []
    for one in tests:
        if not one.dependent or one.quantity in explained:
            continue
        text = (
            f"The residual force depends on {'the ' if one.quantity != 'time' else ''}{one.quantity} "
            f"(p = {one.p_value:.1g}; {one.size:.3g} {unit} RMS, {100.0 * one.share:.0f} % of its variance): "
            f"{advice[one.quantity]}."
        )
        if one.quantity == "load" and one.large and not model.load:
            text += (
                " This is most of what the model leaves: c, and perhaps b, contain friction that grows with the load, "
                "as of loaded gears, and are too large for the axis without it. Do not use them for other loads."
            )
            found.append(warning("axis-residuals", text))
        else:
            found.append(note("axis-residuals", text))
    return found
