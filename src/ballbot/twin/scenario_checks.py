"""Which scenarios can be simulated with a robot, said in one sentence where one cannot."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass

from ballbot.errors import InputError
from ballbot.robot.robot import Robot
from ballbot.simulation.conditions import LONGEST_DELAY
from ballbot.sizes import SHORTEST_SAMPLE, SHORTEST_STEP
from ballbot.twin.scenario import Scenario

#: sizes that may be below zero; all others are zero or more
_SIGNED = ("asymmetry", "floor_tilt", "force", "position", "time", "heading_drift", "seed")

#: sizes that divide, or without which there is nothing
_POSITIVE = (
    "stiffness",
    "frequency",
    "bandwidth",
    "winding_resistance",
    "wavelength",
    "duration",
    "mass",
    "timestep",
    "sample_time",
    "floor_grip",
    "roller_grip",
    "contact_time",
    "fallen_lean",
    "stribeck_speed",
    "stribeck_exponent",
    "per_row",
    "encoder_counts",
    "speed_window",
)

#: sizes that decide how much is computed or kept, and the most that is
_LARGEST = {
    "delay": float(LONGEST_DELAY),  # samples
    "latency": 10.0,
    "speed_window": 10_000.0,
    "per_row": 500.0,
    "sample_time": 1.0,
    "lean_error_time": 1e6,
}
_SMALLEST = {"sample_time": SHORTEST_SAMPLE, "timestep": SHORTEST_STEP}
#: pushes in a run
_MOST_PUSHES = 1000

#: how much of a step the fastest swing that is computed explicitly may take [rad]
_LARGEST_PHASE = 1.0

_STEEPEST_FLOOR = 0.2  # [rad]


def check_scenario(scenario: Scenario, robot: Robot) -> None:
    """Raise `InputError` where the scenario cannot be simulated with that robot."""
    if len(scenario.pushes) > _MOST_PUSHES:
        raise InputError(f"there are {len(scenario.pushes)} pushes; a run has at most {_MOST_PUSHES}.")
    _check_sizes(scenario, "")
    _check_wheels(scenario, robot)
    _check_shares(scenario)
    _check_rates(scenario)


def _check_sizes(value: object, place: str) -> None:
    """Check every number below a dataclass by its field's name."""
    if not is_dataclass(value):
        return
    for field in fields(value):
        content = getattr(value, field.name)
        name = f"{place}{field.name}"
        for one in content if isinstance(content, tuple) else (content,):
            if is_dataclass(one) and field.name != "driveline_laws":  # the laws check themselves
                _check_sizes(one, f"{name}.")
            elif isinstance(one, int | float):
                _check_number(float(one), name, field.name)


def _check_number(value: float, name: str, key: str) -> None:
    if not math.isfinite(value):
        raise InputError(f"{name} is {value}; it must be a finite number.")
    if key in _POSITIVE and value <= 0:
        raise InputError(f"{name} is {value:g}; it must be above zero.")
    if key not in _SIGNED and value < 0:
        raise InputError(f"{name} is {value:g}; it must be zero or more.")
    smallest, largest = _SMALLEST.get(key, -math.inf), _LARGEST.get(key, math.inf)
    if not smallest <= value <= largest:
        bound = f"at least {smallest:g}" if value < smallest else f"at most {largest:g}"
        raise InputError(f"{name} is {value:g}; it must be {bound}.")


def _check_wheels(scenario: Scenario, robot: Robot) -> None:
    friction, rollers = scenario.friction, scenario.rollers
    for part in (friction.viscous, friction.coulomb, friction.stribeck):
        if len(part) != robot.wheel_count:
            raise InputError(
                f"scenario {scenario.name!r} has friction for {len(part)} wheels, "
                f"but robot {robot.name!r} has {robot.wheel_count}."
            )
    if scenario.driveline_laws and len(scenario.driveline_laws) != robot.wheel_count:
        raise InputError(
            f"scenario {scenario.name!r} has {len(scenario.driveline_laws)} driveline laws, "
            f"but robot {robot.name!r} has {robot.wheel_count} wheels."
        )
    if rollers.rows not in (1, 2):
        raise InputError(f"the twin's wheels have one or two rows of rollers, not {rollers.rows}.")
    widest = 2.0 * (robot.ball.radius + rollers.radius)
    if (rollers.rows - 1) * rollers.row_spacing >= widest:
        raise InputError(
            f"rows of rollers {rollers.row_spacing:g} m apart do not touch the ball; row_spacing must be below "
            f"{widest:.3g} m."
        )
    if not 0 < rollers.radius < robot.wheels.radius:
        raise InputError(
            f"a roller's radius must be between 0 and the wheel's {robot.wheels.radius} m, "
            f"not {rollers.radius} m."
        )


def _check_shares(scenario: Scenario) -> None:
    if abs(scenario.asymmetry) >= 1:
        raise InputError(f"asymmetry is {scenario.asymmetry:g}; it must be between -1 and 1.")
    load = scenario.load_dependence
    if load and load.share > 1:
        raise InputError(f"load_dependence.share is {load.share:g}; it must be between 0 and 1.")
    if max(map(abs, scenario.floor_tilt)) > _STEEPEST_FLOOR:
        raise InputError(
            f"floor_tilt is {list(scenario.floor_tilt)} rad; it must be within {_STEEPEST_FLOOR} rad, beyond which "
            "no ballbot stands."
        )
    laws = scenario.driveline_laws
    if laws and (scenario.asymmetry or load):
        raise InputError(
            "asymmetry and load_dependence go with the classical friction, not with driveline_laws."
        )
    if scenario.compliance and scenario.compliance.damping_ratio > 2:
        raise InputError(
            f"compliance.damping_ratio is {scenario.compliance.damping_ratio:g}; it must be between 0 and 2."
        )


def _check_rates(scenario: Scenario) -> None:
    sample_time, step = scenario.sensors.sample_time, scenario.timestep
    steps = sample_time / step
    if steps < 0.5 or abs(steps - round(steps)) > 1e-6 * steps:
        raise InputError(
            f"the sample time {sample_time} s must be a whole number of the twin's timesteps of {step} s."
        )
    compliance = scenario.compliance
    if compliance and 2 * math.pi * compliance.frequency * step > _LARGEST_PHASE / 2:
        # twice the margin: free wheels swing faster than the robot on its ball, on the BBR 1.7 times
        raise InputError(
            f"compliance.frequency is {compliance.frequency:g} Hz, too fast for a timestep of {step:g} s; "
            f"it must be below {_LARGEST_PHASE / (4 * math.pi * step):.3g} Hz, or the timestep shorter."
        )
    timing = scenario.timing
    if timing and timing.jitter >= sample_time / 2:
        raise InputError(
            f"timing.jitter is {timing.jitter:g} s; it must be below half a sample, {sample_time / 2:g} s."
        )
