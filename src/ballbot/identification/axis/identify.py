"""Identification of one axis: a wheel, a motor, a joint or a slide.

1. The inverse model (`motion`) gives start values.
2. Output error over windows (`experiment`) fits nested models, and each is kept that predicts held-out blocks of time
   better than the simpler one: gravity, friction under load, and a law of friction, if its own parameters are
   determined.
3. Intervals: the covariance clustered in time; and how far the parameters are, beyond chance, from those of the inverse
   model and of each record by itself.

An asymmetry is not selected: blocks of the same record share whatever made it, such as a temperature.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.findings import Finding, finding_results, note, warning
from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.model_selection import Gain, gain_between
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import resamples
from ballbot.identification.axis.experiment import AxisEstimate, blocks_of, fit_axis, window_duration
from ballbot.identification.axis.model import FORCES, LAWS, PARAMETERS, AxisModel, unit_for
from ballbot.identification.axis.motion import AxisMotion, inverse_model, motion_of, with_gravity
from ballbot.identification.axis.record import AxisRecord
from ballbot.progress import Progress
from ballbot.summary import Summary, estimated, first_texts, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: a force or a law that lowers the error on held-out blocks by less than this share is not worth its parameters
USEFUL_GAIN = 0.02
#: Stribeck speeds that a fit begins at, over the fastest speed, and shares of the load
_STRIBECK_STARTS, _LOAD_START = (0.03, 0.15), 0.05
#: a break-away force fades if its speed is below this share of the fastest; it represents another curve otherwise
_FADES = 0.5
#: standard errors that a difference or an effect is beyond, where chance makes one in 1,000 cases
_CLEAR = 3.3
#: least share of the residual force's variance that a dependence explains, and the largest p-value of it
_LEAST_SHARE, _LARGEST_CHANCE = 0.05, 1e-3
_DRAWS, _SEED = 2000, 0


@dataclass(frozen=True, kw_only=True)
class AxisOptions:
    """How an axis is identified; what is None is selected by errors on held-out blocks.

    InputError if there is no such law.
    """

    law: str | None = None
    """The friction law: viscous, coulomb, stribeck or asymmetric."""

    gravity: bool | None = None
    """Whether gravity acts on an axis that turns: S sin q + C cos q."""

    load_friction: bool | None = None
    """Whether dry friction grows with the load that the gears transmit, |F + G| / 2."""

    def __post_init__(self) -> None:
        if self.law is not None and self.law not in LAWS:
            hint = suggest(self.law, LAWS, otherwise="the laws are")
            raise InputError(f"There is no friction law {self.law!r} (--law); {hint}")


DEFAULT_OPTIONS = AxisOptions()
_NOTHING: Mapping[str, float] = MappingProxyType({})


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class AxisIdentification:
    """An axis, identified."""

    records: tuple[str, ...]  #: that were fitted
    unit: str  #: of positions: "m" or "rad"
    forces: dict[str, Gain]  #: gravity and load that were selected, with their gains
    window: float  #: length of the windows [s]
    law: str  #: that was selected or requested
    #: the laws that were fitted: all, or the requested one and a simpler one; errors of `law` include what it may lack
    by_law: dict[str, AxisEstimate]
    expected: tuple[float, float, float]  #: error over windows on held-out blocks [m], and its 95 % interval
    findings: tuple[Finding, ...]

    @property
    def best(self) -> AxisEstimate:
        """The estimate by the law that was selected or requested."""
        return self.by_law[self.law]

    def summary(self) -> Summary:
        """Return the law's parameters with their standard errors, the error to expect elsewhere, and findings."""
        best, unit = self.best, f"m{self.unit}"
        rows = [
            (name, estimated(value, best.standard_errors[name], unit_for(PARAMETERS[name], self.unit)))
            for name, value in best.values.items()
        ]
        error, low, high = (1e3 * one for one in self.expected)
        words = (
            f"{error:.3g} {unit} RMS over {self.window:.3g} s, 95 % interval {low:.3g} to {high:.3g} {unit}"
        )
        return Summary(
            title=f"Axis of {', '.join(self.records)}, law {self.law}: value ± standard error",
            rows=(*rows, ("error elsewhere", words)),
            sentences=first_texts(self.findings),
        )

    def plot(self) -> Figure:
        """Return a figure of what each law gains on held-out blocks over the simpler law."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "records": list(self.records),
            "unit": self.unit,
            "law": self.law,
            "terms": {name: gain.to_dict() for name, gain in self.forces.items()},
            "force_between_rows": "interpolated" if self.best.model.interpolated else "held",
            "window": self.window,
            "parameters": self.best.values,
            "standard_errors": self.best.standard_errors,
            "laws": {name: one.to_dict() for name, one in self.by_law.items()},
            "expected_elsewhere": {"position_rmse": self.expected[0], "interval_95": list(self.expected[1:])},
            "findings": finding_results(self.findings),
        }


def identify_axis(
    record: AxisRecord | Sequence[AxisRecord],
    *,
    options: AxisOptions = DEFAULT_OPTIONS,
    known: Mapping[str, float] = _NOTHING,
    validation_records: Sequence[AxisRecord] = (),
    run: Run = DEFAULT_RUN,
) -> AxisIdentification:
    """Identify an axis's mass and friction.

    InputError if the records do not determine the parameters, or the options do not suit them.

    Parameters
    ----------
    record : AxisRecord or sequence of AxisRecord
        Several are fitted together.
    options : AxisOptions, optional
    known : mapping of str to float, optional
        Parameters that are not estimated, by name.
    validation_records : sequence of AxisRecord
        Other records of the axis, which every estimate predicts and none is fitted to.
    run : Run, optional
        Who watches the progress. Its seed is not used.
    """
    records = (record,) if isinstance(record, AxisRecord) else tuple(record)
    _check(records, validation_records, options)
    run.progress(Progress(stage="forces"))
    seen, others = ([motion_of(one) for one in several] for several in (records, validation_records))
    first, forces = _with_forces(seen, options, known)
    law, duration = options.law, window_duration(seen)
    # a law that is requested is fitted beside the simpler one
    wanted = [name for name in LAWS if law is None or name in (law, LAWS[law][1] or "coulomb")]
    fits = dict[str, AxisEstimate]()
    for number, name in enumerate(wanted):
        run.progress(Progress(stage=f"law {name}", done=number, total=len(wanted)))
        fits[name] = first if name == "coulomb" else _fit_law(name, first)
    run.progress(Progress(stage="held-out blocks"))
    for name, fit in fits.items():
        simpler = fits.get(LAWS[name][1])
        errors = {one.record.name: fit.on(one, duration) for one in (*seen, *others)}
        fits[name] = replace(fit, errors=errors, gain=_gain(fit, simpler) if simpler else None)
    chosen = law or _selected(fits)
    best, lacks = _widened(fits[chosen])
    expected = _expected(fits[chosen].held_out)
    findings = (
        note("law", f"The law {chosen} was {'requested' if law else 'selected'}."),
        *(() if law else _asymmetry_findings(best, fits["asymmetric"])),
        *lacks,
        *_undetermined(best),
        *_delayed(fits[chosen]),
        *_residual_findings(best),
        *_elsewhere(best, expected, [one.name for one in validation_records]),
    )
    return AxisIdentification(
        records=tuple(one.name for one in records),
        unit=records[0].unit,
        forces=forces,
        window=duration,
        law=chosen,
        by_law=fits | {chosen: best},
        expected=expected,
        findings=findings,
    )


def _check(
    records: Sequence[AxisRecord], validation_records: Sequence[AxisRecord], options: AxisOptions
) -> None:
    names = [one.name for one in (*records, *validation_records)]
    if options.gravity and records[0].unit == "m":
        raise InputError(
            "An axis that slides has no gravity over its position (--gravity), but in its offset."
        )
    if len(set(names)) < len(names):
        raise InputError(
            f"Two of the records have the same name ({', '.join(names)}); give each its own name."
        )
    for one in records:
        if np.ptp(one.force) == 0.0:
            raise InputError(
                f"{one.name}: the force is {one.force[0] + 0.0:g} {one.force_unit} throughout, so nothing can be "
                "identified; check its column and its scale."
            )


def _with_forces(
    seen: Sequence[AxisMotion], options: AxisOptions, known: Mapping[str, float]
) -> tuple[AxisEstimate, dict[str, Gain]]:
    """Return the fit of the law `coulomb` with gravity and load as requested or selected, and the gains of these."""
    # rows at uneven times are not those of the loop that holds the force
    uneven = not all(one.record.even for one in seen)
    asked = {"gravity": options.gravity, "load": options.load_friction}
    forces = tuple(name for name, wanted in asked.items() if wanted)
    model = AxisModel(law="coulomb", forces=forces, interpolated=uneven, known=known)
    gains = dict[str, Gain]()

    def if_useful(name: str, fit: AxisEstimate, without: AxisEstimate) -> AxisEstimate:
        """Return the fit with a force if held-out blocks support it, and note its gain; else the one without."""
        gain = _gain(fit, without)
        if not (_useful(gain) and any(_is_clear(fit, one) for one in FORCES[name])):
            return without
        gains[name] = gain
        return fit

    wider = model if options.gravity is not None else with_gravity(seen, model)
    fit = _fit_from_inverse_model(wider, seen)
    if wider is not model:
        fit = if_useful("gravity", fit, fit_axis(model, seen, fit.values))
    # without gravity, friction under load is part of b and c
    if options.load_friction is None and "gravity" in fit.model.forces:
        wider = replace(fit.model, forces=(*fit.model.forces, "load"))
        fit = if_useful("load", fit_axis(wider, seen, {**fit.values, "load": _LOAD_START}), fit)
    if not uneven:
        # a log that is slower than its loop contains some of its rows; the force changes between them
        other = fit_axis(replace(fit.model, interpolated=True), seen, fit.values)
        fit = other if other.rms < (1.0 - USEFUL_GAIN) * fit.rms else fit
    return fit, gains


def _gain(fit: AxisEstimate, simpler: AxisEstimate) -> Gain:
    squares, others = fit.held_out[:, None], simpler.held_out[:, None]
    return gain_between(squares, others, blocks_of(len(squares)))


def _useful(gain: Gain | None) -> bool:
    return gain is not None and gain.significant and gain.share >= USEFUL_GAIN


def _is_clear(fit: AxisEstimate, name: str) -> bool:
    return abs(fit.values[name]) > _CLEAR * fit.standard_errors[name]


def _fit_from_inverse_model(model: AxisModel, seen: Sequence[AxisMotion]) -> AxisEstimate:
    inverse = inverse_model(seen, model).values
    if inverse.get("mass", 1.0) <= 0.0:
        raise InputError(
            f"{seen[0].record.name}: the inverse model estimates a mass of {inverse['mass']:.3g}, which must be above "
            "zero. The sign of the force or its column is wrong, or the force is delayed."
        )
    start = {
        name: value if PARAMETERS[name].scale == "signed" else max(value, 0.0)
        for name, value in inverse.items()
    }
    return fit_axis(model, seen, {"load": _LOAD_START, **start})


def _fit_law(law: str, first: AxisEstimate) -> AxisEstimate:
    """Fit a law with the forces of a fit of the law `coulomb`, and from its values."""
    fastest = max(float(np.abs(one.speed).max()) for one in first.motions)
    begin = {**first.values, "asymmetry": 0.0, "stribeck": 0.2 * first.values["coulomb"]}
    # a Stribeck speed has several minima
    starts = _STRIBECK_STARTS if law == "stribeck" else _STRIBECK_STARTS[:1]
    model = replace(first.model, law=law)
    fits = [fit_axis(model, first.motions, {**begin, "stribeck_speed": one * fastest}) for one in starts]
    return min(fits, key=lambda fit: fit.rms)


def _selected(fits: Mapping[str, AxisEstimate]) -> str:
    """Return the law that held-out blocks select."""
    stribeck, coulomb = fits["stribeck"], fits["coulomb"]
    fastest = max(float(np.quantile(np.abs(one.speed), 0.95)) for one in stribeck.motions)
    determined = all(
        stribeck.standard_errors[name] < stribeck.values[name] for name in ("stribeck", "stribeck_speed")
    )
    if _useful(stribeck.gain) and determined and stribeck.values["stribeck_speed"] < _FADES * fastest:
        return "stribeck"
    # noise of the position may be most of the error, and hide a friction that is known to a few percent
    return "coulomb" if _useful(coulomb.gain) or _is_clear(coulomb, "coulomb") else "viscous"


def _widened(fit: AxisEstimate) -> tuple[AxisEstimate, list[Finding]]:
    """Return the fit with intervals that contain what differs between records and methods, and a finding on that."""
    inverse, motions = inverse_model(fit.motions, fit.model), fit.motions
    others = [("by the inverse model", inverse.values, inverse.errors)]
    for number, one in enumerate(motions if len(motions) > 1 else (), start=1):
        alone = fit_axis(fit.model, [one], fit.values)
        others.append((f"in record {number}", alone.values, alone.standard_errors))
    errors, words = dict(fit.standard_errors), []
    for name, own in fit.standard_errors.items():
        # a parameter at a bound has no interval
        known = [(cause, values[name], theirs[name]) for cause, values, theirs in others if name in values]
        beyond = {
            cause: (fit.values[name] - value) ** 2 - error**2 - np.nan_to_num(own) ** 2
            for cause, value, error in known
        }
        cause = max(beyond, key=lambda one: np.nan_to_num(beyond[one], nan=-np.inf), default="")
        most = np.sqrt(np.fmax(beyond.get(cause, 0.0), 0.0))
        errors[name] = float(np.hypot(own, most))
        if most > _CLEAR * own:
            words.append(f"{PARAMETERS[name].symbol} by {most:.2g} {cause}")
    text = (
        "The model may lack something: parameters differ by more than chance between records or methods "
        f"({'; '.join(words)}). The 95 % intervals include that."
    )
    return replace(fit, standard_errors=errors), [note("discrepancy", text)] if words else []


def _expected(squares: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the error [m] of held-out windows with mean square errors (w,), with the interval of a like record's."""
    means = np.array([squares[one].mean() for one in blocks_of(len(squares))])
    drawn = np.sqrt(resamples(len(means), block=1, repeats=_DRAWS, seed=_SEED) @ means / len(means))
    middle = float(np.sqrt(squares.mean()))
    # this record's mean varies as the other one's does
    factor = float(np.exp(1.96 * np.sqrt(2.0) * np.std(np.log(np.maximum(drawn, 1e-300)))))
    return middle, middle / factor, middle * factor


