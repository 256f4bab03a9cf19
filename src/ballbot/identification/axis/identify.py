"""Identification of one axis by four methods, with all that is selected by its errors on held-out blocks of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.fitting.model_selection import ModelSelection
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification.axis.comparison import disagreements, largest_differences
from ballbot.identification.axis.conclusions import axis_findings, inverse_mass_findings
from ballbot.identification.axis.discrepancy import (
    Discrepancy,
    discrepancy_findings,
    discrepancy_of,
    with_another_law,
    with_discrepancy,
)
from ballbot.identification.axis.inverse import InverseFit, inverse_fit
from ballbot.identification.axis.law_fits import check_determined, fit_laws, improved
from ballbot.identification.axis.laws import AXIS_LAWS, AxisLaw, axis_law_named
from ballbot.identification.axis.outliers import outlier_findings
from ballbot.identification.axis.output_error import (
    ClosedLoop,
    OutputErrorFit,
    fit_output_error,
    search_output_error,
    whole_records,
)
from ballbot.identification.axis.prediction import (
    PredictedError,
    elsewhere_findings,
    error_elsewhere,
    predicted_error,
    shifted_parameters,
    with_unknown_parameters,
)
from ballbot.identification.axis.preparation import (
    DEFAULT_OPTIONS,
    AxisOptions,
    Bench,
    prepared_with_windows,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.residuals import residual_findings
from ballbot.identification.axis.result import AxisIdentification, Estimate
from ballbot.identification.axis.selection import (
    Blocks,
    errors_on,
    held_out_errors,
    possible_laws,
    select_law,
)
from ballbot.identification.axis.structure import AxisModel, base_name
from ballbot.progress import Progress


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
        Who watches the progress. Its seed is not used.

    Raises
    ------
    InputError
        If the records do not determine the parameters, or the options do not suit them.
    """
    records = (record,) if isinstance(record, AxisRecord) else tuple(record)
    _check(records, validation_records, options)
    wanted = None if options.law is None else axis_law_named(options.law)
    bench = Bench(records=records, others=tuple(validation_records), bandwidth=options.bandwidth)
    prepared, needed, blocks, horizon = prepared_with_windows(bench, options, run)
    bench, drifting = prepared.bench, prepared.drifting
    model, terms, starts = needed.model, needed.terms, needed.starts
    inverse = _inverse_fits(bench, model)
    fits = fit_laws(model, starts, bench.sightings, blocks, horizon.chosen, run)
    selection, squares = select_law(fits, bench.sightings, blocks, horizon=horizon.chosen, run=run)
    chosen = wanted or selection.best.model
    by_inverse = inverse_estimates(bench, inverse["complete"], model, horizon.chosen)
    simulated = _improving(
        bench, fits, squares, chosen.name, starts[chosen.name], by_inverse, blocks, horizon.chosen, run
    )
    check_determined(fits[chosen.name], starts["coulomb"], bench.sightings, blocks, horizon.chosen)
    by_law = {name: bench.estimate("open loop", fit, horizon.chosen) for name, fit in fits.items()}
    fit, others = fits[chosen.name], [*by_inverse, *simulated]
    lacking = _lacking(bench, selection, chosen, fits, blocks, horizon.chosen)
    best, doubts = _widened(bench, fit.quantile, by_law[chosen.name], others, lacking)
    by_law[chosen.name] = best
    tests = bench.residual_tests(model, fit.values, over_position=needed is prepared)
    expected = _expected(bench, drifting, fit, squares[chosen.name], blocks, horizon.chosen)
    findings = (
        *prepared.findings(records),
        *outlier_findings(fit, bench.sightings, records, blocks, horizon.chosen),
        *axis_findings(
            bench.all,
            selection,
            best,
            [*others, best],
            drifting.asymmetry,
            by_user=wanted is not None,
            asymmetric=by_law["asymmetric"],
        ),
        *inverse_mass_findings(inverse["complete"], others, records[0].unit),
        *doubts,
        *residual_findings(tests, model.with_law(chosen), records),
        *_elsewhere(bench, fit, expected),
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
        estimates=(*others, best),
        by_law=by_law,
        asymmetry=drifting.asymmetry,
        residuals=tests,
        expected=expected,
        findings=findings,
    )


