"""Identification of one axis: a wheel, a motor, a joint or a slide.

1. The inverse model (`regression`) gives start values, and selects the forces over position and load: one after
   another, the one first that explains most of the force of held-out blocks of time.
2. Output error over windows (`output_error`) fits every friction law of the ladder, and selects one: the law that
   predicts held-out blocks better than the simpler law within it, if its own parameters are determined.
3. Intervals: the covariance clustered in time; and how far the parameters move, beyond chance, in fits to parts of the
   records (halves in time, single records, the faster half, windows without a reversal) and from the inverse model.

An asymmetry is not selected: blocks of the same record share whatever made it, such as a temperature.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, finding_results, note, warning
from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.model_selection import (
    Candidate,
    Gain,
    HeldOut,
    ModelSelection,
    gain_between,
    neighbours,
    select_model,
)
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import resamples
from ballbot.identification.axis.model import (
    AXIS_LAWS,
    Axis,
    AxisLaw,
    AxisModel,
    check_law,
    harmonic,
    parameter_named,
    unit_for,
)
from ballbot.identification.axis.motion import default_bandwidth, speed_at_start
from ballbot.identification.axis.output_error import (
    FOLDS,
    OutputError,
    OutputErrorFit,
    Sighting,
    blocks_of,
    fit_output_error,
    held_out_squares,
    sighting,
    window_duration,
    windows_of,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.regression import InverseFit, RegressionRows, inverse_fit, regression_rows
from ballbot.progress import Progress
from ballbot.summary import Summary, estimated, first_texts, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: a force or a law that lowers the error on held-out blocks by less than this share is not worth its parameters
USEFUL_GAIN = 0.02
#: largest p-value of the coefficients of a force that is selected
_LARGEST_CHANCE = 1e-3
#: gravity comes before a spring, which resembles it over a small travel, and before friction under a load, which
#: contains a gravity not yet found
_WORTH = {"gravity": 1.0, "spring": 0.3, "load": 0.3}
#: coefficients within so many standard errors of zero by output error are those of no force
_REFUTED = 2.0
#: of the columns of a wider model, each of length one
_LARGEST_CONDITION = 300.0
#: Stribeck speeds that a fit begins at, over the fastest speed
_STRIBECK_STARTS = (0.03, 0.15)
#: a break-away force fades if its speed is below this share of the fastest; it represents another curve otherwise
_FADES = 0.5
#: slower than this share of its usual speed, an axis reverses or rests
_SLOW = 0.1
#: a window whose error is so many times the usual one is named
_FAR = 10.0
#: a part of the records determines a parameter if its move has an error of less than so many of the whole fit's, as
#: that of a quarter of the windows has
_KNOWN = 2.0
#: standard errors that a difference or an effect is beyond, where chance makes one in 1,000 cases
_CLEAR = 3.3
#: least share of the residual force's variance that a dependence explains
_LEAST_SHARE = 0.05
_DRAWS, _SEED = 2000, 0


@dataclass(frozen=True, kw_only=True)
class AxisOptions:
    """How an axis is identified; what is None is selected by errors on held-out blocks.

    Raises
    ------
    InputError
        If there is no such law or harmonic, or the bandwidth is not above zero.
    """

    law: str | None = None  #: see `AXIS_LAWS`
    bandwidth: float | None = None  #: of the motion [Hz], which sets the filters
    harmonics: tuple[int, ...] | None = None  #: of the force over position
    spring: bool | None = None
    load_friction: bool | None = None
    known: Mapping[str, float] = field(default_factory=dict)  #: parameters that are not estimated, by name

    def __post_init__(self) -> None:
        if self.law is not None:
            check_law(self.law)
        if self.bandwidth is not None and not 0.0 < self.bandwidth < np.inf:
            raise InputError(
                f"--bandwidth is {self.bandwidth:g}; it must be a finite number above zero [Hz]."
            )
        for number in self.harmonics or ():
            harmonic(number)


DEFAULT_OPTIONS = AxisOptions()


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    record: str
    window_rmse: float  #: of the position over windows from their best starts [m]
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]; NaN if it has gaps


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """One method's parameters and their prediction errors."""

    method: str  #: "inverse" or "output error"
    model: AxisModel
    values: dict[str, float]  #: by name, SI units
    standard_errors: dict[str, float]  #: by name, of the whole interval; NaN for a parameter at a bound
    half_widths: dict[str, float]  #: of the 95 % intervals, by name
    correlation: NDArray[np.float64]  #: (p, p) of the errors; empty of the inverse model
    errors: tuple[AxisErrors, ...]  #: on the records fitted, then on the others

    @property
    def law(self) -> AxisLaw:
        """Its friction law."""
        return self.model.law

    def axis(self) -> Axis:
        """Return the axis."""
        return self.model.axis(self.values)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        intervals = {
            name: [value - self.half_widths[name], value + self.half_widths[name]]
            for name, value in self.values.items()
        }
        return {
            "method": self.method,
            "law": self.law.name,
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "intervals_95": intervals,
            "errors": {
                one.record: {k: v for k, v in vars(one).items() if k != "record"} for one in self.errors
            },
        }


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class AxisIdentification:
    """An axis, identified."""

    records: tuple[str, ...]  #: that were fitted
    unit: str  #: of positions: "m" or "rad"
    terms: tuple[tuple[str, Gain], ...]  #: forces over position and load that were selected, and their gains
    window: float  #: length of the windows [s]
    inverse: Estimate  #: the law's linear part by the inverse model, of the moving axis
    best: Estimate  #: the law that was selected or requested, by output error
    by_law: dict[str, Estimate]  #: every law by output error
    laws: ModelSelection[AxisLaw]  #: every law, by its errors on held-out blocks
    expected: tuple[float, float, float]  #: error over windows on held-out blocks [m], and its 95 % interval
    findings: tuple[Finding, ...]

    @property
    def chosen(self) -> AxisLaw:
        """The friction law."""
        return self.best.law

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The chosen law by both steps."""
        return self.inverse, self.best

    def summary(self) -> Summary:
        """Return the law's parameters with their standard errors, the error to expect elsewhere, and findings."""
        best, unit = self.best, f"m{self.unit}"
        rows = [
            (name, estimated(value, best.standard_errors[name], unit_for(parameter_named(name), self.unit)))
            for name, value in best.values.items()
        ]
        error, low, high = (1e3 * one for one in self.expected)
        words = (
            f"{error:.3g} {unit} RMS over {self.window:.3g} s, 95 % interval {low:.3g} to {high:.3g} {unit}"
        )
        return Summary(
            title=f"Axis of {', '.join(self.records)}, law {self.chosen.name}: value ± standard error",
            rows=(*rows, ("error elsewhere", words)),
            sentences=first_texts(self.findings),
        )

    def plot(self) -> Figure:
        """Return a figure of each law's gain on held-out blocks over the simpler law within it."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "records": list(self.records),
            "unit": self.unit,
            "law": self.chosen.name,
            "terms": {name: gain.to_dict() for name, gain in self.terms},
            "force_between_rows": "interpolated" if self.best.model.interpolated else "held",
            "window": self.window,
            "parameters": self.best.values,
            "standard_errors": self.best.standard_errors,
            "estimates": {one.method: one.to_dict() for one in self.estimates},
            "selection": [_law_result(one) for one in self.laws.candidates],
            "laws": {name: one.to_dict() for name, one in self.by_law.items()},
            "expected_elsewhere": {"position_rmse": self.expected[0], "interval_95": list(self.expected[1:])},
            "findings": finding_results(self.findings),
        }


def _law_result(one: Candidate[AxisLaw]) -> dict[str, object]:
    gain = one.gain
    return {
        "law": one.name,
        "below": one.within,
        "held_out_rms": float(np.sqrt(one.held_out.squares.mean())),
        "gain": gain.share if gain else np.nan,
        "gain_interval": [gain.lower, gain.upper] if gain else [np.nan, np.nan],
    }


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
        Several are fitted together.
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
    run.progress(Progress(stage="inverse model"))
    band = options.bandwidth
    seen = [sighting(one, band or default_bandwidth(one)) for one in records]
    others = [sighting(one, band or default_bandwidth(one)) for one in validation_records]
    model, terms = _model(seen, options)
    first = _fit("coulomb", model, seen, band)
    model, terms, first = _confirmed(model, terms, first, seen, options)
    fits = {"coulomb": first}
    for number, name in enumerate(AXIS_LAWS):
        run.progress(Progress(stage=f"law {name}", done=number, total=len(AXIS_LAWS)))
        if name != "coulomb":
            fits[name] = _fit(name, model, seen, band)
    run.progress(Progress(stage="held-out blocks"))
    squares = {name: held_out_squares(fits[name]) for name in AXIS_LAWS}
    laws = _select_law(fits, squares, seen)
    chosen = options.law or laws.best.name
    by_law = {name: _estimate(fit, seen, others) for name, fit in fits.items()}
    fit = fits[chosen]
    linear = fit.model.with_law("coulomb") if chosen == "stribeck" else fit.model
    moving = inverse_fit(records, linear, bandwidth=band, moving=True)
    best, lacks = _widened(by_law[chosen], fit, moving)
    errors = dict(zip(moving.names, moving.clustered_errors.tolist(), strict=True))
    found = AxisIdentification(
        records=tuple(one.name for one in records),
        unit=records[0].unit,
        terms=terms,
        window=window_duration(records),
        inverse=Estimate(
            method="inverse",
            model=linear,
            values=moving.by_name,
            standard_errors=errors,
            half_widths={name: 1.96 * error for name, error in errors.items()},
            correlation=np.empty((0, 0)),
            errors=_errors(linear, moving.by_name, seen, others),
        ),
        best=best,
        by_law=by_law | {chosen: best},
        laws=laws,
        expected=_expected(squares[chosen]),
        findings=(),
    )
    findings = (
        *_law_findings(found, by_user=options.law is not None),
        *lacks,
        *_undetermined(best),
        *_delayed(fit),
        *_outliers(fit),
        *_residual_findings(records, best, band),
        *_elsewhere(found),
    )
    return replace(found, findings=findings)


def _check(
    records: Sequence[AxisRecord], validation_records: Sequence[AxisRecord], options: AxisOptions
) -> None:
    everything = (*records, *validation_records)
    names = [one.name for one in everything]
    if not records:
        raise InputError("There is no record to identify the axis from.")
    if options.harmonics and records[0].unit == "m":
        raise InputError("An axis that slides has no turn for --harmonics.")
    if len(set(names)) < len(names):
        raise InputError(
            f"Two of the records have the same name ({', '.join(names)}); give each its own name."
        )
    if len({one.unit for one in everything}) > 1:
        raise InputError("Some of the records are of an axis that turns and some are not; identify one axis.")
    for one in records:
        if np.ptp(one.force) == 0.0:
            raise InputError(
                f"{one.name}: the force is {one.force[0] + 0.0:g} {one.force_unit} throughout, so nothing can be "
                "identified; check its column and its scale."
            )


Terms = tuple[tuple[str, Gain], ...]


def _model(seen: Sequence[Sighting], options: AxisOptions) -> tuple[AxisModel, Terms]:
    """Return the model with the law `coulomb` and the forces requested or selected, and the gains of the selected."""
    harmonics = [name for number in dict.fromkeys(options.harmonics or ()) for name in harmonic(number)]
    records = [one.record for one in seen]
    requested = AxisModel(
        law=AXIS_LAWS["coulomb"],
        terms=(*(("spring",) if options.spring else ()), *harmonics),
        load=bool(options.load_friction),
        held=options.known,
        # rows at uneven times are not those of the loop that holds the force
        interpolated=not all(one.even for one in records),
    )
    model, gains = select_forces(records, requested, options)
    if model.interpolated:
        return model, gains
    # a log that is slower than its loop contains some of its rows; the force changes between them
    held, between = (
        _fit("coulomb", replace(model, interpolated=one), seen, options.bandwidth) for one in (False, True)
    )
    if between.rms < (1.0 - USEFUL_GAIN) * held.rms:
        return select_forces(records, replace(requested, interpolated=True), options)
    return model, gains


def select_forces(
    records: Sequence[AxisRecord], model: AxisModel, options: AxisOptions = DEFAULT_OPTIONS
) -> tuple[AxisModel, Terms]:
    """Return a model with the forces over position and load that the records support, and the gain of each."""
    gains = list[tuple[str, Gain]]()
    squares = _held_out_force(regression_rows(records, model, bandwidth=options.bandwidth, moving=True))
    while True:
        found = [
            (name, wider, gain, own)
            for name, wider in _wider(records, model, options)
            for gain, own in _gains_of(records, model, wider, squares, options.bandwidth)
        ]
        if not found:
            return model, tuple(gains)
        name, model, gain, squares = max(found, key=lambda one: one[2].share * _WORTH[one[0]])
        gains.append((name, gain))


def _wider(
    records: Sequence[AxisRecord], model: AxisModel, options: AxisOptions
) -> Iterator[tuple[str, AxisModel]]:
    """Yield models with one force more, of those that the user left open."""
    if options.spring is None and "spring" not in model.terms:
        yield "spring", replace(model, terms=("spring", *model.terms))
    # without a force over position it is part of b and c
    if options.load_friction is None and not model.load and model.terms:
        yield "load", replace(model, load=True)
    if options.harmonics is None and records[0].unit == "rad" and "sin_1" not in model.terms:
        yield "gravity", replace(model, terms=(*model.terms, *harmonic(1)))


def _held_out_force(rows: RegressionRows) -> NDArray[np.float64]:
    """Return the sum of squared errors of the force in each block (blocks, 1), fitted without every third block."""
    X, squares = rows.design, np.empty((int(rows.block.max()) + 1, 1))
    for fold in range(FOLDS):
        out = rows.block % FOLDS == fold
        values = np.linalg.lstsq(X[~out], rows.force[~out], rcond=None)[0]
        left = rows.force[out] - X[out] @ values
        sums = np.bincount(rows.block[out], weights=left**2, minlength=len(squares))
        squares[fold::FOLDS, 0] = sums[fold::FOLDS]
    return squares


def _gains_of(
    records: Sequence[AxisRecord],
    model: AxisModel,
    wider: AxisModel,
    squares: NDArray[np.float64],
    bandwidth: float | None,
) -> Iterator[tuple[Gain, NDArray[np.float64]]]:
    """Yield what a wider model gains, and its squares on held-out blocks, if the records support it."""
    rows = regression_rows(records, wider, bandwidth=bandwidth, moving=True)
    X = rows.design
    lengths = np.linalg.norm(X, axis=0)
    if not lengths.all() or np.linalg.cond(X / lengths) > _LARGEST_CONDITION:
        return
    fit = fit_linear(X, rows.force, rows.block)
    names = list(rows.columns)
    own = [place for place, name in enumerate(names) if name not in model.names]
    if not fit.p_value(own) < _LARGEST_CHANCE:
        return
    if wider.load and not 0.0 < fit.values[names.index("load")] < 1.0:
        return
    ours = _held_out_force(rows)
    gain = gain_between(ours, squares, neighbours(range(len(ours)), block=1))
    if gain.significant and gain.share >= 0.5 * USEFUL_GAIN:
        yield gain, ours


def _fit(law: str, model: AxisModel, seen: Sequence[Sighting], bandwidth: float | None) -> OutputErrorFit:
    """Fit a law by output error from the inverse model's values."""
    own, records = model.with_law(law), [one.record for one in seen]
    linear = model.with_law("coulomb") if law == "stribeck" else own
    start = inverse_fit(records, linear, bandwidth=bandwidth, moving=True).by_name
    if start.get("mass", 1.0) <= 0.0:
        raise InputError(
            f"{records[0].name}: the inverse model estimates a mass of {start['mass']:.3g}, which must be above zero. "
            "The sign of the force or its column is wrong, or the force is delayed."
        )
    duration = window_duration(records)
    problem = OutputError(model=own, windows=tuple(windows_of(one, duration) for one in seen))
    if law != "stribeck":
        return fit_output_error(problem, start)
    fastest = max(float(np.abs(one.motion.speed).max()) for one in seen)
    found = [
        fit_output_error(
            problem, {**start, "stribeck": 0.2 * start["coulomb"], "stribeck_speed": share * fastest}
        )
        for share in _STRIBECK_STARTS
    ]
    return min(found, key=lambda fit: fit.rms)


