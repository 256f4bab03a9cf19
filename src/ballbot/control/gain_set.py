"""Gains that may be mixed while the robot balances: one Lyapunov function for all of them.

With M_rk the sampled closed loop of robot r with gain k, torques under way and the controller's memory included, find
P > 0 and g < 1 with

    M_rk^T P M_rk <= g^2 P        of every robot r and every gain k

Then sqrt(z^T P z) shrinks by g or more in every sample, whatever mixture of the gains acts and however fast it changes:
the loop is affine in the gain, and a norm is convex. The margins of each fixed gain do not show that. (S. Boyd,
L. El Ghaoui, E. Feron & V. Balakrishnan, "Linear matrix inequalities in system and control theory", SIAM 1994, ch. 5.)

The robots are the described one, with torques a tenth weaker and stronger, and some drawn from its standard deviations,
or from default ones if its file states none; each with the loop's own delay and with up to one sample more. P is
searched by the method of centers (S. Boyd & L. El Ghaoui, Linear Algebra and its Applications 188-189 (1993) 63-111) on
the loops that grow most. The proof is not the search but `growths`: a Cholesky factor of P and the norms of all loops.
As in `ballbot.control.linear`, friction, limits, and the lags of estimator and motors are not included.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from ballbot.control.controller import Controller
from ballbot.control.law import LAW
from ballbot.control.linear import Matrix, robot_loop
from ballbot.control.lqr import frictionless_model
from ballbot.control.overcompensation import certain_friction, compensation_margin, has_friction
from ballbot.control.tuning import MAX_GAINS, add_gains
from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.robot.variations import draw_robots, uncertain, with_default_errors

#: robots drawn from the standard deviations, and factors of the torques of the described one
_DRAWN, _FACTORS = 12, (0.9, 1.0, 1.1)
#: centers, Newton steps to each, and the Newton decrement at which one is found
_CENTERS, _STEPS, _CENTERED = 60, 50, 0.3
#: share of the gap between level and growth at a center that the next level keeps
_SHARE = 0.05
#: of g, below which the search no longer gains
_RESOLUTION = 1e-7
#: mixtures of two gains whose spectral radius is computed
_MIXTURES = 11


def tunable(
    controller: Controller, others: Sequence[Controller] = (), *, robot: Robot | None = None
) -> Controller:
    """Return a copy of a controller that can mix its gain with those of others, by `Controller.tune`.

    Its compensation can be changed up to what is certain of a described robot's friction
    (`ballbot.control.overcompensation`), by default the controller's robot. `certified` says whether the gains may be
    mixed.

    InputError if the others are too many, or differ from it in more than the gains.
    """
    if len(others) >= MAX_GAINS:
        raise InputError(f"{len(others) + 1} gains are given; firmware can mix {MAX_GAINS}.")
    for other in others:
        differing = [
            name for name in LAW.fields if _besides_gains(controller)[name] != _besides_gains(other)[name]
        ]
        if differing or controller.estimator != other.estimator:
            what = ", ".join(differing).replace("_", " ") or "estimator"
            raise InputError(
                f"The controllers differ in more than their gains: {what}. Design them with the same options except "
                "for the weights (--q)."
            )
    copy = controller.with_parts(controller.parts)
    copy.others = tuple(others)
    add_gains(copy.record, [other.record for other in others])
    described = robot or controller.robot
    if has_friction(described.friction):
        margin = compensation_margin(controller, certain_friction(described))
        copy.record["tuning"]["compensation"] = 1.0 / max(1.0, margin.largest)
    return copy


def _besides_gains(controller: Controller) -> dict[str, bytes]:
    """Return a controller's numbers by field, with zeros in place of what follows from its gain."""
    law = controller.record.copy()
    law["gain"], law["integral"]["gain"] = 0.0, 0.0
    law["lean_limit"]["asked"], law["lean_limit"]["turn_rate"] = 0.0, 0.0
    return {name: law[name].tobytes() for name in LAW.fields}


