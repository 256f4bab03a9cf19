"""Metrics of a closed-loop run: each number a function of its log, with its definition and its unit.

Errors are the true position's and heading's if the log has the truth, and count once the robot has settled:
see `settled`. Torque and energy count from the first row to the last. `score` is every metric at once.

A real robot has no true position. `LogScore` therefore takes the errors of the logged state, with its drift, of
a robot's log and of a simulated run alike: these are the quantities that a prediction names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import numpy as np
from scipy.fft import dst

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.results import to_results

#: time [s] after the start, or after a jump of the reference, from which errors count. The nominal closed loop
#: without friction has done 97 % of a step after 6 s.
SETTLE = 6.0
#: distance from the reference [m] within which a robot has arrived
BAND = 0.05
#: speed below which a robot is at rest [m/s]
REST = 0.1
#: above which a torque is rough rather than balancing [Hz]: the fastest closed-loop pole of the nominal gain turns at
#: a tenth of it, the encoders' and the IMU's noise reaches up to half the sample rate
HIGH_FREQUENCY = 10.0

#: change of the reference from one sample to the next that is a jump, in m and rad
_JUMP = 0.02
#: half the order of the high-pass filter, which runs forward and backward
_FILTER_ORDER = 2
#: rounding that a time is forgiven [s]
_ROUNDING = 1e-6


def settled(log: Log, settle: float) -> Bools:
    """Return which rows (N,) are `settle` s or more after the start and each jump of the reference (2 cm, 0.02 rad)."""
    t, since = log.t, np.concatenate([_jump_times(log), [np.inf]])
    return t - since[np.searchsorted(since, t, side="right") - 1] >= settle - _ROUNDING


def position_error(log: Log) -> Floats:
    """Return the horizontal distance from the reference (N,) [m]."""
    truth = true_place(log)
    return np.hypot(truth["x"] - log["ref_x"], truth["y"] - log["ref_y"])


def heading_error(log: Log) -> Floats:
    """Return how far the heading is from the reference's (N,) [rad], 0 to pi: whole turns do not count."""
    away = true_place(log)["psi"] - log["ref_psi"]
    return np.abs((away + np.pi) % (2.0 * np.pi) - np.pi)


def leans(log: Log) -> Floats:
    """Return the angle between the robot's axis and the vertical (N,) [rad]."""
    truth = true_place(log)
    return lean_angle(truth["theta"], truth["phi"])


def lean_angle(theta: Floats, phi: Floats) -> Floats:
    """Return the angle between an axis of these leans and the vertical [rad]."""
    return np.arccos(np.clip(np.cos(theta) * np.cos(phi), -1.0, 1.0))


def settling_time(log: Log, *, disturbed: Sequence[float] = (), band: float = BAND) -> tuple[float, bool]:
    """Return how long the robot takes to arrive and stay, the longest of the run [s], and whether it always did.

    The start, each jump of the reference and each time [s] in `disturbed` begin an interval. Its settling time runs to
    the last row farther than the band [m] from the reference; it is a lower bound if that is the interval's end.
    """
    t = log.t
    begins = np.unique(np.concatenate([_jump_times(log), [s for s in disturbed if t[0] < s < t[-1]]]))
    starts = np.searchsorted(t, begins - _ROUNDING)
    outside = position_error(log) > band
    longest, always = 0.0, True
    for first, end in zip(starts, [*starts[1:], len(t)], strict=True):
        rows = np.flatnonzero(outside[first:end])
        if rows.size:
            longest = max(longest, float(t[first + rows[-1]] - t[first]))
            always &= bool(first + rows[-1] < end - 1)
    return longest, always


def true_place(log: Log) -> Log:
    """Return the log with the true states in place of the measured ones, if it has them."""
    return log.truth() if "true_x" in log else log


def rms_torque_change(log: Log) -> float:
    """Return the root mean square of the torques' change from one sample to the next [N m]."""
    return rms(np.diff(log.torques, axis=0)) if len(log) > 1 else 0.0