def _confirmed(
    model: AxisModel, terms: Terms, fit: OutputErrorFit, seen: Sequence[Sighting], options: AxisOptions
) -> tuple[AxisModel, Terms, OutputErrorFit]:
    """Return the model without selected forces that output error refutes, which noise of the position does not bias."""
    for term, _ in terms:
        names = harmonic(1) if term == "gravity" else (term,)
        sizes = [abs(fit.values[name]) / max(fit.standard_errors[name], 1e-300) for name in names]
        if all(not size > _REFUTED for size in sizes):
            kept = tuple(one for one in model.terms if one not in names)
            model = replace(model, terms=kept, load=model.load and term != "load")
            terms = tuple(one for one in terms if one[0] != term)
            fit = _fit("coulomb", model, seen, options.bandwidth)
    return model, terms, fit


def _select_law(
    fits: Mapping[str, OutputErrorFit], squares: Mapping[str, NDArray[np.float64]], seen: Sequence[Sighting]
) -> ModelSelection[AxisLaw]:
    """Select a law among those fitted, by the mean square errors of windows held out (w,)."""
    groups = blocks_of(len(squares["coulomb"]))

    def held_out(name: str, inner: AxisLaw | None) -> HeldOut[AxisLaw]:  # noqa: ARG001 (fits are made)
        return HeldOut(model=AXIS_LAWS[name], squares=squares[name][:, None], baseline=None, groups=groups)

    within = {name: law.below for name, law in AXIS_LAWS.items()}
    selection = select_model(
        within, held_out, eligible=[name for name in within if AXIS_LAWS[name].symmetric]
    )
    best = selection.best
    fastest = max(float(np.quantile(np.abs(one.motion.speed), 0.95)) for one in seen)
    while best.within and best.gain:
        fit = fits[best.name]
        own = [name for name in best.model.names if name not in AXIS_LAWS[best.within].names]
        determined = all(fit.standard_errors[name] < abs(fit.values[name]) for name in own)
        fades = fit.values.get("stribeck_speed", 0.0) < _FADES * fastest
        if determined and fades and best.gain.share >= USEFUL_GAIN:
            break
        best = selection.find(best.within)
    dry = fits["coulomb"]
    if best.name == "viscous" and dry.values["coulomb"] > _CLEAR * dry.standard_errors["coulomb"]:
        # noise of the position may be most of the error, and hide a friction that is known to a few percent
        best = selection.find("coulomb")
    return ModelSelection(candidates=selection.candidates, best=best)


