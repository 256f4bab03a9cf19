"""Whether the twin can simulate a robot, and the nominal controller balance it: what `ballbot record` would refuse."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from ballbot.control.presets import nominal_controller
from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.robot import Robot
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin


def twin_findings(robot: Robot) -> tuple[Finding, ...]:
    """Return what `ballbot record nominal` would refuse of a robot; empty if it records it."""
    findings = []
    refusal = _refusal(lambda: _made(robot))
    if refusal:
        text = f"The twin cannot simulate this robot, so `ballbot record` refuses it: {refusal}"
        findings.append(Finding(code="robot-twin", severity="warning", text=text))
    refusal = _refusal(lambda: nominal_controller(robot))
    if refusal:
        text = f"No nominal controller can be designed for this robot: {refusal}"
        findings.append(Finding(code="robot-balance", severity="error", text=text))
    return tuple(findings)


def _refusal(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except InputError as error:
        return str(error)
    return ""


def _made(robot: Robot) -> object:
    scenario = Scenario.nominal(robot)
    # without MuJoCo, the document is all that can be looked at
    return Twin(robot, scenario) if find_spec("mujoco") else twin_mjcf(robot, scenario)
