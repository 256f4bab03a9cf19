"""Scenario files: TOML that says in what a twin differs from a named scenario.

    base = "nominal"
    backlash = 0.0

    [compliance]
    frequency = 12.0
    damping_ratio = 0.05

What a file leaves out is as in its base, "nominal" where it names none. `compliance = false` switches off what the
base has on. Units are SI. A file written by `write_scenario` says everything that is on, has an example of everything
that is off, and reads back as the same scenario.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import get_args, get_type_hints

from ballbot.errors import InputError
from ballbot.files import read_toml, write_text
from ballbot.printable import toml_string
from ballbot.robot.robot import Robot
from ballbot.schema import validate_table
from ballbot.simulation.sensors import Accelerometer, FixSource, SensorFaults
from ballbot.twin.scenario import (
    LAW_NAMES,
    BristleLaw,
    Compliance,
    CurrentLoop,
    LoadDependence,
    Payload,
    Push,
    Roughness,
    Scenario,
    Softness,
    Supply,
    Timing,
    check_scenario,
)

#: a fault of each kind, of a size that a robot like the thesis's could have
EXAMPLES: dict[str, object] = {
    "load_dependence": LoadDependence(share=0.5),
    "softness": Softness(stiffness=3e4, damping=200.0),
    "compliance": Compliance(frequency=40.0, damping_ratio=0.1),
    "current_loop": CurrentLoop(bandwidth=100.0),
    "supply": Supply(winding_resistance=0.6, internal_resistance=0.15),
    "payload": Payload(mass=1.0, position=(0.05, 0.0, 0.6)),
    "roughness": Roughness(height=0.0005, wavelength=0.1, seed=1),
    "timing": Timing(delay=1, jitter=0.001),
    "pushes": Push(time=5.0, duration=0.1, force=(20.0, 0.0, 0.0), height=0.4),
    "sensor_faults": SensorFaults(gyro_bias=0.001, gyro_bias_walk=1e-5, lean_error=0.003, latency=0.005),
    "accelerometer": Accelerometer(),
    "fix": FixSource(rate=10.0),
}

#: by dotted name; what is in brackets is the unit
MEANINGS: dict[str, str] = {
    "name": "name of the scenario",
    "pivoting": "moment that resists the ball's pivoting on the spot, over the normal force [m]",
    "backlash": "gearbox play at the wheel, from stop to stop [rad]",
    "torque_noise": "standard deviation of each sample's torque [N m]",
    "speed_window": "samples over which encoder counts are differenced into a speed",
    "floor_grip": "friction coefficient of the ball on the floor",
    "roller_grip": "friction coefficient of the rollers on the ball; a small one slips",
    "contact_time": "time constant of the rubber contacts [s]",
    "timestep": "of the physics engine [s]",
    "fallen_lean": "lean at which the run ends [rad]",
    "wheel_contact": '"rollers", or "point": a single contact point under each wheel',
    "floor_tilt": "of the floor about x and y [rad]",
    "asymmetry": "dry friction is (1 + asymmetry) times its size forward, (1 - asymmetry) times backward",
    "friction": "True driveline friction b w + (c + s exp(-|w/v_s|^delta)) sgn(w), and rolling friction N C_rr.",
    "friction.viscous": "b [N m s/rad]",
    "friction.coulomb": "c [N m]",
    "friction.stribeck": "s [N m]",
    "friction.stribeck_speed": "v_s [rad/s]",
    "friction.stribeck_exponent": "delta",
    "friction.rolling": "C_rr",
    "rollers": "The actual rollers of the wheels.",
    "rollers.rows": "1 or 2",
    "rollers.per_row": "rollers in a row",
    "rollers.radius": "[m]",
    "rollers.row_spacing": "between the planes of the two rows [m]",
    "sensors": "The actual errors of the sensors.",
    "sensors.sample_time": "[s]",
    "sensors.encoder_counts": "a motor turn",
    "sensors.gyro_noise": "standard deviation [rad/s]",
    "sensors.attitude_noise": "standard deviation of the lean angles and the heading [rad]",
    "sensors.heading_drift": "[rad/s]",
    "load_dependence": "Dry driveline friction that grows with the force between wheel and ball.",
    "load_dependence.share": "fraction of it that follows the force, 0 to 1",
    "softness": "A ball that deforms under the wheels.",
    "softness.stiffness": "of each contact [N/m]",
    "softness.damping": "[N s/m]",
    "compliance": "Drivelines that twist, with a resonance.",
    "compliance.frequency": "at which motor and balancing robot oscillate against each other [Hz]",
    "compliance.damping_ratio": "of that mode",
    "current_loop": "Motor drivers with a lag.",
    "current_loop.bandwidth": "[Hz]",
    "supply": "A battery and windings in place of a fixed speed limit.",
    "supply.winding_resistance": "of a motor [ohm]",
    "supply.internal_resistance": "of the battery, by which it sags [ohm]",
    "payload": "A payload, which shifts the centre of mass.",
    "payload.mass": "[kg]",
    "payload.position": "of its centre from the ball's centre: forward, left, up [m]",
    "roughness": "A floor with gentle bumps.",
    "roughness.height": "root mean square [m]",
    "roughness.wavelength": "the shortest; the longest is four times this [m]",
    "roughness.seed": "of the floor",
    "timing": "A controller with delay or jitter.",
    "timing.delay": "whole samples by which torques are delayed",
    "timing.jitter": "largest deviation of a sampling instant [s]",
    "pushes": "A push on the body; write the table again for another one.",
    "pushes.time": "start of the push [s]",
    "pushes.duration": "[s]",
    "pushes.force": "in the world's x, y, z [N]",
    "pushes.height": "height of its point of action above the ball's centre [m]",
    "sensor_faults": "Errors of the AHRS besides noise.",
    "sensor_faults.gyro_bias": "standard deviation of each axis at the "
    "start; it makes the heading drift [rad/s]",
    "sensor_faults.gyro_bias_walk": "[rad/s/sqrt(s)]",
    "sensor_faults.lean_error": "standard deviation of a slow error of theta and phi [rad]",
    "sensor_faults.lean_error_time": "correlation time of that error [s]",
    "sensor_faults.latency": "in whole samples [s]",
    "accelerometer": "An accelerometer on the body: acc_x to acc_z in the log.",
    "accelerometer.position": "from the ball's centre: forward, left, up [m]",
    "accelerometer.noise": "standard deviation of each sample [m/s^2]",
    "fix": "An external position sensor, used only by a Kalman filter.",
    "fix.rate": "[Hz]",
    "fix.position": "whether it measures x and y",
    "fix.heading": "whether it measures psi",
    "fix.position_noise": "standard deviation of x and of y [m]",
    "fix.heading_noise": "standard deviation [rad]",
    "fix.missing": "fraction of fixes that are lost",
    "driveline_laws": "Other friction laws, in place of those of the "
    "wheels in [friction]: one table for each wheel.",
}


_HINTS = get_type_hints(Scenario)


def read_scenario(path: str | Path, robot: Robot) -> Scenario:
    """Return the scenario that a TOML file describes, for a robot.

    Raises
    ------
    InputError
        Where the file cannot be read, is no TOML, misspells a key, or describes no scenario of that robot.
    """
    path = Path(path)
    tree = read_toml(path)
    try:
        return scenario_of(tree, robot, default_name=path.stem)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def scenario_of(changes: Mapping[str, object], robot: Robot, *, default_name: str) -> Scenario:
    """Return the scenario that tables as those of a scenario file describe, for a robot.

    Parameters
    ----------
    changes : mapping
        What a scenario file says, as nested dictionaries; empty is `nominal`.
    robot : Robot
    default_name : str
        The scenario's, where the tables name none.

    Raises
    ------
    InputError
        Where they misspell a key or describe no scenario of that robot.
    """
    return _scenario(dict(changes), robot, default_name=default_name)


def _scenario(tree: dict[str, object], robot: Robot, *, default_name: str) -> Scenario:
    base = tree.pop("base", "nominal")
    if not isinstance(base, str):
        raise InputError(f"base is {base!r}; it must be a text in quotes, such as {Scenario.names()[0]!r}.")
    start = Scenario.named(base, robot)
    _refuse_unknown(tree, Scenario, "")
    laws = tree.pop("driveline_laws", None)
    values = _merged(asdict(replace(start, driveline_laws=())), {"name": default_name, **tree})
    scenario = validate_table(Scenario, values, of="a scenario file")
    scenario = replace(scenario, driveline_laws=start.driveline_laws if laws is None else _laws(laws))
    check_scenario(scenario, robot)
    return scenario


def _merged(base: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """Return the base with the changes in it, table by table."""
    merged = dict(base)
    for key, value in changes.items():
        known = merged.get(key)
        if isinstance(known, dict) and isinstance(value, dict):
            merged[key] = _merged(known, value)
        else:
            merged[key] = None if value is False and _may_be_off(key) else value
    return merged


def _may_be_off(key: str) -> bool:
    return NoneType in get_args(_HINTS.get(key))


def _refuse_unknown(tree: Mapping[str, object], kind: type, place: str) -> None:
    """Raise where a table has a key that its dataclass has not."""
    hints = get_type_hints(kind)
    for key, value in tree.items():
        if key not in hints:
            known = [*hints, "base"] if kind is Scenario else list(hints)
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"the keys there are {', '.join(known)}."
            raise InputError(f"{place}{key} is not a key of a scenario file; {hint}")
        below = _table_of(hints[key])
        if below:
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, dict):
                    _refuse_unknown(one, below, f"{place}{key}.")


def _table_of(hint: object) -> type | None:
    """Return the dataclass that a field's type is or holds, but for the laws, which there are several of."""
    if isinstance(hint, type) and is_dataclass(hint):
        return hint
    found = [one for one in map(_table_of, get_args(hint)) if one]
    return found[0] if len(found) == 1 else None