def _estimate(fit: OutputErrorFit, seen: Sequence[Sighting], others: Sequence[Sighting]) -> Estimate:
    return Estimate(
        method="output error",
        model=fit.model,
        values=fit.values,
        standard_errors=fit.standard_errors,
        half_widths={name: fit.quantile * error for name, error in fit.standard_errors.items()},
        correlation=fit.correlation,
        errors=_errors(fit.model, fit.values, seen, others),
    )


def _errors(
    model: AxisModel, values: dict[str, float], seen: Sequence[Sighting], others: Sequence[Sighting]
) -> tuple[AxisErrors, ...]:
    """Return how well parameters predict the records fitted, and others, over windows and whole."""
    duration, axis, found = window_duration([one.record for one in seen]), model.axis(values), []
    for one in (*seen, *others):
        record = one.record
        windows = windows_of(one, duration)
        squares = OutputError(model=model, windows=(windows,)).squares(values)
        counts = np.bincount(windows.compared[2])
        whole = np.nan
        if len(record.segments) == 1:
            start = np.array([[record.position[0], speed_at_start(record)]])
            last = np.array([len(record) - 1])
            moved = axis.windows(record, np.array([0]), last, start, interpolated=model.interpolated)
            whole = float(np.sqrt(np.mean((moved - record.position[1:]) ** 2)))
        found.append(
            AxisErrors(
                record=record.name,
                window_rmse=float(np.sqrt(np.sum(squares * counts) / counts.sum())),
                open_loop_rmse=whole,
            )
        )
    return tuple(found)


