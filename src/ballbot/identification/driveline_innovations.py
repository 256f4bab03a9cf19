"""One driveline predicted a sample ahead: the innovations, the encoder's angles less the predicted ones.

    (j_w + j_r) w_dot = u - tau(w) + noise        theta_dot = w

The torque that acts is not the one recorded: it is noisy, and the noise moves the speed for a mechanical time constant.
A simulation of the whole sweep takes that for an effect of the parameters. So the model is corrected after each sample
by the innovation e, the encoder's angle less the predicted one,

    theta += alpha e        w += beta e / h

and the parameters minimize the innovations (prediction-error method: L. Ljung, System Identification,
2nd ed. 1999, chapter 7; the gains: P. Kalata, The tracking index, IEEE Transactions on Aerospace and Electronic Systems
20 (1984) 174-182). The gains are estimated beside the friction; beta = 0 is a simulation without noise of the torque.
Angles and not speeds are compared: a speed differenced from counts is that of half its window ago.

Three effects act where s, v_s and delta do, in the tenths of a second about each stop:

*Noise at rest.* A torque of mean u and deviation sigma moves a wheel that u alone would leave at rest. The speed
expected after a sample is that of a normal variable cut off at zero, m Phi(m/d) + d phi(m/d), with d = sigma h / J.

*Play.* A motor that breaks away crosses the rest of the gearbox's play alone, j_r, and then takes its wheel along:
w <- w j_r / (j_w + j_r). How far each break-away goes alone is estimated, from zero to the play in the robot file.

*Delay* of the torque, in samples, is estimated from zero to `MOST_DELAY`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.friction import dry_friction
from ballbot.mechanics.friction_laws.classical import ClassicalNumbers
from ballbot.mechanics.friction_laws.interface import UNLIMITED, Inertia, move

#: parameters of the friction: b, c, s, v_s, delta; then the delay [samples], alpha, beta and each break-away's gap
FRICTION_SIZE, DELAY, ALPHA, BETA, GAPS = 5, 5, 6, 7, 8
#: longest delay of the torque [samples]
MOST_DELAY = 4.0
#: innovations left out after a start, whose speed is the noisy measured one [samples]
SETTLING = 5
#: longest inner step [s]; RK4 errs by 1e-6 over a time constant of ten steps
_STEP = 5e-3
#: a motor that keeps its angle for so long rests [s]
_REST = 0.1
#: deviations from rest within which noise of the torque counts
_REACH = 6.0
#: an angle that jumps by more from what its speed gives is reset, or wraps [rad]
_LARGEST_JUMP = 0.5
#: a speed so small is rest [rad/s]; corrections would let it fade for hundreds of samples
_AT_REST = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """What one-step predictions of a sweep need."""

    torque: NDArray[np.float64]  #: (N,) [N m]
    angle: NDArray[np.float64]  #: (N,) of the motor at the wheel [rad]
    speed: NDArray[np.float64]  #: (N,) measured, for the starts of pieces [rad/s]
    pieces: tuple[tuple[int, int], ...]  #: first row and row after the last
    sample_time: float  #: [s]
    inertia: float  #: j_w + j_r [kg m^2]
    rotor_inertia: float  #: j_r [kg m^2]
    brake: float  #: b_e of the motor's back-EMF beside b [N m s/rad]
    event: NDArray[np.int64]  #: (N,) which break-away a row follows, -1 before the first
    origin: NDArray[np.float64]  #: (N,) where the motor rested before that [rad]

    def __post_init__(self) -> None:
        torque = real_array(self.torque, ("rows",), "The array of torques")
        object.__setattr__(self, "torque", torque)
        for name in ("angle", "speed", "origin"):
            rows = real_array(getattr(self, name), (len(torque),), f"The array of the {name}")
            object.__setattr__(self, name, rows)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which innovations (m,) are of a turning wheel; at rest they are zero and show no noise."""
        steps = np.abs(np.diff(self.angle)) > 0.0
        return np.concatenate([steps[first + SETTLING : end - 1] for first, end in self.pieces])

    @property
    def events(self) -> list[int]:
        """The break-aways within the pieces."""
        found = np.unique(np.concatenate([self.event[first + 1 : end] for first, end in self.pieces]))
        return [int(one) for one in found if one >= 0]


class Numbers(NamedTuple):
    """What the predictions of a piece have in common, in compiled code."""

    inertia: float  #: j_w + j_r [kg m^2]
    rotor_inertia: float  #: j_r [kg m^2]
    noise: float  #: deviation of the speed after a sample, from noise of the torque [rad/s]
    sample_time: float  #: [s]
    start: float  #: speed of the first row [rad/s]


@inlined
def _free(inertia):
    return Inertia(1.0 / inertia, UNLIMITED, UNLIMITED, 0.0)


@inlined
def _cross_gap(law, numbers, torque, speed, end, travel, part, h):
    """Return speed and travel of a step in which the motor meets its wheel after that part of its travel."""
    met = (speed + part * (end - speed)) * numbers.rotor_inertia / numbers.inertia
    end, rest = move(law, _free(numbers.inertia), torque, np.empty(0), met, (1.0 - part) * h)
    return end, part * travel + rest


@inlined
def _expected(mean, deviation):
    """Return the mean of a normal variable whose negative values become zero."""
    q = mean / deviation
    density = math.exp(-0.5 * q * q) / math.sqrt(2.0 * math.pi)
    return deviation * (density + q * 0.5 * (1.0 + math.erf(q / math.sqrt(2.0))))


