"""Identification of one axis by three methods, with a friction law selected by its errors on held-out windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, finding_results, note
from ballbot.fitting.model_selection import Candidate, ModelSelection
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification.axis.inverse import (
    BLOCK,
    InverseFit,
    Motion,
    asymmetry_over_time,
    default_bandwidth,
    first_row,
    inverse_fit,
    smoothed_motion,
    speed_at_start,
)
from ballbot.identification.axis.model import (
    AXIS_LAWS,
    PARAMETERS,
    Axis,
    AxisLaw,
    Values,
    axis_law_named,
    unit_for,
)
from ballbot.identification.axis.output_error import (
    OutputErrorFit,
    closed_loop_residuals,
    cross_validate_laws,
    equal_spans,
    fit_output_error,
    memoized,
    open_loop_residuals,
    search_output_error,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.progress import Progress, part_of


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    record: str
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]
    closed_loop_force: float | None  #: |F - F_hat| / |F| in closed loop; None if the loop is not known
    closed_loop_position: float | None  #: alike for the position


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """One method's parameters and what they predict."""

    method: str  #: "inverse", "closed loop" or "open loop"
    law: AxisLaw
    values: dict[str, float]  #: SI units
    standard_errors: dict[str, float]  #: clustered in time; NaN if there is none
    errors: tuple[AxisErrors, ...]  #: on the record fitted, then on the others

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "method": self.method,
            "law": self.law.name,
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "errors": {
                one.record: {k: v for k, v in vars(one).items() if k != "record"} for one in self.errors
            },
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisIdentification:
    """An axis, identified."""

    record: str  #: that was fitted
    unit: str  #: of positions: "m" or "rad"
    inverse: dict[str, InverseFit]  #: by form
    ladder: ModelSelection[AxisLaw]  #: every law, by its errors on windows held out
    chosen: AxisLaw
    estimates: tuple[Estimate, ...]  #: the chosen law by every method
    by_law: dict[str, Estimate]  #: every law by output error in open loop
    asymmetry: NDArray[
        np.float64
    ]  #: (parts, 2): (b- - b+)/2 in equal parts of the record, with standard errors; none if a part cannot tell
    remarks: tuple[Finding, ...]

    def estimate(self, method: str) -> Estimate:
        """Return the estimate by that method."""
        return next(one for one in self.estimates if one.method == method)

    @property
    def best(self) -> Estimate:
        """The estimate to simulate the axis with."""
        return self.estimate("open loop")

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "record": self.record,
            "unit": self.unit,
            "law": self.chosen.name,
            "parameters": self.best.values,
            "standard_errors": self.best.standard_errors,
            "estimates": {one.method: one.to_dict() for one in self.estimates},
            "inverse": {form: fit.to_dict() for form, fit in self.inverse.items()},
            "ladder": [_ladder_result(one) for one in self.ladder.candidates],
            "laws": {name: one.to_dict() for name, one in self.by_law.items()},
            "asymmetry_over_time": self.asymmetry,
            "remarks": finding_results(self.remarks),
        }


#: a standard error of this share of a parameter leaves it all but open
_OPEN = 0.5
#: beyond so many standard errors, two parts of a record differ
_DIFFERENT = 2.0


def _ladder_result(one: Candidate[AxisLaw]) -> dict[str, object]:
    """Return what results.json holds of a law on the ladder."""
    gain = one.gain
    return {
        "law": one.name,
        "below": one.within,
        "held_out_rms": float(np.sqrt(one.held_out.squares.mean())),
        "gain": gain.share if gain else np.nan,
        "gain_interval": [gain.lower, gain.upper] if gain else [np.nan, np.nan],
    }


def axis_findings(
    record: AxisRecord,
    ladder: ModelSelection[AxisLaw],
    chosen: AxisLaw,
    by_law: Mapping[str, Estimate],
    asymmetry: NDArray[np.float64],
    *,
    by_user: bool,
) -> tuple[Finding, ...]:
    """Return the findings; `by_user`: whether the user named the law."""
    return (
        _choice_finding(ladder, chosen, by_user=by_user),
        *_asymmetry_findings(record, ladder, chosen, asymmetry),
        *_open_parameters(by_law[chosen.name]),
    )


def _choice_finding(ladder: ModelSelection[AxisLaw], chosen: AxisLaw, *, by_user: bool) -> Finding:
    others = [one for one in ladder.candidates if one.within and one.model.symmetric]
    failed = [one.name for one in others if not one.accepted and one.name != chosen.name]
    words = f"The law {chosen.name} was {('requested' if by_user else 'selected')}"
    if not failed:
        return note("law", f"{words}; every law below it improves the prediction of held-out windows.")
    text = (
        f"{words}; on held-out windows, {', '.join(failed)} "
        "did not improve the prediction over the law below."
    )
    return note("law", text)


