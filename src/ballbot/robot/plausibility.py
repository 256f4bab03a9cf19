"""Whether a robot's numbers go together: sizes, masses, inertias, motors and rates against one another.

`ballbot.robot.checks` refuses impossible robots. These checks find possible but improbable ones, each a finding: an
error where a result would be meaningless (a body of 17 g with 4.37 kg m^2), a warning where the value is unusual. The
ranges are wide: the presets, published robots of 0.6 to 52 kg, lie well within them. A slip of units is searched for
among the parameters of each error, and named if it explains the error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from ballbot.errors import every
from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.robot.components import BY_NAME, PARAMETERS
from ballbot.robot.derived import encoder_step, reflected_rotor_inertia, wheel_speed_limit
from ballbot.robot.parameters import value_of
from ballbot.robot.robot import Robot
from ballbot.robot.variations import likeliest_slip, with_unit

Range = tuple[float, float]

#: [m/s^2], from the equator to the poles with a margin
_GRAVITY_ON_EARTH: Range = (9.7, 9.9)
#: a body of rods and plates rocks about its centre of mass like a mass at this fraction of l from it
_GYRATION_USUAL, _GYRATION_POSSIBLE = (0.15, 1.2), (0.04, 2.5)


def robot_findings(robot: Robot) -> tuple[Finding, ...]:
    """Return the unusual and impossible values of a robot as findings, errors first.

    Parameters
    ----------
    robot : Robot
        One that `ballbot.robot.checks` has passed.

    Returns
    -------
    tuple of Finding
        The place's columns name the parameters.
    """
    findings = list(_findings(robot))
    errors = [one for one in findings if one.severity == "error"]
    slip = likeliest_slip(robot, errors, _findings) if errors else None

    def with_remedy(finding: Finding) -> Finding:
        if finding.severity != "error":
            return finding
        meant = f"Did you mean {slip.words}?" if slip and slip.mends(finding) else ""
        return replace(finding, text=f"{finding.text} {meant or f'Check {every(finding.where.columns)}.'}")

    return by_severity(map(with_remedy, findings))


def named_robot_findings(robot: Robot) -> tuple[Finding, ...]:
    """Return `robot_findings` with the robot's name as their place, for messages that are about files as well."""
    name = f"robot {robot.name}"
    return tuple(replace(one, where=replace(one.where, file=name)) for one in robot_findings(robot))


def _findings(robot: Robot) -> Iterator[Finding]:
    yield from chain(
        _of_gravity(robot),
        _of_ball(robot),
        _of_body(robot),
        _of_moments(robot),
        _of_wheel_places(robot),
        _of_rollers(robot),
        _of_wheel_inertia(robot),
        _of_gear(robot),
        _of_motor(robot),
        _of_balance(robot),
        _of_sensors(robot),
        _of_friction(robot),
        _of_deviations(robot),
    )


def _within(
    code: str, names: tuple[str, ...], text: str, value: float, *, usual: Range, possible: Range
) -> Iterator[Finding]:
    """Yield an error if a value is outside the possible range, a warning if it is outside the usual one."""
    if usual[0] <= value <= usual[1]:
        return
    severity: Severity = "warning" if possible[0] <= value <= possible[1] else "error"
    yield Finding(code=code, severity=severity, text=text, where=Place(columns=names))


def _said(robot: Robot, *names: str) -> str:
    """Return "body.mass 17.1 kg and wheels.radius 0.063 m"."""
    return every([f"{name} {with_unit(BY_NAME[name], value_of(robot, BY_NAME[name]))}" for name in names])


def _usual(name: str) -> str:
    """Return the usual values of a parameter: "0.1 to 3"."""
    least, most = BY_NAME[name].usual
    return f"{least:g} to {most:g}"


def _of_gravity(robot: Robot) -> Iterator[Finding]:
    text = f"gravity is {robot.gravity:g} m/s^2; on Earth it is 9.78 to 9.83."
    yield from _within(
        "robot-gravity",
        ("gravity",),
        text,
        robot.gravity,
        usual=_GRAVITY_ON_EARTH,
        possible=(1.5, 26.0),  # from the Moon to Jupiter
    )


