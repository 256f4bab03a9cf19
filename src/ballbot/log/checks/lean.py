"""Lean axes against the ball's acceleration, by the filtered motion of `ballbot.log.torque_balance`.

The law is that of the momentum about the floor's contact,

    d/dt (v + C w) = -Lambda g                    (`mechanics.model.contact_momentum`)

It contains no torque and no driveline friction: the robot accelerates towards its lean whatever the motors do. It is
evaluated with the lean columns and their rates as they are, and with every exchange and change of sign of them; then
both terms get a free complex gain, whose size is a scale and whose angle is a turn about the vertical.

Disturbances of the ball are not independent of the lean: a controller answers each push with a lean, always in the
same way, so that no standard error over blocks shows the correlation. Unless the law explains nearly everything, a
scale is an error only if a disturbance of the size of the residual, correlated with the lean by `CONFOUNDED`, could not
have made it.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ballbot.arrays import Floats
from ballbot.findings import Finding
from ballbot.log.checks.table import judged
from ballbot.log.evidence import TINY
from ballbot.log.torque_balance import Complex, Motion, as_complex, as_plane, block_sums, clarity
from ballbot.log.units import unit_of_ratio
from ballbot.mechanics.model import contact_momentum
from ballbot.robot import Robot


def _unexplained(columns: Complex, values: Complex) -> Complex:
    """Return values (N,) less their least-squares fit by columns (N, m)."""
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


#: readings within this factor of the best are indistinguishable; one that is clearly better than the columns as logged
#: leaves so many times less unexplained, and is better by so many standard errors
AS_GOOD, CLEARLY_LESS, CLEARLY_BETTER = 1.15, 1.8, 4.0
#: fraction of the ball's acceleration that the best reading must explain for a conclusion, and relative standard error
#: of gravity's gain above which nothing is concluded
EXPLAINED, KNOWN = 0.5, 0.15
#: gains of gravity beyond these, or a turn that another reading of the columns would remove, are accepted only if the
#: law explains nearly everything
USUAL, BETWEEN, MOSTLY = (0.3, 3.0), np.radians(50.0), 0.85
#: gains of gravity's term that are an error, beyond their standard error times `SURE`; correct logs have 0.9 to 1.1
GAIN_RANGE, SURE = (0.87, 1.15), 3.0
#: correlation with the lean that a disturbance reaches through the controller: 0.47 on the logs of a robot
#: whose gain of gravity is 2.3 to 3.8 in 12 of 13 spans of 4 s, where correct logs of the twin have 0.9 to 1.1
CONFOUNDED = 0.5
#: ball speed below which the direction of rolling friction is unknown [m/s]
ROLLING = 0.005

_LEAN, _RATES = ("theta", "phi"), ("theta_dot", "phi_dot")


#: whether two columns are exchanged, and the sign of each; of all readings the first is as logged
Reading = tuple[bool, int, int]
READINGS: list[Reading] = list(product((False, True), (1, -1), (1, -1)))


def matrix_of(reading: Reading) -> Floats:
    """Return the matrix (2, 2) from the logged columns to the quantities."""
    exchanged, *signs = reading
    return np.diag(np.array(signs, dtype=np.float64))[:: -1 if exchanged else 1]


def fault(reading: Reading, names: Sequence[str], *, with_rates: bool = False) -> str:
    """Return the fault of the columns of two names by a reading, and of their rates if they have the same."""
    exchanged, *signs = reading
    wrong = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
    parts = [f"{' and '.join(names)} are swapped"] if exchanged else []
    if wrong:
        parts.append(f"{' and '.join(wrong)} {'have' if len(wrong) > 1 else 'has'} the opposite sign")
    rates = ", with its rate" if len(wrong) == 1 and not exchanged else ", with their rates"
    return " and ".join(parts) + (rates if with_rates else "")


def check_lean_axes(motion: Motion, robot: Robot) -> list[Finding]:
    """Evaluate the law for every reading of the lean columns: signs and exchange, else scale, else a turn of the IMU.

    The finding is a warning if the log is not conclusive, as slipping or shaking wheels have accelerations of their
    own.
    """
    terms, block = _terms(motion, robot), motion.block
    gram = np.array([[block_sums((a.conj() * b).real, block) for b in terms] for a in terms])
    beside = _rates_beside_angles(
        motion
    )  # without it, wheels that shake in their play look like rates of other axes
    pairs = [  # of the angles and of their rates, as logged first
        (g, w)
        for g, w in product(READINGS, READINGS)
        if g == w == READINGS[0] or np.array_equal(matrix_of(g).T @ matrix_of(w), beside)
    ]
    # factors of the first column as first and as second quantity, and of the second column likewise
    weights = np.array([[1.0, *matrix_of(w).T.ravel(), *matrix_of(g).T.ravel()] for g, w in pairs])
    left = np.einsum("hi,ijb,hj->hb", weights, gram, weights)
    total = left.sum(axis=1)
    best = int(np.argmin(total))
    good = [k for k in range(len(pairs)) if total[k] <= AS_GOOD * total[best]]
    good.sort(key=lambda k: (_changes(pairs[k]), total[k]))
    # the gains of both terms under the simplest of the best readings
    weight, y = weights[good[0]], terms[0]
    rates, gravity = (-np.tensordot(weight[part], terms[part], axes=1) for part in (slice(1, 5), slice(5, 9)))
    gains = np.linalg.lstsq(np.column_stack([rates, gravity]), y, rcond=None)[0]
    residual = y - gains[0] * rates - gains[1] * gravity
    # gravity's gain by itself, with the rates' term removed from both sides; errors are clustered by blocks
    alone, rest = _unexplained(rates[:, None], gravity), _unexplained(rates[:, None], y)
    score = alone.conj() * residual
    scores = block_sums(score.real, block) + 1j * block_sums(score.imag, block)
    powers = (float(np.vdot(signal, signal).real) for signal in (alone, y, residual))
    power_alone, power, unknown = (max(power, TINY) for power in powers)
    size, turn, explained = abs(gains[1]), float(np.angle(gains[1])), 1.0 - unknown / power
    error = float(np.linalg.norm(scores) / power_alone)
    usual = USUAL[0] < size < USUAL[1] and abs(turn) < BETWEEN
    if explained < (EXPLAINED if usual else MOSTLY) or error >= KNOWN * size:
        return judged("physics", [])
    advantage = (left[0] - left[best]) / np.maximum(left[0] + left[best], TINY)
    if good[0] != 0 and total[0] > CLEARLY_LESS * total[best] and clarity(advantage) > CLEARLY_BETTER:
        return _misread([pairs[k] for k in good])
    # a disturbance with the correlation has so large a part along the lean for the part that is left; if the law
    # explains nearly everything, nothing else moves the ball
    bias = CONFOUNDED / np.sqrt(1.0 - CONFOUNDED**2) * np.sqrt(unknown / power_alone)
    margin = SURE * error + (0.0 if explained >= MOSTLY else bias)
    # noise of the lean lowers the gain itself, and raises that of the lean regressed on the acceleration
    reverse = float(np.vdot(rest, rest).real) / max(abs(np.vdot(alone, rest)), TINY)
    off = reverse + margin < GAIN_RANGE[0] or size - margin > GAIN_RANGE[1]
    columns, side = (*_LEAN, "x", "y", "x_dot", "y_dot"), "left" if turn > 0.0 else "right"
    degrees, sure = abs(np.degrees(turn)), abs(turn) - SURE * error / size
    unit = unit_of_ratio(size, "m", within=GAIN_RANGE[1])
    key = "lean-scale: unit" if unit else "lean-scale"
    findings = judged(key, columns, float(off), size=size, inverse=1.0 / size, unit=unit)
    return findings or judged("lean-axes: turn", _LEAN, sure, degrees=degrees, side=side)


def _rates_beside_angles(motion: Motion) -> Floats:
    """Return the reading's matrix (2, 2) from the rates' columns to the slopes of the angles' columns as logged."""
    t, turning = motion.even[motion.usable], 1j * motion.turning * motion.lean
    apart = t[2:] - t[:-2]
    slopes = (motion.lean[:, 2:] - motion.lean[:, :-2]) / apart + turning[:, 1:-1]
    pair = [z[:, apart < 1.5 * apart.min()] for z in (slopes, motion.lean_rate[:, 1:-1])]
    angles, rates = (z / np.maximum(np.linalg.norm(z, axis=1, keepdims=True), TINY) for z in pair)
    alike = (angles.conj() @ rates.T).real
    return max(map(matrix_of, READINGS), key=lambda matrix: float(np.sum(matrix * alike)))


