"""A controller as a linear system, and its loop with the robot: for margins and Bode diagrams.

For small errors about upright at psi = 0 the control law is linear in the state x and the controller's memory m; the
reference is zero,

    m[k+1] = A m[k] + B x[k],      u[k] = C m[k] + D x[k]

`ballbot.control.law` is the law that runs. Here it is repeated in NumPy from the same record, in the same order, so
that a design need not compile it (`tests/control/test_margins.py` compares the two):

    x^   = exp(A tau) x + sum over j of G_j v[k-j]       with a prediction; otherwise x
    e    = -x^
    u    = notch(K e + K_I I + d)
    I   += T e of the pose                               d: the disturbance observer's estimate

Not included are friction compensation, limits and the integral's dead band, which are not linear, and the planner
and feed-forward, which act on references only. The plant is the exact model without friction, with torques held over a
sample and delayed by the time that the controller predicts over. The estimator's lag is not in the loop.
"""

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ballbot.arrays import instead_of_sample_time
from ballbot.control.controller import Controller
from ballbot.control.lqr import frictionless_model, held
from ballbot.errors import InputError
from ballbot.state import STATE_NAMES, torque_names

Matrix = NDArray[np.float64]
#: indices of x, y and psi in the state
_POSE = (0, 1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearController:
    """m[k+1] = A m[k] + B x[k], u[k] = C m[k] + D x[k]."""

    A: Matrix  #: (m, m)
    B: Matrix  #: (m, 10)
    C: Matrix  #: (n, m)
    D: Matrix  #: (n, 10)


def linear_controller(controller: Controller) -> LinearController:
    """Return a controller's law for small errors about upright at psi = 0."""
    states = len(STATE_NAMES)
    sizes = {name: len(rows) for name, rows in _update(controller, {}, np.eye(states))[0].items()}
    # the columns of a linear function's matrix are its values at the unit vectors
    total = sum(sizes.values())
    *parts, x = np.split(np.eye(total + states), np.cumsum(list(sizes.values())))
    after, torques = _update(controller, dict(zip(sizes, parts, strict=True)), x)
    rows = np.vstack([np.zeros((0, total + states)), *after.values()])
    return LinearController(A=rows[:, :total], B=rows[:, total:], C=torques[:, :total], D=torques[:, total:])


def _update(
    controller: Controller, memory: Mapping[str, Matrix], x: Matrix
) -> tuple[dict[str, Matrix], Matrix]:
    """Return the memory after an update and the torques (n, c), for c columns of memories and states.

    An entry that `memory` lacks is zero.
    """
    law, wheels, columns = controller.record[0], len(controller.gain), x.shape[1]
    prediction, observer, integral, notch = (
        law[name] for name in ("prediction", "disturbance_observer", "integral", "notch")
    )

    def past(name: str, rows: int) -> Matrix:
        return memory.get(name, np.zeros((rows, columns)))

    after: dict[str, Matrix] = {}
    count, late, fraction = (
        int(prediction["count"]),
        int(prediction["samples"]),
        float(prediction["fraction"]),
    )
    updates = max(count, late + 1 + int(fraction > 0.0)) if observer["on"] else count
    # torques of the previous updates, the newest first, and the observer's share of them
    acting, added = (
        [*past(name, updates * wheels).reshape(updates, wheels, columns)] for name in ("acting", "added")
    )
    estimate = np.zeros((wheels, columns))
    if observer["on"]:
        changes = law["rate"] * (x[5:] - past("rates", 5))
        needed = observer["by_acceleration"][:wheels] @ changes + observer["by_lean"][:wheels] @ x[2:4]
        acted = (1.0 - fraction) * acting[late] + fraction * (acting[late + 1] if fraction > 0.0 else 0.0)
        estimate = past("estimate", wheels)
        estimate = estimate + observer["fraction"] * (acted - needed - estimate)
        idle = observer["idle"][:wheels]
        estimate = estimate - np.outer(idle, idle @ estimate)
        after |= {"rates": x[5:], "estimate": estimate}
    if prediction["on"]:
        ahead = prediction["transition"] @ x
        for ago in range(count):
            ahead = ahead + prediction["by_torque"][:wheels, ago].T @ (acting[ago] - added[ago])
    else:
        ahead = x
    e = -ahead
    torques = controller.gain @ e
    if integral["on"]:
        sums = past("sums", 3)
        torques = torques + integral["gain"][:wheels] @ sums
        after["sums"] = integral["kept"] * sums + integral["step"] * e[list(_POSE)]
    torques = torques + estimate
    if notch["on"]:
        asked, torques = torques, notch["b_0"] * torques + past("notch_1", wheels)
        after["notch_1"] = notch["b_1"] * asked - notch["a_1"] * torques + past("notch_2", wheels)
        after["notch_2"] = notch["b_2"] * asked - notch["a_2"] * torques
    if acting:
        after["acting"] = np.vstack([torques, *acting[:-1]])
        after["added"] = np.vstack([estimate, *added[:-1]])
    return after, torques


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLoop:
    """The sampled loop of a robot and its controller, which can be opened at the wheels' torques.

    The torques v act on the robot and the controller commands u; in operation v = u. The open loop's transfer function,
    in the convention of negative feedback, is L(z) = -u/v, (n, n).
    """

    A: Matrix  #: (10, 10) of the robot, x_dot = A x + B v
    B: Matrix  #: (10, n)
    controller: LinearController
    sample_time: float  #: [s]
    delay: float  #: from a measurement to the action of its torque [s]

    @property
    def wheels(self) -> tuple[str, ...]:
        """The names of the torques at which the loop is opened."""
        return torque_names(self.B.shape[1])

    @property
    def pending(self) -> int:
        """The number of torques of each wheel that are under way."""
        whole, rest = _split(self.delay, self.sample_time)
        return whole + (rest > 0.0)

    def broken(
        self, more_delay: Sequence[float] | Matrix | None = None, *, room: int = 0
    ) -> tuple[Matrix, Matrix, Matrix]:
        """Return A, B, C of the open loop z[k+1] = A z[k] + B v[k], u[k] = C z[k]; L(z) = -C (z I - A)^-1 B.

        `more_delay` (n,) is the delay of each wheel's torque beyond the loop's own [s]; any fraction of a sample.
        The state holds at least `room` torques of each wheel, so that loops of several delays have the same states.
        """
        more = np.zeros(len(self.wheels)) if more_delay is None else np.asarray(more_delay, dtype=np.float64)
        A, B = _late_plant(self.A, self.B, self.sample_time, self.delay + more, room)
        states, law = len(self.A), self.controller
        seen = np.eye(states, len(A))  # the robot's state within the plant's, which includes delayed torques
        whole = np.asarray(block_diag(A, law.A), dtype=np.float64)
        whole[len(A) :, : len(A)] = law.B @ seen
        return (
            whole,
            np.vstack([B, np.zeros((len(law.A), len(self.wheels)))]),
            np.hstack([law.D @ seen, law.C]),
        )

    def closed(self) -> Matrix:
        """Return the matrix of the closed loop."""
        A, B, C = self.broken()
        return A + B @ C

    def response(self, omega: Matrix) -> NDArray[np.complex128]:
        """Return L (f, n, n) at frequencies (f,) [rad/s] up to pi over the sample time."""
        A, B, C = self.broken()
        z = np.exp(1j * np.asarray(omega) * self.sample_time)
        resolvent = np.linalg.solve(
            z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape))
        )
        return np.asarray(-C @ resolvent, dtype=np.complex128)

    def wheel_responses(self, omega: Matrix) -> NDArray[np.complex128]:
        """Return the loops (f, n) opened at one wheel's torque, the others closed, at frequencies (f,) [rad/s]."""
        L = self.response(omega)
        T = np.linalg.solve(np.eye(L.shape[-1]) + L, L)
        closed = np.diagonal(T, axis1=1, axis2=2)  # of each wheel: L_i / (1 + L_i)
        return closed / (1.0 - closed)

    def mode_responses(self, omega: Matrix) -> NDArray[np.complex128]:
        """Return the eigenvalues (f, 3) of L: of both leans, the larger first, and of the heading (equal torques).

        They show the effect of equal changes at all wheels: the closed loop has a pole where one of them is -1.
        """
        values, vectors = np.linalg.eig(self.response(omega))
        alike = np.abs(vectors.sum(axis=1))  # of unit vectors; largest if all wheels have the same torque
        heading = alike.argmax(axis=1)
        others = np.abs(values)
        others[np.arange(len(others)), heading] = -1.0
        order = np.concatenate([np.argsort(-others, axis=1)[:, :2], heading[:, None]], axis=1)
        return np.take_along_axis(values, order, axis=1)


