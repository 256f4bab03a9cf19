"""Findings on the identification of an axis: its law, an asymmetry, doubtful parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, note, warning
from ballbot.fitting.model_selection import ModelSelection
from ballbot.fitting.parameter import Parameter
from ballbot.identification.axis.inverse import InverseFit
from ballbot.identification.axis.laws import PARAMETERS, AxisLaw, unit_for
from ballbot.identification.axis.prediction import failure_findings
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.result import Estimate
from ballbot.identification.axis.selection import USEFUL_GAIN
from ballbot.identification.axis.structure import base_name
from ballbot.rounding import digits, plus_minus

#: a parameter whose 95 % interval reaches further than itself is poorly determined, and than so many times it
#: undetermined; a force of either sign is poorly determined if it reaches further than that share of the usual force
_UNDETERMINED, _SHARE_OF_FORCE = 2.0, 0.1
#: of parameters that shape a law near rest, of which even the largest value of such an interval says nothing
_SHAPES, _UNDETERMINED_SHAPE = ("stribeck_speed", "stiffness", "micro_damping"), 1.0
#: another method predicts windows better if its error is below this share
_BETTER = 0.95
#: beyond so many standard errors, two parts of a record differ
_DIFFERENT = 2.0


def axis_findings(
    records: Sequence[AxisRecord],
    laws: ModelSelection[AxisLaw],
    best: Estimate,
    estimates: Sequence[Estimate],
    asymmetry: NDArray[np.float64],
    *,
    by_user: bool,
    asymmetric: Estimate | None = None,
) -> tuple[Finding, ...]:
    """Return the findings on all records, those that were fitted first.

    Parameters
    ----------
    records : sequence of AxisRecord
    laws : ModelSelection
    best : Estimate
        The result.
    estimates : sequence of Estimate
        Of the chosen law by every method.
    asymmetry : ndarray (parts, 2)
        Of the record over time; empty if it is not known.
    by_user : bool
        Whether the user named the law.
    asymmetric : Estimate, optional
        Of the law asymmetric.
    """
    record = records[0]
    elsewhere = _asymmetry_elsewhere(records, best, asymmetric)
    return (
        *failure_findings(records, best.errors),
        _law_finding(laws, best.model.law, by_user=by_user),
        *_asymmetry_findings(record, laws, best.model.law, asymmetry, elsewhere),
        *_lost_minimum(records, best, estimates),
        *_open_parameters(best, records),
    )


def _law_finding(laws: ModelSelection[AxisLaw], chosen: AxisLaw, *, by_user: bool) -> Finding:
    # a law whose next simpler one is not accepted is compared with the largest accepted one
    gains = {
        one.name: one.gain_over or one.gain
        for one in laws.candidates
        if one.model.symmetric and one.name != chosen.name
    }
    compared = {name: gain for name, gain in gains.items() if gain}
    worse = [name for name, gain in compared.items() if gain.upper < 0.0]
    small = [name for name, gain in compared.items() if 0.0 <= gain.upper < USEFUL_GAIN]
    better = [name for name in compared if laws.find(name).accepted and name not in small]
    open_ = [name for name in compared if name not in (*worse, *small, *better)]
    text = f"The law {chosen.name} was {('requested' if by_user else 'selected')}."
    for names, words in (
        (worse, "predict held-out blocks worse than the simpler law"),
        (
            small,
            f"improve the prediction of held-out blocks by less than {100.0 * USEFUL_GAIN:.0f} % at best",
        ),
        (open_, "may or may not be better than the simpler law; these records cannot decide"),
    ):
        if names:
            verb = (
                words
                if len(names) > 1
                else words.replace("predict ", "predicts ", 1).replace("improve ", "improves ", 1)
            )
            text += f" {', '.join(names)} {verb}."
    bristles = [name for name in better if "stiffness" in laws.find(name).model.names]
    if bristles and not by_user and chosen.name == "coulomb":
        text += (
            f" {' and '.join(bristles)} would predict better where the axis reverses or rests, but the bristles' "
            "stiffness is poorly determined or too high to be seen in the position, or the axis does not yield at rest "
            "as bristles do: something else is missing in the model."
        )
    return note("law", text)


def _asymmetry_findings(
    record: AxisRecord,
    laws: ModelSelection[AxisLaw],
    chosen: AxisLaw,
    asymmetry: NDArray[np.float64],
    elsewhere: str,
) -> list[Finding]:
    verdict = next(one for one in laws.candidates if not one.model.symmetric)
    if verdict.gain is None or not verdict.accepted or not chosen.symmetric:
        return []
    over_time = _over_time(asymmetry, unit_for(PARAMETERS["viscous"], record.unit)) if len(asymmetry) else ""
    text = (
        "The asymmetric law predicts other blocks of this record with "
        f"{100.0 * verdict.gain.share:.0f} % less error, yet it is not selected: "
        f"{over_time}only another record can show whether the asymmetry belongs to the machine "
        f"or to this run (temperature, supply). {elsewhere}"
    )
    return [note("asymmetry", text)]


def _asymmetry_elsewhere(records: Sequence[AxisRecord], best: Estimate, asymmetric: Estimate | None) -> str:
    """Return what the records that were not fitted show of an asymmetry."""
    fitted = best.model.records
    if asymmetric is None or len(records) == fitted:
        return "Validate against one, or choose --law asymmetric."
    names = ", ".join(one.name for one in records[fitted:])
    errors = zip(asymmetric.errors[fitted:], best.errors[fitted:], strict=True)
    pairs = [(theirs.window_rmse, ours.window_rmse) for theirs, ours in errors]
    if all(theirs < (1.0 - USEFUL_GAIN) * ours for theirs, ours in pairs):
        least = min(1.0 - theirs / ours for theirs, ours in pairs)
        return (
            f"{names}: the asymmetric law has {100.0 * least:.0f} % less error there as well, so that it is the "
            "machine's: choose --law asymmetric."
        )
    return f"{names}: the asymmetric law is not clearly better there, so that it may be of this run alone."


def _over_time(asymmetry: NDArray[np.float64], unit: str) -> str:
    """Return how the asymmetry (parts, 2) goes from the record's start to its end."""
    (first, first_error), (last, last_error) = asymmetry[0], asymmetry[-1]
    apart = abs(last - first) / np.hypot(first_error, last_error)
    moving = (
        f", and it changes within the record (by {apart:.1f} standard errors)" if apart > _DIFFERENT else ""
    )
    return (
        f"half the difference of the viscous coefficients is {plus_minus(first, first_error)} {unit} at the start and "
        f"{plus_minus(last, last_error)} at the end{moving}; "
    )


