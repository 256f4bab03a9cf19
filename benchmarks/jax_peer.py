"""The NumPy form written for JAX: RK4 of many robots at once, jitted and mapped over robots, on one core."""

import os
from collections.abc import Callable
from time import perf_counter

import numpy as np

from ballbot.robot import Robot
from benchmarks.numpy_form import ROLLING, UNIT_Z, UNIT_Z_CROSS, constants, rate_of_change
from benchmarks.workloads import nominal_robot, smooth

_ONE_CORE = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
_STEPS, _ROBOTS, _STEP = 100, 4096, 1e-3


def seconds_a_step() -> float | None:
    """Return seconds a step and robot, the best of three calls of 100 steps of 4,096 robots; None without JAX."""
    os.environ.setdefault("XLA_FLAGS", _ONE_CORE)
    try:
        import jax
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)
    robot = nominal_robot()
    f = jax_rate_of_change(robot)
    starts, torques = smooth(_ROBOTS)
    u = torques[0, 0]
    _check(f, robot, starts[:8], u)

    def step(x, _):
        k1 = f(x, u)
        k2 = f(x + _STEP / 2 * k1, u)
        k3 = f(x + _STEP / 2 * k2, u)
        k4 = f(x + _STEP * k3, u)
        return x + _STEP / 6 * (k1 + 2 * (k2 + k3) + k4), None

    run = jax.jit(jax.vmap(lambda x: jax.lax.scan(step, x, None, length=_STEPS)[0]))
    run(starts).block_until_ready()
    best = float("inf")
    for _ in range(3):
        started = perf_counter()
        run(starts).block_until_ready()
        best = min(best, perf_counter() - started)
    return best / (_STEPS * _ROBOTS)


def jax_rate_of_change(robot: Robot) -> Callable:
    """Return f(state, u) as `rate_of_change` does, in JAX."""
    import jax.numpy as jnp

    friction = robot.friction
    r_b, m_r, l, g, (D1, D2, D3), J_0, m_t, A = constants(robot)  # noqa: E741
    e, E, e_cross = UNIT_Z, ROLLING, UNIT_Z_CROSS
    b, c, s = (np.array(value) for value in (friction.viscous, friction.coulomb, friction.stribeck))
    rolling = (robot.ball.mass + m_r) * g * friction.rolling

    def f(state, u):
        (st, ct), (sp, cp), (ss, cs) = ((jnp.sin(a), jnp.cos(a)) for a in (state[2], state[3], state[4]))
        v, w, x = state[5:7], state[7:], jnp.cross
        R = jnp.array(
            [
                [cp * cs, -cp * ss, sp],
                [ct * ss + st * sp * cs, ct * cs - st * sp * ss, -st * cp],
                [st * ss - ct * sp * cs, st * cs + ct * sp * ss, ct * cp],
            ]
        )
        z = R.T @ E @ v / r_b
        H = J_0 @ w + (D3 - D2) @ (w - z)
        M_vw = -m_r * l * (R @ e_cross)[:2] - E.T @ R @ D2 / r_b
        M = jnp.block([[m_t * jnp.eye(2) + E.T @ R @ D1 @ R.T @ E / r_b**2, M_vw], [M_vw.T, J_0 + D3]])
        speeds = A @ (z - w)
        decay = jnp.exp(-(jnp.abs(speeds / friction.stribeck_speed) ** friction.stribeck_exponent))
        torque = u - b * speeds - (c + s * decay) * jnp.sign(speeds)
        force_v = m_r * l * (R @ x(w, x(w, e)))[:2] + E.T @ R @ D1 @ x(z, w) / r_b
        force_w = m_r * g * l * x(R.T @ e, e) - x(w, H) + D2 @ x(z, w)
        W = jnp.hstack([A @ R.T @ E / r_b, -A])
        force = W.T @ torque + jnp.concatenate([-force_v - rolling * v / jnp.hypot(*v), force_w])
        theta_dot = (cs * w[0] - ss * w[1]) / cp
        rates = jnp.array([theta_dot, ss * w[0] + cs * w[1], w[2] - sp * theta_dot])
        return jnp.concatenate([v, rates, jnp.linalg.solve(M, force)])

    return f


def _check(f: Callable, robot: Robot, states: np.ndarray, u: np.ndarray) -> None:
    """Stop where JAX's form is not the NumPy form's equal: a peer must do the same work."""
    numpy_form = rate_of_change(robot)
    for state in states:
        expected = numpy_form(state, u)
        if np.abs(np.asarray(f(state, u)) - expected).max() > 1e-10 * np.abs(expected).max():
            raise RuntimeError("The JAX form of the equations differs from the NumPy form.")