def _widened(plain: Estimate, fit: OutputErrorFit, inverse: InverseFit) -> tuple[Estimate, list[Finding]]:
    """Return the result with intervals that contain what differs between parts and methods, and a finding on that."""
    names = list(fit.values)
    lacks, causes = np.zeros(len(names)), [""] * len(names)
    for cause, windows in _parts(fit):
        moves, errors = fit.moved_by(windows)
        # a part that hardly determines a parameter says nothing about it
        known = errors < _KNOWN * np.array(list(fit.standard_errors.values()))
        beyond = np.sqrt(np.maximum(np.where(known, moves**2 - errors**2, 0.0), 0.0))
        for i in np.flatnonzero(beyond > lacks):
            lacks[i], causes[i] = beyond[i], cause
    for i, name in enumerate(names):
        if name not in inverse.names:
            continue
        at = inverse.names.index(name)
        chance = (
            np.nan_to_num(inverse.clustered_errors[at]) ** 2 + np.nan_to_num(fit.standard_errors[name]) ** 2
        )
        apart = (fit.values[name] - inverse.values[at]) ** 2
        if apart - chance > lacks[i] ** 2:
            lacks[i], causes[i] = np.sqrt(apart - chance), "by the inverse model"
    # a parameter at a bound has no interval
    errors = {
        name: float(np.hypot(fit.standard_errors[name], lack))
        for name, lack in zip(names, lacks, strict=True)
    }
    halves = {name: fit.quantile * error for name, error in errors.items()}
    best = replace(plain, standard_errors=errors, half_widths=halves)
    most = [i for i, name in enumerate(names) if lacks[i] > _CLEAR * fit.standard_errors[name]]
    if not most:
        return best, []
    words = []
    for cause in dict.fromkeys(causes[i] for i in most):
        moved = [f"{parameter_named(names[i]).symbol} by {lacks[i]:.2g}" for i in most if causes[i] == cause]
        words.append(f"{', '.join(moved)} {cause}")
    text = (
        "The model may lack something: parameters differ by more than chance between parts or methods "
        f"({'; '.join(words)}). The 95 % intervals include that."
    )
    return best, [note("discrepancy", text)]