def _late_plant(A: Matrix, B: Matrix, sample_time: float, delays: Matrix, room: int) -> tuple[Matrix, Matrix]:
    """Return the sampled plant with delayed torques: its state is the robot's and each wheel's pending torques.

    A torque commanded at t_k acts from t_k + tau to t_k+1 + tau. The discretisation is exact for any tau: a delay of d
    whole samples and a rest splits the effect of a torque over samples d and d + 1.
    """
    states, wheels = B.shape
    F = held(A, B, sample_time)[0]
    splits = [_split(delay, sample_time) for delay in delays.tolist()]
    waiting = [max(whole + (rest > 0.0), room) for whole, rest in splits]
    begins = states + np.cumsum([0, *waiting])
    whole_A, whole_B = np.zeros((begins[-1], begins[-1])), np.zeros((begins[-1], wheels))
    whole_A[:states, :states] = F
    for i, ((late, rest), count) in enumerate(zip(splits, waiting, strict=True)):
        column, first = B[:, [i]], int(begins[i])
        after, begun = held(A, column, sample_time - rest)
        effects = {late: begun[:, 0]}
        if rest > 0.0:
            effects[late + 1] = after @ held(A, column, rest)[1][:, 0]
        for ago, effect in effects.items():  # ago 0 is the torque commanded now
            if ago == 0:
                whole_B[:states, i] = effect
            else:
                whole_A[:states, first + ago - 1] = effect
        if count:
            whole_B[first, i] = 1.0
            slots = np.arange(first, first + count - 1)
            whole_A[slots + 1, slots] = 1.0
    return whole_A, whole_B