def high_frequency_torque(log: Log) -> float:
    """Return the root mean square of the torques' part above 10 Hz [N m], which the thesis's Figure 5.5 is about.

    As by a Butterworth high-pass of second order, forward and backward: a sine at that frequency keeps half of its
    size. It weights the sine transform of the torques less the line through their ends. InputError if too slow.
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


def rms(values: Floats) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def _jump_times(log: Log) -> Floats:
    """Return when the run starts and the reference jumps [s]."""
    names = ("ref_x", "ref_y", "ref_psi")
    log.require(*names)
    jumps = [np.abs(np.diff(log[name])) > _JUMP for name in names]
    return log.t[np.concatenate([[True], np.logical_or.reduce(jumps)])]


def stop_of(log: Log, at: float) -> dict[str, Any]:
    """Return how a robot that had to stop at a time [s] came to rest, as `Score` has it; nothing if its run was over.

    It is at rest once its speed stays below `REST`; if it does not, the time is up to the end of the run. The distance
    is the largest from its position when it was to stop; it overshoots its final position in its direction of motion.
    """
    truth = true_place(log)
    after = log.t >= at - _ROUNDING
    x, y, t = truth["x"][after], truth["y"][after], log.t[after]
    if not len(t):
        return {}
    moving = np.flatnonzero(np.hypot(truth["x_dot"][after], truth["y_dot"][after]) >= REST)
    last = int(moving[-1]) if moving.size else 0
    way = np.array([truth["x_dot"][after][0], truth["y_dot"][after][0]])
    way /= max(float(np.hypot(*way)), REST)
    return {
        "stopping_time": float(t[last] - at),
        "rested": last < len(t) - 1 and log.ended is None,
        "stopping_distance": float(np.hypot(x - x[0], y - y[0]).max()),
        "overshoot": float(((x - x[-1]) * way[0] + (y - y[-1]) * way[1]).max()),
    }


def top_speed(log: Log) -> float:
    """Return the largest speed over the floor, as a mean over a second [m/s]; the second of a fall does not count."""
    if len(log) < 2:
        return 0.0
    truth, second = true_place(log), round(1.0 / log.sample_time)
    x, y = (truth[name][: -second if log.ended else None] for name in "xy")
    ways = np.hypot(x[second:] - x[:-second], y[second:] - y[:-second])
    return float(ways.max(initial=0.0) / (second * log.sample_time))


def rms_speed_error(log: Log) -> float:
    """Return the root mean square difference of the velocity from the reference's, both axes [m/s]; NaN if it jumps."""
    if len(log) < 2 or len(_jump_times(log)) > 1:
        return np.nan
    truth = true_place(log)
    errors = [truth[f"{name}_dot"] - np.gradient(log[f"ref_{name}"], log.t) for name in "xy"]
    return float(np.sqrt(np.mean(errors[0] ** 2 + errors[1] ** 2)))


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Which rows and events of a run are scored, and how."""

    settle: float = SETTLE  #: see `settled` [s]
    band: float = BAND  #: within which a robot has arrived [m]
    disturbed: tuple[float, ...] = ()  #: when something pushes the robot or changes [s]
    stop: float | None = None  #: when a robot that drives is to stop [s]


DEFAULT_RULES = Rules()


@dataclass(frozen=True, kw_only=True)
class Score:
    """How well a run went. Errors are NaN where the run ended before it had settled once."""

    peak_position_error: float  #: largest horizontal distance from the reference once settled [m]
    rms_position_error: float  #: its root mean square [m]
    peak_heading_error: float  #: once settled [rad]
    settling_time: float  #: the longest of the run; see `metrics.settling_time` [s]
    arrived: bool  #: whether it was within the band at last; else the settling time is a lower bound
    rms_torque: float  #: over the whole run and all wheels [N m]
    rms_torque_change: float  #: from sample to sample [N m]
    high_frequency_torque: float  #: root mean square above 10 Hz [N m]; NaN where sampled at 20 Hz or less
    energy: float  #: integral of |u w| over all wheels [J]
    peak_lean: float = np.nan  #: [rad]
    rms_speed_error: float = np.nan  #: see `metrics.rms_speed_error` [m/s]
    stopping_time: float = np.nan  #: see `stop_of`; NaN, like the next two, where nothing is to stop [s]
    rested: bool = False  #: whether it came to rest; else the stopping time is a lower bound
    stopping_distance: float = np.nan  #: [m]
    overshoot: float = np.nan  #: [m]
    top_speed: float = np.nan  #: see `metrics.top_speed`; also of a run that ended early [m/s]
    #: the largest push from which the robot recovers, on a course that searches for it; then the score is of that run
    largest_impulse: float = np.nan
    ended: str | None  #: why the run stopped early, as in a fall


#: numbers that only some courses have: of a stop, of the largest push, of a reference that does not jump
OF_SOME_COURSES = ("rms_speed_error", "stopping_time", "stopping_distance", "overshoot", "largest_impulse")


def values_of(scores: Sequence[Score], name: str) -> Floats:
    """Return a number of runs by its name (runs,); NaN of a run that ended early, but for what counts up to there."""
    up_to_a_fall = name in ("top_speed", "largest_impulse")
    return np.array(
        [getattr(score, name) if up_to_a_fall or score.ended is None else np.nan for score in scores],
        np.float64,
    )


def falls_of(scores: Sequence[Score]) -> int:
    """Return the number of runs that ended early."""
    return sum(score.ended is not None for score in scores)


def score_results(score: Score) -> dict[str, object]:
    """Return a score as results.json holds it; without arrival there is only a lower bound of the settling time."""
    results = to_results(score)
    if not score.arrived:
        results |= {"settling_time": None, "settling_time_at_least": score.settling_time}
    if not score.rested:
        results |= {"stopping_time": None, "stopping_time_at_least": score.stopping_time}
    without = {name for name in OF_SOME_COURSES if np.isnan(getattr(score, name))}
    without |= {"rested", "stopping_time_at_least"} if "stopping_time" in without else set()
    return {name: value for name, value in results.items() if name not in without}


def score(log: Log, rules: Rules = Rules(), *, unsettled: bool = False) -> Score:
    """Score a run by its true distance from the reference once settled, and by its torques and leans if it has them.

    Raise InputError if a run that did not end early has no settled row, unless it may be `unsettled`.
    """
    log, counted = true_place(log), settled(log, rules.settle)
    if not counted.any() and log.ended is None and not unsettled:
        raise InputError(
            f"No sample of the run is {rules.settle:g} s after the start and after every jump of the reference. "
            "Use a longer run or a shorter settling time."
        )
    position, heading = position_error(log)[counted], heading_error(log)[counted]
    arriving, arrived = settling_time(log, disturbed=rules.disturbed, band=rules.band)
    driven = "u1" in log  # motion capture alone has no torques
    fast = len(log) > 1 and 0.5 / log.sample_time > HIGH_FREQUENCY
    return Score(
        peak_position_error=float(position.max()) if counted.any() else np.nan,
        rms_position_error=rms(position) if counted.any() else np.nan,
        peak_heading_error=float(heading.max()) if counted.any() else np.nan,
        settling_time=arriving,
        arrived=arrived and log.ended is None,
        rms_torque=rms(log.torques) if driven else np.nan,
        rms_torque_change=rms_torque_change(log) if driven else np.nan,
        high_frequency_torque=high_frequency_torque(log) if driven and fast else np.nan,
        energy=energy(log) if driven and "wheel1" in log else np.nan,
        peak_lean=float(np.nanmax(leans(log))) if "theta" in log else np.nan,
        rms_speed_error=rms_speed_error(log),
        **stop_of(log, np.inf if rules.stop is None else rules.stop),
        top_speed=top_speed(log),
        ended=log.ended,
    )


def run_results(log: Log) -> dict[str, object]:
    """Return the entries of results.json for one balancing run: its `Score`, and others."""
    late = () if settled(log, SETTLE).any() else ("settling_time", "settling_time_at_least", "arrived")
    error = position_error(log)
    return {
        "rows": len(log),
        "sample_time": log.sample_time if len(log) > 1 else None,
        "duration": float(log.t[-1] - log.t[0]),
        **{
            name: value
            for name, value in score_results(score(log, unsettled=True)).items()
            if name not in late
        },
        "peak_position_error_whole_run": float(error.max()),
        "rms_position_error_whole_run": rms(error),
        "final_position_error": float(error[-1]),
        "peak_torque": float(np.abs(log.torques).max()),
    }


#: share of the samples whose torques the margin leaves out: single samples at the limit mean little
_RARE = 0.001


@dataclass(frozen=True, kw_only=True)
class LogScore:
    """A run in five numbers that its log shows; errors are NaN if it ended before it settled."""

    peak_error: float  #: largest horizontal distance from the reference once settled [m]
    rms_error: float  #: its root mean square [m]
    roughness: float  #: RMS change of the torques from one sample to the next [N m]
    lean: float  #: largest lean from the vertical [rad]
    torque_margin: float  #: share of the torque limit left, in all but a thousandth of the samples

    @staticmethod
    def of(log: Log, *, torque_limit: float) -> LogScore:
        """Return the numbers of a log with reference, torques and states, whatever its truth."""
        seen = log.without_truth()
        error = position_error(seen)[settled(seen, SETTLE)]
        largest = np.abs(seen.torques).max(axis=1)
        return LogScore(
            peak_error=float(error.max()) if len(error) else np.nan,
            rms_error=rms(error) if len(error) else np.nan,
            roughness=rms_torque_change(seen),
            lean=float(lean_angle(seen["theta"], seen["phi"]).max()),
            torque_margin=max(1.0 - float(np.quantile(largest, 1.0 - _RARE)) / torque_limit, 0.0),
        )

    def sizes(self) -> dict[str, float]:
        """Return its numbers by name, with the share of the torque limit that is used in place of that left."""
        return asdict(self) | {"torque_margin": 1.0 - self.torque_margin}


#: names of the quantities, in their order
QUANTITIES = tuple(field.name for field in fields(LogScore))


@dataclass(frozen=True)
class Metric:
    """A number of a run, as tables, figures and sentences show it."""

    key: str  #: of `Score` or `LogScore`
    words: str  #: that name it in a sentence
    unit: str  #: that it is shown in
    scale: float  #: from SI to that unit
    decimals: int
    heading: str = ""  #: of a table's column
    better: Literal["below", "above"] = "below"

    def shown(self, value: float) -> str:
        """Return a value in the unit, without it."""
        return f"{self.scale * value:.{self.decimals}f}" if np.isfinite(value) else "–"


#: of a course that names none, in the order of the tables; of these less is better
METRICS = (
    Metric("peak_position_error", "peak position error", "mm", 1e3, 0, "peak"),
    Metric("rms_position_error", "RMS position error", "mm", 1e3, 0, "RMS"),
    Metric("peak_heading_error", "peak heading error", "deg", 180.0 / np.pi, 1, "heading"),
    Metric("settling_time", "settling time", "s", 1.0, 1, "settling"),
    Metric("rms_torque", "RMS torque", "N m", 1.0, 3, "torque"),
    Metric("high_frequency_torque", "torque above 10 Hz", "N m", 1.0, 3, "above 10 Hz"),
    Metric("energy", "energy exchanged", "J", 1.0, 1, "energy"),
)
#: those that a course may ask for besides
OTHER_METRICS = (
    Metric("peak_lean", "largest lean", "deg", 180.0 / np.pi, 1, "lean"),
    Metric("rms_speed_error", "RMS speed error", "m/s", 1.0, 3, "speed error"),
    Metric("stopping_time", "time to rest", "s", 1.0, 2, "time to rest"),
    Metric("stopping_distance", "stopping distance", "m", 1.0, 2, "stopping distance"),
    Metric("overshoot", "overshoot", "mm", 1e3, 0, "overshoot"),
    Metric("top_speed", "largest speed", "m/s", 1.0, 2, "top speed", "above"),
    Metric("largest_impulse", "largest impulse recovered", "N s", 1.0, 1, "largest impulse", "above"),
)
METRIC_BY_KEY = {metric.key: metric for metric in (*METRICS, *OTHER_METRICS)}
