"""A model-predictive controller for comparison: the LQR, and the smallest correction that keeps its limits.

An LQR's cost from now on under u = K e + c is e' P e + sum of c[k]' (R + G' P G) c[k], P the Riccati equation's: a
constant and what corrections cost (J. Rossiter, B. Kouvaritakis and M. Rice, Automatica 34 (1998) 65-73). The program
is the least such sum with torques and wheel speeds within their limits, by the linearised exact model

    e[k+1] = F e[k] - G u[k]        y = of_error e[0] + of_nodes C        |y| <= 1

Limits are soft: with z for C such that the corrections cost z' z / 2, what lies d from a limit's half-space costs
d^2 / (2 SOFTNESS) more. c is given at the nodes, runs straight between them, and is zero from the last on (1.5 s);
there the law goes on. If the law keeps the limits by itself, c = 0 and it is left alone to the bit. The solver is
DAQP, a dual active-set method (pip install 'ballbot[peers]').
"""

from __future__ import annotations

from time import perf_counter

import daqp
import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.lqr import LqrDesign, held
from ballbot.mechanics.model import Model
from ballbot.robot import Friction
from ballbot.workflows.recovery_region import top_speed

NODES = (0, 2, 5, 10, 20, 30, 40, 60, 80, 100, 130, 160, 200, 250, 300)
LOOKS = (0, 1, 2, 4, 7, *range(10, 300, 10))
SOFTNESS = 1e-3
#: of the motors' highest speed that is planned with
_SPEED = 0.9
#: DAQP's name for a constraint that may be broken at a cost
_SOFT = 8


class Predictive:
    """A controller (`ballbot.control.interface.Feedback`); its law has no part that remembers torques given.

    Parameters
    ----------
    law : Controller
        Its gain is the design's. Its torque limit is kept by the correction and then by clipping.
    design : LqrDesign
    torque_weight : float
        R of the LQR.
    """

    def __init__(self, law: Controller, design: LqrDesign, *, torque_weight: float) -> None:
        self.sample_time = law.sample_time
        self._limit, n = law.torque_limit, len(law.gain)
        self._law = Controller(
            law.robot,
            law.gain,
            sample_time=law.sample_time,
            compensation=law.compensation,
            torque_limit=1e3,
            speed_band=law.speed_band,
        )
        friction = law.robot.friction
        needs = max(np.add(friction.coulomb, friction.stribeck)) if law.compensation != "none" else 0.0
        model = Model(law.robot.replace(friction=Friction.none(n)))
        linear = model.linearize()
        F, G = held(linear.A, linear.B, law.sample_time)
        speeds = np.hstack([np.zeros((n, 5)), model.wheel_jacobian(np.zeros(5))])
        limits = (self._limit - needs, _SPEED * top_speed(law.robot))
        self._of_error, of_nodes, hats = _prediction(F, G, law.gain, speeds, limits)
        weight = torque_weight * np.eye(n) + G.T @ design.cost @ G
        back = np.linalg.inv(
            np.linalg.cholesky(np.kron(hats.T @ hats, weight))
        ).T  # C = back z: the cost is z' z
        rows = of_nodes @ back
        self._rows, self._first = np.ascontiguousarray(rows), back[:n]
        self._soft = np.full(len(rows), _SOFT, dtype=np.int32)
        self._solver: daqp.Model | None = None
        self.times: list[float] = []  #: that programs took [s]

    def reset(self) -> None:
        """Forget everything that happened so far; a run starts."""
        self._law.reset()
        self._solver = None

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m]."""
        torques = self._law.update(t, state, reference)
        ahead = self._of_error @ heading_error(state, reference)
        if np.abs(ahead).max() > 1.0:
            began = perf_counter()
            torques = torques + self.correction(ahead)
            self.times.append(perf_counter() - began)
        return np.clip(torques, -self._limit, self._limit)

    def correction(self, ahead: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return c[0] (n,) [N m] for what the law alone would make of the limits (m,)."""
        upper, lower = 1.0 - ahead, -1.0 - ahead
        if self._solver is None:
            size = self._rows.shape[1]
            self._solver = daqp.Model()
            self._solver.settings = {"rho_soft": SOFTNESS}
            self._solver.setup(np.eye(size), np.zeros(size), self._rows, upper, lower, self._soft)
        else:
            self._solver.update(bupper=upper, blower=lower, sense=self._soft)
        z, _, flag, _ = self._solver.solve()
        if flag < 1:
            raise RuntimeError(f"DAQP found no answer: {flag}")
        return self._first @ z


def heading_error(state: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return S(psi) (r - x) (10,)."""
    e = np.subtract(reference, state)
    c, s = np.cos(state[4]), np.sin(state[4])
    for i in (0, 2, 5, 7):
        e[i], e[i + 1] = c * e[i] + s * e[i + 1], c * e[i + 1] - s * e[i]
    return e


def _prediction(
    F: NDArray[np.float64],
    G: NDArray[np.float64],
    K: NDArray[np.float64],
    speeds: NDArray[np.float64],
    limits: tuple[float, float],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return of_error (m, 10), of_nodes (m, n J), and how much each node counts at each sample (N, J)."""
    samples, n = np.arange(NODES[-1]), len(K)
    hats = np.column_stack([np.interp(samples, NODES, one) for one in np.eye(len(NODES))[:-1]])
    e, by_nodes = np.eye(10), np.zeros((10, n * hats.shape[1]))
    of_error, of_nodes = [], []
    for k in samples:
        c = np.kron(hats[k], np.eye(n))
        if k in LOOKS:
            of_error.append(K @ e / limits[0])
            of_nodes.append((K @ by_nodes + c) / limits[0])
        if k in LOOKS and k > 0:  # the speeds now are what they are
            of_error.append(speeds @ e / limits[1])
            of_nodes.append(speeds @ by_nodes / limits[1])
        e, by_nodes = (F - G @ K) @ e, (F - G @ K) @ by_nodes - G @ c
    return np.vstack(of_error), np.vstack(of_nodes), hats