def _split(delay: float, sample_time: float) -> tuple[int, float]:
    """Return a delay's whole samples and the rest [s]; a rest within rounding is zero."""
    samples = delay / sample_time
    whole = math.floor(samples + 1e-9)
    rest = (samples - whole) * sample_time
    return whole, rest if rest > 1e-9 * sample_time else 0.0


def robot_loop(controller: Controller) -> RobotLoop:
    """Return the loop of a controller and its robot's exact model without friction."""
    linear = frictionless_model(controller.robot).linearize()
    prediction = controller.parts.prediction
    return RobotLoop(
        A=linear.A,
        B=linear.B,
        controller=linear_controller(controller),
        sample_time=controller.sample_time,
        delay=prediction.delay if prediction else 0.0,
    )


#: factors of all torques that a loop must tolerate: a tenth less, a tenth more, a phase lag of six degrees
_LEAST_MARGIN = (0.9, 1.1, cmath.exp(0.1j))
#: rate of growth [1/s] that dry friction hides for longer than a run lasts
_SLOW = 0.05
#: distance by which rounding may move a pole out of the unit circle, also a double pole on it
_ROUNDING = 1e-6


def lacking_margin(controller: Controller) -> str | None:
    """Return why a controller's loop is unstable or has no margin; None if it has one, also with marginal poles."""
    loop = robot_loop(controller)
    A, B, C = loop.broken()

    def growth(factor: complex) -> float:
        return float(np.abs(np.linalg.eigvals(A + factor * (B @ C))).max())

    name, time = controller.robot.name, controller.sample_time
    if (radius := growth(1.0)) > 1.0 + _ROUNDING:
        what = (
            f"The controller does not stabilise the robot {name!r}: an error grows by a factor of "
            f"{math.exp(min(math.log(radius) / time, 700.0)):.3g} a second."
        )
    elif max(map(growth, _LEAST_MARGIN)) > 1.0 + _ROUNDING:
        what = (
            f"The loop of the controller and the robot {name!r} has no stability margin: a torque that is 10 % off, "
            "or late by 6 degrees of phase, makes it unstable."
        )
    elif (rate := _growth_by_friction(controller, loop)) > _SLOW:
        return (
            f"The viscous friction of the robot {name!r}, with the back-EMF of motors on a voltage or a duty, makes "
            f"this loop unstable: an error grows by a factor of {math.exp(min(rate, 700.0)):.3g} a second. "
            "Compensate it: full or partial compensation, as the precise controller has it."
        )
    else:
        return None
    rare = math.exp(float(np.linalg.eigvals(loop.A).real.max()) * time)
    return f"{what} Its sample time is {time:g} s; {instead_of_sample_time(time)}" if rare > 2.0 else what


def _growth_by_friction(controller: Controller, loop: RobotLoop) -> float:
    """Return the rate [1/s] at which an error grows with the viscous friction that is not compensated."""
    robot = controller.robot
    if controller.compensation != "none" or not any(robot.friction.viscous):
        return -math.inf
    A = loop.A.copy()
    A[:, 5:] -= (
        loop.B @ np.diag(robot.friction.viscous) @ frictionless_model(robot).wheel_jacobian(np.zeros(5))
    )
    poles = np.linalg.eigvals(replace(loop, A=A).closed())
    return math.log(float(np.abs(poles).max())) / controller.sample_time


def refuse_without_margin(controller: Controller) -> None:
    """Raise InputError if a controller's loop is unstable, or becomes so by 10 % of torque or 6 degrees of phase."""
    if sentence := lacking_margin(controller):
        raise InputError(sentence)
