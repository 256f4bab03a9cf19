"""Identification of one axis by four methods, with all that is selected by its errors on held-out blocks of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.findings import Finding
from ballbot.fitting.model_selection import Gain
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification.axis.comparison import methods_differ
from ballbot.identification.axis.conclusions import axis_findings
from ballbot.identification.axis.force_timing import delay_findings, delayed, force_delay, is_interpolated
from ballbot.identification.axis.inverse import (
    InverseFit,
    asymmetry_over_time,
    inverse_fit,
    without_drift,
)
from ballbot.identification.axis.law_fits import check_determined, fit_laws, improved, initial_values
from ballbot.identification.axis.laws import AXIS_LAWS, PARAMETERS, AxisLaw, axis_law_named
from ballbot.identification.axis.load import NO_LOAD_FRICTION, load_named, possible_loads
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import (
    ClosedLoop,
    OutputErrorFit,
    Sighting,
    fit_output_error,
    memoized,
    search_output_error,
    sighting,
    whole_records,
)
from ballbot.identification.axis.prediction import (
    PredictedError,
    axis_errors,
    elsewhere_findings,
    error_elsewhere,
    predicted_error,
    with_unknown_parameters,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.residuals import ResidualTest, residual_findings, residual_tests
from ballbot.identification.axis.result import AxisIdentification, Estimate
from ballbot.identification.axis.selection import (
    Blocks,
    blocks_of,
    errors_on,
    fit_all,
    held_out_errors,
    select_horizon,
    select_law,
)
from ballbot.identification.axis.structure import TURN, AxisModel, base_name, terms_of
from ballbot.identification.axis.terms import Kind, gain_of_load, select_terms, without_refuted
from ballbot.progress import Progress, part_of


@dataclass(frozen=True, kw_only=True)
class AxisOptions:
    """How an axis is identified; what is not given is selected by held-out errors.

    Raises
    ------
    InputError
        If there is no such law, harmonic or parameter, or a bandwidth or a period is not above zero.
    """

    law: str | None = None  #: the name of one of `AXIS_LAWS`
    bandwidth: float | None = None  #: of the motion [Hz]; from sampling and noise by default
    harmonics: tuple[int, ...] | None = None  #: of a force over position
    spring: bool | None = None  #: whether a force is proportional to position
    load_friction: str | None = (
        None  #: the kind of load that dry friction depends on, one of `LOADS`, or "none"
    )
    drift: bool | None = None  #: whether the offset drifts
    period: float | None = None  #: of the first harmonic [m]; one turn of an axis that turns by default
    separate: tuple[str, ...] = ()  #: parameters of which each record has its own

    def __post_init__(self) -> None:
        if self.law is not None:
            axis_law_named(self.law)
        if self.load_friction not in (None, NO_LOAD_FRICTION):
            load_named(self.load_friction)
        for name, meaning in _ABOVE_ZERO.items():
            value = getattr(self, name)
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"--{name} is {value:g}; {meaning} must be a finite number above zero.")
        known = (*PARAMETERS, *terms_of(spring=False, harmonics=self.harmonics or ()))
        for name in self.separate:
            if name not in known:
                hint = suggest(name, known, otherwise="the parameters are")
                raise InputError(f"--separate names no parameter: {name!r}; {hint}")


_ABOVE_ZERO = {"bandwidth": "the bandwidth of the motion [Hz]", "period": "the travel of the first harmonic"}
DEFAULT_OPTIONS = AxisOptions()


#: shares of the work done when the horizon is chosen, when the laws are fitted, and when they are judged
_HORIZON_TO, _FITS_TO, _LAWS_TO, _WHOLE_FROM = 0.3, 0.5, 0.9, 0.95


def identify_axis(
    record: AxisRecord | Sequence[AxisRecord],
    *,
    options: AxisOptions = DEFAULT_OPTIONS,
    validation_records: Sequence[AxisRecord] = (),
    run: Run = DEFAULT_RUN,
) -> AxisIdentification:
    """Identify an axis's mass and friction.

    Parameters
    ----------
    record : AxisRecord or sequence of AxisRecord
        Several are fitted together. With their loop and reference, output error in closed loop is done as well.
    options : AxisOptions, optional
    validation_records : sequence of AxisRecord
        Other records of the axis, which every estimate predicts and none is fitted to.
    run : Run, optional
        Its checkpoint answers for each horizon, each law and each fit. Its seed is not used.

    Raises
    ------
    InputError
        If the records do not determine the parameters, or the options do not suit them.
    """
    records = (record,) if isinstance(record, AxisRecord) else tuple(record)
    _check(records, validation_records, options)
    wanted = None if options.law is None else axis_law_named(options.law)
    bench = _Bench(records=records, others=tuple(validation_records), bandwidth=options.bandwidth)
    blocks = blocks_of(records)
    run.progress(Progress(stage="inverse model", done=0.0, total=1.0))
    prepared, delay = _prepared_in_time(bench, options, blocks)
    bench, drifting = prepared.bench, prepared.drifting
    choosing = replace(run, progress=part_of(run.progress, 0.0, _HORIZON_TO))
    dry = AXIS_LAWS["dahl" if prepared.model.bending else "coulomb"]
    horizon = select_horizon(
        prepared.model.with_law(dry), prepared.starts[dry.name], bench.sightings, blocks, choosing
    )
    prepared = _with_best_load(prepared, dry, blocks, horizon.chosen)
    needed = _without_refuted(prepared, dry, blocks, horizon.chosen)
    model, terms, starts = needed.model, needed.terms, needed.starts
    inverse = _inverse_fits(bench, model)
    fitting = replace(run, progress=part_of(run.progress, _HORIZON_TO, _FITS_TO))
    fits = fit_laws(model, starts, bench.sightings, blocks, horizon.chosen, fitting)
    judging = replace(run, progress=part_of(run.progress, _FITS_TO, _LAWS_TO))
    selection, squares = select_law(fits, bench.sightings, blocks, horizon=horizon.chosen, run=judging)
    chosen = wanted or selection.best.model
    simulated = _improving(bench, fits, squares, chosen.name, starts, blocks, horizon.chosen, run)
    by_law = {name: bench.estimate("open loop", fit, horizon.chosen) for name, fit in fits.items()}
    estimates = [
        _inverse_estimate(bench, inverse["complete"], model, horizon.chosen),
        *simulated,
        by_law[chosen.name],
    ]
    asymmetry = drifting.asymmetry
    tests = bench.residual_tests(model, fits[chosen.name].values, over_position=needed is prepared)
    expected = _expected(bench, drifting, fits[chosen.name], squares[chosen.name], blocks, horizon.chosen)
    run.progress(Progress(stage="done", done=1.0, total=1.0))
    findings = (
        *delay_findings(records, delay),
        *axis_findings(
            bench.all, selection, by_law[chosen.name], estimates, asymmetry, by_user=wanted is not None
        ),
        *methods_differ(bench.records, by_law[chosen.name], estimates, bandwidth=options.bandwidth),
        *residual_findings(tests, model.with_law(chosen), records),
        *_elsewhere(bench, fits[chosen.name], expected),
    )
    return AxisIdentification(
        records=tuple(one.name for one in records),
        unit=records[0].unit,
        model=model.with_law(chosen),
        terms=terms,
        drift=bench.drift_from(drifting),
        horizon=horizon,
        inverse=inverse,
        laws=selection,
        estimates=tuple(estimates),
        by_law=by_law,
        asymmetry=asymmetry,
        residuals=tests,
        expected=expected,
        findings=findings,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Prepared:
    """Records with what the inverse model shows of them, and where searches begin."""

    bench: _Bench  #: without a drift of the offset
    drifting: _Bench
    model: AxisModel
    terms: tuple[tuple[str, Gain], ...]
    starts: dict[str, dict[str, float]]


def _prepared(bench: _Bench, options: AxisOptions, blocks: Blocks) -> _Prepared:
    model, terms = _structure(bench, options)
    drifting = bench
    if model.drifts:
        flat = without_drift(bench.records, model, bandwidth=options.bandwidth)
        bench, model = replace(bench, records=flat, flat=True), replace(model, drifts=0)
    starts = initial_values(bench.sightings, model, bandwidth=bench.bandwidth)
    model = replace(model, interpolated=is_interpolated(bench.sightings, model, starts, blocks))
    return _Prepared(bench=bench, drifting=drifting, model=model, terms=terms, starts=starts)


def _prepared_in_time(bench: _Bench, options: AxisOptions, blocks: Blocks) -> tuple[_Prepared, float]:
    """Return records whose forces act when they are recorded, and by how many rows they were moved for that."""
    prepared = _prepared(bench, options, blocks)
    rows = force_delay(prepared.bench.sightings, prepared.model, prepared.starts, blocks)
    return (_prepared(bench.delayed(rows), options, blocks), rows) if rows else (prepared, 0.0)


def _with_best_load(prepared: _Prepared, law: AxisLaw, blocks: Blocks, horizon: float) -> _Prepared:
    """Return what was prepared, with that of the loads whose fit is closest, if one was selected.

    The loads resemble each other, and the inverse model's error, which noise of the position biases, hardly tells them
    apart.
    """
    selected = next((name for name, _ in prepared.terms if name.startswith("load ")), None)
    if selected is None:
        return prepared
    bench, seen = prepared.bench, prepared.bench.sightings
    found = [prepared]
    for load in possible_loads(bench.records, over_position=bool(prepared.model.terms)):
        model = replace(prepared.model, load=load)
        gain = gain_of_load(bench.records, model, bandwidth=bench.bandwidth)
        if load == prepared.model.load or gain is None:
            continue
        terms = tuple((f"load {load}", gain) if one[0] == selected else one for one in prepared.terms)
        starts = initial_values(seen, model, bandwidth=bench.bandwidth)
        found.append(replace(prepared, model=model, terms=terms, starts=starts))

    def error(one: _Prepared) -> float:
        return fit_all(one.model.with_law(law), one.starts[law.name], seen, blocks, horizon, restarts=1).rms

    return min(found, key=error) if len(found) > 1 else prepared


def _without_refuted(prepared: _Prepared, law: AxisLaw, blocks: Blocks, horizon: float) -> _Prepared:
    """Return what was prepared, without the forces over position that a law's fit refutes."""
    model, seen = prepared.model.with_law(law), prepared.bench.sightings
    model, terms = without_refuted(model, prepared.starts[law.name], prepared.terms, seen, blocks, horizon)
    if terms == prepared.terms:
        return prepared
    model = model.with_law(AXIS_LAWS["coulomb"])
    starts = initial_values(seen, model, bandwidth=prepared.bench.bandwidth)
    return replace(prepared, model=model, terms=terms, starts=starts)