@inlined
def _with_noise(law, torque, start, end, deviation, inertia, h):
    """Return the speed expected after a sample of a wheel at rest or nearly, whose torque is noisy."""
    forward = start > 0.0 or (start == 0.0 and torque > 0.0)
    direction = 1.0 if forward else -1.0
    mean = direction * end
    if not mean > 0.0:
        speed = abs(start)
        mean = speed + h / inertia * (direction * torque - law.b * speed - dry_friction(law, speed))
    if abs(mean) < _REACH * deviation:
        return direction * _expected(mean, deviation)
    return end


@compiled
def _run(rows, numbers, steps, torque, angle, event, origin, out):
    """Write the innovations (k, N - 1) of a piece by rows of parameters (k, 8 + events); see `innovations`."""
    h, state = numbers.sample_time, np.empty(0)
    for lane in range(len(rows)):
        row = rows[lane]
        law = ClassicalNumbers(row[0], row[1], row[2], 1.0 / row[3], row[4])
        whole = max(int(row[DELAY]), 0)
        late = row[DELAY] - whole
        theta, w, current, engaged = angle[0], numbers.start, -1, True
        for k in range(1, len(angle)):
            if event[k] != current:
                current = event[k]
                engaged = current < 0 or row[GAPS + current] <= 0.0
            held, before = torque[max(k - 1 - whole, 0)], torque[max(k - 2 - whole, 0)]
            start, origin_of = w, origin[k]
            # the torque of the sample before still acts for the delay's part of a sample
            for step in range(steps + 1):
                u = before if step == 0 else held
                part = late * h if step == 0 else (1.0 - late) * h / steps
                if not part > 0.0:
                    continue
                begin = w
                w, travel = move(
                    law, _free(numbers.inertia if engaged else numbers.rotor_inertia), u, state, w, part
                )
                if not engaged and travel != 0.0:
                    left = row[GAPS + current] - abs(theta - origin_of)
                    if abs(theta + travel - origin_of) >= row[GAPS + current]:
                        engaged = True
                        met = min(max(left / abs(travel), 0.0), 1.0)
                        w, travel = _cross_gap(law, numbers, u, begin, w, travel, met, part)
                theta += travel
            inertia = numbers.inertia if engaged else numbers.rotor_inertia
            deviation = numbers.noise * numbers.inertia / inertia
            if deviation > 0.0 and abs(w) < _REACH * deviation:
                mean_torque = late * before + (1.0 - late) * held
                expected = _with_noise(law, mean_torque, start, w, deviation, inertia, h)
                theta += 0.5 * h * (expected - w)
                w = expected
            error = angle[k] - theta
            out[lane, k - 1] = error / h
            theta += row[ALPHA] * error
            w += row[BETA] * error / h
            if abs(w) < _AT_REST:
                w = 0.0


def break_aways(
    angle: NDArray[np.float64], *, sample_time: float, play: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return each row's break-away (N,), -1 before the first, and the angle (N,) at which the motor rested before it.

    Rests within the play of one another belong to one break-away: noise makes a motor creep before it starts.
    """
    event, origin = np.full(len(angle), -1, dtype=np.int64), np.zeros(len(angle))
    if play <= 0.0:
        return event, origin
    steps = np.abs(np.diff(angle))
    # encoders step by counts; a count to and fro is rest
    count = float(steps[steps > 0.0].min()) if np.any(steps > 0.0) else 0.0
    still = np.concatenate([[False], steps <= 1.5 * count, [False]])
    edges = np.flatnonzero(np.diff(still)).reshape(-1, 2)
    rests = [(a, b) for a, b in edges if b - a >= _REST / sample_time]
    number, last = -1, math.inf
    for a, b in rests:
        place = float(angle[(a + b) // 2])
        if abs(place - last) < play:
            continue
        number, last = number + 1, place
        event[a:], origin[a:] = number, place
    return event, origin


def angles_of(
    angle: NDArray[np.float64] | None, speed: NDArray[np.float64], *, sample_time: float
) -> NDArray[np.float64]:
    """Return the encoder's angles (N,), or the speed's integral if they are missing or contradict the speed."""
    if angle is not None:
        apart = np.diff(angle) - sample_time * speed[1:]
        allowed = np.maximum(_LARGEST_JUMP, 0.5 * sample_time * np.abs(speed).max())
        if np.all(np.abs(apart) < allowed) and np.mean(np.abs(apart)) < 0.1 * sample_time * np.mean(
            np.abs(speed)
        ):
            return angle
    return sample_time * np.cumsum(speed)


def innovations(track: Track, rows: NDArray[np.float64], *, noise: float) -> NDArray[np.float64]:
    """Return the innovations (k, m) [rad/s] of all pieces by rows of parameters (k, 8 + events).

    Parameters
    ----------
    track : Track
    rows : ndarray (k, 8 + events)
        SI units; see `FRICTION_SIZE`.
    noise : float
        Standard deviation of what the torque's noise changes the speed by in a sample [rad/s].

    Raises
    ------
    InputError
        If the rows have another length, or hold a value that is not finite.
    """
    steps = max(1, math.ceil(track.sample_time / _STEP - 1e-9))
    size = GAPS + int(track.event.max()) + 1
    braked = real_array(rows, ("sets", size), "The array of the driveline's parameters").copy()
    braked[:, 0] += track.brake
    found = []
    for first, end in track.pieces:
        out = np.empty((len(rows), end - first - 1))
        _run(
            braked,
            Numbers(track.inertia, track.rotor_inertia, noise, track.sample_time, float(track.speed[first])),
            steps,
            track.torque[first:end],
            track.angle[first:end],
            track.event[first:end],
            track.origin[first:end],
            out,
        )
        found.append(out[:, SETTLING:])
    return np.concatenate(found, axis=1)