def _of_ball(robot: Robot) -> Iterator[Finding]:
    ball = robot.ball
    density = ball.mass / (4.0 / 3.0 * math.pi * ball.radius**3)
    names = ("ball.radius", "ball.mass")
    yield from _within(
        "robot-ball",
        names,
        f"{_said(robot, *names)} give the ball a mean density of {density:.3g} kg/m^3; "
        "a basketball has 84, a bowling ball 1300.",
        density,
        usual=(30.0, 2500.0),
        possible=(5.0, 9000.0),  # an inflated film; solid steel
    )
    yield from _within(
        "robot-ball",
        ("ball.radius",),
        f"{_said(robot, 'ball.radius')} is unusual; balls of ballbots measure 0.05 to 0.3 m.",
        ball.radius,
        usual=(0.03, 0.5),
        possible=(0.01, 1.0),
    )
    yield from _within(
        "robot-ball",
        ("ball.mass", "body.mass"),
        f"{_said(robot, 'body.mass', 'ball.mass')}: the body weighs {robot.body.mass / ball.mass:.3g} times the ball.",
        robot.body.mass / ball.mass,
        usual=(0.7, 100.0),
        possible=(0.1, 1000.0),
    )


def _of_body(robot: Robot) -> Iterator[Finding]:
    body, radius = robot.body, robot.ball.radius
    names = ("body.center_of_mass", "ball.radius")
    height = body.center_of_mass / radius
    if height <= 1.0:
        text = (
            f"{_said(robot, *names)}: the body's centre of mass would lie inside the ball, and l counts from the "
            "ball's centre."
        )
    else:
        text = (
            f"{_said(robot, *names)}: the body's centre of mass would lie {height:.3g} ball radii above the ball's "
            "centre."
        )
    yield from _within("robot-body", names, text, height, usual=(1.2, 10.0), possible=(1.0, 25.0))
    names = ("body.mass", "body.center_of_mass", "body.inertia.xx", "body.inertia.yy")
    for axis, moment in zip("xy", np.diag(body.inertia_about_center_of_mass())[:2], strict=True):
        gyration = math.sqrt(max(float(moment), 0.0) / body.mass)
        fraction = gyration / body.center_of_mass
        text = (
            f"body.inertia about the centre of mass, {float(moment):.3g} kg m^2 about {axis}, and "
            f"{_said(robot, 'body.mass', 'body.center_of_mass')} do not go together: the radius of gyration is "
            f"{gyration:.3g} m, {fraction:.2g} of that height, where robots have 0.3 to 0.9."
        )
        found = list(
            _within("robot-body", names, text, fraction, usual=_GYRATION_USUAL, possible=_GYRATION_POSSIBLE)
        )
        if found:
            yield from found
            return


def _of_moments(robot: Robot) -> Iterator[Finding]:
    body = robot.body
    central = body.inertia_about_center_of_mass()
    xx, yy, zz = (float(one) for one in np.diag(central))
    ratio = math.sqrt(zz / body.mass) / robot.ball.radius
    yield from _within(
        "robot-body",
        ("body.inertia.zz", "body.mass", "ball.radius"),
        f"{_said(robot, 'body.inertia.zz', 'body.mass')}: the body's mass would lie {ratio:.2g} ball radii from its "
        "vertical axis, where robots have 0.6 to 1.",
        ratio,
        usual=(0.2, 4.0),
        possible=(0.05, 12.0),
    )
    yield from _within(
        "robot-body",
        ("body.inertia.xx", "body.inertia.yy"),
        f"The body's inertias about the centre of mass about x and y, {xx:.3g} and {yy:.3g} kg m^2, differ "
        f"{max(xx, yy) / min(xx, yy):.3g} times; check whether xx, yy and zz are in their order.",
        max(xx, yy) / min(xx, yy),
        usual=(1.0, 3.0),
        possible=(1.0, 40.0),
    )
    products = np.abs(central - np.diag(np.diag(central))) / np.sqrt(np.outer([xx, yy, zz], [xx, yy, zz]))
    if products.max() > 0.5:
        names = ("body.inertia.xy", "body.inertia.xz", "body.inertia.yz")
        text = (
            f"A product of inertia is {products.max():.2g} of the largest that the moments allow; a robot that "
            "stands upright has small ones."
        )
        yield Finding(code="robot-body", severity="warning", text=text, where=Place(columns=names))


