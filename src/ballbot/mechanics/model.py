"""The robot's equations of motion as one object, in either formulation, and two linear models of it.

State x = [x y theta phi psi and their rates], input u = wheel torques [N m]:

    M(q) q_ddot + bias(q, q_dot) = W(q)^T (u - friction)        wheel speeds  W(q) q_dot

"exact" is the corrected rigid-body model, "thesis" Appendix II as printed. `LinearModel` is x_dot = A x + B u about
upright. `contact_momentum` is the angular momentum about the point where the ball touches the floor; no friction of the
driveline changes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError, missing_package
from ballbot.mechanics.engine.arrays import (
    accelerations,
    energies,
    mass_matrices,
    wheel_jacobians,
    wheel_speeds_at,
)
from ballbot.mechanics.engine.lanes import unpacked
from ballbot.mechanics.engine.run import simulate_one
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.parameters import Exact, Formulation, Pivoting, RobotNumbers, Thesis, pack, selector
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.state import STATE_NAMES, torque_names
from ballbot.summary import Summarized, Summary, pole_words

if TYPE_CHECKING:
    from control import StateSpace


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LinearModel(Summarized):
    """x_dot = A x + B u about upright at psi = 0; x = [x y theta phi psi and their rates], u = wheel torques [N m]."""

    A: NDArray[np.float64]  #: (10, 10)
    B: NDArray[np.float64]  #: (10, n)

    def summary(self) -> Summary:
        """Return the accelerations by each state and torque, and the poles."""
        half, torques = len(self.A) // 2, torque_names(self.B.shape[1])
        names = STATE_NAMES if len(self.A) == len(STATE_NAMES) else [f"x{i + 1}" for i in range(len(self.A))]
        by_each = np.hstack([self.A[half:], self.B[half:]])
        # rounding of a sum that is zero
        by_each = np.where(abs(by_each) < 1e-12 * abs(by_each).max(), 0.0, by_each)
        cells = [tuple(f"{value:.4g}" for value in column) for column in by_each.T.tolist()]
        whole = not self.B[:half].any() and np.array_equal(self.A[:half], np.eye(half, 2 * half, half))
        return Summary(
            title="x_dot = A x + B u about upright: accelerations by each state and torque",
            rows=(
                ("of", tuple(names[:half])),
                *zip([*names, *torques], cells, strict=True),
                ("poles", f"{pole_words(self.poles())} rad/s"),
            ),
            sentences=() if whole else ("The first rows of A and B are not shown.",),
        )

    def poles(self) -> NDArray[np.complex128]:
        """Return the poles, the largest real part first.

        Returns
        -------
        ndarray (10,)
            Eigenvalues of A [rad/s].

        Examples
        --------
        >>> Model("alten").linearize().poles()[0].real.round(2)
        np.float64(5.2)
        """
        poles = np.asarray(np.linalg.eigvals(self.A), dtype=np.complex128)
        return poles[np.argsort(-np.real(poles), kind="stable")]

    def to_control(self) -> StateSpace:
        """Return the model as a python-control StateSpace with all states as outputs.

        Inputs are named u1 .. un, states and outputs x .. psi_dot, so that `control.interconnect` finds them.

        Returns
        -------
        control.StateSpace

        Raises
        ------
        InputError
            If python-control is not installed.

        Examples
        --------
        >>> Model("alten").linearize().to_control().input_labels
        ['u1', 'u2', 'u3']
        """
        try:
            from control import StateSpace
        except ImportError:
            raise missing_package("A StateSpace", "python-control", extra="interop") from None
        names = {
            "inputs": [*torque_names(self.B.shape[1])],
            "outputs": [*STATE_NAMES],
            "states": [*STATE_NAMES],
        }
        return StateSpace(self.A, self.B, np.eye(len(self.A)), np.zeros_like(self.B), **names, name="robot")


_MAX_STEPS = 1e8  # of one call: most of a minute on one core


@dataclass(frozen=True, init=False, repr=False)
class Model(Summarized):
    """A robot's mechanics.

    Parameters
    ----------
    robot : Robot, preset or robot file
    formulation : {"exact", "thesis"}
    step : float
        Longest inner step of `advance` [s]; RK4 at 1 ms is converged for robots of this size.
    pivoting : float, optional
        If given, the ball may pivot on the floor, against a friction of at most this torque [N m]. The ball's spin
        about the vertical [rad/s] is then a sixth velocity: q_dot (..., 6) and states (..., 11) have it last.

    Raises
    ------
    InputError
        If the formulation is unknown, or the step or the pivoting friction is not allowed.

    Examples
    --------
    >>> print(f"The robot falls by {Model('alten').linearize().poles()[0].real:.2f}/s.")
    The robot falls by 5.20/s.
    """

    robot: Robot
    formulation: Formulation = "exact"
    step: float = 1e-3
    pivoting: float | None = None

    def __init__(
        self,
        robot: RobotLike,
        formulation: Formulation = "exact",
        step: float = 1e-3,
        pivoting: float | None = None,
    ) -> None:
        given = {"robot": as_robot(robot), "formulation": formulation, "step": step, "pivoting": pivoting}
        for name, value in given.items():
            object.__setattr__(self, name, value)
        self._check()
        law = self.robot.friction.own_law
        chosen = selector(self.formulation, self.robot.wheel_count, pivoting=self.pivots, law=law)
        object.__setattr__(self, "_selected", chosen)
        row = pack(self.robot, self.formulation, pivoting=self.pivoting or 0.0)
        object.__setattr__(self, "_row", row)

    def _check(self) -> None:
        if self.formulation not in ("exact", "thesis"):
            raise InputError(f"The formulation is {self.formulation!r}; it must be 'exact' or 'thesis'.")
        if not (np.isfinite(self.step) and self.step > 0):
            raise InputError(f"The model's step is {self.step!r}; it must be a positive time in seconds.")
        if self.pivoting is not None and not (np.isfinite(self.pivoting) and self.pivoting >= 0):
            raise InputError(
                f"The pivoting friction is {self.pivoting!r}; it must be a torque in N m, not negative."
            )

    @property
    def pivots(self) -> bool:
        """Whether the ball may pivot on the floor."""
        return self.pivoting is not None

    @property
    def velocity_count(self) -> int:
        """Number of velocities, m: five, or six where the ball pivots."""
        return 6 if self.pivots else 5

    @property
    def selected(self) -> Exact | Thesis | Pivoting:
        """The value that selects the compiled equations."""
        return self._selected  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def packed(self) -> NDArray[np.float64]:
        """The robot's numbers as compiled code reads them; see `ballbot.mechanics.parameters.pack`."""
        return self._row  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def _parameters(self) -> RobotNumbers:
        return unpacked(self.selected, self.packed.item)

    def summary(self) -> Summary:
        """Return the model's formulation, step and pivoting friction."""
        pivoting = "none" if self.pivoting is None else f"against at most {self.pivoting:.3g} N m"
        rows = (
            ("formulation", self.formulation),
            ("longest inner step", f"{self.step:.3g} s"),
            ("pivoting of the ball", pivoting),
        )
        return Summary(title=f"Model of the robot {self.robot.name}", rows=rows)

    def mass_matrix(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return the mass matrix M(q), symmetric and positive definite.

        Parameters
        ----------
        q : array_like (..., 5)
            x, y [m], theta, phi, psi [rad].

        Returns
        -------
        ndarray (..., m, m)
            In SI units, m being `velocity_count`.

        Raises
        ------
        InputError
            If the shape is wrong or a value is not finite.

        Examples
        --------
        >>> Model("alten").mass_matrix(np.zeros(5)).diagonal().round(2)
        array([22.64, 22.64,  4.38,  4.38,  0.21])
        """
        return mass_matrices(self.selected, self._parameters, real_array(q, ("...", 5), "q"))

    def acceleration(self, q: ArrayLike, q_dot: ArrayLike, u: ArrayLike) -> NDArray[np.float64]:
        """Return the accelerations of the rigid body with viscous friction b and without dry friction.

        Parameters
        ----------
        q : array_like (..., 5)
            x, y [m], theta, phi, psi [rad].
        q_dot : array_like (..., m)
            Their rates [m/s, rad/s].
        u : array_like (..., n)
            Wheel torques [N m].

        Returns
        -------
        ndarray (..., m)
            q_ddot [m/s^2, rad/s^2].

        Raises
        ------
        InputError
            If shapes are wrong or do not match, or a value is not finite.

        Examples
        --------
        A robot at rest that leans by 0.01 rad falls further, and its ball rolls away:

        >>> Model("alten").acceleration([0, 0, 0.01, 0, 0], np.zeros(5), np.zeros(3)).round(3)
        array([ 0.   ,  0.079,  0.271, -0.   , -0.   ])
        """
        n, m = self.robot.wheel_count, self.velocity_count
        q, q_dot, u = _alike((q, 5, "q"), (q_dot, m, "q_dot"), (u, n, "u"))
        return accelerations(self.selected, self._parameters, q, q_dot, u)

    def wheel_speed(self, q: ArrayLike, q_dot: ArrayLike) -> NDArray[np.float64]:
        """Return the wheel speeds: the encoders' ("exact"), or Omega_wheels (II.16) ("thesis").

        Parameters
        ----------
        q : array_like (..., 5)
            x, y [m], theta, phi, psi [rad].
        q_dot : array_like (..., m)
            Their rates [m/s, rad/s].

        Returns
        -------
        ndarray (..., n)
            [rad/s], positive as the torques are.

        Raises
        ------
        InputError
            If shapes are wrong or do not match, or a value is not finite.

        Examples
        --------
        Rolling along x at 1 m/s without a lean:

        >>> Model("alten").wheel_speed(np.zeros(5), [1, 0, 0, 0, 0]).round(2)
        array([ 0.  , -9.72,  9.72])
        """
        q, q_dot = _alike((q, 5, "q"), (q_dot, self.velocity_count, "q_dot"))
        return wheel_speeds_at(self.selected, self._parameters, q, q_dot)

    def wheel_jacobian(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return W(q): wheel speeds are W q_dot, and torques u do the generalised force W^T u.

        Parameters
        ----------
        q : array_like (..., 5)
            x, y [m], theta, phi, psi [rad].

        Returns
        -------
        ndarray (..., n, m)
            In 1/m for the columns of x and y, without a unit for the others.

        Raises
        ------
        InputError
            If the shape is wrong or a value is not finite.

        Examples
        --------
        >>> Model("alten").wheel_jacobian(np.zeros(5)).shape
        (3, 5)
        """
        return wheel_jacobians(self.selected, self._parameters, real_array(q, ("...", 5), "q"))

    def energy(self, q: ArrayLike, q_dot: ArrayLike) -> NDArray[np.float64]:
        """Return kinetic plus potential energy; the potential is zero at the height of the ball's centre.

        Parameters
        ----------
        q : array_like (..., 5)
            x, y [m], theta, phi, psi [rad].
        q_dot : array_like (..., m)
            Their rates [m/s, rad/s].

        Returns
        -------
        ndarray (...)
            [J].

        Raises
        ------
        InputError
            If shapes are wrong or do not match, or a value is not finite.

        Examples
        --------
        >>> Model("alten").energy(np.zeros(5), np.zeros(5)).round(2)
        np.float64(65.83)
        """
        q, q_dot = _alike((q, 5, "q"), (q_dot, self.velocity_count, "q_dot"))
        return energies(self.selected, self._parameters, q, q_dot)

    def linearize(self) -> LinearModel:
        """Return the linear model about upright at psi = 0, with viscous friction and without dry friction.

        Upright at rest, gravity's torque on the body is m_r g l (theta, phi, 0) to first order, so

            M q_ddot = m_r g l (0, 0, theta, phi, 0) + W^T (u - b W q_dot).

        Returns
        -------
        LinearModel
            A (10, 10) and B (10, n) of x_dot = A x + B u.

        Raises
        ------
        InputError
            If the ball may pivot: at rest it sticks.

        Examples
        --------
        >>> linear = Model("alten").linearize()
        >>> linear.A.shape, linear.B.shape
        ((10, 10), (10, 3))
        """
        if self.pivots:
            raise InputError(
                "A pivoting ball sticks at rest, so the model has no linearisation there; linearise the model "
                "without pivoting friction."
            )
        robot, origin = self.robot, np.zeros(5)
        M, W = self.mass_matrix(origin), self.wheel_jacobian(origin)
        tipping = robot.body.mass * robot.gravity * robot.body.center_of_mass
        stiffness = np.diag([0.0, 0.0, tipping, tipping, 0.0])
        damping = W.T @ np.diag(robot.friction.viscous) @ W
        A, B = np.zeros((10, 10)), np.zeros((10, robot.wheel_count))
        A[:5, 5:] = np.eye(5)
        A[5:, :5] = np.linalg.solve(M, stiffness)
        A[5:, 5:] = -np.linalg.solve(M, damping)
        B[5:] = np.linalg.solve(M, W.T)
        return LinearModel(A=A, B=B)

    def advance(self, state: ArrayLike, torques: ArrayLike, duration: float) -> NDArray[np.float64]:
        """Return the state after a time in which the torques are held; the friction really sticks.

        Parameters
        ----------
        state : array_like (10,), or (11,) where the ball pivots
            x, y [m], theta, phi, psi [rad], and their rates.
        torques : array_like (n,)
            Wheel torques [N m].
        duration : float
            [s]; divided into equal inner steps not longer than `step`.

        Returns
        -------
        ndarray, shaped like `state`

        Raises
        ------
        InputError
            If an array has another shape or a value that is not finite, the duration is not above zero, or the state is
            past a lean of 1.2 rad, at which the simulation ends.

        Examples
        --------
        >>> lean = Model("alten").advance([0, 0, 0.01, 0, 0, 0, 0, 0, 0, 0], np.zeros(3), 0.2)[2]
        >>> lean.round(4)
        np.float64(0.0159)
        """
        state = real_array(state, (5 + self.velocity_count,), "The state")
        torques = real_array(torques, (self.robot.wheel_count,), "The array of torques")
        duration = positive_number(duration, "The duration")
        if not max(abs(state[2]), abs(state[3])) <= LARGEST_LEAN:
            raise InputError(
                f"The lean is {state[2]:.3g}, {state[3]:.3g} rad; it must be below {LARGEST_LEAN} rad, where no "
                "wheel holds the ball any more."
            )
        steps = self.steps_in(duration)
        return simulate_one(self.selected, self.packed, state, torques, sample_time=duration, steps=steps)

    def steps_in(self, duration: float) -> int:
        """Return how many inner steps a time is divided into.

        Parameters
        ----------
        duration : float
            [s].

        Returns
        -------
        int

        Raises
        ------
        InputError
            If they are more than a hundred million, most of a minute's work.

        Examples
        --------
        >>> Model("alten").steps_in(0.005)
        5
        """
        wanted = np.ceil(duration / self.step - 1e-9)
        if not wanted <= _MAX_STEPS:
            raise InputError(
                f"{duration:g} s take {wanted:.3g} inner steps of {self.step:g} s; at most {_MAX_STEPS:.0e} are "
                "possible. Use a longer step or a shorter duration."
            )
        return max(1, int(wanted))


#: a model, or the robot of an exact one: a robot, the name of a preset, or the path of a robot file
ModelLike = Model | RobotLike


def as_model(source: ModelLike) -> Model:
    """Return the model itself, or the exact one of a robot, of the preset of that name or of that file.

    InputError if it is none of these.
    """
    return source if isinstance(source, Model) else Model(source)


def _alike(*arguments: tuple[ArrayLike, int, str]) -> list[NDArray[np.float64]]:
    """Return arguments (..., size) as arrays of one shape but for their last axes."""
    arrays = [real_array(value, ("...", size), name) for value, size, name in arguments]
    try:
        shape = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    except ValueError:
        shapes = ", ".join(f"{name} {part.shape}" for (*_, name), part in zip(arguments, arrays, strict=True))
        raise InputError(f"The shapes do not match: {shapes}.") from None
    return [np.broadcast_to(array, (*shape, array.shape[-1])) for array in arrays]


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactMomentum:
    """The numbers of d/dt (v + C w) = -Lambda (g + kappa v/|v|), heading frame."""

    lever: NDArray[np.float64]  #: (2, 3) C [m]
    pull: NDArray[np.float64]  #: (2, 2) Lambda [m/s^2]
    rolling: float  #: kappa, the lean that carries the rolling friction [rad]


def contact_momentum(robot: Robot) -> ContactMomentum:
    """Return the law of the momentum about the floor's contact, from the exact model's mass matrix upright.

    Wheel torques, their friction and the gearboxes' play act between body and ball. They cancel in the sum of the
    ball's equation of motion and the body's, taken with the lever r_b (W = [A R^T E / r_b, -A]):

        (row v) + E^T R / r_b (row w)        E = [[0, -1], [1, 0], [0, 0]]

    What is left, linear in the rates and for a small lean, in the heading frame:

        d/dt (v + C w) = -Lambda (g + kappa v/|v|)

    v is the ball's velocity, w the body's angular velocity, g = (x and y of R^T e_z) the upward direction in the
    body's frame: (-sin phi, sin theta) at psi = 0, to second order. s = v + C w is the momentum as a speed; only
    gravity changes it, and what pushes the robot from outside: rolling friction, a slope, a hand. No friction of the
    driveline, identified or not, is in it. Rolling friction acts as a lean of kappa = N C_rr r_b / (m_r g l) would.
    """
    E = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    both = np.hstack([np.eye(2), E.T / robot.ball.radius])  # (row v) + E^T / r_b (row w)
    mass = both @ Model(robot).mass_matrix(np.zeros(5))
    moment = robot.body.mass * robot.gravity * robot.body.center_of_mass  # gravity's, for a whole radian
    # gravity turns the body about g x e_z = (g_y, -g_x), and E^T (g_y, -g_x, 0) = -g
    pull = np.linalg.solve(mass[:, :2], np.eye(2) * moment / robot.ball.radius)
    lever = np.linalg.solve(mass[:, :2], mass[:, 2:])
    return ContactMomentum(
        lever=np.asarray(lever, dtype=np.float64),
        pull=np.asarray(pull, dtype=np.float64),
        rolling=robot.rolling_force * robot.ball.radius / moment,
    )