def _lacking(
    bench: Bench,
    selection: ModelSelection[AxisLaw],
    chosen: AxisLaw,
    fits: Mapping[str, OutputErrorFit],
    blocks: Blocks,
    horizon: float,
) -> Discrepancy:
    """Return what the chosen law may lack, the friction of laws that the records do not exclude included."""
    lacking = discrepancy_of(fits[chosen.name], bench.sightings, blocks, horizon)
    for name, cause in possible_laws(selection, chosen, fits, bench.sightings).items():
        lacking = with_another_law(lacking, fits["coulomb"], fits[name], cause)
    return lacking


def _widened(
    bench: Bench, quantile: float, plain: Estimate, others: Sequence[Estimate], lacking: Discrepancy
) -> tuple[Estimate, list[Finding]]:
    """Return the result with intervals that include what the model lacks and other methods find, and the findings."""
    apart = disagreements(bench.records, plain, others, bandwidth=bench.bandwidth)
    between = {name: size / quantile for name, size in largest_differences(apart).items()}
    best = with_discrepancy(plain, lacking.errors, quantile)
    best = with_discrepancy(best, between, quantile)
    findings = [one.finding for one in apart]
    return best, [*findings, *discrepancy_findings(plain, lacking, bench.records[0].unit)]


def _improving(
    bench: Bench,
    fits: dict[str, OutputErrorFit],
    squares: dict[str, NDArray[np.float64]],
    law: str,
    start: Mapping[str, float],
    by_inverse: Sequence[Estimate],
    blocks: Blocks,
    horizon: float,
    run: Run,
) -> list[Estimate]:
    """Return a law by output error over whole records.

    Its fit and its held-out errors are replaced if the windows' error is less from there, or from the inverse model's.
    """
    simulated = _simulated(bench, fits[law], start, horizon, run)
    others = [one.values for one in (*simulated, *by_inverse) if one.values.keys() == fits[law].values.keys()]
    best = improved(fits[law], others, bench.sightings, blocks, horizon)
    if best is not fits[law]:
        judged = [(horizon, False)]
        fits[law] = best
        squares[law] = held_out_errors(best, bench.sightings, blocks, horizon=horizon, judged=judged)[:, 0]
    return simulated


def _expected(
    bench: Bench,
    drifting: Bench,
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
    usual = max(one.usual_force for one in bench.records)
    foreign, shifted = (
        errors_on(replace(fit, values=one), bench.sightings, blocks, range(len(blocks)), horizon)
        for one in (values, shifted_parameters(fit.model, fit.values, usual))
    )
    return with_unknown_parameters(expected, foreign, shifted)


def _elsewhere(bench: Bench, fit: OutputErrorFit, expected: PredictedError) -> list[Finding]:
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


def _inverse_fits(bench: Bench, model: AxisModel) -> dict[str, InverseFit]:
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


def inverse_estimates(bench: Bench, fit: InverseFit, own: AxisModel, horizon: float) -> list[Estimate]:
    """Return the estimate of a fit of the inverse model `own`; none if a mass is not above zero, which cannot move."""
    values, errors = fit.by_name, dict(zip(fit.names, fit.clustered_errors.tolist(), strict=True))
    masses = (
        values[own.label("mass", number)] + one.known_load.inertia for number, one in enumerate(bench.records)
    )
    if not min(masses) > 0.0:
        return []
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
    return [bench.estimate("inverse", found, horizon)]


def _simulated(
    bench: Bench, fit: OutputErrorFit, start: Mapping[str, float], horizon: float, run: Run
) -> list[Estimate]:
    """Return the law of a fit by output error over whole records: in their loops, and in open loop from `start`."""
    found, sightings = [], bench.sightings
    if all(one.loop is not None for one in bench.records):
        run.progress(Progress(stage="closed loop"))
        loops = ClosedLoop(model=fit.model, sightings=sightings)
        closed = fit_output_error(fit.model, fit.values, loops)
        found.append(bench.estimate("closed loop", closed, horizon))
    if all(len(one.segments) == 1 for one in bench.records):
        run.progress(Progress(stage="whole records"))
        whole = search_output_error(fit.model, start, whole_records(fit.model, sightings))
        found.append(bench.estimate("whole record", whole, horizon))
    return found