def _of_wheel_places(robot: Robot) -> Iterator[Finding]:
    wheels, ball = robot.wheels, robot.ball
    names = ("wheels.radius", "ball.radius")
    yield from _within(
        "robot-wheels",
        names,
        f"{_said(robot, *names)}: the wheels' radius is {wheels.radius / ball.radius:.3g} of the ball's, where robots "
        "have 0.3 to 0.6.",
        wheels.radius / ball.radius,
        usual=(0.15, 0.9),
        possible=(0.03, 1.5),
    )
    tilt = math.degrees(wheels.tilt)
    yield from _within(
        "robot-wheels",
        ("wheels.tilt",),
        f"wheels.tilt is {tilt:.3g} deg ({wheels.tilt:.3g} rad) from the ball's zenith; robots have 40 to 55 deg.",
        tilt,
        usual=(25.0, 65.0),
        possible=(10.0, 80.0),
    )
    azimuths = np.sort(np.mod(wheels.azimuths, 2.0 * math.pi))
    gaps = np.diff(np.append(azimuths, azimuths[0] + 2.0 * math.pi))
    least = math.degrees(float(gaps.min()))
    even = 360.0 / robot.wheel_count
    yield from _within(
        "robot-wheels",
        ("wheels.azimuths",),
        f"{_said(robot, 'wheels.azimuths')}: two wheels are {least:.3g} deg apart, where {robot.wheel_count} wheels "
        f"placed evenly are {even:g} deg apart.",
        least / even,
        usual=(0.6, 1.01),
        possible=(0.25, 1.01),
    )
    room = (ball.radius + wheels.radius) * math.sin(wheels.tilt) * math.tan(0.5 * min(float(gaps.min()), 3.0))
    if wheels.radius >= room:
        names = ("wheels.radius", "wheels.tilt", "wheels.azimuths", "ball.radius")
        text = (
            f"{_said(robot, 'wheels.radius', 'wheels.tilt')}: neighbouring wheels would cut into each other; on this "
            f"ball their radius must be below {room:.3g} m."
        )
        yield Finding(code="robot-wheels", severity="error", text=text, where=Place(columns=names))


def _of_rollers(robot: Robot) -> Iterator[Finding]:
    wheels, rollers = robot.wheels, robot.wheels.rollers
    for name, size, most in (
        ("wheels.rollers.radius", rollers.radius, 0.35),
        ("wheels.rollers.row_spacing", rollers.row_spacing, 1.0),
    ):
        text = (
            f"{_said(robot, name, 'wheels.radius')}: robots have {'0.1 to 0.2' if most < 1.0 else '0 to 0.5'} of the "
            "wheel's radius."
        )
        yield from _within(
            "robot-wheels",
            (name, "wheels.radius"),
            text,
            size / wheels.radius,
            usual=(0.0, most),
            possible=(0.0, 1.5 * most),
        )
    per_row = rollers.per_row
    yield from _within(
        "robot-wheels",
        ("wheels.rollers.per_row",),
        f"wheels.rollers.per_row is {per_row}; omni-wheels have 5 to 20 rollers in a ring.",
        float(per_row),
        usual=(4.0, 60.0),
        possible=(3.0, 1000.0),
    )


def _of_wheel_inertia(robot: Robot) -> Iterator[Finding]:
    wheels = robot.wheels
    rims = robot.wheel_count * wheels.inertia / wheels.radius**2
    names = ("wheels.inertia", "wheels.radius", "body.mass")
    fraction = rims / robot.body.mass
    if fraction > 1.0:
        text = (
            f"{_said(robot, 'wheels.inertia', 'wheels.radius')}: {robot.wheel_count} wheels would weigh {rims:.3g} kg "
            f"even with all their mass at the rim, more than the body with its wheels, {robot.body.mass:.3g} kg: an "
            "inertia too large, or a radius too small."
        )
        yield from _within("robot-wheels", names, text, fraction, usual=(0.0, 1.0), possible=(0.0, 2.0))
    elif 0.0 < fraction < 1e-4:
        text = (
            f"{_said(robot, 'wheels.inertia', 'wheels.radius')}: as discs, {robot.wheel_count} wheels would weigh "
            f"{2e3 * rims:.2g} g of the body's {robot.body.mass:.3g} kg."
        )
        yield Finding(code="robot-wheels", severity="warning", text=text, where=Place(columns=names))