def _improving(
    bench: _Bench,
    fits: dict[str, OutputErrorFit],
    squares: dict[str, NDArray[np.float64]],
    law: str,
    starts: Mapping[str, dict[str, float]],
    blocks: Blocks,
    horizon: float,
    run: Run,
) -> list[Estimate]:
    """Return a law by output error over whole records; replace its fit and its held-out errors if that is better.

    Raises
    ------
    InputError
        If the records do not determine the law.
    """
    others = _simulated(bench, fits[law], starts[law], horizon, run)
    best = improved(fits[law], [one.values for one in others], bench.sightings, blocks, horizon, run)
    if best is not fits[law]:
        judged = [(horizon, False)]
        fits[law] = best
        squares[law] = held_out_errors(best, bench.sightings, blocks, horizon=horizon, judged=judged)[:, 0]
    check_determined(best, starts["coulomb"], bench.sightings, blocks, horizon)
    return others


def _expected(
    bench: _Bench,
    drifting: _Bench,
    fit: OutputErrorFit,
    squares: NDArray[np.float64],
    blocks: Blocks,
    horizon: float,
) -> PredictedError:
    """Return the error to expect on another record, whose drift and separate parameters are not known."""
    if drifting is not bench:
        drifted = errors_on(fit, drifting.sightings, blocks, range(len(blocks)), horizon)
        squares = np.maximum(squares, drifted)
    expected = predicted_error(squares, blocks, horizon=horizon)
    values = fit.model.values_from_others(fit.values)
    if values == fit.values:
        return expected
    foreign = errors_on(replace(fit, values=values), bench.sightings, blocks, range(len(blocks)), horizon)
    return with_unknown_parameters(expected, foreign)


