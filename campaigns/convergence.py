"""Measure the order of the whole method: its error against an event-driven reference as the step shrinks.

.venv/bin/python -m campaigns.evidence convergence

The reference follows a robot with set-valued friction from event to event. Between two events each wheel slides with a
known sign or sticks, the ball rolls or sticks, and the equations are smooth with constraints, which SciPy's DOP853
integrates to 1e-12. Events, found by root finding, are a speed that reaches zero and a holding force that reaches its
limit. At an event every combination of contacts at rest is tried for consistency. Mass matrix and free acceleration are
the model's; friction and sticking are written down here again.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ballbot import Model, Robot
from ballbot.mechanics.floor import rolling_friction
from benchmarks.workloads import nominal_robot
from campaigns.section import Section

_WHEEL_AT_REST = 1e-9  # [rad/s], the remainder of a speed at an event
_BALL_AT_REST = 1e-9  # [m/s]; a ball that breaks away has it, since it must move some way


class Mode(NamedTuple):
    """What every contact does."""

    signs: tuple[int, ...]  #: +1 or -1 for a wheel that slides so, 0 for one that sticks
    rolls: bool  #: whether the ball moves

    def with_sign(self, wheel: int, sign: int) -> Self:
        """Return the mode with another sign of one wheel."""
        return self._replace(signs=(*self.signs[:wheel], sign, *self.signs[wheel + 1 :]))


@dataclass(frozen=True, kw_only=True)
class Phase:
    """What the contacts do from a time on."""

    start: float  #: [s]
    mode: Mode


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """An end and the way there."""

    state: NDArray[np.float64]  #: (10,)
    phases: list[Phase]


class Forces(NamedTuple):
    """Accelerations and the friction of every contact."""

    q_ddot: NDArray[np.float64]  #: (5,)
    wheels: NDArray[np.float64]  #: (n,) [N m]; those of sticking wheels by their constraint
    floor: NDArray[np.float64]  #: (2,) [N], likewise; friction opposes the force that both give


class EventDriven:
    """A robot followed from event to event."""

    def __init__(self, robot: Robot) -> None:
        n, friction = robot.wheel_count, robot.friction
        self._friction = friction
        self._held = np.array(friction.coulomb) + np.array(friction.stribeck)
        self._rolling_force = robot.rolling_force
        without_dry = replace(friction, coulomb=(0.0,) * n, stribeck=(0.0,) * n, rolling=0.0)
        self._model = Model(robot.replace(friction=without_dry))

    def follow(
        self, start: NDArray[np.float64], torques: NDArray[np.float64], sample_time: float
    ) -> Followed:
        """Return where torques (samples, n), each held for a sample, take a state (10,)."""
        state, phases = np.array(start, dtype=float), []
        mode = Mode(tuple(int(np.sign(w)) for w in self._speeds(state)), bool(np.any(state[5:7])))
        for sample, u in enumerate(torques):
            t, end = sample * sample_time, (sample + 1) * sample_time
            state, mode = self._consistent(state, u, self._at_rest(state, mode), mode)
            while t < end:
                phases.append(Phase(start=t, mode=mode))
                t, state, mode = self._until_event(t, end, state, u, mode)
        return Followed(state=state, phases=phases)

    def _until_event(
        self, t: float, end: float, state: NDArray[np.float64], u: NDArray[np.float64], mode: Mode
    ) -> tuple[float, NDArray[np.float64], Mode]:
        """Integrate to the next event or `end`; return its time, its state and the mode of the contacts after it."""
        n = len(mode.signs)
        events = [self._wheel_event(wheel, u, mode) for wheel in range(n)] + [self._ball_event(u, mode)]
        run = solve_ivp(
            lambda _, x: np.concatenate([x[5:], self._motion(x, u, mode).q_ddot]),
            (t, end),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            events=events,
        )
        t, state = float(run.t[-1]), run.y[:, -1]
        happened = [contact for contact, times in enumerate(run.t_events) if len(times)]
        if not happened:
            return t, state, mode
        resting = self._at_rest(state, mode)
        contact = happened[0]
        if contact < n and mode.signs[contact] == 0:  # breaks away, the way that friction held it from
            sign = int(np.sign(self._motion(state, u, mode).wheels[contact]))
            return t, state, mode.with_sign(contact, sign)
        state, mode = self._consistent(state, u, resting | {contact}, mode)
        return t, state, mode

    def _wheel_event(self, wheel: int, u: NDArray[np.float64], mode: Mode) -> Callable[..., float]:
        sign = mode.signs[wheel]

        def sliding_speed(_: float, x: NDArray[np.float64]) -> float:
            return float(sign * self._speeds(x)[wheel])

        def unused_torque(_: float, x: NDArray[np.float64]) -> float:
            return float(self._held[wheel] - abs(self._motion(x, u, mode).wheels[wheel]))

        return _terminal(sliding_speed if sign else unused_torque)

    def _ball_event(self, u: NDArray[np.float64], mode: Mode) -> Callable[..., float]:
        def speed(_: float, x: NDArray[np.float64]) -> float:
            return float(np.hypot(*x[5:7])) - 0.5 * _BALL_AT_REST

        def unused_force(_: float, x: NDArray[np.float64]) -> float:
            return float(self._rolling_force - np.hypot(*self._motion(x, u, mode).floor))

        return _terminal(speed if mode.rolls else unused_force)

    def _at_rest(self, state: NDArray[np.float64], mode: Mode) -> set[int]:
        """Return the contacts at rest, the ball as the last."""
        speeds = np.append(
            np.abs(self._speeds(state)) / _WHEEL_AT_REST, np.hypot(*state[5:7]) / _BALL_AT_REST
        )
        stuck = np.append(np.array(mode.signs) == 0, not mode.rolls)
        return {int(i) for i in np.flatnonzero(stuck | (speeds < 0.9))}

    def _consistent(
        self, state: NDArray[np.float64], u: NDArray[np.float64], resting: set[int], mode: Mode
    ) -> tuple[NDArray[np.float64], Mode]:
        """Return the mode of contacts at rest: they stick within their limits, or slide as they are accelerated.

        The ball sticks if it can. Otherwise it starts at the speed of rest, in the direction that friction held back.
        """
        n = len(mode.signs)
        wheels, ball_rests = sorted(resting - {n}), n in resting
        if ball_rests:
            state = np.concatenate([state[:5], [0.0, 0.0], state[7:]])
            choice = self._choice(state, u, wheels, mode._replace(rolls=False))
            if choice is not None:
                return state, choice
            pull = self._motion(state, u, mode._replace(rolls=False)).floor
            state = np.concatenate([state[:5], _BALL_AT_REST * pull / np.hypot(*pull), state[7:]])
        choice = self._choice(state, u, wheels, mode._replace(rolls=True))
        if choice is None:
            raise RuntimeError(f"no motion of the contacts is consistent at {state.tolist()}")
        return state, choice

    def _choice(
        self, state: NDArray[np.float64], u: NDArray[np.float64], wheels: list[int], mode: Mode
    ) -> Mode | None:
        """Return the mode in which the forces of those wheels, and of a ball that sticks, are consistent."""
        W, turning = self._rows(state)
        for choice in product((0, 1, -1), repeat=len(wheels)):
            tried = mode
            for wheel, sign in zip(wheels, choice, strict=True):
                tried = tried.with_sign(wheel, sign)
            motion = self._motion(state, u, tried)
            rates = W @ motion.q_ddot + turning
            if all(
                abs(motion.wheels[i]) <= self._held[i]
                if tried.signs[i] == 0
                else tried.signs[i] * rates[i] > 0.0
                for i in wheels
            ) and (tried.rolls or np.hypot(*motion.floor) <= self._rolling_force):
                return tried
        return None

    def _motion(self, state: NDArray[np.float64], u: NDArray[np.float64], mode: Mode) -> Forces:
        q, q_dot = state[:5], state[5:]
        n, law = len(mode.signs), self._friction
        M = self._model.mass_matrix(q)
        W, turning = self._rows(state)
        slides = np.array(mode.signs) != 0
        decay = np.exp(-(np.abs(W @ q_dot / law.stribeck_speed) ** law.stribeck_exponent))
        dry = np.array(law.coulomb) + np.array(law.stribeck) * decay
        forces = np.zeros(n + 2)
        forces[:n] = np.where(slides, dry * mode.signs, 0.0)
        if mode.rolls:
            forces[n:] = -rolling_friction(q_dot[:2], self._rolling_force)
        rows = np.vstack([W, np.eye(5)[:2]])
        q_ddot = self._model.acceleration(q, q_dot, u) - np.linalg.solve(M, rows.T @ forces)
        sticks = np.append(~slides, [not mode.rolls] * 2)
        if sticks.any():
            response = np.linalg.solve(M, rows[sticks].T)
            drift = np.append(turning, [0.0, 0.0])[sticks]
            forces[sticks] = np.linalg.solve(rows[sticks] @ response, rows[sticks] @ q_ddot + drift)
            q_ddot = q_ddot - response @ forces[sticks]
        return Forces(q_ddot, forces[:n], forces[n:])

    def _rows(self, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return W and W_dot q_dot, the latter by a central difference (truncation and rounding near 1e-10)."""
        q, q_dot, step = state[:5], state[5:], 1e-5
        W = self._model.wheel_jacobian(np.stack([q, q + step * q_dot, q - step * q_dot]))
        return W[0], (W[1] - W[2]) @ q_dot / (2 * step)

    def _speeds(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._model.wheel_jacobian(state[:5]) @ state[5:]


def _terminal(event: Callable[..., float]) -> Callable[..., float]:
    """Return the event as one that ends the integration where it falls through zero."""
    event.terminal, event.direction = True, -1.0  # pyright: ignore[reportFunctionMemberAccess]
    return event


STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
SAMPLE_TIME = 0.04  # [s], a whole number of every step

#: the nominal scenario's
FRICTION = nominal_robot().friction


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A start and the torques that follow, held over `SAMPLE_TIME`."""

    start: NDArray[np.float64]  #: (10,)
    torques: NDArray[np.float64]  #: (samples, 3) [N m]


def robot() -> Robot:
    """Return the thesis's robot with the nominal scenario's friction."""
    return Robot.load("alten").replace(friction=FRICTION)


def smooth_cases(rng: np.random.Generator, count: int) -> list[Case]:
    """Return motions in which every wheel turns fast, one way."""
    start = np.array([0, 0, 0.02, -0.03, 0.4, 1.0, 0.3, 0.2, -0.1, 6.0])
    spread = np.array([0, 0, 0.02, 0.02, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5])
    torques = np.tile([0.4, -0.3, 0.5], (4, 1))
    return [Case(start=start + spread * rng.uniform(-1, 1, 10), torques=torques) for _ in range(count)]


def reversing_cases(rng: np.random.Generator, count: int) -> list[Case]:
    """Return motions in which strong torques turn every wheel about: through zero without sticking."""
    start = np.array([0, 0, 0.0, 0.0, 0.0, 0.3, 0.2, 0.0, 0.0, 1.5])
    spread = np.array([0, 0, 0.02, 0.02, 1.0, 0.1, 0.1, 0.1, 0.1, 0.5])
    torques = np.tile([-1.6, -1.5, -1.7], (8, 1))
    return [Case(start=start + spread * rng.uniform(-1, 1, 10), torques=torques) for _ in range(count)]


def sticking_cases(rng: np.random.Generator, count: int) -> list[Case]:
    """Return motions under swinging torques, in which wheels stick for a while and break away."""
    k = np.arange(10)
    torques = np.stack([0.2 * np.sin(0.9 * k), 0.2 * np.cos(0.8 * k), np.full(10, -0.1)], axis=1)
    start = np.array([0, 0, 0.01, 0.005, 0.0, 0.07, -0.05, 0, 0, 0.0])
    spread = np.array([0, 0, 0.005, 0.005, 1.0, 0.02, 0.02, 0.02, 0.02, 0.1])
    return [Case(start=start + spread * rng.uniform(-1, 1, 10), torques=torques) for _ in range(count)]


def errors(cases: list[Case], references: list[Followed], steps: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the root mean square over cases of the largest error among the ten states, for each step."""
    table = np.empty((len(steps), len(cases)))
    for row, step in enumerate(steps):
        model = Model(robot(), step=step)
        for column, (case, known) in enumerate(zip(cases, references, strict=True)):
            state = case.start
            for u in case.torques:
                state = model.advance(state, u, SAMPLE_TIME)
            table[row, column] = np.abs(state - known.state).max()
    return np.sqrt(np.mean(table**2, axis=1))


def follow(cases: list[Case]) -> list[Followed]:
    """Return the event-driven references."""
    reference = EventDriven(robot())
    return [reference.follow(case.start, case.torques, SAMPLE_TIME) for case in cases]


def observed_order(steps: tuple[float, ...], values: NDArray[np.float64]) -> float:
    """Return the slope of log error over log step, by least squares."""
    return float(np.polyfit(np.log(steps), np.log(values), 1)[0])


def changes(known: Followed) -> int:
    """Return how often the mode of the contacts changes."""
    return sum(a.mode != b.mode for a, b in zip(known.phases, known.phases[1:], strict=False))


def sticks(known: Followed) -> bool:
    """Return whether a wheel sticks at some time."""
    return any(0 in phase.mode.signs for phase in known.phases)


def campaign() -> Section:
    """Return errors and orders of the three kinds of motion."""
    rng = np.random.default_rng(51)
    kinds = {"smooth": smooth_cases, "reversing": reversing_cases, "stick-slip": sticking_cases}
    columns, orders, all_errors = ["step"], [], []
    for name, make in kinds.items():
        cases = make(rng, 20)
        known = follow(cases)
        sizes = errors(cases, known, STEPS)
        # below 1e-12 the smooth motion's error is rounding, and the reference's
        kept = sizes > 1e-12
        orders.append(observed_order(tuple(np.array(STEPS)[kept]), sizes[kept]))
        all_errors.append(sizes)
        columns.append(f"{name} ({np.mean([changes(case) for case in known]):.1f} changes)")
    rows = [[f"{1e3 * step:g} ms", *(f"{e[i]:.1e}" for e in all_errors)] for i, step in enumerate(STEPS)]
    rows.append(["**order**", *(f"**{order:.2f}**" for order in orders)])
    return Section(
        title="Order of the whole method",
        before="Error of the engine (RK4 with known signs, the convex step where a sign may change) against an "
        "event-driven reference (DOP853 at 1e-12 from event to event, `campaigns/convergence.py`): largest of the "
        "ten states at the end of 0.16 s, 0.32 s and 0.4 s, root mean square over 20 motions of the nominal scenario "
        "each. In brackets, how often a wheel reverses, sticks or breaks away in a motion.",
        columns=columns,
        rows=rows,
        after="If no sign changes, the method has RK4's order four. A step in which a wheel reverses or sticks has "
        "order two: the convex step is taken twice, the second time with the forces half way and the friction of a "
        "wheel that turns about changed at the instant at which it stops.",
    )