def _of_gear(robot: Robot) -> Iterator[Finding]:
    drive, wheels = robot.drive, robot.wheels
    n = drive.gear_ratio
    yield from _within(
        "robot-drive",
        ("drive.gear_ratio",),
        f"drive.gear_ratio is {n:g} motor turns for a wheel turn; robots have 1 to 100."
        + (f" Did you mean its inverse, {1.0 / n:.4g}?" if n < 1.0 else ""),
        n,
        usual=(1.0, 200.0),
        possible=(0.8, 600.0),
    )
    reflected = reflected_rotor_inertia(
        gear_ratio=n, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    on_ball = (reflected + wheels.inertia) * (robot.ball.radius / wheels.radius) ** 2
    body = float(np.diag(robot.body.inertia_about_ball_center())[:2].min())
    names = ("drive.gear_ratio", "drive.motor_inertia", "drive.gear_inertia", "wheels.inertia")
    yield from _within(
        "robot-drive",
        names,
        f"{_said(robot, 'drive.gear_ratio', 'drive.motor_inertia', 'wheels.inertia')}: a rotor and its wheel weigh on "
        f"the ball with {on_ball:.3g} kg m^2, {on_ball / body:.2g} times the body's inertia of {body:.3g} kg m^2 "
        "about the ball's centre; robots have 0.0003 to 0.2.",
        on_ball / body,
        usual=(0.0, 0.5),
        possible=(0.0, 3.0),
    )


def _of_motor(robot: Robot) -> Iterator[Finding]:
    drive = robot.drive
    fastest = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )
    speed = fastest * robot.wheels.radius
    names = ("drive.supply_voltage", "drive.speed_constant", "drive.gear_ratio", "wheels.radius")
    yield from _within(
        "robot-drive",
        names,
        f"{_said(robot, *names[:3])}: the wheels turn at {fastest:.3g} rad/s at most, {speed:.3g} m/s at their rim; "
        "robots have 0.7 to 6 m/s.",
        speed,
        usual=(0.2, 25.0),
        possible=(0.05, 100.0),
    )
    current = drive.torque_limit / (drive.gear_ratio * drive.torque_constant)
    names = ("drive.torque_limit", "drive.torque_constant", "drive.gear_ratio")
    yield from _within(
        "robot-drive",
        names,
        f"{_said(robot, *names)}: the largest torque takes {current:.3g} A; motors of robots take 1 to 50 A.",
        current,
        usual=(0.2, 120.0),
        possible=(0.02, 600.0),
    )
    yield from _within(
        "robot-drive",
        ("drive.supply_voltage",),
        f"drive.supply_voltage is {drive.supply_voltage:g} V; batteries of robots have 6 to 60 V.",
        drive.supply_voltage,
        usual=(3.0, 120.0),
        possible=(0.5, 800.0),
    )
    play = math.degrees(drive.backlash)
    if play > 5.0:
        text = f"drive.backlash is {play:.3g} deg at the wheel; gearboxes have 0.05 to 3 deg."
        yield Finding(
            code="robot-drive", severity="warning", text=text, where=Place(columns=("drive.backlash",))
        )


def _of_balance(robot: Robot) -> Iterator[Finding]:
    """Yield what keeps a robot from balancing at all."""
    body = robot.body
    lever = robot.ball.radius / robot.wheels.radius * math.cos(robot.wheels.tilt)
    # (r_b / r_w) cos(tilt) sum |cos(beta - direction)| u, at its least over directions
    directions = np.linspace(0.0, math.pi, 61)[:, None]
    strongest = np.abs(np.cos(np.array(robot.wheels.azimuths) - directions)).sum(axis=1).min()
    torque = float(strongest) * lever * robot.drive.torque_limit
    weight = body.mass * robot.gravity * body.center_of_mass
    lean = math.degrees(math.asin(min(1.0, torque / weight)))
    names = ("drive.torque_limit", "body.mass", "body.center_of_mass")
    yield from _within(
        "robot-balance",
        names,
        f"{_said(robot, *names)}: with all motors at their limit the body is held up to a lean of {lean:.2g} deg, too "
        "little to balance; robots have 5 deg or more.",
        lean,
        usual=(2.0, 90.0),
        possible=(0.5, 90.0),
    )
    inertia = float(np.diag(body.inertia_about_ball_center())[:2].max())
    rate = math.sqrt(weight / inertia)
    period = robot.sensors.sample_time
    names = ("sensors.sample_time",)
    yield from _within(
        "robot-balance",
        names,
        f"sensors.sample_time is {1e3 * period:g} ms, and the body falls {rate:.3g} times e-fold in a second; a "
        "controller that slow does not balance it. Robots have 1 to 10 ms.",
        period * rate,
        usual=(0.0, 0.15),
        possible=(0.0, 0.5),
    )