def _elsewhere(bench: _Bench, fit: OutputErrorFit, expected: PredictedError) -> list[Finding]:
    """Return how well the other records are predicted, compared with the expected error."""
    found = [(one, error_elsewhere(fit, one, horizon=expected.horizon)) for one in bench.others]
    return elsewhere_findings(expected, found, unit=bench.records[0].unit)


def _check(
    records: Sequence[AxisRecord], validation_records: Sequence[AxisRecord], options: AxisOptions
) -> None:
    if not records:
        raise InputError("There is no record to identify the axis from.")
    if options.separate and len(records) == 1:
        raise InputError(
            f"--separate {options.separate[0]}: a parameter can be separate only between several records, and one is "
            "fitted; give more with --also, or leave it out."
        )
    everything = (*records, *validation_records)
    names = [one.name for one in everything]
    if len(set(names)) < len(names):
        raise InputError(
            f"Two of the records have the same name ({', '.join(names)}); give each its own name."
        )
    if len({one.unit for one in everything}) > 1:
        raise InputError("Some of the records are of an axis that turns and some are not; identify one axis.")
    for one in records:
        if np.ptp(one.force) == 0.0 and one.known_load.weight == 0.0:
            raise InputError(
                f"{one.name}: the force is {one.force[0] + 0.0:g} {one.force_unit} "
                "throughout, so nothing can be identified; check its column and its scale"
                + (
                    ", or give the load of a pendulum by --load-mass and --load-arm."
                    if one.unit == "rad"
                    else "."
                )
            )


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """The records that are fitted, and others that every estimate predicts."""

    records: tuple[AxisRecord, ...]
    others: tuple[AxisRecord, ...]
    bandwidth: float | None  #: that the user asks for
    flat: bool = False  #: whether a drift is subtracted from the forces

    @property
    def all(self) -> tuple[AxisRecord, ...]:
        """The records that are fitted, then the others."""
        return (*self.records, *self.others)

    @cached_property
    def sightings(self) -> list[Sighting]:
        """The records that are fitted, with their filtered motion."""
        return [sighting(one, self.band(one)) for one in self.records]

    @property
    def asymmetry(self) -> NDArray[np.float64]:
        """The asymmetry of the only record over time (parts, 2); empty for several."""
        return asymmetry_over_time(self.records[0]) if len(self.records) == 1 else np.empty((0, 2))

    def residual_tests(
        self, model: AxisModel, found: Mapping[str, float], *, over_position: bool
    ) -> tuple[ResidualTest, ...]:
        """Return the tests of the inverse model's residual, with the Stribeck speed that was found."""
        return residual_tests(
            self.records,
            model,
            bandwidth=self.bandwidth,
            over_position=over_position,
            stribeck_speed=found.get("stribeck_speed"),
        )

    def delayed(self, rows: float) -> _Bench:
        """Return records whose forces act so many rows later."""
        moved = (tuple(delayed(one, rows) for one in several) for several in (self.records, self.others))
        records, others = moved
        return replace(self, records=records, others=others)

    def drift_from(self, drifting: _Bench) -> float:
        """Return the largest range [N] of the drift that was subtracted from the forces of `drifting`."""
        pairs = zip(drifting.records, self.records, strict=True)
        return max(float(np.ptp(one.force - flat.force)) for one, flat in pairs)

    def band(self, record: AxisRecord) -> float:
        """Return the bandwidth of a record's motion [Hz]."""
        return default_bandwidth(record) if self.bandwidth is None else self.bandwidth

    def estimate(self, method: str, fit: OutputErrorFit, horizon: float) -> Estimate:
        """Return an estimate with its errors on all records."""
        numbers: list[int | None] = [*range(len(self.records)), *(None for _ in self.others)]
        return Estimate(
            method=method,
            model=fit.model,
            values=fit.values,
            standard_errors=fit.standard_errors,
            half_widths=fit.half_widths,
            errors=tuple(
                axis_errors(fit, record, number, bandwidth=self.band(record), horizon=horizon)
                for record, number in zip(self.all, numbers, strict=True)
            ),
        )


