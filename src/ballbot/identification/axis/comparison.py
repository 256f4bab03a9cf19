"""Where the methods that identify an axis disagree by more than their errors.

A closed loop that is not the recorded one (`loop_law`) says nothing on the axis: its difference is reported, and not
included in the result's interval.

Methods of one law are compared parameter by parameter. The inverse model knows straight lines of friction over speed
only. Against a result with another law, it is fitted to the force that the result requires for the recorded motion, on
the same rows: what it finds there is what it should find in the recorded force if the result is right. A Stribeck
curve is then no difference, and a dry friction that the result has dropped is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.errors import InputError
from ballbot.findings import Finding, warning
from ballbot.identification.axis.inverse import free_inverse_fit
from ballbot.identification.axis.laws import PARAMETERS, unit_for
from ballbot.identification.axis.loop_law import fitted_loop_law
from ballbot.identification.axis.motion import default_bandwidth, smoothed_motion
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.result import Estimate

#: methods differ beyond so many of their errors, and by this share of the parameter
_APART, _SHARE_APART = 3.0, 0.1
#: of the other number, this share is a rounding error
_NOTHING = 1e-6
#: the fit of whole records minimizes another error, and is not compared
_COMPARED = ("inverse", "closed loop")
_CAUSES = {
    "mass": "the force is late or early against the position, or the position is noisy",
    "viscous": "friction changes with time, load or temperature, or the force is late or early",
    "coulomb": "friction changes near rest or with time, or a force is missing",
}


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """A parameter that a method finds otherwise than the result, by more than their errors."""

    name: str  #: of the parameter
    difference: float  #: its size, SI units
    in_interval: bool  #: whether the result's interval includes it
    finding: Finding


def disagreements(
    records: Sequence[AxisRecord],
    best: Estimate,
    estimates: Sequence[Estimate],
    *,
    bandwidth: float | None = None,
) -> list[Disagreement]:
    """Return each parameter in which a method differs from the result by more than their errors, with a warning."""
    found = []
    laws = [fitted_loop_law(one) for one in records]
    another_loop = any(law is not None and law.differs for law in laws)
    for other in estimates:
        if other.method not in _COMPARED:
            continue
        wrong = another_loop and other.method == "closed loop"
        ours = best.values
        if other.law.name != best.law.name:
            ours = _as_the_inverse_model_finds(records, best, other, bandwidth)
        for name in _CAUSES:
            if name in ours and name in other.values:
                found += _apart(name, ours[name], best, other, records[0].unit, another_loop=wrong)
    return found


def largest_differences(found: Sequence[Disagreement]) -> dict[str, float]:
    """Return the largest difference of each parameter that its interval includes, by name."""
    largest: dict[str, float] = {}
    for one in found:
        if one.in_interval:
            largest[one.name] = max(one.difference, largest.get(one.name, 0.0))
    return largest


def _as_the_inverse_model_finds(
    records: Sequence[AxisRecord], best: Estimate, inverse: Estimate, bandwidth: float | None
) -> Mapping[str, float]:
    """Return what the inverse model finds in the force that the result requires; empty if it finds nothing."""
    required = []
    for number, record in enumerate(records):
        band = default_bandwidth(record) if bandwidth is None else bandwidth
        motion = smoothed_motion(record, bandwidth=band)
        force = best.axis(number).needed_force(record, motion.position, motion.speed, motion.acceleration)
        required.append(replace(record, force=force, added=None, loop=None))
    # this force is that of the row's own motion, and not held since the row before
    model = replace(inverse.model, interpolated=True)
    try:
        return free_inverse_fit(required, model=model, bandwidth=bandwidth, moving=True).by_name
    except InputError:
        return {}


def _apart(
    name: str, ours: float, best: Estimate, other: Estimate, unit: str, *, another_loop: bool
) -> list[Disagreement]:
    theirs, kind = other.values[name], PARAMETERS[name]
    # a parameter that the law does not have is zero, without an error
    error = float(np.hypot(best.standard_errors.get(name, 0.0), other.standard_errors[name]))
    difference = abs(ours - theirs)
    size = abs(ours) if name in best.values else max(abs(ours), abs(theirs))
    if not (difference > _APART * error and difference > _SHARE_APART * size):
        return []
    causes = _CAUSES[name]
    if another_loop:
        causes = "the recorded force is not that of the loop given, which is simulated"
    elif other.method == "closed loop":
        causes += ", or the drive's loop is not quite the one simulated"
    unit_text = unit_for(kind, unit)
    if name not in best.values and abs(ours) < _NOTHING * abs(theirs):
        by = f"zero by the open loop, with the law {best.law.name}, and"
    else:
        law = "" if other.law.name == best.law.name else f", with the law {best.law.name},"
        by = f"{ours:.3g} {unit_text} by the open loop{law} and"
    text = (
        f"{kind.symbol} is {by} {theirs:.3g} by the {other.method} method, {difference / error:.0f} standard errors "
        f"apart: {causes}."
    )
    if np.isfinite(best.half_widths.get(name, np.nan)):
        verb = "does not include" if another_loop else "includes"
        text += f" The 95 % interval of {kind.symbol} {verb} this difference."
    finding = warning("methods-differ", text)
    return [Disagreement(name=name, difference=difference, in_interval=not another_loop, finding=finding)]
