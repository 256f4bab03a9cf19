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
        raise InputError(
            f"The scenario has {len(scenario.pushes)} pushes; it can have at most {_MOST_PUSHES}."
        )
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
                f"The scenario {scenario.name!r} has friction for {len(part)} "
                f"wheels, but the robot {robot.name!r} has {robot.wheel_count}."
            )
    if scenario.driveline_laws and len(scenario.driveline_laws) != robot.wheel_count:
        raise InputError(
            f"The scenario {scenario.name!r} has {len(scenario.driveline_laws)} driveline "
            f"laws, but the robot {robot.name!r} has {robot.wheel_count} wheels."
        )
    if rollers.rows not in (1, 2):
        raise InputError(f"The twin's wheels must have one or two rows of rollers, not {rollers.rows}.")
    widest = 2.0 * (robot.ball.radius + rollers.radius)
    if (rollers.rows - 1) * rollers.row_spacing >= widest:
        raise InputError(
            f"Rows of rollers {rollers.row_spacing:g} m apart do not "
            f"touch the ball; row_spacing must be below {widest:.3g} m."
        )
    if not 0 < rollers.radius < robot.wheels.radius:
        raise InputError(
            f"The radius of the rollers is {rollers.radius} m; it must "
            f"be above 0 and below the wheel's {robot.wheels.radius} m."
        )


def _check_shares(scenario: Scenario) -> None:
    if abs(scenario.asymmetry) >= 1:
        raise InputError(f"asymmetry is {scenario.asymmetry:g}; it must be between -1 and 1.")
    load = scenario.load_dependence
    if load and load.share > 1:
        raise InputError(f"load_dependence.share is {load.share:g}; it must be between 0 and 1.")
    if max(map(abs, scenario.floor_tilt)) > _STEEPEST_FLOOR:
        raise InputError(
            f"floor_tilt is {list(scenario.floor_tilt)} rad; each must be within "
            f"{_STEEPEST_FLOOR} rad, because no robot balances on a steeper floor."
        )
    laws = scenario.driveline_laws
    if laws and (scenario.asymmetry or load):
        raise InputError(
            "asymmetry and load_dependence need the classical friction; remove them or driveline_laws."
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
            f"The sample time {sample_time} s must be a whole multiple of the twin's timestep, {step} s."
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
            f"timing.jitter is {timing.jitter:g} s; it must be "
            f"below half a sample time, {sample_time / 2:g} s."
        )
