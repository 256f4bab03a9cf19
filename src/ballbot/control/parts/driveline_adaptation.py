"""Driveline adaptation: compensation that follows each wheel's friction as it changes, by warmth or wear.

The compensation of wheel i is scaled by a_i. Each sample's lost torques say by how much the scales are off (f_i the
friction compensated and r_i the wheel's part in the rolling friction, both unscaled):

    lost_i = a_i f_i + a_r r_i + noise

A Kalman filter of a = (a_1 .. a_n, a_r), which are taken for random walks, slow ones of the drivelines and a quick one
of the floor, tells the two apart: friction of a wheel goes with that wheel's direction of turning, rolling friction
with the ball's direction over the floor. For each wheel that turns, phi having f_i at i and r_i at the end,

    p = P phi      a += p (lost_i - phi.a) / (R/h + phi.p)      P -= p p^T / (R/h + phi.p)

and before it P_jj += h Q_j, never above where it began. The wheels' scales stay within their bounds, and all rest where
nothing is told: while a wheel turns too slowly for its friction to be sure, and while a torque is at its limit. (r_i is
what the torque balance sees of the rolling friction, which is not the torque that carries it: see
`TorqueBalance.by_force`. a_r scales nothing: what the floor takes is `ballbot.control.parts.floor_adaptation`'s.)
The times are those after which a small change has been followed to 63 %, for wheels that turn and friction torques of
`TYPICAL`: Q = (R/T^2)/TYPICAL^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballbot.control.parts.torque_balance import MAX_WHEELS, TorqueBalance
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import called, inlined

#: friction torque of a wheel for which the times hold [N m]
TYPICAL = 0.1
#: how far a floor may be from the one identified on, standard deviation of its scale at the start
_FLOOR_SPREAD = 1.0


@dataclass(frozen=True, kw_only=True)
class DrivelineAdaptation:
    """How fast and how far the compensation of the wheels follows.

    Raises
    ------
    InputError
        Where a number is not positive, or the bounds leave no room for 1.
    """

    balance: TorqueBalance  #: of the robot
    time: float = 120.0  #: over which drivelines are followed, of motion; they warm slowly [s]
    spread: float = 0.05  #: how far they may be from what was identified, standard deviation of their scales
    lowest: float = 0.3  #: bound of the scales
    highest: float = 1.5  #: bound of the scales; above 1 the compensation may exceed what was identified
    floor_time: float = 5.0  #: over which another floor is told from them, of motion [s]
    noise: float = 0.045  #: sqrt(R), error of a wheel's lost torque as the mean of a second [N m s^0.5]
    least_speed: float = 0.3  #: of a wheel, below which it tells nothing [rad/s]

    def __post_init__(self) -> None:
        for name in ("time", "spread", "floor_time", "noise", "least_speed"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} of the driveline adaptation is {value:g}; it must be positive.")
        if not 0.0 <= self.lowest <= 1.0 <= self.highest < math.inf:
            raise InputError(
                f"The bounds of the driveline adaptation are {self.lowest:g} and {self.highest:g}; 1 must lie "
                "between them."
            )


#: numbers that `pack_adaptation` returns
ADAPTATION_SIZE = 9
#: place of the rolling friction's scale among the scales, behind room for those of the wheels
ROLLING = MAX_WHEELS
_SCALES = MAX_WHEELS + 1
#: numbers remembered: the scales less 1, P less what it was at the start, and p; all zero at the start of a run
ADAPTATION_MEMORY = _SCALES * (_SCALES + 2)

# places in a row: 1 where there is an adaptation, then these; h Q and P_jj at the start of each wheel's scale with its
# bounds less 1, and of the rolling friction's, which has none
_LEAST_SPEED, _NOISE, _WHEEL, _LOWEST, _FLOOR = 1, 2, 3, 5, 7
# places in the memory
_P, _COLUMN = _SCALES, _SCALES + _SCALES * _SCALES


def pack_adaptation(adaptation: DrivelineAdaptation | None, sample_time: float) -> list[float]:
    """Return what `judge` reads, `ADAPTATION_SIZE` numbers; all zero where there is none."""
    if adaptation is None:
        return [0.0] * ADAPTATION_SIZE
    R = adaptation.noise**2

    def walk(time: float) -> float:
        return sample_time * R / (TYPICAL * time) ** 2

    return [
        1.0,
        adaptation.least_speed,
        R / sample_time,
        walk(adaptation.time),
        adaptation.spread**2,
        adaptation.lowest - 1.0,
        adaptation.highest - 1.0,
        walk(adaptation.floor_time),
        _FLOOR_SPREAD**2,
    ]


@inlined
def tells(row, place, speed):
    """Return whether a wheel turns fast enough to tell of its friction."""
    return abs(speed) > row[place + _LEAST_SPEED]


@called
def widen(row, place, memory, first, which):
    """Let a scale's variance grow by a sample's walk, up to what it was at the start."""
    diagonal = first + _P + which * (_SCALES + 1)
    walk = row[place + (_FLOOR if which == ROLLING else _WHEEL)]
    memory[diagonal] = min(0.0, memory[diagonal] + walk)


@called
def judge(row, place, memory, first, wheel, friction, carried, lost):
    """Correct the scales by what one wheel lost [N m], of which friction and rolling friction are known unscaled."""
    scale, rolling, column = first + wheel, first + ROLLING, first + _COLUMN
    for j in range(_SCALES):
        line = first + _P + j * _SCALES
        memory[column + j] = memory[line + wheel] * friction + memory[line + ROLLING] * carried
    memory[column + wheel] += row[place + _WHEEL + 1] * friction
    memory[column + ROLLING] += row[place + _FLOOR + 1] * carried
    size = row[place + _NOISE] + memory[column + wheel] * friction + memory[column + ROLLING] * carried
    miss = (lost - (1.0 + memory[scale]) * friction - (1.0 + memory[rolling]) * carried) / size
    for j in range(_SCALES):
        memory[first + j] += memory[column + j] * miss
        if j != ROLLING:
            memory[first + j] = max(row[place + _LOWEST], min(row[place + _LOWEST + 1], memory[first + j]))
        for k in range(_SCALES):
            memory[first + _P + j * _SCALES + k] -= memory[column + j] * memory[column + k] / size