def _structure(bench: _Bench, options: AxisOptions) -> tuple[AxisModel, tuple[tuple[str, Gain], ...]]:
    """Return the model with the forces that are given or selected and its bristles, and the selected ones' gains."""
    period = TURN if options.period is None else options.period
    if options.harmonics and options.period is None and bench.records[0].unit == "m":
        raise InputError("Harmonics of an axis that slides need the travel of one period; give --period.")
    model = AxisModel(
        law=AXIS_LAWS["coulomb"],
        terms=terms_of(spring=bool(options.spring), harmonics=options.harmonics or ()),
        drifts=2 if options.drift else 0,
        period=period,
        separate=options.separate,
        records=len(bench.records),
    )
    kinds: list[Kind] = []
    if options.spring is None:
        kinds.append("spring")
    if options.harmonics is None:
        kinds.append("harmonic")
    if options.drift is None:
        kinds.append("drift")
    if options.load_friction is None:
        kinds.append("load")
    found, selected = select_terms(bench.records, model, kinds=kinds, bandwidth=options.bandwidth)
    if options.load_friction not in (None, NO_LOAD_FRICTION):
        load = load_named(options.load_friction)
        if load not in possible_loads(bench.records, over_position=bool(found.terms)):
            missing = "a load in every record (--load)" if load == "recorded" else "a force over position"
            raise InputError(
                f"--load-friction {load}: the friction can depend on that load only with {missing}."
            )
        found = replace(found, load=load)
    return found, selected