def _asymmetry_findings(
    record: AxisRecord, ladder: ModelSelection[AxisLaw], chosen: AxisLaw, asymmetry: NDArray[np.float64]
) -> list[Finding]:
    verdict = next(one for one in ladder.candidates if not one.model.symmetric)
    if verdict.gain is None or not verdict.accepted or not chosen.symmetric:
        return []
    over_time = _over_time(asymmetry, unit_for(PARAMETERS["viscous"], record.unit)) if len(asymmetry) else ""
    text = (
        "The asymmetric law predicts other windows of this record with "
        f"{100.0 * verdict.gain.share:.0f} % less error, yet it is not selected: "
        f"{over_time}only another record can show whether the asymmetry belongs to the machine "
        "or to this run (temperature, supply). Validate against one, or choose --law asymmetric."
    )
    return [note("asymmetry", text)]


def _over_time(asymmetry: NDArray[np.float64], unit: str) -> str:
    """Return how the asymmetry (parts, 2) goes from the record's start to its end."""
    (first, first_error), (last, last_error) = asymmetry[0], asymmetry[-1]
    apart = abs(last - first) / np.hypot(first_error, last_error)
    moving = (
        f", and it changes within the record (by {apart:.1f} standard errors)" if apart > _DIFFERENT else ""
    )
    return (
        f"half the difference of the viscous coefficients is {first:.3g} +- {first_error:.2g} {unit} at the start and "
        f"{last:.3g} +- {last_error:.2g} at the end{moving}; "
    )


def _open_parameters(best: Estimate) -> list[Finding]:
    found = []
    for name, value in best.values.items():
        error, symbol = best.standard_errors[name], PARAMETERS[name].symbol
        if not np.isfinite(error):
            found.append(note("at-bound", f"{symbol} is at a bound and has no standard error."))
        elif error > _OPEN * abs(value):
            text = f"{symbol} is poorly determined: {value:.3g} with a standard error of {error:.2g}."
            found.append(note("poorly-determined", text))
    return found


#: where a search starts: the bristles' travel over the record's, the break-away's share of Coulomb friction
_BRISTLE_TRAVEL, _BREAK_AWAY = 4e-4, 0.1
#: shares of the work done when the ladder begins and ends, and when the open-loop fits end
_LADDER_FROM, _LADDER_TO, _FITS_TO = 0.1, 0.7, 0.95


def identify_axis(
    record: AxisRecord,
    *,
    law: str | None = None,
    bandwidth: float | None = None,
    window: float = 1.0,
    horizon: float | None = None,
    validation_records: Sequence[AxisRecord] = (),
    run: Run = DEFAULT_RUN,
) -> AxisIdentification:
    """Identify an axis's mass and friction.

    Parameters
    ----------
    record : AxisRecord
        With its loop and reference, output error in closed loop is done as well.
    law : str, optional
        One of `RUNGS`; by default the symmetric one of the least error on windows held out, among those that earn
        their place.
    bandwidth : float, optional
        Of the motion [Hz]; 20 by default, or less where the sampling is slow.
    window : float
        Duration of the windows [s] of the cross-validation.
    horizon : float, optional
        Duration of the windows [s] that the final open-loop fit predicts; the whole record by default.
    validation_records : sequence of AxisRecord
        Other records of the axis, which every estimate predicts and none is fitted to.
    run : Run, optional
        Its checkpoint answers for each law on the ladder and each fit. Its seed is not used.

    Raises
    ------
    InputError
        If the record does not determine the parameters, there is no such law, or an option is invalid.
    """
    _check(record, validation_records, window=window, horizon=horizon)
    wanted = axis_law_named(law) if law else None
    band = default_bandwidth(record) if bandwidth is None else bandwidth
    inverse = {
        "coulomb": inverse_fit(record, form="coulomb", bandwidth=band),
        "asymmetric": inverse_fit(record, form="asymmetric", bandwidth=band),
    }
    motion = smoothed_motion(record, bandwidth=band)
    starts = _initial_values(record, motion, inverse)
    of_ladder = replace(run, progress=part_of(run.progress, _LADDER_FROM, _LADDER_TO))
    ladder = cross_validate_laws(record, motion, starts, window=window, run=of_ladder)
    chosen = wanted or ladder.best.model
    bench = _Bench(records=(record, *validation_records), bandwidth=band)
    by_law = {}
    for number, name in enumerate(AXIS_LAWS):
        stage = Progress(stage=f"open loop, law {name}", done=number, total=len(AXIS_LAWS))
        part_of(run.progress, _LADDER_TO, _FITS_TO)(stage)
        fit = partial(_open_loop, record, motion, AXIS_LAWS[name], starts[name], horizon)
        by_law[name] = bench.estimate(
            "open loop", memoized(run, "open loop", AXIS_LAWS[name], starts[name], fit)
        )
    run.progress(Progress(stage="closed loop", done=_FITS_TO, total=1.0))
    estimates = [_inverse_estimate(bench, inverse)]
    if record.loop is not None:
        start = first_row(record, bandwidth=band)
        residuals = closed_loop_residuals(record, start=start, block=BLOCK)
        usual = float(np.std(record.force)) * 0.05
        begin = starts[chosen.name]
        fit = partial(fit_output_error, chosen, begin, residuals, scale=usual)
        estimates.append(bench.estimate("closed loop", memoized(run, "closed loop", chosen, begin, fit)))
    estimates.append(by_law[chosen.name])
    asymmetry = asymmetry_over_time(record)
    run.progress(Progress(stage="done", done=1.0, total=1.0))
    return AxisIdentification(
        record=record.name,
        unit=record.unit,
        inverse=inverse,
        ladder=ladder,
        chosen=chosen,
        estimates=tuple(estimates),
        by_law=by_law,
        asymmetry=asymmetry,
        remarks=axis_findings(record, ladder, chosen, by_law, asymmetry, by_user=wanted is not None),
    )


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """The records that every estimate predicts, the fitted one first."""

    records: tuple[AxisRecord, ...]
    bandwidth: float

    def estimate(self, method: str, fit: OutputErrorFit) -> Estimate:
        return Estimate(
            method=method,
            law=fit.law,
            values=fit.values,
            standard_errors=fit.standard_errors,
            errors=tuple(axis_errors(fit.axis, record, bandwidth=self.bandwidth) for record in self.records),
        )