def _parts(fit: OutputErrorFit) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield parts of the records, as windows (w,), each with what a fit to it is."""
    speeds, slow, record = [], [], []
    for number, one in enumerate(fit.problem.windows):
        speed = np.abs(one.seen.motion.speed)
        for first, count in zip(one.firsts.tolist(), one.counts.tolist(), strict=True):
            part = speed[first : first + count + 1]
            speeds.append(float(np.sqrt(np.mean(part**2))))
            slow.append(float(part.min()) < _SLOW * one.seen.usual_speed)
            record.append(number)
    count, numbers = len(speeds), np.array(record)
    time = np.arange(count) < count // 2
    yield "in the first half", time
    yield "in the second half", ~time
    yield "in the faster half of the windows", np.array(speeds) >= np.median(speeds)
    yield "without the windows that reverse or rest", ~np.array(slow)
    if len(set(record)) > 1:
        for number in set(record):
            yield f"in record {number + 1}", numbers == number


def _expected(squares: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the error [m] of held-out windows with mean square errors (w,), with the interval of a like record's."""
    groups = blocks_of(len(squares))
    means = np.array([squares[one].mean() for one in groups])
    drawn = np.sqrt(resamples(len(means), block=1, repeats=_DRAWS, seed=_SEED) @ means / len(means))
    middle = float(np.sqrt(squares.mean()))
    # this record's mean varies as the other one's does
    spread = np.sqrt(2.0) * float(np.std(np.log(np.maximum(drawn, 1e-300))))
    return middle, middle * float(np.exp(-1.96 * spread)), middle * float(np.exp(1.96 * spread))