@dataclass(frozen=True, kw_only=True, eq=False)
class GainSet:
    """The closed loops of a controller's gains."""

    loops: Matrix  #: (r, k, m, m) of each robot with each gain
    P: Matrix  #: (m, m), of the Lyapunov function
    sample_time: float  #: [s]
    deviations: str  #: of which robots are drawn: the robot file's or default ones

    @property
    def growth(self) -> float:
        """The largest factor by which sqrt(z^T P z) changes in a sample; below 1 the gains may be mixed."""
        return float(growths(self.loops.reshape(-1, *self.P.shape), self.P).max())

    def radius(self, weights: Sequence[float]) -> float:
        """Return the largest spectral radius over the robots with a fixed mixture of the gains."""
        mixed = np.einsum("k,rkij->rij", np.asarray(weights), self.loops)
        return float(np.abs(np.linalg.eigvals(mixed)).max())

    def sentence(self) -> str:
        """Return in one sentence whether the gains may be mixed while the robot balances."""
        loops, gains, growth = *self.loops.shape[:2], self.growth
        if growth < 1.0:
            return (
                f"The {gains} gains share a Lyapunov function over {loops} uncertain robots and delays, drawn from "
                f"{self.deviations}: any mixture is stable, however fast it changes."
            )
        weights = np.linspace(0.0, 1.0, _MIXTURES)
        fixed = max(
            self.radius([*(1.0 - weight) * np.eye(gains)[a] + weight * np.eye(gains)[b]])
            for a in range(gains)
            for b in range(a)
            for weight in weights
        )
        return (
            f"The {gains} gains share no quadratic Lyapunov function: under the best one an error can grow by a factor "
            f"of {growth:.6f} a sample ({growth ** (1.0 / self.sample_time):.3g} a second) while they change, although "
            f"the spectral radius of a fixed mixture is at most {fixed:.6f}; take gains that differ less."
        )


def gain_set(controller: Controller) -> GainSet:
    """Return the loops of a controller's gains, and the Lyapunov function under which they grow least."""
    robot = controller.robot
    robots = [(robot, factor) for factor in _FACTORS]
    stated = bool(uncertain(robot))
    drawn_from = robot if stated else with_default_errors(robot)
    robots += [(drawn, 1.0) for drawn in draw_robots(drawn_from, _DRAWN, seed=1)]
    own = [robot_loop(each) for each in (controller, *controller.others)]
    loops = []
    for one, factor in robots:
        linear = frictionless_model(one).linearize()
        changed = [replace(loop, A=linear.A, B=factor * linear.B) for loop in own]
        late = controller.sample_time * np.ones(robot.wheel_count)
        for delay in (0.0 * late, late):
            broken = [loop.broken(delay, room=own[0].pending + 1) for loop in changed]
            loops += [[A + B @ C for A, B, C in broken]]
    reduced = _reduced(np.array(loops))
    return GainSet(
        loops=reduced,
        P=_lyapunov(reduced),
        sample_time=controller.sample_time,
        deviations="the file's deviations" if stated else "default deviations, as the file states none",
    )


def certified(controller: Controller) -> GainSet:
    """Return the loops of a controller's gains with the Lyapunov function that they share; InputError without one."""
    gains = gain_set(controller)
    if not gains.growth < 1.0:
        raise InputError(gains.sentence())
    return gains


def growths(loops: Matrix, P: Matrix) -> Matrix:
    """Return the largest factors (v,) by which loops (v, m, m) change sqrt(z^T P z) in a sample."""
    U = np.linalg.cholesky(P).T
    return np.asarray(np.linalg.norm(U @ loops @ np.linalg.inv(U), 2, axis=(1, 2)), dtype=np.float64)