#: what to do about a residual force that depends on a quantity
_ADVICE = {
    "position": "a force over position is missing, as of a cable, cogging or gravity (--gravity)",
    "speed": "friction is no straight line over speed: compare the laws",
    "time": "friction or the constant force drifts; record the warm machine",
}


def _residual_findings(best: AxisEstimate) -> Iterator[Finding]:
    """Warn if the force that the result leaves depends on position, speed or time, by straight pieces over each."""
    axis, tables = best.axis(), []
    for number, one in enumerate(best.motions):
        force, rows = one.force(interpolated=best.model.interpolated), one.moving
        left = force - axis.other_forces(force, one.position, one.speed, one.acceleration)
        left = one.lowpassed(left - axis.friction(one.speed))[rows]
        # records have blocks of their own
        block = one.block[rows] + number * 10**6
        tables.append(np.array([left, block, one.position[rows], one.speed[rows], one.record.t[rows]]))
    left, block, *columns = np.hstack(tables)
    for (quantity, advice), column in zip(_ADVICE.items(), columns, strict=True):
        edges = np.unique(np.quantile(column, np.linspace(0.0, 1.0, 6)))
        if len(edges) < 3:
            continue
        shapes = np.column_stack([np.interp(column, edges, one) for one in np.eye(len(edges))])
        fit = fit_linear(shapes, left, block.astype(np.int64))
        chance = fit.p_value(range(shapes.shape[1]))
        share = float(np.mean((shapes @ fit.values - np.mean(left)) ** 2) / max(np.var(left), 1e-300))
        if chance < _LARGEST_CHANCE and share > _LEAST_SHARE:
            yield warning(
                "axis-residuals",
                f"The residual force depends on the {quantity} (p = {chance:.1g}; {100.0 * min(share, 1.0):.0f} % "
                f"of its variance): {advice}.",
            )


