"""Ballbot: model, identify, validate and control ball-balancing robots.

The names and packages below are loaded when first used, so that ``import ballbot`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from ballbot.registry import LOADERS

if TYPE_CHECKING:
    from ballbot.control.controller import Controller as Controller
    from ballbot.control.lqr import lqr as lqr
    from ballbot.control.margins import loop_margins as loop_margins
    from ballbot.errors import InputError as InputError
    from ballbot.firmware.export import export as export
    from ballbot.identification import identify as identify
    from ballbot.learning.learn import learn as learn
    from ballbot.log import Log as Log
    from ballbot.mechanics.model import Model as Model
    from ballbot.robot import Robot as Robot
    from ballbot.robot.friction_law import LawParameter as LawParameter
    from ballbot.robot.friction_law import register_friction_law as register_friction_law
    from ballbot.simulation.batch import simulate_batch as simulate_batch
    from ballbot.twin.run import simulate as simulate
    from ballbot.twin.twin import Twin as Twin
    from ballbot.validation import validate as validate
    from ballbot.workflows.league import compare as compare
    from ballbot.workflows.plan import plan as plan
    from ballbot.workflows.record import record as record
    from ballbot.workflows.study import study as study

__version__ = "0.1.0"

_HOME = {
    "Controller": "ballbot.control.controller",
    "InputError": "ballbot.errors",
    "LawParameter": "ballbot.robot.friction_law",
    "Log": "ballbot.log",
    "Model": "ballbot.mechanics.model",
    "Robot": "ballbot.robot",
    "Twin": "ballbot.twin.twin",
    "compare": "ballbot.workflows.league",
    "export": "ballbot.firmware.export",
    "identify": "ballbot.identification",
    "lqr": "ballbot.control.lqr",
    "learn": "ballbot.learning.learn",
    "loop_margins": "ballbot.control.margins",
    "plan": "ballbot.workflows.plan",
    "record": "ballbot.workflows.record",
    "register_friction_law": "ballbot.robot.friction_law",
    "simulate": "ballbot.twin.run",
    "simulate_batch": "ballbot.simulation.batch",
    "study": "ballbot.workflows.study",
    "validate": "ballbot.validation",
}

_PACKAGES = (
    "robot", "mechanics", "log", "estimation", "control", "simulation", "twin", "fitting",
    "identification", "validation", "vision", "workflows", "learning", "firmware", "link", "viewer", "report",
)  # fmt: skip

LOADERS.append(lambda: import_module("ballbot.report.plots"))

__all__ = ["__version__", *sorted(_HOME)]


def __getattr__(name: str) -> object:
    if name in _PACKAGES:
        return import_module(f"ballbot.{name}")
    if name not in _HOME:
        from ballbot.errors import nearest

        near = nearest(name, [*_HOME, *_PACKAGES])
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise AttributeError(f"Module 'ballbot' has no attribute {name!r}.{hint}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, *_PACKAGES])