def _reduced(loops: Matrix) -> Matrix:
    """Return loops (.., m, m) without states that act on nothing, and with states that are always equal as one."""
    loops, kept = loops.copy(), list(range(loops.shape[-1]))
    for j in reversed(kept.copy()):
        rest = [i for i in kept if i != j]
        alike = [i for i in rest if (loops[..., i, kept] == loops[..., j, kept]).all()]
        if alike:
            loops[..., alike[0]] += loops[..., j]
        if alike or not loops[..., j].any():
            kept = rest
    return loops[..., kept, :][..., kept]


def _lyapunov(loops: Matrix) -> Matrix:
    """Return a P that all loops (r, k, m, m) share, or under which they grow least."""
    m = loops.shape[-1]
    # start with the sum of each gain's own for the described robot, the first with torques of factor 1
    start = np.zeros((m, m))
    for M in loops[2 * _FACTORS.index(1.0)]:
        stable = M / max(1.0, 1.0001 * float(np.abs(np.linalg.eigvals(M)).max()))
        start += solve_discrete_lyapunov(stable.T, np.eye(m))
    U = np.linalg.cholesky(start).T
    scaled = U @ loops.reshape(-1, m, m) @ np.linalg.inv(U)  # in these coordinates the start is I
    P, active, slack = np.eye(m), np.zeros(len(scaled), dtype=bool), 0.01
    for _ in range(_CENTERS):
        growth = growths(scaled, P)
        top = float(growth.max())
        if top < 1.0:
            break
        worst = int(growth.argmax())
        if active[worst] and slack < _RESOLUTION:
            break
        level = top + (_SHARE * slack if active[worst] else max(slack, 0.3 * (top - 1.0)))
        active[worst] = True
        P = _center(scaled[active], level**2, P)
        slack = level - float(growths(scaled[active], P).max())
    return U.T @ P @ U


def _slacks(loops: Matrix, level: float, P: Matrix) -> Matrix:
    """Return the matrices that must be positive: P, 2 I - P, and level P - M^T P M of each loop."""
    return np.array([P, 2.0 * np.eye(len(P)) - P, *(level * P - np.swapaxes(loops, 1, 2) @ P @ loops)])


def _barrier(slacks: Matrix) -> float:
    """Return minus the sum of the logarithms of their determinants; infinite unless all are positive."""
    try:
        return -2.0 * float(np.log(np.linalg.cholesky(slacks).diagonal(axis1=1, axis2=2)).sum())
    except np.linalg.LinAlgError:
        return float("inf")


def _center(loops: Matrix, level: float, P: Matrix) -> Matrix:
    """Return the analytic center of the P with M^T P M < level P and 0 < P < 2 I, by Newton's method from a P."""
    rows, columns = np.triu_indices(len(P))

    def changes(C: Matrix) -> Matrix:
        """Return C E C^T for the changes E of all entries of P, (entries, entries), as vectors of the same norm."""
        pairs = C[:, rows].T[:, :, None] * C[:, columns].T[:, None, :]
        pairs[rows != columns] += np.swapaxes(pairs[rows != columns], 1, 2)
        return pairs[:, rows, columns] * np.where(rows == columns, 1.0, 2.0**0.5)

    for _ in range(_STEPS):
        slacks = _slacks(loops, level, P)
        gradient, hessian = np.zeros(len(rows)), np.zeros((len(rows), len(rows)))
        for number, C in enumerate(np.linalg.inv(np.linalg.cholesky(slacks))):
            change = changes(C) * (1.0, -1.0, level)[min(number, 2)]
            if number >= 2:
                change -= changes(C @ loops[number - 2].T)
            gradient -= change[:, rows == columns].sum(axis=1)
            hessian += change @ change.T
        step = np.linalg.solve(hessian, -gradient)
        direction = np.zeros_like(P)
        direction[rows, columns] = direction[columns, rows] = step
        decrement, share, value = -float(gradient @ step), 1.0, _barrier(slacks)
        while _barrier(_slacks(loops, level, P + share * direction)) > value - 0.1 * share * decrement:
            share *= 0.5
            if share < 1e-6:
                return P
        P = P + share * direction
        if decrement < _CENTERED**2:
            break
    return P
