"""Residuals as wheel torques, and how they depend on a wheel's speed, travel and position; dither of the wheels' speed.

Residual torque: what the wheels would have had to push more for the model to be right. In the heading frame and
upright, a torque more of du makes the rates h M^-1 W^T du higher after a sample of h. With S the covariance of the
rates' residuals e, least squares weighted by what each rate is known to gives

    du = (J^T S^-1 J)^-1 J^T S^-1 e,      J = h M^-1 W^T

A measured sample is in its residual with its noise, so a dependence on the wheels' speed is estimated from the speed
some rows earlier.

- Speed: friction that the model's law lacks or has too much of.
- Travel since the last reversal: play, or friction with a memory. In a gearbox with play the motor crosses the play
  after each reversal and pushes nothing; then it strikes. So the torque along the motion, s du with s the direction, is
  off within the play and right beyond it. The speed is low there too, and a friction law may be off at low speeds; so
  the travel's part is estimated beside the speed's, s du = f(travel) + g(|w|). Friction that gives way before it slips
  (Dahl's, LuGre's) makes the same mark, over its own length: the two cannot be separated here.
- Position: places where a wheel turns harder, once or several times a turn. Order m recurs m times a turn: rollers
  pass the contact `per_row` times a turn in each ring, an eccentric wheel is felt once. Each order is fitted by itself,
  du = a cos(m angle) + b sin(m angle), and tested, the chance of any false one over all orders and wheels being 1 %
  (Bonferroni).
- Dither: an omni-wheel's rollers pass the contact one by one and shake the wheel. If that shaking is as fast as the
  motion itself, dry friction changes sign with the shaking and is felt by the slow motion as a smaller, smoother
  resistance than the law gives. Heading shows this first, because turning on the spot moves the wheels least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.least_squares import fit_linear
from ballbot.log import Log
from ballbot.log.columns import wheel_speed_names
from ballbot.log.signals import turning_points
from ballbot.mechanics.model import Model
from ballbot.robot import Rollers
from ballbot.robot.derived import encoder_step
from ballbot.validation.prediction import Prediction
from ballbot.validation.statistics import indicators, slices

#: the fast part begins at so many times the unstable pole, above anything that balancing asks for
_FAST = 6.0
#: a log shorter than this many rows is too short for the filter
_LEAST_ROWS = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Dither:
    """The wheels' speed, split in motion and dither; root mean squares over the log."""

    corner: float  #: [Hz] where the fast part begins
    motion: NDArray[np.float64]  #: (n,) [rad/s] below the corner
    dither: NDArray[np.float64]  #: (n,) [rad/s] above the corner
    encoder: float  #: [rad/s] share of the encoder's quantisation above the corner
    heading: NDArray[np.float64]  #: (n,) [rad/s] the part of the motion that turning about the vertical makes
    reversals: NDArray[np.float64]  #: (n,) changes of sign a second
    reversals_of_motion: NDArray[np.float64]  #: (n,) changes of sign a second of the slow part


def find_dither(model: Model, log: Log) -> Dither | None:
    """Return the dither of the wheels' speeds in the log, or None if the log lacks them or is short."""
    from scipy.signal import butter, sosfiltfilt

    names = wheel_speed_names(model.robot.wheel_count)
    rate = 1.0 / log.sample_time
    corner = _FAST * float(model.linearize().poles()[0].real) / (2.0 * np.pi)
    usable = all(name in log and np.isfinite(log[name]).all() for name in names)
    if not usable or len(log) < _LEAST_ROWS or not 0.0 < corner < 0.4 * rate:
        return None
    speeds = log.wheel_speeds
    slow = sosfiltfilt(butter(4, corner, fs=rate, output="sos"), speeds, axis=0)
    sensors, drive = model.robot.sensors, model.robot.drive
    step = encoder_step(encoder_counts=sensors.encoder_counts, gear_ratio=drive.gear_ratio)
    # the difference of two counts, each rounded evenly: variance 2/12 of a step; above the corner, nearly all of it
    counting = step * rate / np.sqrt(6.0)
    return Dither(
        corner=corner,
        motion=_rms(slow),
        dither=_rms(speeds - slow),
        encoder=float(counting),
        heading=np.abs(model.wheel_jacobian(np.zeros(5))[:, 4]) * _rms(log["psi_dot"][:, None]),
        reversals=_reversals(speeds, log),
        reversals_of_motion=_reversals(slow, log),
    )


