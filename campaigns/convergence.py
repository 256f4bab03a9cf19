"""The order of the whole method: its error against the event-driven reference as the step shrinks.

.venv/bin/python -m campaigns.evidence convergence
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot import Model, Robot
from benchmarks.workloads import nominal_robot
from campaigns.event_driven import EventDriven, Followed
from campaigns.section import Section

STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
SAMPLE_TIME = 0.04  # [s], a whole number of every step

#: the nominal scenario's (design.md section 11)
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
    """Return how often what the wheels do changes."""
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
        found = errors(cases, known, STEPS)
        # below 1e-12 the smooth motion's error is rounding, and the reference's
        kept = found > 1e-12
        orders.append(observed_order(tuple(np.array(STEPS)[kept]), found[kept]))
        all_errors.append(found)
        columns.append(f"{name} ({np.mean([changes(one) for one in known]):.1f} changes)")
    rows = [[f"{1e3 * step:g} ms", *(f"{e[i]:.1e}" for e in all_errors)] for i, step in enumerate(STEPS)]
    rows.append(["**order**", *(f"**{order:.2f}**" for order in orders)])
    return Section(
        title="Order of the whole method",
        before="Error of the engine (RK4 with known signs, the convex step where a sign may change) against an "
        "event-driven reference (DOP853 at 1e-12 from event to event, `campaigns/event_driven.py`): largest of the "
        "ten states at the end of 0.16 s, 0.32 s and 0.4 s, root mean square over 20 motions of the nominal scenario "
        "each. In brackets, how often a motion's wheels start to slide the other way, stick or break away.",
        columns=columns,
        rows=rows,
        after="Where no sign changes the method has RK4's order four. A step in which a wheel turns about or sticks "
        "takes the friction of its end for the whole step, which errs by h, and so does the motion.",
    )