def _lost_minimum(
    records: Sequence[AxisRecord], best: Estimate, estimates: Sequence[Estimate]
) -> list[Finding]:
    """Return a warning if another method predicts the windows of all fitted records together better than the result."""
    fitted = records[: best.model.records]
    durations = np.array([one.duration for one in fitted])

    def together(one: Estimate) -> float:
        errors = np.array([own.window_rmse for own in one.errors[: len(fitted)]])
        return float(np.sqrt(durations @ errors**2 / durations.sum()))

    other = min(estimates, key=together)
    least, error = together(other), together(best)
    if not least < _BETTER * error:
        return []
    text = (
        f"{', '.join(one.name for one in fitted)}: the error over windows is {1e3 * least:.3g} m{fitted[0].unit} by "
        f"the method {other.method} (law {other.law.name}) and {1e3 * error:.3g} by the open loop (law "
        f"{best.law.name}), which minimizes it over windows that begin elsewhere: a few of them are most of the error, "
        "or it did not find the parameters of the least error. Compare the methods before you use these parameters."
    )
    return [warning("lost-minimum", text)]


def inverse_mass_findings(fit: InverseFit, estimates: Sequence[Estimate], unit: str) -> list[Finding]:
    """Return a note if the inverse model's fit is not among the estimates, as its mass is not above zero."""
    if any(one.method == "inverse" for one in estimates):
        return []
    place = next(i for i, label in enumerate(fit.names) if base_name(label) == "mass")
    number = plus_minus(float(fit.values[place]), float(fit.clustered_errors[place]))
    text = (
        f"The inverse model estimates a mass of {number} {unit_for(PARAMETERS['mass'], unit)}, which is not above "
        "zero, and is left out of the comparison of methods: noise of the position and a late force bias it."
    )
    return [note("inverse-mass", text)]


def _open_parameters(best: Estimate, records: Sequence[AxisRecord]) -> list[Finding]:
    found = []
    usual = max(one.usual_force for one in records)
    reach = 0.5 * max(float(np.ptp(one.position)) for one in records)
    for label, value in best.values.items():
        half, kind = best.half_widths[label], best.model.parameter(label)
        # a number of either sign, or an amount, may be near zero and well known; it may not be as large as the force
        large = kind.scale == "ratio" or (kind.unit == "N" and half > usual)
        force = half * (reach if kind.unit == "N/m" else 1.0)
        small = kind.scale == "signed" and force < _SHARE_OF_FORCE * usual
        drift = label.startswith("drift_")
        undetermined = _UNDETERMINED_SHAPE if base_name(label) in _SHAPES else _UNDETERMINED
        if not np.isfinite(best.standard_errors[label]):
            found.append(note("at-bound", f"{kind.symbol} is at a bound and has no standard error."))
        elif half > undetermined * abs(value) and large and not drift:
            text = (
                f"{kind.symbol} is not determined by these records: its 95 % interval contains zero and more than "
                "twice its value. Do not use its number."
            )
            severity = "warning" if half > _UNDETERMINED * abs(value) else "note"
            found.append(Finding(code="undetermined", severity=severity, text=text))
        elif half > abs(value) and not small and not drift:
            interval = _interval_words(kind, value, half, unit_for(kind, records[0].unit))
            found.append(note("poorly-determined", f"{kind.symbol} is poorly determined: {interval}."))
    return found


def _interval_words(kind: Parameter, value: float, half: float, unit: str) -> str:
    """Return a 95 % interval that contains zero in words; of an amount, which is not negative, its end."""
    if kind.scale == "signed":
        return f"its 95 % interval is {plus_minus(value, half)} {unit}".rstrip()
    return f"its 95 % interval ends at {digits(value + half, 2)} {unit}".rstrip()
