"""Whether a sweep of free wheels is one: torques against speeds, by the driveline's own equation.

    (j_w + j_r) w_dot + b w + c sgn(w) + offset = u

is fitted to pieces of 0.1 s, each an integral over time, so that no speed is differentiated. The inertia found over the
robot file's shows units of torque, speed and time; the power u w shows signs; the share of u explained shows order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.identification.driveline import Sweep
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: [s], of an integral
_PIECE = 0.1
_LEAST_PIECES = 20
#: correlation of torque and speed below which motors take energy from the wheels that they alone drive
_BRAKES = -0.3
#: share of the torque that the equation must explain
_EXPLAINED = 0.5
#: another order of the wheels must leave this share of what the columns' own order leaves
_BETTER_ORDER = 0.3
#: inertia found over the file's; rotors are often known to a factor of two only
_USUAL, _POSSIBLE = (0.65, 1.6), (0.2, 5.0)
#: a cause explains a factor up to this factor
_NEAR = 1.6
#: speed over that of the motor without load
_FASTEST = 1.4
#: of one wheel over that of the others
_UNLIKE = 2.5
#: a wheel that turns by less than this share of the others' is dead
_DEAD = 0.03
#: [s], of one and the same speed
_FROZEN = 0.25
#: [s]; slower rows show no dry friction
_SLOWEST_SAMPLING = 0.1


def sweep_findings(robot: Robot, sweeps: Sequence[Sweep]) -> tuple[Finding, ...]:
    """Return the faults of the sweeps of all wheels of a robot, errors first."""
    fits = [_fit(sweep.torque, sweep) for sweep in sweeps]
    dead = [one for sweep in sweeps for one in _dead(sweep, sweeps)]
    frozen = [one for sweep in sweeps for one in _frozen(sweep)]
    findings = [*_sampling(sweeps[0]), *_limit(sweeps), *frozen, *dead]
    if not dead:
        findings += _order(sweeps, fits) or [
            *_sign(sweeps),
            *(one for sweep, fit in zip(sweeps, fits, strict=True) for one in _unrelated(sweep, fit)),
        ]
    if not any(one.code in ("torque-sign", "torque-order", "torque-unrelated") for one in findings):
        findings += _scale(robot, sweeps, fits)
    return by_severity(findings)


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """The equation fitted to one wheel."""

    inertia: float  #: over the robot file's
    error: float  #: standard error of that
    explained: float  #: share of the torque's variance; NaN if there are too few pieces


def _fit(torque: NDArray[np.float64], sweep: Sweep) -> _Fit:
    """Fit the equation to a wheel's speed and that torque (N,), which may be another wheel's."""
    h, rows = sweep.sample_time, max(2, round(_PIECE / sweep.sample_time))
    starts = np.concatenate([np.arange(a, b - rows, rows) for a, b in sweep.pieces()] or [np.empty(0, int)])
    if len(starts) < _LEAST_PIECES:
        return _Fit(inertia=math.nan, error=math.nan, explained=math.nan)
    within = starts[:, None] + np.arange(rows)
    speed, ends = sweep.speed[within], sweep.speed[starts + rows] - sweep.speed[starts]
    X = np.column_stack(
        [
            sweep.inertia * ends,
            h * speed.sum(axis=1),
            h * np.sign(speed).sum(axis=1),
            np.full(len(starts), rows * h),
        ]
    )
    y = h * torque[within].sum(axis=1)
    found, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
    if rank < X.shape[1] or not np.var(y) > 0.0:
        return _Fit(inertia=math.nan, error=math.nan, explained=math.nan)
    left = y - X @ found
    variance = np.linalg.inv(X.T @ X)[0, 0] * np.var(left)
    return _Fit(
        inertia=float(found[0]),
        error=float(np.sqrt(variance)),
        explained=float(1.0 - np.var(left) / np.var(y)),
    )


def _columns(sweep: Sweep) -> tuple[str, str]:
    return f"u{sweep.wheel}", f"wheel{sweep.wheel}_dot"


def _finding(code: str, text: str, *columns: str, severity: Severity = "error") -> Finding:
    return Finding(code=code, severity=severity, text=text, where=Place(columns=columns))


def _sampling(sweep: Sweep) -> Iterator[Finding]:
    h = sweep.sample_time
    if h > _SLOWEST_SAMPLING:
        cause = (
            f"t appears to be in milliseconds ({0.001 * h:.3g} s)" if h >= 1.0 else "log at 100 Hz or more"
        )
        yield _finding("scale", f"Rows come every {h:.3g} s, too slowly for a driveline; {cause}.", "t")


def _limit(sweeps: Sequence[Sweep]) -> Iterator[Finding]:
    """Yield a limit that no wheel comes near, so that where the supply limits the speed would count as free."""
    fastest = max(float(np.abs(sweep.speed).max()) for sweep in sweeps)
    if sweeps[0].limit > _FASTEST * fastest:
        text = (
            f"The speed limit is {sweeps[0].limit:.4g} rad/s and the wheels reach {fastest:.4g} rad/s. "
            f"If the limit was given in rpm, it is {sweeps[0].limit * math.pi / 30.0:.4g} rad/s."
        )
        yield _finding("speed-limit", text, severity="warning")


def _frozen(sweep: Sweep) -> Iterator[Finding]:
    """Yield a speed that repeats itself, beside rest and the supply's limit."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(sweep.speed)) + 1, [len(sweep.speed)]])
    level = np.abs(sweep.speed[edges[:-1]])
    counted = np.where((level > 0.0) & (level < 0.97 * sweep.limit), np.diff(edges), 0)
    longest = int(np.argmax(counted))
    lasts = float(counted[longest]) * sweep.sample_time
    if counted[longest] >= 20 and lasts > _FROZEN:
        start, (u, w) = float(sweep.t[edges[longest]]), _columns(sweep)
        moved = float(np.ptp(sweep.torque[edges[longest] : edges[longest + 1]]))
        text = (
            f"{w} stays at {sweep.speed[edges[longest]]:.4g} rad/s for {lasts:.2g} s from t = {start:.4g} s "
            f"on, while {u} changes by {moved:.3g} N m: the encoder or the log froze. Remove that interval."
        )
        yield _finding("stuck", text, w)


