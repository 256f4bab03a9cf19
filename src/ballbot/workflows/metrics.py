"""Metrics of a closed-loop run: each number a function of its log, with its definition and its unit.

Errors are the true position's and heading's if the log has the truth, and count once the robot has settled:
see `settled`. Torque and energy count from the first row to the last. `score` is every metric at once.

A real robot has no true position. `Performance` therefore takes the errors of the logged state, with its drift, of
a robot's log and of a simulated run alike: these are the quantities that a prediction names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dst

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.results import to_results

#: time [s] after the start, or after a jump of the reference, from which errors count. The nominal closed loop
#: without friction has done 97 % of a step after 6 s.
SETTLE = 6.0
#: distance from the reference [m] within which a robot has arrived
BAND = 0.05
#: above which a torque is rough rather than balancing [Hz]: the fastest closed-loop pole of the nominal gain turns at
#: a tenth of it, the encoders' and the IMU's noise reaches up to half the sample rate
HIGH_FREQUENCY = 10.0

#: change of the reference from one sample to the next that is a jump, in m and rad
_JUMP = 0.02
#: half the order of the high-pass filter, which runs forward and backward
_FILTER_ORDER = 2
#: rounding that a time is forgiven [s]
_ROUNDING = 1e-6


def settled(log: Log, settle: float) -> NDArray[np.bool_]:
    """Return which rows (N,) are at least `settle` seconds after the start and after each jump of the reference.

    A jump is a change by more than 2 cm or 0.02 rad from one row to the next; a push is none.
    """
    t, since = log.t, np.concatenate([_jump_times(log), [np.inf]])
    return t - since[np.searchsorted(since, t, side="right") - 1] >= settle - _ROUNDING


def position_error(log: Log) -> NDArray[np.float64]:
    """Return the horizontal distance from the reference (N,) [m]."""
    place = true_place(log)
    return np.hypot(place["x"] - log["ref_x"], place["y"] - log["ref_y"])


def heading_error(log: Log) -> NDArray[np.float64]:
    """Return how far the heading is from the reference's (N,) [rad], 0 to pi: whole turns do not count."""
    away = true_place(log)["psi"] - log["ref_psi"]
    return np.abs((away + np.pi) % (2.0 * np.pi) - np.pi)


def leans(log: Log) -> NDArray[np.float64]:
    """Return the angle between the robot's axis and the vertical (N,) [rad]."""
    place = true_place(log)
    return lean_of(place["theta"], place["phi"])