def axis_errors(axis: Axis, record: AxisRecord, *, bandwidth: float) -> AxisErrors:
    """Return how well an axis predicts a record; closed-loop errors leave out the filter's start, as published."""
    motion = smoothed_motion(record, bandwidth=bandwidth)
    positions = axis.open_loop(
        record.force[:-1],
        position=float(record.position[0]),
        speed=speed_at_start(record),
        sample_time=record.sample_time,
    )
    rmse = float(np.sqrt(np.mean((positions - record.position[1:]) ** 2)))
    force = position = None
    if record.loop is not None:
        start = first_row(record, bandwidth=bandwidth)
        moved = axis.closed_loop(record, speed=speed_at_start(record))
        force = _relative(moved.forces[start:], record.force[start:])
        position = _relative(moved.positions[start:], motion.position[start:])
    return AxisErrors(
        record=record.name, open_loop_rmse=rmse, closed_loop_force=force, closed_loop_position=position
    )


def _check(
    record: AxisRecord, validation_records: Sequence[AxisRecord], *, window: float, horizon: float | None
) -> None:
    for name, value in (("window", window), ("horizon", horizon)):
        if value is not None and not 10.0 * record.sample_time <= value < np.inf:
            raise InputError(f"The {name} is {value:g} s; it must be at least ten samples.")
    names = [one.name for one in (record, *validation_records)]
    if len(set(names)) < len(names):
        raise InputError(
            f"Two of the records have the same name ({', '.join(names)}); give each its own name."
        )
    if np.ptp(record.force) == 0.0:
        raise InputError(
            f"{record.name}: the force is {record.force[0] + 0.0:g} {record.force_unit} "
            "throughout, so nothing can be identified; check its column and its scale."
        )


def _relative(found: NDArray[np.float64], measured: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(found - measured) / np.linalg.norm(measured))


def _inverse_estimate(bench: _Bench, inverse: dict[str, InverseFit]) -> Estimate:
    fit = inverse["coulomb"]
    return bench.estimate(
        "inverse",
        OutputErrorFit(
            law=AXIS_LAWS["coulomb"],
            values=dict(zip(fit.names, fit.values.tolist(), strict=True)),
            standard_errors=dict(zip(fit.names, fit.clustered_errors.tolist(), strict=True)),
            rms=fit.relative_force_error,
        ),
    )


def _open_loop(
    record: AxisRecord, motion: Motion, chosen: AxisLaw, start: Values, horizon: float | None
) -> OutputErrorFit:
    spans = equal_spans(record, np.inf if horizon is None else horizon)
    residuals = open_loop_residuals(record, motion, spans, block=BLOCK)
    return search_output_error(chosen, start, residuals, scale=1e-3 * float(np.ptp(record.position)))


def _initial_values(
    record: AxisRecord, motion: Motion, inverse: dict[str, InverseFit]
) -> dict[str, dict[str, float]]:
    """Return where each law's search starts: at the inverse model's parameters."""
    least = 1e-3 * float(np.std(record.force))
    symmetric = inverse["coulomb"]
    values = dict(zip(symmetric.names, symmetric.values.tolist(), strict=True))
    if values["mass"] <= 0.0:
        raise InputError(
            f"{record.name}: the inverse model estimates a mass of {values['mass']:.3g}. "
            "The sign of the force or its column is wrong, or the axis hardly accelerates."
        )
    values |= {name: max(values[name], least) for name in ("viscous", "coulomb")}
    values["stiffness"] = values["coulomb"] / (_BRISTLE_TRAVEL * float(np.ptp(record.position)))
    values["stribeck"] = _BREAK_AWAY * values["coulomb"]
    values["stribeck_speed"] = float(np.median(np.abs(motion.speed))) / 3.0
    values["micro_damping"] = 0.1 * float(np.sqrt(values["stiffness"] * values["mass"]))
    asymmetric = dict(zip(inverse["asymmetric"].names, inverse["asymmetric"].values.tolist(), strict=True))
    asymmetric = {name: max(value, least) for name, value in asymmetric.items()}
    return {name: (values if law.symmetric else asymmetric) for name, law in AXIS_LAWS.items()}