def _changes(readings: Sequence[Reading]) -> int:
    """Return the number of separate faults."""
    return sum(exchanged + (min(signs) < 0) for exchanged, *signs in readings)


def _terms(motion: Motion, robot: Robot) -> Complex:
    """Return the law's terms (9, N): acceleration; lever of each rate in either place; pull of each angle likewise."""
    law, turning = contact_momentum(robot), 1j * motion.turning

    def by(matrix: Floats, z: Complex) -> Complex:
        return as_complex(as_plane(z) @ matrix.T)

    rates = [
        by(law.lever[:, :2], axis * w_dot) + turning * by(law.lever[:, :2], axis * w)
        for w, w_dot in zip(motion.lean_rate, motion.lean_acceleration, strict=True)
        for axis in (1.0, 1j)
    ]
    # sin theta in theta's place is +j of g, in phi's place -1
    angles = [by(law.pull, axis * lean) for lean in motion.lean for axis in (1j, -1.0)]
    rolling = motion.velocity / np.maximum(np.abs(motion.velocity), ROLLING)
    # rolling friction, and the constant of a slope or of a lean's zero
    removed = np.column_stack([rolling, np.ones_like(rolling)])
    terms = np.column_stack([motion.acceleration + turning * motion.velocity, *rates, *angles])
    return _unexplained(removed, terms).T


def _misread(readings: Sequence[tuple[Reading, Reading]]) -> list[Finding]:
    """Return the finding that names every simplest reading, of those that explain the motion best, simplest first."""
    causes, columns = [], set[str]()
    for angles, rates in (reading for reading in readings if _changes(reading) == _changes(readings[0])):
        parts = [text for text in (fault(angles, _LEAN), fault(rates, _RATES)) if text]
        causes.append(fault(angles, _LEAN, with_rates=True) if angles == rates else " and ".join(parts))
        columns |= {name for name in (*_LEAN, *_RATES) if any(name in part.split() for part in parts)}
    return judged("lean-axes", sorted(columns), causes=", or ".join(causes))