def _of_sensors(robot: Robot) -> Iterator[Finding]:
    sensors = robot.sensors
    yield from _within(
        "robot-sensors",
        ("sensors.sample_time",),
        f"sensors.sample_time is {sensors.sample_time:g} s; robots have 1 to 10 ms.",
        sensors.sample_time,
        usual=(2e-4, 1.0),
        possible=(2e-5, 1.0),
    )
    step = encoder_step(encoder_counts=sensors.encoder_counts, gear_ratio=robot.drive.gear_ratio)
    yield from _within(
        "robot-sensors",
        ("sensors.encoder_counts", "drive.gear_ratio"),
        f"{_said(robot, 'sensors.encoder_counts', 'drive.gear_ratio')}: an encoder count is {math.degrees(step):.2g} "
        "deg of the wheel; robots have 0.001 to 1 deg. encoder_counts are a motor turn's, not a wheel turn's.",
        step,
        usual=(1e-7, 0.05),
        possible=(1e-12, 1.0),
    )
    largest = {"sensors.gyro_noise": 0.1, "sensors.attitude_noise": 0.03, "sensors.heading_drift": 0.1}
    for name, limit in largest.items():
        value = value_of(robot, BY_NAME[name])
        assert not isinstance(value, tuple)
        if abs(value) > limit:
            unit = BY_NAME[name].unit
            text = (
                f"{name} is {value:.3g} {unit}, more than the {limit:g} of a poor sensor; did you mean {value:.3g} "
                f"{unit.replace('rad', 'deg')}?"
            )
            yield Finding(code="robot-sensors", severity="warning", text=text, where=Place(columns=(name,)))


def _of_friction(robot: Robot) -> Iterator[Finding]:
    friction, drive = robot.friction, robot.drive
    dry = max(friction.breakaway)
    names = ("friction.coulomb", "friction.stribeck", "drive.torque_limit")
    yield from _within(
        "robot-friction",
        names,
        f"A wheel's dry friction c + s is {dry:.3g} N m, {dry / drive.torque_limit:.2g} of drive.torque_limit, "
        f"{drive.torque_limit:.3g} N m: the motor {'cannot' if dry >= drive.torque_limit else 'can hardly'} turn it.",
        dry / drive.torque_limit,
        usual=(0.0, 0.5),
        possible=(0.0, 0.999),
    )
    names = ("friction.viscous", "drive.torque_limit")
    slow = drive.torque_limit / max(max(friction.viscous), 1e-300) * robot.wheels.radius
    yield from _within(
        "robot-friction",
        names,
        f"{_said(robot, *names)}: against viscous friction alone a wheel's rim reaches {slow:.2g} m/s.",
        slow,
        usual=(0.3, math.inf),
        possible=(0.03, math.inf),
    )
    yield from _within(
        "robot-friction",
        ("friction.rolling",),
        f"friction.rolling is {friction.rolling:g}, a floor that brakes as a slope of "
        f"{math.degrees(math.atan(friction.rolling)):.2g} deg does; balls have {_usual('friction.rolling')}.",
        friction.rolling,
        usual=BY_NAME["friction.rolling"].usual,
        possible=(0.0, 0.6),
    )
    if max(friction.stribeck) > 0.0:
        for name in ("friction.stribeck_speed", "friction.stribeck_exponent"):
            value = value_of(robot, BY_NAME[name])
            assert not isinstance(value, tuple)
            text = f"{_said(robot, name)} is unusual; robots have {_usual(name)}."
            usual = BY_NAME[name].usual
            yield from _within("robot-friction", (name,), text, value, usual=usual, possible=(1e-9, math.inf))


def _of_deviations(robot: Robot) -> Iterator[Finding]:
    """Yield standard deviations that leave a value all but open; friction's may, after a poor identification.

    Friction without any counts as exact where it is compensated.
    """
    exact = [
        one.name
        for one in PARAMETERS
        if one.table == "friction"
        and np.any(value_of(robot, one))
        and one.name not in robot.standard_deviations
        and not (one.key.startswith("stribeck_") and not any(robot.friction.stribeck))
    ]
    if exact:
        text = (
            f"{every(exact)} {'has' if len(exact) == 1 else 'have'} no standard deviation: compensation takes "
            f"{'its value' if len(exact) == 1 else 'their values'} as exact."
        )
        yield Finding(severity="note", code="robot-deviation", text=text, where=Place(columns=tuple(exact)))
    for name, deviation in robot.standard_deviations.items():
        if name.startswith("friction.") or (name.startswith("body.inertia.") and name[-2] != name[-1]):
            continue
        values, deviations = (
            np.atleast_1d(np.array(one, dtype=float)) for one in (value_of(robot, BY_NAME[name]), deviation)
        )
        # an azimuth of zero, say, is known by its own scale
        scale = np.where(BY_NAME[name].unit == "rad", np.maximum(np.abs(values), 1.0), np.abs(values))
        worst = int(np.argmax(deviations - 0.5 * scale))
        if deviations[worst] > 0.5 * scale[worst] > 0.0:
            text = (
                f"{name} is {values[worst]:.4g} with a standard deviation of {deviations[worst]:.4g} "
                f"{BY_NAME[name].unit}, which leaves it open; look at its unit."
            )
            yield Finding(code="robot-deviation", severity="warning", text=text, where=Place(columns=(name,)))
