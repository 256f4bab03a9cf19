"""Fastest motions by direct collocation: the exact model's equations on CasADi's symbols, solved by Ipopt.

    minimise  T + c sum |u_k+1 - u_k|^2 / L^2        subject to  x' = f(x, u)  and every limit at every node

States x (10,) and the wheels' net torques u (n,), what friction leaves of the motors', stand at N + 1 nodes of equal
time. Over each two intervals the state is a cubic, which has the derivative f at its middle node too: Simpson's rule
(C. R. Hargraves and S. W. Paris, J. Guidance 10 (1987) 338). Ipopt solves it (A. Wächter and L. T. Biegler, Math.
Program. 106 (2006) 25). Wheel friction only takes from the torques that the motors have, so that the controller's
compensation gives it; the floor's rolling friction is a force in f. The small second term makes the torques unique, and
their reversals gentle enough for gears with play: with a tenth of it, wheels of the twin slipped.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.interpolate import BPoly
from scipy.ndimage import gaussian_filter1d

from ballbot.arrays import Floats
from ballbot.errors import InputError, missing_package
from ballbot.mechanics.engine.arrays import angle_accelerations
from ballbot.mechanics.engine.lanes import unpacked
from ballbot.mechanics.engine.smooth import acceleration
from ballbot.mechanics.engine.vector import rotate
from ballbot.mechanics.equations import attitude_of, ball_torque, body_rates, wheel_speeds
from ballbot.mechanics.floor import FloorFriction
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.geometry import wheel_load
from ballbot.mechanics.model import Model
from ballbot.mechanics.traction import forces_at_contacts, pack_contacts
from ballbot.robot import Robot
from ballbot.robot.checks import check_parameters
from ballbot.robot.components import FALLING_PART
from ballbot.robot.parameters import parameter, parameter_class

if TYPE_CHECKING:
    import casadi

#: limits, by the names of reports
FAMILIES = ("wheel torque", "motor speed", "lean", "speed", "wheel grip", "floor grip", "pivoting")
#: c
_SMOOTHNESS = 1e-2
#: limits whose rows are of squares; in place of no limit [m/s]
_SQUARED, _ANY_SPEED = ("lean", "speed", "floor grip"), 1e3
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
    #: a wheel that the motion unloads slips by the controller's own torques
    reserve: float = parameter(
        "part of a wheel's load at rest that holds no force of the motion", default=0.4, least=0.0, most=0.9
    )
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


class PlannedPath(NamedTuple):
    """A path over the floor, by its length."""

    place: casadi.Function  #: x, y [m] and psi [rad] at a length [m]
    length: float  #: [m]
    corridor: float  #: [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A motion to find, from a state to a state; what is NaN of the end is free."""

    start: Floats  #: (10,)
    end: Floats  #: (10,)
    torques: Floats  #: (2, n) net, at start and end [N m]
    line: Floats | None = None  #: (2,) direction on the floor in which the end is
    course: PlannedPath | None = None
    time: float  #: a guess [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedMotion:
    """A fastest motion, at its nodes."""

    t: Floats  #: (N + 1,) [s]
    states: Floats  #: (N + 1, 10)
    accelerations: Floats  #: (N + 1, 5)
    torques: Floats  #: (N + 1, n) net [N m]
    savings: dict[str, float]  #: by which a per cent more of each limit would shorten it [s]
    factor: float  #: of the limits that were made as large as they must be; 1 if none was

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return states (k, 10), with continuous accelerations, and net torques (k, n) at times (k,)."""
        nodes = np.stack([self.states[:, :5], self.states[:, 5:], self.accelerations], axis=1)
        q = BPoly.from_derivatives(self.t, nodes)
        torques = np.column_stack([np.interp(t, self.t, column) for column in self.torques.T])
        return np.hstack([q(t), q.derivative()(t)]), torques


class _Equations(NamedTuple):
    """Functions of x (10,) and u (n,) [N m], and of `more`, by which each limit is larger (7,)."""

    rate: casadi.Function  #: x'
    excess: casadi.Function  #: rows that the limits keep below zero
    used: casadi.Function  #: parts of the limits (7,), and the motors' torques (n,) [N m]
    balance: casadi.Function  #: accelerations (5,), and their derivatives by leans and u
    by_limit: casadi.Function  #: derivatives of the weighted excess by `more`


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
        check_parameters(replace(self.limits, speed=min(self.limits.speed, _ANY_SPEED)))
        if self.limits.torque > self.robot.drive.torque_limit:
            raise InputError(
                f"A plan may ask for {self.limits.torque:g} N m of a motor, which gives at most "
                f"{self.robot.drive.torque_limit:g} N m (drive.torque_limit of the robot)."
            )
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

    @property
    def left(self) -> Floats:
        """What the margin leaves of each limit (7,); the speed's is not for the controller."""
        return np.array([1.0 if name == "speed" else 1.0 - self.limits.margin for name in FAMILIES])

    @cached_property
    def _equations(self) -> _Equations:
        ca, robot, limits = self._casadi, self.robot, self.limits
        model, n = Model(robot), robot.wheel_count
        P = unpacked(model.selected, model.packed.item)
        x, u = ca.SX.sym("x", 10), ca.SX.sym("u", n)
        q, net = [x[i] for i in range(10)], tuple(u[i] for i in range(n))
        a = attitude_of(tuple(f(angle) for angle in q[2:5] for f in (ca.sin, ca.cos)))
        v, rates = tuple(q[5:7]), tuple(q[7:])
        w = body_rates(a, rates)
        pace = v[0] ** 2 + v[1] ** 2
        brake = -P.rolling_force / ca.sqrt(pace + _SLOW_BALL**2)
        v_dot, w_dot = acceleration(
            model.selected, P, a, v, w, net, FloorFriction((brake * v[0], brake * v[1]), 0.0)
        )
        rate = ca.vertcat(*q[5:], *v_dot, *angle_accelerations(model.selected, a, rates, w_dot))
        speeds = wheel_speeds(model.selected, P, a, v, w)
        motors = [net[i] + self._friction(i, speeds[i]) for i in range(n)]
        contacts = pack_contacts(robot).tolist()
        moments, presses, force = forces_at_contacts(P, a, w, (v_dot, w_dot), net, contacts)
        load, top, normal = wheel_load(robot), robot.drive.top_speed, force[2] / robot.weight
        curve = [
            FALLING_PART * motor / limits.torque + speed / top
            for motor, speed in zip(motors, speeds, strict=True)
        ]
        grips = [moment / (robot.wheels.radius * limits.grip * load) for moment in moments]
        reserve = (1.0 - limits.margin) * limits.reserve
        turn = rotate(a.R, ball_torque(P, moments))[2] / (limits.pivot * robot.weight)
        slide = (force[0] ** 2 + force[1] ** 2) / (limits.floor_grip * robot.weight) ** 2
        asked = {
            "wheel torque": [(sign * motor / limits.torque, 1.0) for motor in motors for sign in (1, -1)],
            "motor speed": [(sign * share, 1.0) for share in curve for sign in (1, -1)],
            "lean": [((q[2] ** 2 + q[3] ** 2) / limits.lean**2, 1.0)],
            "speed": [(pace / min(limits.speed, _ANY_SPEED) ** 2, 1.0)],
            "wheel grip": [
                (s * f + reserve, N / load) for f, N in zip(grips, presses, strict=True) for s in (1, -1)
            ],
            "floor grip": [(slide, normal**2)],
            "pivoting": [(sign * turn, normal) for sign in (1, -1)],
        }
        more, rows, used = ca.SX.sym("more", len(FAMILIES)), [], []
        for i, name in enumerate(FAMILIES):
            power = 2 if name in _SQUARED else 1
            rows += [part - (self.left[i] * more[i]) ** power * of for part, of in asked[name]]
            used.append(ca.mmax(ca.vertcat(*(part / of for part, of in asked[name]))) ** (1.0 / power))
        excess, weights = ca.vertcat(*rows), ca.SX.sym("weights", len(rows))
        balance = [rate[5:], ca.jacobian(rate[5:], ca.vertcat(x[2:4], u))]
        by_limit = ca.gradient(ca.dot(weights, excess), more)
        return _Equations(
            rate=ca.Function("rate", [x, u], [rate]),
            excess=ca.Function("excess", [x, u, more], [excess]),
            used=ca.Function("used", [x, u], [ca.vertcat(*used), ca.vertcat(*motors)]),
            balance=ca.Function("balance", [x, u], balance),
            by_limit=ca.Function("by_limit", [x, u, more, weights], [by_limit]),
        )

    def _friction(self, wheel: int, speed: Any) -> Any:
        """Return a wheel's friction by the robot's law, loaded by the largest torque, as a sum of smooth functions."""
        side = np.geomspace(0.1 * _SLOW, 1.2 * self.robot.drive.top_speed, 200)
        speeds = np.concatenate([-side, side])
        every = np.repeat(speeds[:, None], self.robot.wheel_count, axis=1)
        table = wheel_friction(every, self.robot.friction, torque=np.full(every.shape, self.torque))
        widths = _SLOW * np.geomspace(1.0, 32.0, _WIDTHS)
        steps = np.tanh(speeds[:, None] / widths)
        basis = np.column_stack([speeds, steps, steps**2])
        smooth = table[:, wheel] * np.tanh(np.abs(speeds) / _SLOW)
        weights = np.linalg.lstsq(basis, smooth, rcond=None)[0].tolist()
        stairs = [self._casadi.tanh(speed / width) for width in widths]
        terms = [speed, *stairs, *(stair**2 for stair in stairs)]
        return sum(weight * term for weight, term in zip(weights, terms, strict=True))

    def used(self, states: Floats, torques: Floats) -> tuple[Floats, Floats]:
        """Return what is used of each of `FAMILIES` (k, 7), and the motors' torques (k, n) [N m], at states (k, 10)."""
        shares, given = self._equations.used(states.T, torques.T)
        return np.asarray(shares).T, np.asarray(given).T

    def steady(self, velocity: Floats) -> tuple[Floats, Floats]:
        """Return the state (10,) at the origin and the net torques (n,) of a steady motion (2,) [m/s]."""
        state, torques = np.zeros(10), np.zeros(self.robot.wheel_count)
        state[5:7] = velocity
        for _ in range(_NEWTON):
            rest, slope = (np.asarray(part) for part in self._equations.balance(state, torques))
            step = -np.linalg.lstsq(slope, rest[:, 0], rcond=None)[0]
            state[2:4] += step[:2]
            torques += step[2:]
        return state, torques

    def steady_use(self, velocity: Floats) -> Floats:
        """Return what a steady motion (2,) [m/s] uses of each limit less the margin (7,)."""
        state, torques = self.steady(velocity)
        return self.used(state[None], torques[None])[0][0] / self.left

    def top_speed(self, direction: Floats) -> tuple[float, str]:
        """Return the largest steady speed in a direction (2,) [m/s], and the family that bounds it."""
        low, high = 0.0, 1.5 * self.robot.drive.top_speed * self.robot.wheels.radius
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.steady_use(middle * direction).max() <= 1.0 else (low, middle)
        return low, FAMILIES[int(self.steady_use(high * direction).argmax())]

    def fastest(self, leg: Leg, *, time: float | None = None, larger: Collection[str] = ()) -> PlannedMotion:
        """Return the fastest motion; with a time [s], the one in it with the least factor of the limits `larger`.

        InputError if the solver ends without one.
        """
        ca, equations = self._casadi, self._equations
        N = 2 * int(np.clip(round(leg.time / _SPACING), _FEWEST, _MOST))
        opti = ca.Opti()
        X, U = opti.variable(10, N + 1), opti.variable(self.robot.wheel_count, N + 1)
        T, factor = opti.variable(), opti.variable()
        opti.subject_to(T >= _SHORTEST if time is None else time == T)
        opti.subject_to(factor >= 0.1 if larger else factor == 1.0)
        more = ca.vertcat(*(factor if name in larger else 1.0 for name in FAMILIES))
        F, h = equations.rate.map(N + 1)(X, U), 2.0 * T / N
        x_0, x_m, x_1, f_0, f_m, f_1 = (M[:, i::2][:, : N // 2] for M in (X, F) for i in range(3))
        opti.subject_to(ca.vec(x_m - 0.5 * (x_0 + x_1) - h / 8.0 * (f_0 - f_1)) == 0.0)
        opti.subject_to(ca.vec(x_1 - x_0 - h / 6.0 * (f_0 + 4.0 * f_m + f_1)) == 0.0)
        within = ca.vec(equations.excess.map(N + 1)(X, U, ca.repmat(more, 1, N + 1))) <= 0.0
        opti.subject_to(within)
        opti.subject_to(X[:, 0] == leg.start)
        ends = [i for i in range(10) if np.isfinite(leg.end[i])]
        opti.subject_to(X[ends, -1] == leg.end[ends])
        if leg.line is not None:
            opti.subject_to(X[0, -1] * leg.line[1] == X[1, -1] * leg.line[0])
        opti.subject_to(U[:, 0] == leg.torques[0])
        opti.subject_to(U[:, -1] == leg.torques[1])
        places = _stay_on(opti, ca, leg.course, X) if leg.course else _stay_between(opti, leg, X)
        guess = np.zeros((10, N + 1))
        guess[[0, 1, 4]] = places.T
        guess[[5, 6, 9]] = ((places[-1] - places[0]) / leg.time)[:, None]
        for symbol, value in ((X, guess), (T, time or leg.time), (factor, 1.0)):
            opti.set_initial(symbol, value)
        jumps = ca.sumsqr(U[:, 1:] - U[:, :-1]) / self.torque**2
        opti.minimize((factor if larger else T) + _SMOOTHNESS * jumps)
        opti.solver("ipopt", {"print_time": False}, _IPOPT)
        try:
            solved = opti.solve()
        except RuntimeError:
            why = str(opti.stats()["return_status"]).replace("_", " ").lower()
            raise InputError(
                f"The solver found no plan: {why} after {opti.stats()['iter_count']} iterations. Give it wider limits "
                "or a smoother path."
            ) from None
        states, net = np.asarray(solved.value(X)), np.asarray(solved.value(U))
        weights = np.asarray(solved.value(opti.dual(within))).reshape(N + 1, -1).T
        saved = np.asarray(equations.by_limit(states, net, solved.value(more), weights)).sum(axis=1)
        return PlannedMotion(
            t=np.linspace(0.0, solved.value(T), N + 1),
            states=states.T,
            accelerations=np.asarray(equations.rate(states, net)).T[:, 5:],
            torques=net.T,
            savings=dict(zip(FAMILIES, (-0.01 * saved).tolist(), strict=True)),
            factor=float(solved.value(factor)),
        )


_IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-6, "acceptable_iter": 0}


def _stay_between(opti: Any, leg: Leg, X: Any) -> Floats:
    """Keep the heading between those of the ends, and return a guess of x, y and psi (N + 1, 3)."""
    middle, half = 0.5 * (leg.end[4] + leg.start[4]), 0.5 * abs(leg.end[4] - leg.start[4]) + _HEADING_BAND
    opti.subject_to(opti.bounded(middle - half, X[4, :], middle + half))
    free = leg.start + 0.5 * leg.time * np.roll(leg.start + np.nan_to_num(leg.end), -5)
    end = np.where(np.isfinite(leg.end), leg.end, free)
    return np.linspace(leg.start, end, X.shape[1])[:, [0, 1, 4]]


def _stay_on(opti: Any, ca: Any, course: PlannedPath, X: Any) -> Floats:
    """Keep the ball in the corridor of a course; return a guess of x, y and psi."""
    path, length, corridor = course
    N = X.shape[1] - 1
    s, first = opti.variable(N + 1), np.linspace(0.0, length, N + 1)
    off = X[[0, 1, 4], :] - path.map(N + 1)(s.T)
    opti.subject_to(ca.vec(ca.sum1(off[:2, :] ** 2)) / corridor**2 <= 1.0)
    opti.subject_to(ca.vec(off[2, :] ** 2) / _HEADING_ERROR**2 <= 1.0)
    opti.subject_to(opti.bounded(-corridor, s, length + corridor))
    opti.subject_to(opti.bounded(-length / N, s[1:] - s[:-1], 4.0 * length / N))  # it may roll back first
    opti.subject_to(s[[0, -1]] == np.array([0.0, length]))
    opti.set_initial(s, first)
    return np.asarray(path(first[None])).T


def course_through(places: Floats, corridor: float) -> PlannedPath:
    """Return the course through places (k, 3), rounded within a corridor [m]; InputError if it has no length."""
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
    return PlannedPath(ca.interpolant("course", "bspline", [s], smooth.ravel()), float(lengths[-1]), corridor)
