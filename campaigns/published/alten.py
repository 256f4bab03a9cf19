"""The thesis's robot ("alten"): printed geometry, poles, gains and tracking, and what each approximation does to them.

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
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import LinearModel, Model
from ballbot.mechanics.parameters import Formulation
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.robot import Friction, Robot
from campaigns.published.printed import (
    PERIOD,
    SETTLED,
    SIDE,
    mixture_model,
    track,
    unstable_poles,
)
from campaigns.reproduce import markdown_table
from tests.support.lagrangian import Corrections

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
    """Return the gain with the nominal scenario's weights, sampled."""
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


def mixture_outcomes(robot: Robot, *, progress: ProgressCallback = ignore_progress) -> dict[Mixture, Outcome]:
    """Return what each of the sixteen mixtures leads to; half a minute, to derive them.

    Parameters
    ----------
    robot : Robot
        Without friction.
    progress : callable, optional
        Called with the progress.
    """
    chosen, models = mixtures(), []
    for mixture in chosen:
        models.append(mixture_model(robot, corrections_with(mixture)))
        progress(Progress(stage="the thesis's mixtures", done=len(models), total=len(chosen)))
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


#: (V.2) T_owb and (V.3) its inverse, as printed
PRINTED_T_OWB = ((-1.2346, 0.0, 1.2346), (0.6173, -1.0692, 1.2346), (0.6173, 1.0692, 1.2346))
PRINTED_T_OBW = ((-0.5400, 0.2700, 0.2700), (0.0, -0.4676, 0.4676), (0.2700, 0.2700, 0.2700))

_FORMULATIONS: tuple[Formulation, ...] = ("thesis", "exact")
#: entries of A and B that determine the linear model of a symmetric robot with three wheels
_ENTRIES = (
    ("theta_dd/theta [1/s^2]", "A", 7, 2),
    ("y_dd/theta [m/s^2/rad]", "A", 6, 2),
    ("theta_dd/u1 [1/(kg m^2)]", "B", 7, 0),
    ("y_dd/u1 [1/(kg m)]", "B", 6, 0),
    ("psi_dd/u1 [1/(kg m^2)]", "B", 9, 0),
)


def section(robot: Robot, *, progress: ProgressCallback = ignore_progress) -> str:
    """Return the source's part of the page, computed; some tens of seconds, most of them to derive the mixtures."""
    frictionless = robot.replace(friction=Friction.none(robot.wheel_count))
    found = mixture_outcomes(frictionless, progress=progress)
    return "\n".join([_model_part(frictionless), _blame_part(frictionless, found)])


def _model_part(robot: Robot) -> str:
    """Return what the source does and what becomes of its linear model, of the robot without friction."""
    body, ball, wheels = robot.body, robot.ball, robot.wheels
    heading = np.divide(*(Model(robot, name).linearize().B[9, 0] for name in _FORMULATIONS))
    thesis_pole, exact_pole = (unstable_poles(Model(robot, name).linearize())[0] for name in _FORMULATIONS)
    return f"""\
## The thesis (ALTEN's ball-balancing robot)

Source: the thesis, Appendices II, III and V; preset `alten`, formulation "thesis" (Appendix II with its misprints
mended and its physics as printed) beside "exact". It prints no poles and no gains; the geometry that it prints comes
out: (V.2) and (V.3) to {geometry_difference(robot):.1g}, less than half of a last digit.

**What it does.** It makes {len(APPROXIMATIONS)} approximations, of which {len(AT_REST)} act upright and at rest. The
body's inertia, {body.inertia[0]:.2f} kg m^2, was measured about the ball's centre and v_body moves the mass again, so
that m_r l^2 = {body.mass * body.center_of_mass**2:.3f} kg m^2 counts twice. The locked wheels, in the body's inertia
already, turn again with the wheels. Rotors and gears are left out. And the motors' counter-torque is missing, which
makes the body's torque (r_b + r_w)/r_b = {1.0 + wheels.radius / ball.radius:.3f} times too large.

**How it is switched on.** `Model(robot, formulation="thesis")`; any mixture by
`tests.support.lagrangian.equations(robot, Corrections(...))`.

{_model_table(robot)}

The printed model falls with {thesis_pole:.3f} rad/s where the robot falls with {exact_pole:.3f}, that is
{exact_pole / thesis_pole:.2f} times too slowly. Its torques turn the heading {heading:.2f} times too fast.
"""


def _blame_part(robot: Robot, found: Mapping[Mixture, Outcome]) -> str:
    """Return which approximation causes how much, of the robot without friction."""
    return f"""\
### Which approximation causes how much

{_share_table(robot, found)}

A share is what the correction changes, averaged over all orders of making the corrections, so that the shares add up to
the difference. The gain is the first wheel's, of an LQR with the nominal scenario's weights, sampled at
{1e3 * robot.sensors.sample_time:g} ms. It is tried on the exact model without friction, twice around a square of
{SIDE:g} m by steps, {PERIOD / 4:g} s a corner: "left" is the root mean square distance from the corner over its last
{SETTLED:g} s.
"""


def geometry_difference(robot: Robot) -> float:
    """Return the largest difference of our T_owb and its inverse from (V.2) and (V.3)."""
    T = transforms(robot)
    pairs = ((T.T_owb, PRINTED_T_OWB), (T.T_obw, PRINTED_T_OBW))
    return max(float(np.abs(ours - np.array(printed)).max()) for ours, printed in pairs)


def _model_table(robot: Robot) -> str:
    models = {name: Model(robot, name).linearize() for name in _FORMULATIONS}
    rows = []
    for label, matrix, row, column in _ENTRIES:
        thesis, exact = (getattr(model, matrix)[row, column] for model in models.values())
        rows.append([label, f"{thesis:.4f}", f"{exact:.4f}", f"{thesis / exact:.3f}"])
    poles = [unstable_poles(model)[0] for model in models.values()]
    rows.append(
        ["unstable pole, twice [rad/s]", *(f"{pole:.4f}" for pole in poles), f"{poles[0] / poles[1]:.3f}"]
    )
    return markdown_table(["", "thesis", "exact", "thesis/exact"], rows)


def _share_table(robot: Robot, found: Mapping[Mixture, Outcome]) -> str:
    columns: Mapping[str, Callable[[Outcome], float]] = {
        "pole [rad/s]": lambda outcome: outcome.pole,
        "gain on theta": lambda outcome: outcome.lean_gain,
        "gain on theta_dot": lambda outcome: outcome.lean_rate_gain,
        "left [mm]": lambda outcome: 1e3 * outcome.settled_error,
        "largest lean [deg]": lambda outcome: float(np.degrees(outcome.peak_lean)),
    }
    none, corrected = found[min(found, key=len)], found[max(found, key=len)]
    exact = outcomes(robot, [Model(robot).linearize()])[0]
    blame = [shares({mixture: take(one) for mixture, one in found.items()}) for take in columns.values()]
    rows = [["**thesis**", *(f"{take(none):.4f}" for take in columns.values())]]
    rows += [[APPROXIMATIONS[name], *(f"{column[name]:+.4f}" for column in blame)] for name in blame[0]]
    last = [take(exact) - take(corrected) for take in columns.values()]
    rows.append(["the others, which act in motion only", *(f"{_unsigned_zero(step):+.4f}" for step in last)])
    rows.append(["**exact**", *(f"{take(exact):.4f}" for take in columns.values())])
    return markdown_table(["", *columns], rows)


def _unsigned_zero(value: float) -> float:
    return 0.0 if abs(value) < 5e-5 else value