#: what to do about a residual force that depends on a quantity
_ADVICE = {
    "position": "a force over position is missing: try --harmonics or --spring",
    "speed": "friction is no straight line over speed: compare the laws",
    "time": "friction or the constant force drifts; record the warm machine",
}


def _residual_findings(
    records: Sequence[AxisRecord], best: Estimate, bandwidth: float | None
) -> Iterator[Finding]:
    """Warn if the force that the result leaves depends on position, speed or time, by straight pieces over each."""
    rows = regression_rows(records, best.model, bandwidth=bandwidth, moving=True)
    left = rows.force - rows.design @ np.array([best.values[name] for name in rows.columns])
    if "stribeck" in best.values:
        speed = rows.seen["speed"]
        fading = np.exp(-np.abs(speed) / best.values["stribeck_speed"]) * np.sign(speed)
        left = left - best.values["stribeck"] * fading
    for quantity, column in rows.seen.items():
        edges = np.unique(np.quantile(column, np.linspace(0.0, 1.0, 6)))
        if len(edges) < 3:
            continue
        shapes = np.column_stack([np.interp(column, edges, one) for one in np.eye(len(edges))])
        fit = fit_linear(shapes, left, rows.block)
        chance = fit.p_value(range(shapes.shape[1]))
        share = float(np.mean((shapes @ fit.values - np.mean(left)) ** 2) / max(np.var(left), 1e-300))
        if chance < _LARGEST_CHANCE and share > _LEAST_SHARE:
            yield warning(
                "axis-residuals",
                f"The residual force depends on the {quantity} (p = {chance:.1g}; {100.0 * min(share, 1.0):.0f} % "
                f"of its variance): {_ADVICE[quantity]}.",
            )


