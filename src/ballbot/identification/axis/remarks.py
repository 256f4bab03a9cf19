"""What an axis's identification has to say in plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.axis.ladder import RungVerdict
from ballbot.identification.axis.laws import PARAMETERS, Rung
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.result import Estimate

#: a standard error of this share of a parameter leaves it all but open
_OPEN = 0.5
#: beyond so many standard errors, two parts of a record differ
_DIFFERENT = 2.0


def remarks(
    record: AxisRecord,
    ladder: Sequence[RungVerdict],
    rung: Rung,
    rungs: Mapping[str, Estimate],
    asymmetry: NDArray[np.float64],
    *,
    taken: bool,
) -> tuple[str, ...]:
    """Return the sentences; `taken` says that the user named the law."""
    return (
        _choice(ladder, rung, taken=taken),
        *_asymmetry(record, ladder, rung, asymmetry),
        *_open_parameters(rungs[rung.name]),
    )


def _choice(ladder: Sequence[RungVerdict], rung: Rung, *, taken: bool) -> str:
    others = [one for one in ladder if one.rung.below and one.rung.symmetric]
    failed = [one.rung.name for one in others if not one.earned and one.rung.name != rung.name]
    words = f"The law {rung.name} was {('asked for' if taken else 'taken')}"
    if not failed:
        return f"{words}; every law below it improves the prediction of held-out windows."
    return (
        f"{words}; on held-out windows, {', '.join(failed)} "
        "did not improve the prediction over the law below."
    )


def _asymmetry(
    record: AxisRecord, ladder: Sequence[RungVerdict], rung: Rung, asymmetry: NDArray[np.float64]
) -> list[str]:
    verdict = next(one for one in ladder if not one.rung.symmetric)
    if not verdict.earned or not rung.symmetric:
        return []
    over_time = _over_time(asymmetry, PARAMETERS["viscous"].unit_for(record.unit)) if len(asymmetry) else ""
    return [
        "The asymmetric law predicts other windows of this record with "
        f"{100.0 * verdict.gain:.0f} % less squared error, yet it is not selected: "
        f"{over_time}only another record can show whether the asymmetry belongs to the machine "
        "or to this run (temperature, supply). Validate against one, or choose --law asymmetric."
    ]


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


def _open_parameters(best: Estimate) -> list[str]:
    sentences = []
    for name, value in best.values.items():
        error, symbol = best.standard_errors[name], PARAMETERS[name].symbol
        if not np.isfinite(error):
            sentences.append(f"{symbol} is at a bound and has no standard error.")
        elif error > _OPEN * abs(value):
            sentences.append(
                f"{symbol} is poorly determined: {value:.3g} with a standard error of {error:.2g}."
            )
    return sentences