def _laws(tables: object) -> tuple[BristleLaw, ...]:
    if not (isinstance(tables, list) and all(isinstance(table, dict) for table in tables)):
        raise InputError(
            "driveline_laws must be tables: write [[driveline_laws]] above the keys of each wheel."
        )
    return tuple(_law(dict(table)) for table in tables)


def _law(table: dict[str, object]) -> BristleLaw:
    name = table.pop("law", None)
    if not (isinstance(name, str) and name in LAW_NAMES):
        raise InputError(f"driveline_laws.law is {name!r}; it must be one of {', '.join(LAW_NAMES)}.")
    kind = LAW_NAMES[name]
    known = [field.name for field in fields(kind)]
    for key in table:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(known)}."
            raise InputError(f"driveline_laws.{key} is not a parameter of the law {name!r}; {hint}")
    return validate_table(kind, table, of=f"the law {name!r}")


_HEADER = (
    "# A scenario for Ballbot's twin: the robot's true properties, unknown to the "
    "identification. Units are SI.\n# Record with it: ballbot record FILE --out "
    "DIR. A key that a file omits has the value of its base. What is off is\n# "
    "commented out; remove the # at the beginning of its lines to switch it on.\n"
)


def write_scenario(scenario: Scenario, path: str | Path) -> None:
    """Write a scenario as a TOML file that reads back as the same one.

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    write_text(path, scenario_text(scenario))


def scenario_text(scenario: Scenario) -> str:
    """Return the text that `write_scenario` writes."""
    tables: list[str] = []
    lines = [_HEADER, 'base = "nominal"']
    for field in fields(scenario):
        name, value = field.name, getattr(scenario, field.name)
        if name == "driveline_laws":
            tables += [line for law in value for line in _law_lines(law)]
        elif is_dataclass(value):
            tables += ["", *_comment(name, ""), f"[{name}]", *_lines(value, f"{name}.")]
        elif name == "pushes" and value:
            for push in value:
                tables += ["", *_comment(name, ""), f"[[{name}]]", *_lines(push, f"{name}.")]
        elif value is None or name == "pushes":
            tables += _switched_off(name)
        else:
            lines.append(_line(name, value, name))
    return "\n".join([*lines, *tables]) + "\n"


def _lines(table: object, place: str) -> Iterator[str]:
    assert is_dataclass(table)
    for field in fields(table):
        value = getattr(table, field.name)
        if value is not None:
            yield _line(field.name, value, place + field.name)


def _line(key: str, value: object, name: str) -> str:
    comment = "".join(_comment(name, "  "))
    return f"{key} = {_toml(value)}{comment}"


def _comment(name: str, space: str) -> list[str]:
    return [f"{space}# {MEANINGS[name]}"] if name in MEANINGS else []


def _law_lines(law: object) -> Iterator[str]:
    name = next(name for name, kind in LAW_NAMES.items() if isinstance(law, kind))
    yield from ("", *_comment("driveline_laws", ""), "[[driveline_laws]]", f'law = "{name}"')
    yield from _lines(law, "driveline_laws.")


def _switched_off(name: str) -> list[str]:
    if name not in EXAMPLES:
        return []
    heading = f"[[{name}]]" if name == "pushes" else f"[{name}]"
    lines = [heading, *_lines(EXAMPLES[name], f"{name}.")]
    return ["", f"# Off: {MEANINGS[name]}", *(f"# {line}" for line in lines)]


def _toml(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(one) for one in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return toml_string(value)
    return repr(value)
