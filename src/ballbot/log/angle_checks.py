"""Checks of angles against their rates, and of the lean: degrees where radians belong, signs, wraps, falls.

An angle's change over half a second is compared with the integral of its rate over the same time: long
enough that a lean angle's noise (a few milliradians) is small beside it, short enough that a gyro's drift
is. The ratio is of standard deviations, so it is 57.3 where the one is in degrees and the other in radians.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import POSITION_NAMES, STATE_NAMES, numbered
from ballbot.log.log import Log

DEGREES = float(np.degrees(1.0))
COMPARED_TIME = 0.5  #: [s] over which an angle's change and its rate's integral are compared
FEWEST_ROWS = 40  #: below which no comparison is made
CLEAR_CORRELATION = 0.8  #: below which a comparison says nothing
LOST_LEAN = 0.6  #: [rad] no ball-balancing robot of this kind comes back from
RECOVERED_LEAN = 0.3  #: [rad] below which an excursion past `LOST_LEAN` counts as over


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How two signals that should be the same agree."""

    correlation: float
    ratio: float  #: of the standard deviations, first over second, with the correlation's sign


def agreement(first: NDArray[np.float64], second: NDArray[np.float64]) -> Agreement | None:
    """Compare two signals (N,) where both are finite; None where there is too little to compare."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < FEWEST_ROWS:
        return None
    a, b = first[both], second[both]
    if not (a.std() > 0.0 and b.std() > 0.0):
        return None
    correlation = float(np.corrcoef(a, b)[0, 1])
    return Agreement(correlation=correlation, ratio=float(np.copysign(a.std() / b.std(), correlation)))


def check_rates(log: Log) -> list[Finding]:
    """Return what is wrong between each angle (or position) and its rate: degrees, sign, scale."""
    findings = []
    for name in _with_rates(log):
        found = _change_against_rate(log, name)
        if found is not None and abs(found.correlation) >= CLEAR_CORRELATION:
            findings += _verdict(name, f"{name}_dot", found, what="changes", reference="integrates to")
    return findings


def check_gyro(log: Log) -> list[Finding]:
    """Return what is wrong between the gyro and the body rates w = B(Phi) Phi_dot of the state columns."""
    from ballbot.mechanics.geometry import body_rates_matrix

    gyro = ("gyro_x", "gyro_y", "gyro_z")
    if not {*gyro, *STATE_NAMES[2:5], *STATE_NAMES[7:10]} <= set(log.names):
        return []
    rates = np.column_stack([log[name] for name in STATE_NAMES[7:10]])
    body = np.einsum("nij,nj->ni", body_rates_matrix(log["theta"], log["phi"], log["psi"]), rates)
    findings = []
    for i, name in enumerate(gyro):
        found = agreement(log[name], body[:, i])
        if found is not None and abs(found.correlation) >= CLEAR_CORRELATION:
            findings += _verdict(
                name, "the turning of theta, phi, psi", found, what="varies", reference="makes"
            )
    return findings


def check_lean(log: Log) -> list[Finding]:
    """Return an error for a lean in degrees, or a warning for a fall, by how often and how far the lean is lost."""
    if not {"theta", "phi"} <= set(log.names):
        return []
    lean = np.nan_to_num(
        np.hypot(log["theta"], log["phi"]), posinf=0.0
    )  # what has no value is told elsewhere
    excursions = _excursions(lean)
    if not excursions:
        return []
    first, peak = excursions[0], float(lean.max())
    time = float(log.t[first])
    if len(excursions) >= 3 or peak > np.pi / 2:
        sentence = (
            f"The lean passes {LOST_LEAN:g} {len(excursions)} times and reaches {peak:.3g}, which no "
            f"balancing robot does in radians: theta and phi are in degrees, or the log goes on after a fall "
            f"(t = {time:.6g} s)."
        )
        return [
            Finding(
                severity="error",
                code="degrees",
                text=sentence,
                where=Place(columns=("theta", "phi"), time=time),
            )
        ]
    sentence = (
        f"The robot falls or is caught: its lean passes {LOST_LEAN:g} rad at t = {time:.6g} s (row "
        f"{first + 1}); only what is before that is balancing."
    )
    return [
        Finding(
            severity="warning", code="fall", text=sentence, where=Place(columns=("theta", "phi"), time=time)
        )
    ]


def check_wrap(log: Log) -> list[Finding]:
    """Return a warning where an angle jumps by a turn from one row to the next."""
    findings = []
    for name in ("psi", *_numbered(log, prefix="wheel")):
        if name not in log:
            continue
        jumps = np.abs(np.diff(log[name]))
        wraps = np.flatnonzero(np.abs(jumps - 2.0 * np.pi) < 0.5)
        if wraps.size:
            k = int(wraps[0]) + 1
            sentence = (
                f"{name} jumps by a turn {wraps.size} times, first at row {k + 1} (t = {log.t[k]:.6g} s): it "
                f"is wrapped, and must be unwrapped (numpy.unwrap) before it is used."
            )
            findings.append(
                Finding(
                    severity="warning",
                    code="wrap",
                    text=sentence,
                    where=Place(columns=(name,), time=float(log.t[k])),
                )
            )
    return findings


def _with_rates(log: Log) -> list[str]:
    names = [*POSITION_NAMES, *_numbered(log, prefix="wheel")]
    return [name for name in names if name in log and f"{name}_dot" in log]


def _numbered(log: Log, *, prefix: str) -> tuple[str, ...]:
    return numbered(log.names, prefix=prefix) if f"{prefix}1" in log else ()


def _change_against_rate(log: Log, name: str) -> Agreement | None:
    rate = log[f"{name}_dot"]
    finite = np.isfinite(log[name]) & np.isfinite(rate)
    t, angle, rate = log.t[finite], log[name][finite], rate[finite]
    if len(t) < FEWEST_ROWS:
        return None
    if name == "psi":
        angle = np.unwrap(angle)
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))))
    rows = int(np.clip(round(COMPARED_TIME / log.sample_time), 1, len(t) // 4))
    return agreement(angle[rows:] - angle[:-rows], integral[rows:] - integral[:-rows])


def _verdict(name: str, other: str, found: Agreement, *, what: str, reference: str) -> list[Finding]:
    """Return the finding that a ratio other than one means; half again as much is still put down to noise."""
    size = abs(found.ratio)
    seen = f"{name} {what} {size:.3g} times as much as {other} {reference}"
    columns = (name, other) if other.endswith("_dot") else (name,)
    findings = []
    if found.ratio < 0.0:
        sentence = (
            f"{name} and {other} have opposite signs (correlation {found.correlation:.2f}): flip one of them."
        )
        findings.append(Finding(severity="error", code="sign", text=sentence, where=Place(columns=columns)))
    length = name in ("x", "y")
    if not length and 0.75 < size / DEGREES < 1.33:
        sentence = f"{seen}: {name} is in degrees where radians belong."
        findings.append(
            Finding(severity="error", code="degrees", text=sentence, where=Place(columns=columns))
        )
    elif not length and 0.75 < size * DEGREES < 1.33:
        sentence = f"{seen}: {other} is in degrees where radians belong."
        findings.append(
            Finding(severity="error", code="degrees", text=sentence, where=Place(columns=columns))
        )
    elif not 1.0 / 1.5 < size < 1.5:
        sentence = f"{seen}: one of the two has a wrong scale, delay or much noise."
        findings.append(
            Finding(severity="warning", code="scale", text=sentence, where=Place(columns=columns))
        )
    return findings


def _excursions(lean: NDArray[np.float64]) -> list[int]:
    """Return the rows where the lean passes `LOST_LEAN`, each counted once until it is below `RECOVERED_LEAN`."""
    starts: list[int] = []
    k = 0
    while k < len(lean):
        beyond = np.flatnonzero(lean[k:] > LOST_LEAN)
        if not beyond.size:
            break
        starts.append(k + int(beyond[0]))
        back = np.flatnonzero(lean[starts[-1] :] < RECOVERED_LEAN)
        if not back.size:
            break
        k = starts[-1] + int(back[0])
    return starts