def _dead(sweep: Sweep, sweeps: Sequence[Sweep]) -> Iterator[Finding]:
    others = [one for one in sweeps if one is not sweep]
    turns = _rms(sweep.speed) / max(_rms(one.speed) for one in others)
    drives = _rms(sweep.torque) / max(_rms(one.torque) for one in others)
    u, w = _columns(sweep)
    if turns < _DEAD:
        text = (
            f"Wheel {sweep.wheel} hardly turns ({np.abs(sweep.speed).max():.2g} rad/s at "
            f"most) while {u} reaches {np.abs(sweep.torque).max():.3g} N m and the other "
            "wheels turn: its motor or its encoder is dead, or the wheel is jammed."
        )
        yield _finding("dead-motor", text, u, w)
    elif drives < _DEAD:
        text = (
            f"{u} stays below {np.abs(sweep.torque).max():.2g} N m while wheel {sweep.wheel} "
            "turns like the others: its torque was not logged, or has another unit."
        )
        yield _finding("dead-motor", text, u, w)


def _sign(sweeps: Sequence[Sweep]) -> Iterator[Finding]:
    wrong = [sweep for sweep in sweeps if _power(sweep) < _BRAKES]
    if not wrong:
        return
    if len(wrong) == len(sweeps):
        what = "All torques, or all wheel speeds, have the opposite sign"
    else:
        pairs = [" or ".join(_columns(sweep)) for sweep in wrong]
        what = f"{' and '.join(pairs)} {'has' if len(wrong) == 1 else 'have'} the opposite sign"
    text = (
        f"{what}: the free wheels turn against their motors all the time (correlation "
        f"{_power(wrong[0]):.2f}), and nothing else drives them. Negate the torques or the speeds."
    )
    yield _finding("torque-sign", text, *(name for sweep in wrong for name in _columns(sweep)))


def _order(sweeps: Sequence[Sweep], fits: Sequence[_Fit]) -> list[Finding]:
    """Return an error if the torques fit the wheels in another order; torques that are all alike show none."""
    torques = np.array([sweep.torque for sweep in sweeps])
    if any(math.isnan(fit.explained) for fit in fits):
        return []
    left = np.array([[1.0 - _fit(torque, sweep).explained for torque in torques] for sweep in sweeps])
    orders = list(permutations(range(len(sweeps))))
    costs = [sum(left[wheel, column] for wheel, column in enumerate(order)) for order in orders]
    best = int(np.argmin(costs))
    # the first order is the columns' own
    if not costs[best] < _BETTER_ORDER * costs[0] or costs[0] < 0.05 * len(sweeps):
        return []
    moved = [(wheel, column) for wheel, column in enumerate(orders[best]) if wheel != column]
    pairs = [f"u{column + 1} drives wheel {wheel + 1}" for wheel, column in moved]
    text = f"The torques are in another order than the wheels: {', '.join(pairs)}. Rename the columns."
    columns = tuple(f"u{wheel + 1}" for wheel, _ in moved)
    return [_finding("torque-order", text, *columns)]


def _unrelated(sweep: Sweep, fit: _Fit) -> Iterator[Finding]:
    if fit.explained < _EXPLAINED and _power(sweep) >= _BRAKES:
        u, w = _columns(sweep)
        text = (
            f"{w} explains only {100.0 * max(fit.explained, 0.0):.0f} % of {u}: that torque does not "
            "move that wheel. The column may belong to another wheel or another run, or be noise."
        )
        yield _finding("torque-unrelated", text, u, w)


