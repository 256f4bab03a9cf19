"""The floor's force on the ball."""

import numpy as np
from numpy.typing import NDArray

from ballbot import Model


def normal_force(
    model: Model, q: NDArray[np.float64], q_dot: NDArray[np.float64], u: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return it (...) [N]: (m_b + m_r) g + m_r l d^2/dt^2 (cos theta cos phi)."""
    q_ddot, body = model.acceleration(q, q_dot, u), model.robot.body
    (st, ct), (sp, cp) = ((np.sin(q[..., i]), np.cos(q[..., i])) for i in (2, 3))
    t, p = q_dot[..., 2], q_dot[..., 3]
    falling = st * cp * q_ddot[..., 2] + ct * sp * q_ddot[..., 3]
    height = 2 * st * sp * t * p - falling - ct * cp * (t**2 + p**2)
    return model.robot.weight + body.mass * body.center_of_mass * height
