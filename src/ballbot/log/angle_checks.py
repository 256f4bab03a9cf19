"""Checks of angles on their own: a lean in degrees, falls, wraps."""

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import numbered
from ballbot.log.log import Log

LOST_LEAN = 0.6  #: [rad] no ball-balancing robot of this kind comes back from
RECOVERED_LEAN = 0.3  #: [rad] below which an excursion past `LOST_LEAN` counts as over


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
            f"The lean exceeds {LOST_LEAN:g} {len(excursions)} times and reaches "
            f"{peak:.3g}, which no balancing robot does in radians: theta and phi "
            f"are in degrees, or the log continues after a fall (t = {time:.6g} s)."
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
        f"The robot falls or is caught: its lean exceeds {LOST_LEAN:g} rad at t "
        f"= {time:.6g} s (row {first + 1}); only the rows before show balancing."
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
                f"{name} jumps by a full turn {wraps.size} times, first at row {k + 1} (t "
                f"= {log.t[k]:.6g} s): it is wrapped. Unwrap it (numpy.unwrap) before use."
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


def _numbered(log: Log, *, prefix: str) -> tuple[str, ...]:
    return numbered(log.names, prefix=prefix) if f"{prefix}1" in log else ()


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
