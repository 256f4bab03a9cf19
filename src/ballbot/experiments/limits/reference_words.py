"""What is said of a reference's margins: a verdict with its reasons, and a table."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from ballbot.experiments.limits.reference_margins import THIN, ReferenceMargins, Use

HEADINGS = ("", "quantity", "at most", "limit", "used", "when (s)")


def verdict(margins: ReferenceMargins, name: str) -> list[str]:
    """Return whether the robot can follow the reference of that name, and why not."""
    reasons = _reasons(margins)
    if reasons:
        said = [f"The robot cannot follow {name}:", *(f"- {reason};" for reason in reasons)]
        said[-1] = said[-1][:-1] + "."
    else:
        uses = (*margins.uses, *margins.closed.uses)
        tightest = max(uses, key=lambda use: use.share)
        margin = "a thin margin" if tightest.share > THIN else "its tightest margin"
        said = [f"The robot can follow {name}; {margin} is {tightest.quantity}, {tightest.share:.0%} used."]
    closed = margins.closed
    if closed.ended == np.inf:
        said.append(
            f"With this controller its largest distance from the reference is {closed.peak_error:.3f} m, and "
            f"its torques are at their limit {closed.at_limit:.1%} of the time."
        )
    if margins.jumps:
        t, size = margins.jumps[0]
        more = f" and {len(margins.jumps) - 1} more" if len(margins.jumps) > 1 else ""
        said.append(
            f"The reference jumps (by {size:.3g} at t = {t:g} s{more}). No robot follows a jump exactly, so "
            "only the closed loop is judged."
        )
    power = closed.peak_power if margins.peak_power is None else max(margins.peak_power, closed.peak_power)
    said.append(
        f"The motors deliver at most {power:.3g} W, {power / margins.supply_voltage:.3g} A at "
        f"{margins.supply_voltage:g} V, without the losses of the windings. A robot file has no limit of "
        "power."
    )
    return said


def rows(margins: ReferenceMargins) -> list[list[str]]:
    """Return the table's rows: of the path followed exactly, and in closed loop."""
    parts = (("followed exactly", margins.uses), ("closed loop", margins.closed.uses))
    return [[which, *_row(use)] for which, uses in parts for use in uses]


def margin_results(margins: ReferenceMargins) -> dict[str, object]:
    """Return what results.json holds."""
    closed = margins.closed
    return {
        "can_be_followed": margins.can_be_followed,
        "reasons": _reasons(margins),
        "jumps": [list(jump) for jump in margins.jumps],
        "followed_exactly": [_use_results(use) for use in margins.uses],
        "peak_power": margins.peak_power,
        "closed_loop": {
            "uses": [_use_results(use) for use in closed.uses],
            "share_at_torque_limit": closed.at_limit,
            "ended": None if closed.ended == np.inf else closed.ended,
            "peak_error": closed.peak_error,
            "peak_power": closed.peak_power,
        },
    }


def _reasons(margins: ReferenceMargins) -> list[str]:
    reasons = [_reason(use) for use in margins.uses if use.share > 1.0]
    closed = margins.closed
    uses = [
        use
        for use in closed.uses
        if use.share > 1.0 and not (use.quantity == "lean" and closed.ended < np.inf)
    ]
    reasons += [f"in closed loop {_reason(use)}" for use in uses]
    if closed.ended < np.inf:
        reasons.append(
            f"in closed loop it falls at t = {closed.ended:.2f} s, after its torques were at their limit "
            f"{closed.at_limit:.0%} of the time"
        )
    return reasons


def _reason(use: Use) -> str:
    match use.quantity:
        case "torque":
            return (
                f"wheel {use.wheel} needs {use.value:.3g} N m at t = {use.t:.2f} s, and its motor gives "
                f"{use.limit:.3g} N m"
            )
        case "wheel speed":
            return (
                f"wheel {use.wheel} has to turn at {use.value:.3g} rad/s at t = {use.t:.2f} s, and the supply "
                f"allows {use.limit:.3g} rad/s"
            )
        case "lean":
            return (
                f"the robot has to lean by {np.degrees(use.value):.3g} degrees at t = {use.t:.2f} s, and beyond "
                f"{np.degrees(use.limit):.3g} degrees full torque does not bring it back"
            )
        case _:
            if use.value > _NOTHING_HELPS:
                return f"a wheel lifts off the ball at t = {use.t:.2f} s"
            return (
                f"a wheel needs a friction coefficient of {use.value:.3g} on the ball at t = {use.t:.2f} s, and "
                f"has {use.limit:.3g}"
            )


#: friction coefficients above this are those of a wheel on which nothing presses
_NOTHING_HELPS = 100.0


def _row(use: Use) -> list[str]:
    value, limit, unit = use.value, use.limit, use.unit
    if unit == "rad":
        value, limit, unit = np.degrees(value), np.degrees(limit), "degrees"
    name = use.quantity if use.wheel is None else f"{use.quantity}, wheel {use.wheel}"
    name += f" ({unit})" if unit else ""
    shown = ["lifted", f"{limit:.3g}", "-"] if value > _NOTHING_HELPS else []
    return [name, *(shown or [f"{value:.3g}", f"{limit:.3g}", f"{use.share:.0%}"]), f"{use.t:.2f}"]


def _use_results(use: Use) -> dict[str, object]:
    return {**asdict(use), "share": use.share}
