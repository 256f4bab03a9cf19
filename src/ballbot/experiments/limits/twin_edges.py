"""The same limits on the twin, whose wheels can slip and lift and whose controller sees its sensors only."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from ballbot.control.controller import Controller
from ballbot.control.references import hold
from ballbot.estimation.interface import named_estimator
from ballbot.experiments.limits.limits import Kind, RobotLimits, TwinEdge
from ballbot.experiments.limits.starts import leaning
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario, Twin
from ballbot.twin.scenario import Push

#: a blow on the twin is a force of so long [s], four samples of the nominal scenario
BLOW = 0.02
_AT = 0.5  # when it comes [s]
_AFTER = 3.0  # and how long a robot must stand from then on [s]
_HALVINGS = 5


def twin_edges(
    robot: Robot,
    controller: Controller,
    scenario: Scenario,
    found: RobotLimits,
    *,
    directions: Sequence[int],
    seed: int = 1,
    tell: Callable[[float], None] | None = None,
) -> list[TwinEdge]:
    """Return the twin's limits beside the model's, by halving between none and a tenth more than the model's most.

    Parameters
    ----------
    robot : Robot
    controller : Controller
    scenario : Scenario
        What is true of the twin; it counts as fallen where the model does.
    found : RobotLimits
        The model's.
    directions : sequence of int
        Places among its directions.
    seed : int
        Of every run.
    tell : callable, optional
        Told the share that is done.
    """
    lenient = replace(scenario, fallen_lean=LARGEST_LEAN)
    state = named_estimator(controller.estimator, robot, sample_time=scenario.sensors.sample_time)
    twin = Twin(robot, lenient, estimator=state)
    edges = []
    for done, place in enumerate(directions, start=1):
        direction = float(found.directions[place])

        def leans(size: float, direction: float = direction) -> bool:
            start = leaning(direction, size)
            run = simulate(twin, controller, hold(), duration=_AFTER, initial_state=start, seed=seed)
            return run.ended is None

        def stands(size: float, direction: float = direction) -> bool:
            struck = Twin(robot, replace(lenient, pushes=(_blow(robot, direction, size),)), estimator=state)
            run = simulate(struck, controller, hold(), duration=_AT + _AFTER, seed=seed)
            return run.ended is None

        sizes = {
            "lean": (found.lean.sure.sizes[place], found.lean.most.sizes[place]),
            "blow": (
                found.blow_at_center(found.blow.sure)[place],
                found.blow_at_center(found.blow.most)[place],
            ),
        }
        edges += [
            _edge("lean", direction, *sizes["lean"], leans),
            _edge("blow", direction, *sizes["blow"], stands),
        ]
        if tell:
            tell(done / len(directions))
    return edges


def _edge(
    kind: Kind, direction: float, sure: float, most: float, stands: Callable[[float], bool]
) -> TwinEdge:
    low, high = 0.0, 1.1 * float(most)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(middle) else (low, middle)
    return TwinEdge(kind=kind, direction=direction, sure=float(sure), twin=low, most=float(most))


def _blow(robot: Robot, direction: float, impulse: float) -> Push:
    force = impulse / BLOW
    return Push(
        time=_AT,
        duration=BLOW,
        force=(force * math.cos(direction), force * math.sin(direction), 0.0),
        height=robot.body.center_of_mass,
    )
