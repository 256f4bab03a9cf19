"""Positions, angles and the gyro against the rates beside them: the unit of time, units of columns, signs, exchanges.

A column's change over half a second is compared with the integral of its rate over the same time (`units`). The ratio
is one of standard deviations: it is 57.3 if the column is in degrees and its rate in radians.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import combinations

import numpy as np

from ballbot.findings import Finding
from ballbot.log.checks.table import judged
from ballbot.log.clock import clock_findings
from ballbot.log.columns import POSITION_NAMES, STATE_NAMES, numbered_names
from ballbot.log.evidence import RELATED, SCALED
from ballbot.log.imu_angles import integral_of
from ballbot.log.log import Log
from ballbot.log.units import (
    FEWEST_ROWS,
    Agreement,
    agreement,
    change_agreement,
    unit_of_ratio,
)

#: columns are swapped if each agrees with the other's rate by more than with its own by this much
SWAPPED_MARGIN = 0.3
#: a ratio is a unit's if it is away from its factor by less than this factor: noise changes it
NOISY = 1.33
_GYRO = ("gyro_x", "gyro_y", "gyro_z")


def check_rates(log: Log) -> list[Finding]:
    """Return contradictions of angles and positions to their rates: time, degrees, sign, scale, swapped."""
    wheels = numbered_names(log.names, prefix="wheel")
    names = [name for name in (*POSITION_NAMES, *wheels) if name in log and f"{name}_dot" in log]

    def compared(name: str, other: str) -> Agreement | None:
        """Compare a column's changes over half a second with the integral of a rate."""
        return change_agreement(log.t, log[name], integral_of(log.t, log[f"{other}_dot"]))

    if len(log) < 2:
        return []
    pairs = ("x", "y"), ("theta", "phi")
    clear, findings = _contradictions(compared, names, lambda name: f"{name}_dot", pairs)
    for name in (name for name in names if name not in clear):
        rate = integral_of(log.t, log[f"{name}_dot"])
        correlation, _ = change_agreement(log.t, np.nancumsum(log[name]), rate) or (0.0, 1.0)
        findings += judged("scale: changes", [name], float(correlation >= SCALED), name=name)
    return _time_findings(log, clear) or findings


def check_gyro(log: Log) -> list[Finding]:
    """Return contradictions of the gyro to the body rates w = B(Phi) Phi_dot of the state columns."""
    from ballbot.mechanics.geometry import body_rates_matrix

    if not {*_GYRO, *STATE_NAMES[2:5], *STATE_NAMES[7:10]} <= set(log.names):
        return []
    rates = np.column_stack([log[name] for name in STATE_NAMES[7:10]])
    body = np.einsum("nij,nj->ni", body_rates_matrix(log["theta"], log["phi"], log["psi"]), rates)

    def compared(name: str, other: str) -> Agreement | None:
        return agreement(log[name], body[:, _GYRO.index(other)])

    pairs = combinations(_GYRO, 2)
    return _contradictions(compared, _GYRO, lambda _: "theta_dot, phi_dot, psi_dot", pairs)[1]


def _contradictions(
    compared: Callable[[str, str], Agreement | None],
    names: Iterable[str],
    rates: Callable[[str], str],
    pairs: Iterable[tuple[str, str]],
) -> tuple[dict[str, float], list[Finding]]:
    """Return the clear ratios of columns to their own rates, and findings on these and on pairs that are exchanged."""
    agreements = {name: agreement for name in names if (agreement := compared(name, name))}
    clear = {name: own for name, own in agreements.items() if abs(own[0]) >= RELATED}
    findings = [item for name in clear for item in _verdict(name, rates(name), *clear[name])]

    def follows(name: str, other: str) -> bool:
        crossed, own = compared(name, other), abs(agreements[name][0])
        return crossed is not None and abs(crossed[0]) >= max(RELATED, own + SWAPPED_MARGIN)

    for first, second in (pair for pair in pairs if {*pair} <= set(agreements)):
        if follows(first, second) and follows(second, first):
            findings += judged("swapped", [first, second], first=first, second=second)
    return {name: ratio for name, (_, ratio) in clear.items()}, findings


def _time_findings(log: Log, ratios: Mapping[str, float]) -> list[Finding]:
    """Return the error of the unit or the direction of time, by all clear ratios."""
    if len(ratios) >= 3 and max(ratios.values()) < 0.0:
        return judged("time-scale: reverse", ["t"])
    of_states = {name: ratio for name, ratio in ratios.items() if not name.startswith("wheel")}
    factor, by_t = float(np.median(list(of_states.values()) or [1.0])), log.sample_time
    both_kinds = len({name in ("x", "y") for name in of_states}) == 2
    if both_kinds and all(factor / 1.25 < ratio < factor * 1.25 for ratio in of_states.values()):
        unit = unit_of_ratio(1.0 / factor, "s", within=NOISY)
        cause = f"t is in {unit}, not in seconds" if unit else "t is stretched (wrong sample time or unit)"
        numbers = {"factor": factor, "by_rates": factor * by_t, "by_t": by_t, "cause": cause}
        return judged("time-scale", ["t"], max(factor, 1.0 / factor), **numbers)
    # columns that a robot's own sensors and motors give come at the rate of its control
    of_a_run = not {"u1", "theta", "gyro_x", "wheel1"}.isdisjoint(log.names)
    return clock_findings(log.t, "--mapping") if len(log) >= FEWEST_ROWS and not ratios and of_a_run else []


def _verdict(name: str, rates: str, correlation: float, ratio: float) -> Iterator[Finding]:
    """Return the findings on a ratio other than one."""
    size, of_length, is_gyro = abs(ratio), name in ("x", "y"), name.startswith("gyro")
    columns = [name] if is_gyro else [name, rates]
    numbers = {"name": name, "rates": rates, "size": size, "correlation": correlation}
    yield from judged("sign", columns, -ratio, **numbers)
    for column, factor, timed in ((name, size, is_gyro), (rates, 1.0 / size, True)):
        right = ("m" if of_length else "rad") + "/s" * timed
        if unit := unit_of_ratio(factor, right, within=NOISY):
            key = "degrees" if unit.startswith("deg") else "scale: unit"
            yield from judged(key, columns, **numbers, column=column, unit=unit, right=right)
            return
    yield from judged("scale", columns, max(size, 1.0 / size), **numbers)