def _law_findings(found: AxisIdentification, *, by_user: bool) -> Iterator[Finding]:
    chosen = found.chosen.name
    words = f"The law {chosen} was {'requested' if by_user else 'selected'}"
    if by_user and found.laws.best.name != chosen:
        words += f"; held-out blocks would select {found.laws.best.name}"
    open_laws = [one.name for one in found.laws.candidates if one.decision == "undecided" and one.gain]
    if open_laws:
        words += f". Held-out blocks do not decide about {' and '.join(open_laws)}"
    yield note("law", f"{words}.")
    both = found.laws.find("asymmetric")
    if both.accepted and both.gain and found.chosen.symmetric:
        ours, theirs = found.best.errors, found.by_law["asymmetric"].errors
        others = [(a, b) for a, b in zip(ours, theirs, strict=True) if a.record not in found.records]
        better = [a.record for a, b in others if b.window_rmse < a.window_rmse]
        confirmed = (
            "no other record shows whether the machine or this run has it"
            if not others
            else f"{len(better)} of {len(others)} other records are predicted better with it"
        )
        yield note(
            "asymmetry",
            f"Friction that differs between directions predicts other blocks of these records with "
            f"{100.0 * both.gain.share:.0f} % less error; {confirmed}. It is not selected: --law asymmetric does.",
        )