def lean_of(theta: NDArray[np.float64], phi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle between an axis of these leans and the vertical [rad]."""
    return np.arccos(np.clip(np.cos(theta) * np.cos(phi), -1.0, 1.0))


def settling_time(log: Log, *, disturbed: Sequence[float] = ()) -> tuple[float, bool]:
    """Return how long the robot takes to arrive and stay, the longest of the run [s], and whether it always did.

    The start, each jump of the reference and each time [s] in `disturbed` begin a stretch. Its settling time runs to
    the last row at which the robot is farther than `BAND` from the reference. If the robot is outside at its end, the
    second value is False, and the time a lower bound.
    """
    t = log.t
    begins = np.unique(np.concatenate([_jump_times(log), [s for s in disturbed if t[0] < s < t[-1]]]))
    starts = np.searchsorted(t, begins - _ROUNDING)
    outside = position_error(log) > BAND
    longest, always = 0.0, True
    for first, end in zip(starts, [*starts[1:], len(t)], strict=True):
        rows = np.flatnonzero(outside[first:end])
        if rows.size:
            longest = max(longest, float(t[first + rows[-1]] - t[first]))
            always &= bool(first + rows[-1] < end - 1)
    return longest, always


def true_place(log: Log) -> Log:
    """Return the log with the truth in place of what was measured, where it has it."""
    return log.truth() if "true_x" in log else log


def rms_torque(log: Log) -> float:
    """Return the root mean square of the torques of all wheels [N m]."""
    return rms(log.torques)


def rms_torque_change(log: Log) -> float:
    """Return the root mean square of the torques' change from one sample to the next [N m]."""
    return rms(np.diff(log.torques, axis=0)) if len(log) > 1 else 0.0


def high_frequency_torque(log: Log) -> float:
    """Return the root mean square of what the torques hold above 10 Hz [N m]: the worry of Figure 5.5.

    As by a Butterworth high-pass of second order, forward and backward: a sine at that frequency keeps half of its
    size. It weights the sine transform of the torques less the line through their ends, whose odd extension has neither
    jump nor corner. InputError if half the log's sample rate is not above that frequency.
    """
    rate = 1.0 / log.sample_time
    if 0.5 * rate <= HIGH_FREQUENCY:
        raise InputError(
            f"The torques are sampled at {rate:.4g} Hz, which shows nothing above {0.5 * rate:.4g} Hz; "
            f"torque above {HIGH_FREQUENCY:g} Hz cannot be computed."
        )
    last = len(log) - 1
    if last < 2:
        return 0.0
    # the bilinear transform's frequencies, over the filter's
    ratio = np.tan(0.5 * np.pi * np.arange(1, last) / last) / np.tan(np.pi * HIGH_FREQUENCY / rate)
    power = ratio ** (2 * _FILTER_ORDER)
    u = log.torques
    rest = u - u[0] - np.linspace(0.0, 1.0, len(u))[:, None] * (u[-1] - u[0])
    passed = (power / (1.0 + power))[:, None] * dst(rest[1:-1], type=1, axis=0, norm="ortho")
    return float(np.sqrt((passed**2).sum() / u.size))


def energy(log: Log) -> float:
    """Return the mechanical energy that the motors exchange [J]: the integral of sum |u_i w_i|, u held between rows."""
    return float(np.abs(log.torques[:-1] * np.diff(log.wheel_angles, axis=0)).sum())


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def _jump_times(log: Log) -> NDArray[np.float64]:
    """Return when the run starts and the reference jumps [s]."""
    names = ("ref_x", "ref_y", "ref_psi")
    log.require(*names)
    jumps = [np.abs(np.diff(log[name])) > _JUMP for name in names]
    return log.t[np.concatenate([[True], np.logical_or.reduce(jumps)])]


@dataclass(frozen=True, kw_only=True)
class Score:
    """How well a run went. Errors are NaN where the run ended before it had settled once."""

    peak_position_error: float  #: largest horizontal distance from the reference once settled [m]
    rms_position_error: float  #: its root mean square [m]
    peak_heading_error: float  #: once settled [rad]
    settling_time: float  #: the longest of the run; see `metrics.settling_time` [s]
    #: whether it always was within the band at last; where not, the settling time is a lower bound
    arrived: bool
    rms_torque: float  #: over the whole run and all wheels [N m]
    rms_torque_change: float  #: from sample to sample [N m]
    high_frequency_torque: float  #: root mean square above 10 Hz [N m]; NaN where sampled at 20 Hz or less
    energy: float  #: integral of |u w| over all wheels [J]
    ended: str | None  #: why the run stopped early, as in a fall


def values_of(scores: Sequence[Score], name: str) -> NDArray[np.float64]:
    """Return a number of runs by its name (runs,); NaN of a run that ended early."""
    return np.array([getattr(score, name) if score.ended is None else np.nan for score in scores], np.float64)


def falls_of(scores: Sequence[Score]) -> int:
    """Return the number of runs that ended early."""
    return sum(score.ended is not None for score in scores)


def score_results(one: Score) -> dict[str, object]:
    """Return a score as results.json holds it; without arrival there is only a lower bound of the settling time."""
    results = to_results(one)
    if not one.arrived:
        results |= {"settling_time": None, "settling_time_at_least": one.settling_time}
    return results


def score(
    log: Log, *, settle: float = SETTLE, disturbed: Sequence[float] = (), unsettled: bool = False
) -> Score:
    """Score a run by how far it truly was from the reference once it had settled, and by what that took.

    InputError if a run that did not end early has no row that counts, unless it may be `unsettled`.
    """
    log, counted = true_place(log), settled(log, settle)
    if not counted.any() and log.ended is None and not unsettled:
        raise InputError(
            f"No sample of the run is {settle:g} s after the start and after every jump of the reference. "
            "Use a longer run or a shorter settling time."
        )
    position, heading = position_error(log)[counted], heading_error(log)[counted]
    arriving, arrived = settling_time(log, disturbed=disturbed)
    fast = len(log) > 1 and 0.5 / log.sample_time > HIGH_FREQUENCY
    return Score(
        peak_position_error=float(position.max()) if counted.any() else np.nan,
        rms_position_error=rms(position) if counted.any() else np.nan,
        peak_heading_error=float(heading.max()) if counted.any() else np.nan,
        settling_time=arriving,
        arrived=arrived and log.ended is None,
        rms_torque=rms_torque(log),
        rms_torque_change=rms_torque_change(log),
        high_frequency_torque=high_frequency_torque(log) if fast else np.nan,
        energy=energy(log),
        ended=log.ended,
    )


def run_results(log: Log) -> dict[str, object]:
    """Return one balancing run in numbers, as results.json holds it: what has a value of its `Score`, and others."""
    scores = score_results(score(log, unsettled=True))
    if not settled(log, SETTLE).any():
        late = ("settling_time", "settling_time_at_least", "arrived")
        scores = {name: one for name, one in scores.items() if name not in late}
    error = position_error(log)
    return {
        "rows": len(log),
        "sample_time": log.sample_time if len(log) > 1 else None,
        "duration": float(log.t[-1] - log.t[0]),
        **{name: one for name, one in scores.items() if not (isinstance(one, float) and np.isnan(one))},
        "peak_position_error_whole_run": float(error.max()),
        "rms_position_error_whole_run": rms(error),
        "final_position_error": float(error[-1]),
        "peak_lean": float(np.nanmax(leans(log))),
        "peak_torque": float(np.abs(log.torques).max()),
    }


#: share of the samples whose torques the margin leaves out: single samples at the limit mean little
_RARE = 0.001


@dataclass(frozen=True, kw_only=True)
class Performance:
    """A run in five numbers that its log shows; errors are NaN if it ended before it settled."""

    peak_error: float  #: largest horizontal distance from the reference once settled [m]
    rms_error: float  #: its root mean square [m]
    roughness: float  #: RMS change of the torques from one sample to the next [N m]
    lean: float  #: largest lean from the vertical [rad]
    #: share of the torque limit that the torques of any wheel leave in all but a thousandth of the samples; measured
    #: torques beyond the limit leave none
    torque_margin: float

    @staticmethod
    def of(log: Log, *, torque_limit: float) -> Performance:
        """Return the numbers of a log with reference, torques and states, whatever its truth."""
        seen = log.without_truth()
        error = position_error(seen)[settled(seen, SETTLE)]
        largest = np.abs(seen.torques).max(axis=1)
        return Performance(
            peak_error=float(error.max()) if len(error) else np.nan,
            rms_error=rms(error) if len(error) else np.nan,
            roughness=rms_torque_change(seen),
            lean=float(lean_of(seen["theta"], seen["phi"]).max()),
            torque_margin=max(1.0 - float(np.quantile(largest, 1.0 - _RARE)) / torque_limit, 0.0),
        )

    def sizes(self) -> dict[str, float]:
        """Return its numbers by name, with the share of the torque limit that is used in place of that left."""
        return asdict(self) | {"torque_margin": 1.0 - self.torque_margin}


#: names of the quantities, in their order
QUANTITIES = tuple(field.name for field in fields(Performance))


@dataclass(frozen=True)
class Metric:
    """A number of a run, as tables, figures and sentences show it."""

    key: str  #: of `Score` or `Performance`
    words: str  #: that name it in a sentence
    unit: str  #: that it is shown in
    scale: float  #: from SI to that unit
    decimals: int
    heading: str = ""  #: of a table's column
    better: Literal["below", "above"] = "below"

    def shown(self, value: float) -> str:
        """Return a value in the unit, without it."""
        return f"{self.scale * value:.{self.decimals}f}" if np.isfinite(value) else "–"
