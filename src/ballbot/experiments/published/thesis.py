"""The thesis's robot ("alten"): what its approximations do to poles, gains and tracking, each by its share.

The six corrections between the formulations "thesis" and "exact" can be made in any mixture (`Corrections`). Two of
them change nothing upright and at rest; the sixteen mixtures of the other four are all computed. Each correction's
share in a difference is its effect averaged over all orders in which the corrections can be made (Shapley's value), so
that the shares add up to the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from math import factorial

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.lqr import LqrDesign, lqr
from ballbot.control.presets import NOMINAL_STATE_WEIGHTS, NOMINAL_TORQUE_WEIGHT
from ballbot.experiments.published.linear import mixture_model, unstable_poles
from ballbot.experiments.published.tracking import track
from ballbot.mechanics.model import LinearModel, Model
from ballbot.mechanics.symbolic import Corrections, equations
from ballbot.robot import Robot

#: each correction, by its name in `Corrections`, as the page calls what it mends
APPROXIMATIONS: Mapping[str, str] = {
    "inertia_about_center_of_mass": "m_r l^2 counted twice (II.22, II.25), item 5",
    "locked_wheels_once": "locked wheels counted twice (II.27)",
    "reflected_rotors": "rotors and gears left out (II.28), item 7",
    "counter_torque": "the motors' counter-torque missing (II.32), item 6",
    "body_rates": "Euler rates taken for the body's angular velocity (II.24), item 4",
    "nonholonomic_wheels": "the wheels' speeds put into the energies of Lagrange's equation (II.34)",
}
#: the corrections that change anything upright and at rest
AT_REST = tuple(APPROXIMATIONS)[:4]

Mixture = frozenset[str]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one mixture's linear model leads to; its gain is tried on the exact model without friction."""

    pole: float  #: the faster unstable one [rad/s]
    lean_gain: float  #: first wheel's, on theta [N m/rad]
    lean_rate_gain: float  #: first wheel's, on theta_dot [N m s/rad]
    settled_error: float  #: see `tracking.Track` [m]
    peak_lean: float  #: [rad]


def corrections_with(corrected: Iterable[str]) -> Corrections:
    """Return the thesis's equations with the named corrections made and no other."""
    named = set(corrected)
    return Corrections(**{field.name: field.name in named for field in fields(Corrections)})


def mixtures() -> list[Mixture]:
    """Return every mixture of the corrections that matter at rest, none first and all last."""
    return [frozenset(chosen) for size in range(len(AT_REST) + 1) for chosen in combinations(AT_REST, size)]


def nominal_lqr(robot: Robot, model: LinearModel) -> LqrDesign:
    """Return the gain with the nominal scenario's weights, sampled (design section 11)."""
    weights = (NOMINAL_TORQUE_WEIGHT,) * robot.wheel_count
    return lqr(model, NOMINAL_STATE_WEIGHTS, weights, sample_time=robot.sensors.sample_time)


def outcomes(robot: Robot, models: Sequence[LinearModel]) -> list[Outcome]:
    """Return what each of some linear models leads to.

    Parameters
    ----------
    robot : Robot
        Without friction; its exact model is what the gains are tried on.
    models : sequence of LinearModel
        What the gains are designed on.
    """
    designs = [nominal_lqr(robot, model) for model in models]
    tracks = track(Model(robot), [Controller(robot, design.gain) for design in designs])
    return [
        Outcome(
            pole=unstable_poles(model)[0],
            lean_gain=float(design.gain[0, 2]),
            lean_rate_gain=float(design.gain[0, 7]),
            settled_error=tracked.settled_error,
            peak_lean=tracked.peak_lean,
        )
        for model, design, tracked in zip(models, designs, tracks, strict=True)
    ]


def mixture_outcomes(
    robot: Robot, *, progress: Callable[[float], None] | None = None
) -> dict[Mixture, Outcome]:
    """Return what each of the sixteen mixtures leads to; half a minute, to derive them.

    Parameters
    ----------
    robot : Robot
        Without friction.
    progress : callable, optional
        Called with the share that is done, from 0 to 1.
    """
    chosen, models = mixtures(), []
    for mixture in chosen:
        models.append(mixture_model(robot, corrections_with(mixture)))
        if progress:
            progress(len(models) / len(chosen))
    return dict(zip(chosen, outcomes(robot, models), strict=True))


def shares(values: Mapping[Mixture, float]) -> dict[str, float]:
    """Return each correction's share in the difference between all corrections and none; they add up to it.

    Shapley's value: what making the correction changes, averaged over all orders of making them all.

    Parameters
    ----------
    values : mapping of frozenset of str to float
        For every subset of the corrections.
    """
    players = max(values, key=len)
    count = len(players)
    found = dict.fromkeys(sorted(players, key=list(APPROXIMATIONS).index), 0.0)
    for mixture, value in values.items():
        for name in players:
            before = len(mixture - {name})
            weight = factorial(before) * factorial(count - before - 1) / factorial(count)
            found[name] += weight * value if name in mixture else -weight * value
    return found


def change_while_moving(robot: Robot, name: str, *, states: int = 200) -> float:
    """Return by how much accelerations are off where one correction alone is not made, relative, root mean square.

    Over random states: lean U(-0.1, 0.1) rad, any heading, rates U(-1, 1), torques U(-2, 2) N m.
    """
    rng = np.random.default_rng(1)
    lacking = equations(robot, corrections_with(set(APPROXIMATIONS) - {name}))
    exact = equations(robot, "exact")
    off, size = 0.0, 0.0
    for _ in range(states):
        q = rng.uniform([0.0, 0.0, -0.1, -0.1, -np.pi], [0.0, 0.0, 0.1, 0.1, np.pi])
        q_dot, u = rng.uniform(-1.0, 1.0, 5), rng.uniform(-2.0, 2.0, robot.wheel_count)
        right = exact.acceleration(q, q_dot, u)
        off += float(np.sum((lacking.acceleration(q, q_dot, u) - right) ** 2))
        size += float(np.sum(right**2))
    return float(np.sqrt(off / size))