def _undetermined(best: Estimate) -> Iterator[Finding]:
    for name, value in best.values.items():
        error, kind = best.standard_errors[name], parameter_named(name)
        if kind.scale == "signed":
            continue
        if not np.isfinite(error):
            yield warning("at-bound", f"{kind.symbol} ({kind.meaning}) is at its bound, {value:.3g}.")
        elif error > abs(value):
            yield warning(
                "undetermined",
                f"The records do not determine {kind.symbol} ({kind.meaning}): its standard error is larger than its "
                "value.",
            )


def _delayed(fit: OutputErrorFit) -> Iterator[Finding]:
    """Warn if the motion shows that the force acts later or earlier than its rows."""
    records = [one.seen.record for one in fit.problem.windows]
    row = max(one.sample_time for one in records)
    begun = fit.problem.starts(fit.values)
    change = replace(fit.problem, late=row).errors(fit.values) - begun.errors
    column = begun.project(change) / row
    free = np.linalg.norm(fit.slopes, axis=0) > 0.0
    X = np.column_stack([fit.slopes[:, free], column])
    lengths = np.linalg.norm(X, axis=0)
    if not lengths.all() or np.linalg.cond(X / lengths) > _LARGEST_CONDITION:
        return
    found = fit_linear(X / lengths, -fit.residuals, fit.problem.window)
    late, error = float(found.values[-1] / lengths[-1]), float(found.errors[-1] / lengths[-1])
    if abs(late) > max(_CLEAR * error, 0.5 * row):
        text = (
            f"The force seems to act {1e3 * abs(late):.2g} ± {1e3 * error:.2g} ms "
            f"{'later' if late > 0.0 else 'earlier'} than its rows, as behind a bus or a filter, or the drive yields "
            "or has play: then inertia and viscous friction are off. Shift the force if you know its delay."
        )
        yield warning("force-delay", text)


def _outliers(fit: OutputErrorFit) -> Iterator[Finding]:
    """Name the windows that are predicted far worse than the others."""
    counts = np.bincount(fit.problem.window)
    errors = np.sqrt(np.bincount(fit.problem.window, weights=fit.residuals**2) / counts)
    far = np.flatnonzero(errors > _FAR * np.median(errors))
    if 0 < len(far) <= 0.1 * len(errors):
        firsts = [
            f"{one.seen.record.name}, rows {first + 1} to {first + count + 1}"
            for one in fit.problem.windows
            for first, count in zip(one.firsts.tolist(), one.counts.tolist(), strict=True)
        ]
        text = (
            f"{len(far)} of {len(errors)} windows are predicted more than {_FAR:.0f} times worse than the others "
            f"({'; '.join(firsts[i] for i in far[:3])}): look for lost messages, touches or hits there, and leave "
            "corrupted cells empty."
        )
        yield warning("outliers", text)


def _elsewhere(found: AxisIdentification) -> Iterator[Finding]:
    """Compare the errors on other records with the error expected there."""
    middle, low, high = found.expected
    for one in found.best.errors:
        if one.record not in found.records:
            fits = (
                "as expected"
                if low <= one.window_rmse <= high
                else "better"
                if one.window_rmse < low
                else "worse"
            )
            unit = f"m{found.unit}"
            text = (
                f"{one.record} is predicted {fits}{'' if fits == 'as expected' else ' than expected'}: "
                f"{1e3 * one.window_rmse:.3g} {unit}, expected {1e3 * middle:.3g} ({1e3 * low:.3g} to "
                f"{1e3 * high:.3g})."
            )
            yield warning("other-record", text) if fits == "worse" else note("other-record", text)