def _scale(robot: Robot, sweeps: Sequence[Sweep], fits: Sequence[_Fit]) -> list[Finding]:
    known = [fit for fit in fits if math.isfinite(fit.inertia) and fit.error < 0.5 * abs(fit.inertia)]
    fastest = max(float(np.abs(sweep.speed).max()) for sweep in sweeps)
    over = fastest / _no_load_speed(robot)
    findings = []
    if known:
        ratio = float(np.median([fit.inertia for fit in known]))
        findings += _unlike_others(sweeps, fits, ratio) or _off_by(ratio, robot, sweeps)
    if over > _FASTEST and all(one.severity != "error" for one in findings):
        units = {"rpm": 30.0 / math.pi, "deg/s": 180.0 / math.pi}
        near = [unit for unit, factor in units.items() if over < _FASTEST * factor]
        text = (
            f"The wheels turn at up to {fastest:.4g} rad/s, {over:.3g} times the "
            f"{_no_load_speed(robot):.3g} rad/s that the robot's motors reach without load. Check the "
            f"unit of the speeds ({' or '.join(near) or 'encoder counts'}?) and drive.supply_voltage."
        )
        findings.append(_finding("speed-limit", text, *(_columns(sweep)[1] for sweep in sweeps)))
    return findings


def _unlike_others(sweeps: Sequence[Sweep], fits: Sequence[_Fit], usual: float) -> list[Finding]:
    """Return an error for each wheel whose torques or speeds have another scale than the others'."""
    findings = []
    for sweep, fit in zip(sweeps, fits, strict=True):
        ratio = fit.inertia / usual
        if fit.error < 0.3 * abs(fit.inertia) and not 1.0 / _UNLIKE < ratio < _UNLIKE:
            u, w = _columns(sweep)
            text = (
                f"By {u} and {w}, wheel {sweep.wheel} has {ratio:.3g} times the inertia of the other "
                "wheels: one of the two columns has another unit than those of the other wheels."
            )
            findings.append(_finding("torque-scale", text, u, w))
    return findings


def _off_by(ratio: float, robot: Robot, sweeps: Sequence[Sweep]) -> list[Finding]:
    columns = tuple(name for sweep in sweeps for name in _columns(sweep))
    if _USUAL[0] <= ratio <= _USUAL[1]:
        return []
    if ratio < 0.0:
        text = (
            f"By these torques the wheels would have {ratio:.3g} times the inertia "
            "in the robot file: they speed up when the torque falls. Torques and "
            "speeds are not simultaneous; shift the columns u in time."
        )
        return [_finding("torque-delay", text, *columns)]
    severity: Severity = "warning" if _POSSIBLE[0] <= ratio <= _POSSIBLE[1] else "error"
    causes = list(_causes(ratio, robot, sweeps))
    if not causes:
        causes = ["torques, speeds or t are in another unit"]
    if severity == "warning" or causes[0].endswith("another unit"):
        causes.append("wheels.inertia, drive.motor_inertia or drive.gear_ratio is wrong")
    text = (
        f"By these torques the wheels have {ratio:.3g} times the inertia in the "
        f"robot file ({sweeps[0].inertia:.3g} kg m^2): {', or '.join(causes)}."
    )
    return [_finding("torque-scale", text, *columns, severity=severity)]


def _causes(ratio: float, robot: Robot, sweeps: Sequence[Sweep]) -> Iterator[str]:
    """Yield the slips of units that make such a ratio and that leave torques, speeds and time of this robot."""
    drive = robot.drive
    n = drive.gear_ratio
    fastest = max(float(np.abs(sweep.speed).max()) for sweep in sweeps) / _no_load_speed(robot)
    strongest = max(float(np.abs(sweep.torque).max()) for sweep in sweeps) / drive.torque_limit
    h = sweeps[0].sample_time
    slips = (
        # what it is, the ratio that it makes, and by what it multiplies torque, speed and time
        ("the torques are in mN m", 1e3, 1e3, 1.0, 1.0),
        ("the torques are in N cm", 1e2, 1e2, 1.0, 1.0),
        ("the torques are the motors', before the gear", 1.0 / n, 1.0 / n, 1.0, 1.0),
        ("the torques are currents in A", 1.0 / (n * drive.torque_constant), None, 1.0, 1.0),
        ("the torques are in percent of the largest", 100.0 / drive.torque_limit, None, 1.0, 1.0),
        ("the speeds are in rpm", math.pi / 30.0, 1.0, 30.0 / math.pi, 1.0),
        ("the speeds are in deg/s", math.pi / 180.0, 1.0, 180.0 / math.pi, 1.0),
        ("the speeds are the motors', before the gear", 1.0 / n, 1.0, n, 1.0),
        ("the speeds are in turns a second", 2.0 * math.pi, 1.0, 1.0 / (2.0 * math.pi), 1.0),
        ("t is in milliseconds", 1e3, 1.0, 1.0, 1e3),
    )
    for words, makes, torque, speed, time in slips:
        fits = 1.0 / _NEAR < ratio / makes < _NEAR
        torque_factor = makes if torque is None else torque
        believable = (
            strongest / torque_factor < 1.5 and fastest / speed < _FASTEST and h / time < _SLOWEST_SAMPLING
        )
        if fits and believable and h / time > 1e-5:
            yield words


def _no_load_speed(robot: Robot) -> float:
    drive = robot.drive
    return wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )


def _power(sweep: Sweep) -> float:
    """Return the correlation of torque and speed about zero."""
    return float(np.mean(sweep.torque * sweep.speed)) / (_rms(sweep.torque) * _rms(sweep.speed) or 1.0)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