def _asymmetry_findings(best: AxisEstimate, both: AxisEstimate) -> Iterator[Finding]:
    if both.gain and both.gain.significant:
        others = [name for name in best.errors if name not in [one.record.name for one in best.motions]]
        better = [one for one in others if both.errors[one].window_rmse < best.errors[one].window_rmse]
        confirmed = (
            f"{len(better)} of {len(others)} other records are predicted better with it"
            if others
            else "no other record shows whether the machine or this run has it"
        )
        yield note(
            "asymmetry",
            f"Friction that differs between directions predicts other blocks of these records with "
            f"{100.0 * both.gain.share:.0f} % less error; {confirmed}. It is not selected: --law asymmetric does.",
        )


def _undetermined(best: AxisEstimate) -> Iterator[Finding]:
    for name, value in best.values.items():
        error, kind = best.standard_errors[name], PARAMETERS[name]
        what = f"{kind.symbol} ({kind.meaning})"
        if kind.scale != "signed" and not np.isfinite(error):
            yield warning("at-bound", f"{what} is at its bound, or has no effect: {value:.3g}.")
        elif kind.scale != "signed" and error > abs(value):
            text = f"The records do not determine {what}: its standard error is larger than its value."
            yield warning("undetermined", text)


def _delayed(fit: AxisEstimate) -> Iterator[Finding]:
    """Warn if the motion shows that the force acts later or earlier than its rows."""
    model = replace(fit.model, forces=(*fit.model.forces, "delay"))
    late = fit_axis(model, fit.motions, {**fit.values, "delay": 0.0})
    delay, row = late.values["delay"], max(one.record.sample_time for one in fit.motions)
    if _is_clear(late, "delay") and abs(delay) > 0.5 * row:
        text = (
            f"The force seems to act {1e3 * abs(delay):.2g} ± {1e3 * late.standard_errors['delay']:.2g} ms "
            f"{'later' if delay > 0.0 else 'earlier'} than its rows, as behind a bus or a filter, or the drive yields "
            "or has play: then inertia and viscous friction are off. Shift the force if you know its delay."
        )
        yield warning("force-delay", text)


def _elsewhere(
    best: AxisEstimate, expected: tuple[float, float, float], others: Sequence[str]
) -> Iterator[Finding]:
    """Compare the errors on other records with the error expected there."""
    middle, low, high = (1e3 * one for one in expected)
    for name in others:
        error, unit = 1e3 * best.errors[name].window_rmse, f"m{best.motions[0].record.unit}"
        fits = (
            "as expected" if low <= error <= high else f"{'better' if error < low else 'worse'} than expected"
        )
        text = f"{name} is predicted {fits}: {error:.3g} {unit}, expected {middle:.3g} ({low:.3g} to {high:.3g})."
        yield warning("other-record", text) if error > high else note("other-record", text)
