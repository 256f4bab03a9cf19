"""A pendulum with viscous and dry friction, at any amplitude.

    angle'' = -omega_n^2 sin(angle) - beta angle' - kappa sgn(angle')

beta = b / I and kappa = c / I with the pivot's viscous friction b [N m s/rad], its dry friction c [N m] and the inertia
I about the pivot; omega_n^2 = m g r / I. Where gravity cannot overcome kappa the body rests. The period grows with the
amplitude A: T = T_0 2 K(sin(A/2)) / pi, with the complete elliptic integral K (L. Landau and E. Lifshitz, Mechanics,
section 11).
"""

from __future__ import annotations

import math

from numpy.typing import NDArray
from scipy.special import ellipk

from ballbot.mechanics.compiled import compiled_alone


def period_growth(amplitude: float) -> float:
    """Return by what factor the period of an amplitude [rad] is longer than a small swing's."""
    return 2.0 / math.pi * float(ellipk(math.sin(0.5 * amplitude) ** 2))


@compiled_alone
def follow_pendulum(
    stiffness: float,
    viscous: float,
    dry: float,
    angle: float,
    rate: float,
    t: NDArray,
    longest_step: float,
    angles: NDArray,
    rates: NDArray,
) -> None:
    """Fill `angles` and `rates` (n,) with the motion at times t (n,) from `angle` [rad] and `rate` [rad/s] at t_0.

    Steps of Runge and Kutta, cut where the motion turns, so that dry friction changes its sign at a step's end.

    Parameters
    ----------
    stiffness : float
        omega_n^2 [1/s^2].
    viscous, dry : float
        beta [1/s] and kappa [1/s^2].
    longest_step : float
        [s].
    """
    angles[0], rates[0] = angle, rate
    for k in range(1, len(t)):
        left = t[k] - t[k - 1]
        while left > 0.0:
            h = min(left, longest_step)
            if rate == 0.0:
                pull = -stiffness * math.sin(angle)
                if abs(pull) <= dry:
                    break  # it rests
                sign = math.copysign(1.0, pull)
            else:
                sign = math.copysign(1.0, rate)
            after, speed = _step(stiffness, viscous, dry * sign, angle, rate, h)
            if speed * sign < 0.0:
                # at a turn the acceleration hardly changes, so that the rate falls in nearly a straight line
                for _ in range(3):
                    h *= rate / (rate - speed)
                    after, speed = _step(stiffness, viscous, dry * sign, angle, rate, h)
                speed = 0.0
            angle, rate = after, speed
            left -= h
        angles[k], rates[k] = angle, rate


@compiled_alone
def _step(
    stiffness: float, viscous: float, force: float, angle: float, rate: float, h: float
) -> tuple[float, float]:
    k1 = -stiffness * math.sin(angle) - viscous * rate - force
    r2 = rate + 0.5 * h * k1
    k2 = -stiffness * math.sin(angle + 0.5 * h * rate) - viscous * r2 - force
    r3 = rate + 0.5 * h * k2
    k3 = -stiffness * math.sin(angle + 0.5 * h * r2) - viscous * r3 - force
    r4 = rate + h * k3
    k4 = -stiffness * math.sin(angle + h * r3) - viscous * r4 - force
    return angle + h / 6.0 * (rate + 2.0 * r2 + 2.0 * r3 + r4), rate + h / 6.0 * (
        k1 + 2.0 * k2 + 2.0 * k3 + k4
    )