def _inverse_fits(bench: _Bench, model: AxisModel) -> dict[str, InverseFit]:
    """Return the inverse model's fits: of the moving axis, complete, and as published for one record of a slide.

    The published forms have no forces but friction and the offset, and would give numbers without meaning to an axis
    that has others.
    """
    found = {}
    if len(bench.records) == 1 and not model.terms and model.load is None:
        for form in ("coulomb", "asymmetric"):
            found[form] = inverse_fit(bench.records[0], form=form, bandwidth=bench.bandwidth)
    found["complete"] = inverse_fit(bench.records, model=model, bandwidth=bench.bandwidth, moving=True)
    return found


def _inverse_estimate(bench: _Bench, fit: InverseFit, own: AxisModel, horizon: float) -> Estimate:
    """Return the estimate of a fit of the inverse model `own`."""
    values, errors = fit.by_name, dict(zip(fit.names, fit.clustered_errors.tolist(), strict=True))
    if own.bending:
        own = own.with_law(AXIS_LAWS["dahl"])
        dry = np.mean([value for label, value in values.items() if base_name(label) == "coulomb"])
        bent = {label: float(dry) / own.bending for label in own.labels if base_name(label) == "stiffness"}
        values, errors = values | bent, errors | dict.fromkeys(bent, np.nan)
    found = OutputErrorFit(
        model=own,
        values=values,
        standard_errors=errors,
        rms=fit.relative_force_error,
        freedom=max(1, fit.blocks - len(fit.names)),
    )
    return bench.estimate("inverse", found, horizon)


def _simulated(
    bench: _Bench, fit: OutputErrorFit, start: Mapping[str, float], horizon: float, run: Run
) -> list[Estimate]:
    """Return the law of a fit by output error over whole records: in their loops, and in open loop from `start`."""
    found, sightings = [], bench.sightings
    if all(one.loop is not None for one in bench.records):
        run.progress(Progress(stage="closed loop", done=_LAWS_TO, total=1.0))
        loops = ClosedLoop(model=fit.model, sightings=sightings)
        work = partial(fit_output_error, fit.model, fit.values, loops)
        closed = memoized(run, "closed loop", fit.model, fit.values, work)
        found.append(bench.estimate("closed loop", closed, horizon))
    if all(len(one.segments) == 1 for one in bench.records):
        run.progress(Progress(stage="whole records", done=_WHOLE_FROM, total=1.0))
        work = partial(search_output_error, fit.model, start, whole_records(fit.model, sightings))
        whole = memoized(run, "whole records", fit.model, start, work)
        found.append(bench.estimate("whole record", whole, horizon))
    return found
