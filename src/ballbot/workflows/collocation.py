"""Fastest motions by direct collocation: the exact model's equations on CasADi's symbols, solved by Ipopt.

    minimise  T + c sum |u_k+1 - u_k|^2 / L^2        subject to  x' = f(x, u)  and every limit at every node

States x (10,) and the wheels' net torques u (n,), what friction leaves of the motors', stand at N + 1 nodes of equal
time. Over each two intervals the state is a cubic, which has the derivative f at its middle node too: Simpson's rule
(C. R. Hargraves and S. W. Paris, J. Guidance 10 (1987) 338). Ipopt solves it (A. Wächter and L. T. Biegler, Math.
Program. 106 (2006) 25). Wheel friction only takes from the torques that the motors have, so that the controller's
compensation gives it; the floor's rolling friction is a force in f. The small second term makes the torques unique.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly
from scipy.ndimage import gaussian_filter1d

from ballbot.errors import InputError, missing_package
from ballbot.mechanics.engine.arrays import angle_accelerations
from ballbot.mechanics.engine.lanes import unpacked
from ballbot.mechanics.engine.smooth import acceleration
from ballbot.mechanics.engine.vector import add, cross, rotate, scale
from ballbot.mechanics.equations import attitude_of, ball_torque, body_rates, wheel_speeds
from ballbot.mechanics.floor import FloorFriction
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.geometry import wheel_load
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.parameters import parameter, parameter_class
from ballbot.simulation.imperfections import FALLING_PART
from ballbot.simulation.model_plant import forces_at_wheels, pack_contacts

if TYPE_CHECKING:
    import casadi

#: limits, by the names of reports
FAMILIES = ("wheel torque", "motor speed", "lean", "speed", "wheel grip", "floor grip", "pivoting")
#: c
_SMOOTHNESS = 1e-3
#: below which the friction's sign becomes a ramp: wheel [rad/s], ball [m/s]
_SLOW, _SLOW_BALL = 0.5, 0.02
#: of the functions that friction is a sum of
_WIDTHS = 6
#: an interval, about [s], and how many there are
_SPACING = 0.1
_FEWEST, _MOST = 16, 120
#: how far the heading may leave the range between its ends, and that of a course [rad]
_HEADING_BAND, _HEADING_ERROR = 0.01, 0.05
#: steps to a steady motion: each doubles the digits
_NEWTON = 6
#: the shortest motion [s]
_SHORTEST = 0.05
#: places nearer than this are one [m, rad]
_SAME = 1e-6


@parameter_class
class MoveLimits:
    """What a move may ask for; `margin` is taken from torque, motor speed, lean and grip, for the controller."""

    torque: float = parameter("largest torque of a wheel's motor", "N m", most=1000.0)
    lean: float = parameter("largest lean", "rad", default=0.35, most=1.0)
    speed: float = parameter("largest speed of the ball", "m/s", default=math.inf, most=math.inf)
    grip: float = parameter("friction coefficient of the wheels on the ball", default=1.0, most=10.0)
    floor_grip: float = parameter("friction coefficient of the ball on the floor", default=1.0, most=10.0)
    #: beyond it the ball pivots under a robot that turns, and the heading is lost
    pivot: float = parameter(
        "moment that holds the ball from pivoting on the floor, over the normal force",
        "m",
        default=0.02,
        most=1.0,
    )
    margin: float = parameter(
        "fraction of the limits that is left to the controller", default=0.2, least=0.0, most=0.9
    )


class Course(NamedTuple):
    """A path over the floor, by its length."""

    place: casadi.Function  #: x, y [m] and psi [rad] at a length [m]
    length: float  #: [m]
    corridor: float  #: [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A motion to find, from a state to a state; what is NaN of the end is free."""

    start: NDArray[np.float64]  #: (10,)
    end: NDArray[np.float64]  #: (10,)
    torques: NDArray[np.float64]  #: (2, n) net, at start and end [N m]
    line: NDArray[np.float64] | None = None  #: (2,) direction on the floor in which the end is
    course: Course | None = None
    time: float  #: a guess [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A fastest motion, at its nodes."""

    t: NDArray[np.float64]  #: (N + 1,) [s]
    states: NDArray[np.float64]  #: (N + 1, 10)
    accelerations: NDArray[np.float64]  #: (N + 1, 5)
    torques: NDArray[np.float64]  #: (N + 1, n) net [N m]
    #: by which a per cent more of each limit would shorten it [s]
    savings: dict[str, float]
    factor: float  #: of the limit that was made as large as it must be; 1 if none was
    iterations: int

    def at(self, t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return states (k, 10), with continuous accelerations, and net torques (k, n) at times (k,)."""
        nodes = np.stack([self.states[:, :5], self.states[:, 5:], self.accelerations], axis=1)
        q = BPoly.from_derivatives(self.t, nodes)
        torques = np.column_stack([np.interp(t, self.t, column) for column in self.torques.T])
        return np.hstack([q(t), q.derivative()(t)]), torques


@dataclass(frozen=True, kw_only=True)
class Planner:
    """A robot's equations and limits on symbols. InputError without CasADi, or if friction holds a wheel."""

    robot: Robot
    limits: MoveLimits
    _casadi: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        try:
            import casadi
        except ImportError:
            raise missing_package("A plan", "CasADi", extra="plan") from None
        object.__setattr__(self, "_casadi", casadi)
        for i, breakaway in enumerate(self.robot.friction.breakaway):
            if breakaway >= self.torque:
                raise InputError(
                    f"Wheel {i + 1} needs {breakaway:.3g} N m to start against its friction, "
                    f"{breakaway / self.torque:.2f} times the {self.torque:.3g} N m that a plan may ask for."
                )

    @property
    def torque(self) -> float:
        """Largest torque of a motor, less the margin [N m]."""
        return (1.0 - self.limits.margin) * self.limits.torque

    @cached_property
    def _symbols(self) -> tuple:
        """Return x, u, x', the limits' rows (<= 1) by families, what is used of each limit, and the rows' factors."""
        ca, robot, limits = self._casadi, self.robot, self.limits
        model, n = Model(robot), robot.wheel_count
        P = unpacked(model.selected, model.packed.item)
        x, u, more = ca.SX.sym("x", 10), ca.SX.sym("u", n), ca.SX.sym("more", len(FAMILIES))
        q, net = [x[i] for i in range(10)], tuple(u[i] for i in range(n))
        a = attitude_of(tuple(f(angle) for angle in q[2:5] for f in (ca.sin, ca.cos)))
        v, rates = tuple(q[5:7]), tuple(q[7:])
        w = body_rates(a, rates)
        brake = -P.rolling_force / ca.sqrt(v[0] ** 2 + v[1] ** 2 + _SLOW_BALL**2)
        floor = FloorFriction((brake * v[0], brake * v[1]), 0.0)
        v_dot, w_dot = acceleration(model.selected, P, a, v, w, net, floor)
        rate = ca.vertcat(*q[5:], *v_dot, *angle_accelerations(model.selected, a, rates, w_dot))
        speeds = wheel_speeds(model.selected, P, a, v, w)
        motors = [net[i] + self._friction(i, speeds[i]) for i in range(n)]
        pushes, presses = forces_at_wheels(P, a, w, (v_dot, w_dot), net, pack_contacts(robot).tolist())
        turn = rotate(a.R, ball_torque(P, pushes))[2]
        pushes = [push / robot.wheels.radius for push in pushes]
        turning = add(cross(w_dot, (0.0, 0.0, 1.0)), cross(w, cross(w, (0.0, 0.0, 1.0))))
        force = add(
            (P.weighed * v_dot[0], P.weighed * v_dot[1], robot.weight), scale(rotate(a.R, turning), P.ml)
        )
        left = 1.0 - limits.margin
        lean, pace = q[2] ** 2 + q[3] ** 2, v[0] ** 2 + v[1] ** 2
        top, load = left * robot.drive.top_speed * more[1], wheel_load(robot)
        asked = [torque / (self.torque * more[0]) for torque in motors]
        curve = [FALLING_PART * asked[i] + speeds[i] / top for i in range(n)]
        slips = [
            sign * f / (left * limits.grip * more[4]) - N
            for f, N in zip(pushes, presses, strict=True)
            for sign in (1, -1)
        ]
        rows = {
            "wheel torque": [sign * one for one in asked for sign in (1, -1)],
            "motor speed": [sign * one for one in curve for sign in (1, -1)],
            "lean": [lean / (left * limits.lean * more[2]) ** 2],
            "speed": [pace / (min(limits.speed, 1e3) * more[3]) ** 2],
            "wheel grip": [slip / load + 1.0 for slip in slips],
            "pivoting": [
                (sign * turn / (left * limits.pivot * more[6]) - force[2]) / robot.weight + 1.0 for sign in (1, -1)
            ],
            "floor grip": [
                (force[0] ** 2 + force[1] ** 2) / (left * limits.floor_grip * more[5] * robot.weight) ** 2
                + 1.0 - (force[2] / robot.weight) ** 2
            ],
        }  # fmt: skip
        used = [
            ca.mmax(ca.fabs(ca.vertcat(*motors))) / limits.torque,
            ca.mmax(ca.fabs(ca.vertcat(*speeds))) / robot.drive.top_speed,
            ca.sqrt(lean) / limits.lean,
            ca.sqrt(pace) / limits.speed,
            ca.mmax(ca.vertcat(*(ca.fabs(f) / N for f, N in zip(pushes, presses, strict=True))))
            / limits.grip,
            ca.sqrt(force[0] ** 2 + force[1] ** 2) / force[2] / limits.floor_grip,
            ca.fabs(turn) / force[2] / limits.pivot,
        ]
        return x, u, more, rate, rows, ca.vertcat(*used), ca.vertcat(*motors)

    def _friction(self, wheel: int, speed: Any) -> Any:
        """Return a wheel's friction by the robot's law, loaded by the largest torque, as a sum of smooth functions."""
        side = np.geomspace(0.1 * _SLOW, 1.2 * self.robot.drive.top_speed, 200)
        speeds = np.concatenate([-side, side])
        every = np.repeat(speeds[:, None], self.robot.wheel_count, axis=1)
        table = wheel_friction(every, self.robot.friction, torque=np.full(every.shape, self.torque))
        widths = _SLOW * np.geomspace(1.0, 32.0, _WIDTHS)
        steps = np.tanh(speeds[:, None] / widths)
        basis = np.column_stack([speeds, steps, steps**2])
        weights = np.linalg.lstsq(basis, table[:, wheel] * np.tanh(np.abs(speeds) / _SLOW), rcond=None)[
            0
        ].tolist()
        stairs = [self._casadi.tanh(speed / width) for width in widths]
        terms = [speed, *stairs, *(one**2 for one in stairs)]
        return sum(weight * term for weight, term in zip(weights, terms, strict=True))

    @cached_property
    def _families(self) -> NDArray[np.str_]:
        """The family of each row of the limits."""
        return np.array([name for name, rows in self._symbols[4].items() for _ in rows])

    @cached_property
    def _functions(self) -> tuple:
        """Return the functions f(x, u), and f with the limits' rows of (x, u, factors)."""
        ca = self._casadi
        x, u, more, rate, rows, *_ = self._symbols
        every = ca.vertcat(*(row for family in rows.values() for row in family))
        return ca.Function("f", [x, u], [rate]), ca.Function("limits", [x, u, more], [rate, every])

    def used(
        self, states: NDArray[np.float64], torques: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what is used of each of `FAMILIES` (k, 7), and the motors' torques (k, n) [N m], at states (k, 10)."""
        x, u, _, _, _, used, motors = self._symbols
        shares, given = self._casadi.Function("used", [x, u], [used, motors])(states.T, torques.T)
        return np.asarray(shares).T, np.asarray(given).T

    def steady(self, velocity: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the state (10,) at the origin and the net torques (n,) of a steady motion (2,) [m/s]."""
        state, torques = np.zeros(10), np.zeros(self.robot.wheel_count)
        state[5:7] = velocity
        for _ in range(_NEWTON):
            rest, slope = (np.asarray(one) for one in self._balance(state, torques))
            step = -np.linalg.lstsq(slope, rest[:, 0], rcond=None)[0]
            state[2:4] += step[:2]
            torques += step[2:]
        return state, torques

    @cached_property
    def _balance(self) -> Any:
        """The function of (x, u) that gives the accelerations and how they change with lean and torques."""
        x, u, _, rate, *_ = self._symbols
        jacobian = self._casadi.jacobian(rate[5:], self._casadi.vertcat(x[2:4], u))
        return self._casadi.Function("balance", [x, u], [rate[5:], jacobian])

    def steady_use(self, velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what a steady motion (2,) [m/s] uses of each family, of the limit less the margin (7,)."""
        state, torques = self.steady(velocity)
        rows = np.asarray(self._functions[1](state, torques, np.ones(len(FAMILIES)))[1])[:, 0]
        return np.array([max(rows[self._families == name]) for name in FAMILIES])

    def top_speed(self, direction: NDArray[np.float64]) -> tuple[float, str]:
        """Return the largest steady speed in a direction (2,) [m/s], and the family that bounds it."""
        low, high = 0.0, 1.5 * self.robot.drive.top_speed * self.robot.wheels.radius
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.steady_use(middle * direction).max() <= 1.0 else (low, middle)
        return low, FAMILIES[int(self.steady_use(high * direction).argmax())]

    def fastest(self, leg: Leg, *, time: float | None = None, larger: str = "") -> Motion:
        """Return the fastest motion; with a time [s], the one in it with the least factor of the limit `larger`.

        InputError if the solver ends without one.
        """
        ca, n = self._casadi, self.robot.wheel_count
        N = 2 * int(np.clip(round(leg.time / _SPACING), _FEWEST, _MOST))
        f, limits = self._functions
        X, U, T, factor = (
            ca.MX.sym("X", 10, N + 1),
            ca.MX.sym("U", n, N + 1),
            ca.MX.sym("T"),
            ca.MX.sym("factor"),
        )
        more = ca.vertcat(*(factor if name == larger else 1.0 for name in FAMILIES))
        F, rows = limits.map(N + 1)(X, U, ca.repmat(more, 1, N + 1))
        equal = ca.vertcat(*_defects(ca, X, F, 2.0 * T / N), *_ends(leg, X, U))
        path = _path(ca, leg, X, N)
        jumps = ca.sumsqr(U[:, 1:] - U[:, :-1]) / self.torque**2
        problem = {
            "x": ca.vertcat(ca.vec(X), ca.vec(U), T, factor, path.lengths),
            "f": (factor if larger else T) + _SMOOTHNESS * jumps,
            "g": ca.vertcat(equal, ca.vec(rows), path.rows),
        }
        lower, upper = _state_bounds(leg, N)
        torques = np.full(n * (N + 1), np.inf)
        times = (_SHORTEST, np.inf) if time is None else (time, time)
        factors = (0.1, np.inf) if larger else (1.0, 1.0)
        first = _guess(leg, path.places).ravel(), np.zeros(len(torques)), [time or leg.time, 1.0], path.first
        zeros, most = np.zeros(equal.numel()), np.ones(rows.numel() + path.rows.numel())
        bounds = {
            "x0": np.concatenate(first),
            "lbx": np.concatenate([lower, -torques, [times[0], factors[0]], path.least]),
            "ubx": np.concatenate([upper, torques, [times[1], factors[1]], path.most]),
            "lbg": np.concatenate([zeros, -np.inf * most]),
            "ubg": np.concatenate([zeros, most]),
        }
        solved, iterations = _solved(ca, problem, bounds)
        z, count = np.asarray(solved["x"])[:, 0], 10 * (N + 1)
        states, net = z[:count].reshape(N + 1, 10), z[count : count + len(torques)].reshape(N + 1, n)
        T_found, factor_found = z[count + len(torques) :][:2]
        multipliers = np.asarray(solved["lam_g"])[equal.numel() :, 0][: rows.numel()].reshape(N + 1, -1)
        return Motion(
            t=np.linspace(0.0, T_found, N + 1),
            states=states,
            accelerations=np.asarray(f(states.T, net.T)).T[:, 5:],
            torques=net,
            savings={
                name: float(_PER_CENT[name] * multipliers[:, self._families == name].sum())
                for name in FAMILIES
            },
            factor=float(factor_found),
            iterations=iterations,
        )


_OPTIONS = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-6, "acceptable_iter": 0},
}
#: of the right side of a family's rows for one per cent of its limit, which is squared in some
_PER_CENT = {name: 0.02 if name in ("lean", "speed", "floor grip") else 0.01 for name in FAMILIES}


def _solved(ca: Any, problem: dict[str, Any], bounds: dict[str, Any]) -> tuple[dict[str, Any], int]:
    """Return Ipopt's solution and its iterations; InputError if it has none."""
    solver = ca.nlpsol("fastest", "ipopt", problem, _OPTIONS)
    solved, state = solver(**bounds), solver.stats()
    if not state["success"]:
        words = str(state["return_status"]).replace("_", " ").lower()
        raise InputError(
            f"The solver found no plan: {words} after {state['iter_count']} iterations. Give it wider limits or a "
            "smoother path."
        )
    return solved, int(state["iter_count"])


def _state_bounds(leg: Leg, N: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the bounds of the states: without a course, the heading stays between those of its ends."""
    middle, band = np.zeros((N + 1, 10)), np.full((N + 1, 10), np.inf)
    if leg.course is None:  # turning to and fro would gain a hundredth of the time
        middle[:, 4] = 0.5 * (leg.end[4] + leg.start[4])
        band[:, 4] = 0.5 * abs(leg.end[4] - leg.start[4]) + _HEADING_BAND
    return (middle - band).ravel(), (middle + band).ravel()


def _defects(ca: Any, X: Any, F: Any, h: Any) -> Iterator:
    """Yield what is zero over each interval h: at its middle the cubic, and Simpson's rule at its end."""
    x_0, x_m, x_1, f_0, f_m, f_1 = (M[:, i::2][:, : X.shape[1] // 2] for M in (X, F) for i in range(3))
    yield ca.vec(x_m - 0.5 * (x_0 + x_1) - h / 8.0 * (f_0 - f_1))
    yield ca.vec(x_1 - x_0 - h / 6.0 * (f_0 + 4.0 * f_m + f_1))


def _ends(leg: Leg, X: Any, U: Any) -> list:
    """Return what is zero at both ends."""
    end = [X[i, -1] - leg.end[i] for i in range(10) if np.isfinite(leg.end[i])]
    if leg.line is not None:
        end.append(X[0, -1] * leg.line[1] - X[1, -1] * leg.line[0])
    return [X[:, 0] - leg.start, *end, U[:, 0] - leg.torques[0], U[:, -1] - leg.torques[1]]


class _Path(NamedTuple):
    """The lengths along a course that are found with a motion; without a course, nothing but a guess of places."""

    lengths: Any  #: symbols
    rows: Any  #: at most 1
    places: NDArray[np.float64]  #: (N + 1, 3) x, y and psi at first
    first: NDArray[np.float64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]


def _path(ca: Any, leg: Leg, X: Any, N: int) -> _Path:
    none = np.zeros(0)
    if leg.course is None:
        start = leg.start[[0, 1, 4]]
        free = start + 0.5 * leg.time * leg.start[[5, 6, 9]]
        if leg.line is not None and np.isnan(leg.end[0]):
            free[:2] = start[:2] + 0.5 * leg.time * (leg.start[5:7] + leg.end[5:7])
        end = np.where(np.isfinite(leg.end[[0, 1, 4]]), leg.end[[0, 1, 4]], free)
        return _Path(ca.MX(0, 1), ca.MX(0, 1), np.linspace(start, end, N + 1), none, none, none)
    place, length, corridor = leg.course
    s, first = ca.MX.sym("s", N + 1), np.linspace(0.0, length, N + 1)
    off = X[[0, 1, 4], :] - place.map(N + 1)(s.T)
    steps = (s[1:] - s[:-1]) * (N / length)
    rows = ca.vertcat(
        ca.vec(ca.sum1(off[:2, :] ** 2)) / corridor**2,
        ca.vec(off[2, :] ** 2) / _HEADING_ERROR**2,
        steps / 4.0,
        -steps,
    )
    least, most = np.full(N + 1, -corridor), np.full(N + 1, length + corridor)
    least[[0, -1]] = most[[0, -1]] = 0.0, length
    return _Path(s, rows, np.asarray(place(first[None])).T, first, least, most)


def _guess(leg: Leg, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return states (N + 1, 10) without lean through places, at the mean speed."""
    states = np.zeros((len(places), 10))
    states[:, [0, 1, 4]] = places
    states[:, [5, 6, 9]] = (places[-1] - places[0]) / leg.time
    return states


def course_through(places: NDArray[np.float64], corridor: float) -> Course:
    """Return the course through places x, y [m] and psi [rad] (k, 3); its corners are rounded within the corridor [m].

    InputError if it has no length.
    """
    import casadi as ca

    kept = np.concatenate([[True], np.abs(np.diff(places, axis=0)).max(axis=1) > _SAME])
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places[kept, :2], axis=0).T))])
    if not lengths[-1] > 0.0:
        raise InputError("The path has no length: all its places are the same.")
    fine = min(0.5 * corridor, lengths[-1] / 50.0)
    margin = 10.0 * fine  # on both sides, along the ends' directions
    count = int(np.ceil(lengths[-1] / fine))
    s = np.linspace(-margin, lengths[-1] + margin, count + 1 + 2 * round(margin / lengths[-1] * count))
    points = np.column_stack([np.interp(s, lengths, column) for column in places[kept].T])
    for outside, index in ((s < 0.0, 0), (s > lengths[-1], -1)):
        ends = places[kept][[0, 1] if index == 0 else [-2, -1], :2]
        along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
        points[outside, :2] += (s[outside] - (0.0 if index == 0 else lengths[-1]))[:, None] * along
    smooth = gaussian_filter1d(points, 0.7 * corridor / (s[1] - s[0]), axis=0, mode="nearest")
    return Course(ca.interpolant("course", "bspline", [s], smooth.ravel()), float(lengths[-1]), corridor)