def _rms(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(np.mean(values**2, axis=0))


def _reversals(speeds: NDArray[np.float64], log: Log) -> NDArray[np.float64]:
    """Return changes of sign a second; a count of zero keeps the sign before it."""
    duration = log.t[-1] - log.t[0]
    changes = []
    for speed in speeds.T:
        moving = speed[speed != 0.0]
        changes.append(np.count_nonzero(np.signbit(moving[1:]) != np.signbit(moving[:-1])) / duration)
    return np.array(changes)


_HORIZONTAL_PAIRS = ((0, 1), (2, 3))
#: a covariance's smallest directions are lifted to this share of its largest, so that it has an inverse
_LIFT = 1e-10


def wheel_torque_residuals(prediction: Prediction, model: Model) -> NDArray[np.float64]:
    """Return the residual torques (steps, n) [N m]."""
    rates = prediction.residuals[:, 5:].copy()
    c, s = np.cos(prediction.heading), np.sin(prediction.heading)
    for first, second in _HORIZONTAL_PAIRS:
        forward, left = rates[:, first].copy(), rates[:, second].copy()
        rates[:, first], rates[:, second] = c * forward + s * left, c * left - s * forward
    upright = np.zeros(5)
    J = prediction.sample_time * np.linalg.solve(model.mass_matrix(upright), model.wheel_jacobian(upright).T)
    scale = np.sqrt(np.mean(rates**2, axis=0)) + np.finfo(float).tiny
    S = np.cov(rates / scale, rowvar=False) + _LIFT * np.eye(len(scale))
    weighted = np.linalg.solve(S, J / scale[:, None])
    gain = np.linalg.solve(weighted.T @ (J / scale[:, None]), weighted.T)
    return (rates / scale) @ gain.T


_BINS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedEffect:
    """Mean residual torque of one wheel at speeds that are equally frequent."""

    speeds: NDArray[np.float64]  #: (b,) [rad/s] mean of each bin
    torques: NDArray[np.float64]  #: (b,) [N m]
    half_widths: NDArray[np.float64]  #: (b,) of the 95 % intervals
    p_value: float  #: of no torque at any speed; NaN if a speed was seldom had

    @property
    def largest(self) -> int:
        """The bin whose torque is the furthest from zero, in errors."""
        return int(np.argmax(np.abs(self.torques) / self.half_widths))


def speed_effect(
    torque: NDArray[np.float64], speed: NDArray[np.float64], blocks: NDArray[np.int64]
) -> SpeedEffect:
    """Return one wheel's mean residual torque (n,) against its earlier speed (n,); NaN is passed over."""
    known = np.isfinite(speed)
    torque, speed, blocks = torque[known], speed[known], blocks[known]
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 2:  # a wheel that stood still
        edges = np.array([-np.inf, np.inf])
    place = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    columns = indicators(place, len(edges) - 1)
    found = fit_linear(columns, torque, blocks)
    return SpeedEffect(
        speeds=columns.T @ speed / columns.sum(axis=0),
        torques=found.values,
        half_widths=found.half_widths,
        p_value=found.p_value(range(columns.shape[1])),
    )


#: [rad] ends of the bins of travel; torques beyond the last end are the reference
TRAVEL_EDGES = (0.003, 0.007, 0.013, 0.025, 0.05, 0.1)
_SPEED_BINS = 8
#: fewer show no play
LEAST_REVERSALS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayEffect:
    """Mean residual torque along the motion, by the travel since the last reversal."""

    travels: NDArray[np.float64]  #: (b,) [rad] mean of each bin
    torques: NDArray[np.float64]  #: (b,) [N m] less that far from a reversal at the same speed
    half_widths: NDArray[np.float64]  #: (b,) of the 95 % intervals
    p_value: float  #: of no torque at any travel
    reversals: int

    @property
    def clearest(self) -> int:
        """The bin whose torque is the furthest from zero, in errors."""
        return int(np.argmax(np.abs(self.torques) / self.half_widths))


def play_effect(
    torques: NDArray[np.float64],
    speeds: NDArray[np.float64],
    angles: NDArray[np.float64],
    blocks: NDArray[np.int64],
    segments: Sequence[int],
    *,
    least_turn: float,
) -> PlayEffect | None:
    """Return how the wheels' residual torques depend on the travel since the last reversal.

    Parameters
    ----------
    torques, speeds, angles : ndarray (n, wheels)
        Residual torque, speed some rows earlier (NaN if missing), encoders' angle.
    blocks : ndarray (n,)
    segments : sequence of int
    least_turn : float
        A turn back by less is the encoder's noise [rad].

    Returns
    -------
    PlayEffect or None
        None if the wheels hardly turned back.
    """
    moved = [since_reversal(angle, segments, least_turn=least_turn) for angle in angles.T]
    travel, way = (np.concatenate(parts) for parts in zip(*moved, strict=True))
    along, speed = way * torques.T.ravel(), np.abs(speeds.T.ravel())
    known = np.isfinite(travel) & np.isfinite(speed)
    reversals = int(sum(np.count_nonzero(np.diff(w[np.isfinite(t)]) != 0.0) for t, w in moved))
    travel, along, speed = travel[known], along[known], speed[known]
    block = np.tile(blocks, angles.shape[1])[known]
    place = np.searchsorted(TRAVEL_EDGES, travel)
    if reversals < LEAST_REVERSALS or len(np.unique(place)) <= len(TRAVEL_EDGES):
        return None
    edges = np.quantile(speed, np.linspace(0.0, 1.0, _SPEED_BINS + 1))[1:-1]
    of_speed = indicators(np.searchsorted(edges, speed), _SPEED_BINS)
    of_travel = indicators(place, len(TRAVEL_EDGES))
    found = fit_linear(np.hstack([of_travel, of_speed]), along, block)
    count = len(TRAVEL_EDGES)
    return PlayEffect(
        travels=of_travel.T @ travel / of_travel.sum(axis=0),
        torques=found.values[:count],
        half_widths=found.half_widths[:count],
        p_value=found.p_value(range(count)),
        reversals=reversals,
    )


def since_reversal(
    angle: NDArray[np.float64], segments: Sequence[int], *, least_turn: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far an angle (n,) has come since it last turned back, and its direction; NaN before the first time."""
    travel, way = np.full_like(angle, np.nan), np.zeros_like(angle)
    for where in slices(segments):
        turns = turning_points(angle[where], least_turn)
        for first, last in pairwise(turns[1:]):
            rows = slice(where.start + first + 1, where.start + last + 1)
            travel[rows] = np.abs(angle[rows] - angle[where.start + first])
            way[rows] = np.sign(angle[where.start + last] - angle[where.start + first])
    return travel, way


#: chance of any false order
ORDER_LEVEL = 0.01
#: a wheel that turned less than this shows no position twice [turns]
LEAST_TURNS = 1.0
#: largest number of orders reported for a wheel
_MOST_FOUND = 6
#: an amplitude of noise is below this many standard errors of its parts in 95 % of cases (Rayleigh's)
_QUANTILE = 2.45


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionEffect:
    """Amplitudes of residual torque by order and wheel."""

    orders: NDArray[np.int64]  #: (m,) times a turn
    amplitudes: NDArray[np.float64]  #: (m, wheels) [N m]
    half_widths: NDArray[np.float64]  #: (m, wheels) of the amplitude of noise alone, 95 %
    significant: NDArray[np.bool_]  #: (m, wheels)
    per_row: int  #: rollers in a ring
    turns: float  #: that the wheels covered, the one that turned least

    @property
    def found(self) -> tuple[int, ...]:
        """The orders that are significant in any wheel."""
        return tuple(self.orders[self.significant.any(axis=1)].tolist())


def position_effect(
    torques: NDArray[np.float64], angles: NDArray[np.float64], blocks: NDArray[np.int64], *, rollers: Rollers
) -> PositionEffect | None:
    """Return the orders of residual torques (n, wheels) over encoder angles (n, wheels) of one log.

    They go up to twice the rollers of a wheel. None if a wheel turned less than `LEAST_TURNS`.
    """
    turns = float(np.ptp(angles, axis=0).min()) / (2.0 * np.pi)
    if turns < LEAST_TURNS:
        return None
    orders = np.arange(1, 2 * rollers.rows * rollers.per_row + 1)
    level = ORDER_LEVEL / (len(orders) * angles.shape[1])
    wheels = [
        _orders_of(torque - torque.mean(), angle, blocks, orders, level=level)
        for torque, angle in zip(torques.T, angles.T, strict=True)
    ]
    amplitudes, half_widths, significant = (np.column_stack(parts) for parts in zip(*wheels, strict=True))
    return PositionEffect(
        orders=orders,
        amplitudes=amplitudes,
        half_widths=half_widths,
        significant=significant,
        per_row=rollers.per_row,
        turns=turns,
    )


def _orders_of(
    torque: NDArray[np.float64],
    angle: NDArray[np.float64],
    blocks: NDArray[np.int64],
    orders: NDArray[np.int64],
    *,
    level: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return amplitudes, noise and significance (m,) of one wheel's orders.

    An order that is found is taken out before the others are looked at again: over few turns, each leaks into its
    neighbours.
    """
    amplitudes, half_widths = np.zeros(len(orders)), np.zeros(len(orders))
    significant = np.zeros(len(orders), dtype=np.bool_)
    for _ in range(_MOST_FOUND):
        waves = [np.column_stack([np.cos(m * angle), np.sin(m * angle)]) for m in orders]
        fits = [fit_linear(wave, torque, blocks) for wave in waves]
        for place in np.flatnonzero(~significant):
            amplitudes[place] = np.hypot(*fits[place].values)
            half_widths[place] = _QUANTILE * np.sqrt(0.5 * np.trace(fits[place].covariance))
        p_values = [
            1.0 if found else one.p_value((0, 1)) for one, found in zip(fits, significant, strict=True)
        ]
        surest = int(np.argmin(p_values))
        if p_values[surest] > level:
            break
        significant[surest] = True
        torque = torque - waves[surest] @ fits[surest].values
    return amplitudes, half_widths, significant
