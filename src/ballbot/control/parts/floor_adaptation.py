"""Floor adaptation: the drag of the floor is separated from the pull of a slope, and turns with the motion.

Rolling friction acts against the motion: where that turns or ends, it does so at once, and an integral that carries
it is wrong until it has forgotten it. A slope's push stays. So the integral action's sum G (2,), world frame, is taken
for a part b that stays and a drag kappa along the commanded motion,

    G = b + kappa d + noise        d = v_r/|v_r|, a ramp below the speed from which it counts as motion

b and kappa are random walks, which a Kalman filter separates: at rest G shows b alone, and what comes with a motion
is kappa. What is given is I + kappa d in the integral's place, I = G - kappa d, so that nothing jumps as kappa changes
(within the integral's limit), and a motion that turns or ends takes its drag with it. For each axis, phi being
(1, 0, d_x) or (0, 1, d_y),

    p = P phi     (b, kappa) += p (G_i - phi.(b, kappa)) / (R + phi.p)     P -= p p^T / (R + phi.p)

and before it P_jj += Q_j, never above where it began: what a slope takes at the start is learnt as quickly as what the
floor does, and later slowly. kappa stays within its bound; it rests while nothing is asked to
move, and all rest while a torque or the lean is at its limit. Times are those after which a small change has been
followed to 63 %: in units of a second's noise R = 1/h, Q = h/T^2 and P begins at 1/T. (kappa also takes what else
turns with the motion: what the wheels' compensation leaves, and what feedback of the lean makes of it.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.part import LawSettings, Part, Steps
from ballbot.control.records import number, setting, whole
from ballbot.mechanics.engine.compiled import called, inlined

#: |d|^2 below which nothing is asked to move: a shaped motion never ends altogether
_MOVES = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorRecord:
    """R, then h Q and P at the start of b and of kappa, and the bounds."""

    on: int = field(default=1, metadata=whole())
    noise: float = field(metadata=number("1/s"))
    slope_walk: float = field(metadata=number("1/s"))
    slope_start: float = field(metadata=number("1/s"))
    drag_walk: float = field(metadata=number("1/s"))
    drag_start: float = field(metadata=number("1/s"))
    highest: float = field(metadata=number("m s"))
    steepness: float = field(metadata=number("s/m"))


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorState:
    """kappa, b, and P less what it was at the start."""

    drag: float = field(metadata=number("m s"))
    slope: NDArray[np.float64] = field(metadata=number("m s", 2))
    P_xx: float = field(metadata=number("1/s"))
    P_yy: float = field(metadata=number("1/s"))
    P_kk: float = field(metadata=number("1/s"))
    P_xy: float = field(metadata=number("1/s"))
    P_xk: float = field(metadata=number("1/s"))
    P_yk: float = field(metadata=number("1/s"))


@inlined
def direction(own, v_x, v_y):
    """Return d (2,) for the commanded velocity; `own` is a `FloorRecord`."""
    speed = (v_x * v_x + v_y * v_y) ** 0.5
    share = min(1.0, speed * own.steepness) / max(speed, 1e-300)
    return share * v_x, share * v_y


@inlined
def _learn(law, memory, now, limited):
    """Step the filter, unless a torque or the error is at its limit."""
    if law.floor_adaptation.on > 0 and not limited:
        d_x, d_y = direction(law.floor_adaptation, now.wanted[0].rate, now.wanted[1].rate)
        _separate(law.floor_adaptation, memory.floor_adaptation, memory.integral.sums, d_x, d_y)


@called
def _separate(own, state, sums, d_x, d_y):
    """Step the filter by a sample; `sums` are the integrals of x and y."""
    kappa, b_x, b_y = state.drag, state.slope[0], state.slope[1]
    start_b, start_k = own.slope_start, own.drag_start
    G_x, G_y = sums[0] + kappa * d_x, sums[1] + kappa * d_y
    moves = d_x * d_x + d_y * d_y > _MOVES
    xx = start_b + min(0.0, state.P_xx + own.slope_walk)
    yy = start_b + min(0.0, state.P_yy + own.slope_walk)
    kk = start_k + min(0.0, state.P_kk + (own.drag_walk if moves else 0.0))
    xy, xk, yk = state.P_xy, state.P_xk, state.P_yk
    for axis in range(2):
        if axis == 0:
            miss = G_x - b_x - kappa * d_x
            p_x, p_y, p_k = xx + xk * d_x, xy + yk * d_x, xk + kk * d_x
            size = own.noise + p_x + d_x * p_k
        else:
            miss = G_y - b_y - kappa * d_y
            p_x, p_y, p_k = xy + xk * d_y, yy + yk * d_y, yk + kk * d_y
            size = own.noise + p_y + d_y * p_k
        b_x, b_y = b_x + p_x * miss / size, b_y + p_y * miss / size
        kappa += p_k * miss / size if moves else 0.0
        xx, yy, kk = xx - p_x * p_x / size, yy - p_y * p_y / size, kk - p_k * p_k / size
        xy, xk, yk = xy - p_x * p_y / size, xk - p_x * p_k / size, yk - p_y * p_k / size
    kappa = max(-own.highest, min(own.highest, kappa))
    state.drag, state.slope[0], state.slope[1] = kappa, b_x, b_y
    state.P_xx, state.P_yy, state.P_kk = xx - start_b, yy - start_b, kk - start_k
    state.P_xy, state.P_xk, state.P_yk = xy, xk, yk
    sums[0], sums[1] = G_x - kappa * d_x, G_y - kappa * d_y


@dataclass(frozen=True, kw_only=True)
class FloorAdaptation(Part):
    """Separate the floor's drag from a slope and compensate it along the motion. Off by default.

    Splits the integral of x and y (2,) [m s], world frame, into a part that stays (a slope) and one along the commanded
    velocity (rolling friction), by a Kalman filter. The second part turns with the motion at once. Needs
    `IntegralAction` and `ReferenceShaping`.

    Raises
    ------
    InputError
        If a number is not positive.
    """

    label = "floor adaptation"
    comment = "The part of the integral that turns with the motion is separated from a slope's, which stays."
    record = FloorRecord
    state = FloorState
    steps = Steps(learn=_learn)
    needs: ClassVar[Mapping[str, str]] = {
        "integral": "it learns the friction of the floor from the integrals",
        "shaping": "only a smooth reference has a direction of motion at all times",
    }

    time: float = field(
        default=3.0,
        metadata=setting("s", "of motion, over which the drag is followed", above=0.0, example=5.0),
    )
    slope_time: float = field(
        default=20.0,
        metadata=setting("s", "over which a slope is followed, once it is known", above=0.0, example=25.0),
    )
    highest: float = field(
        default=0.15,
        metadata=setting("m s", "limit of the drag, in units of the integral", above=0.0, example=0.1),
    )
    full_speed: float = field(
        default=0.02,
        metadata=setting(
            "m/s", "commanded speed from which on the whole drag is applied", above=0.0, example=0.03
        ),
    )

    def numbers(self, settings: LawSettings) -> FloorRecord:
        """Return the filter for a sample time."""
        sample_time = settings.sample_time
        return FloorRecord(
            noise=1.0 / sample_time,
            slope_walk=sample_time / self.slope_time**2,
            slope_start=1.0 / self.time,
            drag_walk=sample_time / self.time**2,
            drag_start=1.0 / self.time,
            highest=self.highest,
            steepness=1.0 / self.full_speed,
        )
