"""The step that bristle laws (Dahl, LuGre) share, however stiff the bristles are.

    z_dot = rho (w - r z)          J w_dot = T - sigma_0 z - sigma_1 z_dot - b w          r >= 0, rho > 0

r, the bristles' rate of relaxing, and rho depend on speed and deflection. With r, rho, sigma_1 and T frozen this is
linear with two states, and its exponential is closed: exact before sliding (r = 0), stable for every step, because
trace and determinant keep their signs. Frozen at the middle of the step, found by half a step frozen at its start,
it has order two.
"""

from ballbot.mechanics.compiled import inlined
from ballbot.mechanics.elementary import exponential, sine_cosine


@inlined
def _propagator(m, d, h) -> tuple[float, float]:
    """Return C and S with exp(M h) = C I + S (M - m I), for a 2 x 2 M of half trace m < 0 and m^2 - det = d."""
    if d * h * h > 1e-6:
        q = d**0.5
        fast, slow = m - q, (m * m - d) / (m - q)  # both eigenvalues, without cancellation
        e_slow, e_fast = exponential(slow * h), exponential(fast * h)
        return 0.5 * (e_slow + e_fast), (e_slow - e_fast) / (2.0 * q)
    decay = exponential(m * h)
    if d * h * h < -1e-6:
        q = (-d) ** 0.5
        sine, cosine = sine_cosine(q * h)
        return decay * cosine, decay * sine / q
    x = d * h * h  # the series of cosh and sinh(..)/.., to rounding
    return decay * (1.0 + x * (0.5 + x / 24.0)), decay * h * (1.0 + x / 6.0 * (1.0 + x / 20.0))


@inlined
def linear_motion(sigma_0, sigma_1, b, r, rho, T, inv_J, z, w, h) -> tuple[float, float, float]:
    """Return z, w and the angle travelled after h [s], with r, rho, sigma_1 and T frozen.

    Parameters
    ----------
    sigma_0 : float
        Stiffness [N m/rad], above zero.
    sigma_1, b : float
        Damping of the bristle's rate and of the speed [N m s/rad].
    r, rho : float
        [1/s], [-]
    T : float
        [N m]
    inv_J : float
        [1/(kg m^2)]
    z, w : float
        [rad], [rad/s] at the start.
    """
    a, k, d = rho * r, inv_J * (sigma_0 - sigma_1 * rho * r), inv_J * (sigma_1 * rho + b)
    half_trace = -0.5 * (a + d)
    determinant = inv_J * rho * (sigma_0 + r * b)
    C, S = _propagator(half_trace, half_trace * half_trace - determinant, h)
    z_still = T / (sigma_0 + r * b)
    x, y = z - z_still, w - r * z_still
    z_end = z_still + C * x + S * ((-a - half_trace) * x + rho * y)
    w_end = r * z_still + C * y + S * (-k * x + (-d - half_trace) * y)
    # integrals of both equations over the step give the integrals of z and w
    change = z_end - z
    z_integral = (T * h - (w_end - w) / inv_J - (sigma_1 + b / rho) * change) / (sigma_0 + r * b)
    return z_end, w_end, change / rho + r * z_integral
