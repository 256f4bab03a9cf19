"""The robot that an identification leads to: what was found in place of what was there, and where it came from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.quantities import FRICTION, Layout
from ballbot.identification.rigid_body import RIGID, with_friction, with_rigid_body
from ballbot.robot import Robot

#: the lines of a robot file that a quantity of the rigid body stands in
_LINES = {
    "center_of_mass": ("body.center_of_mass",),
    "second_moment": tuple(f"body.inertia.{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
    "ball_inertia": ("ball.inertia",),
    "wheel_inertia": ("wheels.inertia",),
    "rotor_inertia": ("drive.motor_inertia", "drive.gear_inertia"),
}


def found_robot(
    robot: Robot,
    layout: Layout,
    values: NDArray[np.float64],
    standard_errors: NDArray[np.float64],
    *,
    log_count: int,
) -> Robot:
    """Return the robot with friction and rigid body out of parameters (p,); its sources tell the standard errors (p,).

    Gains, offsets, delays and biases belong to motors and sensors, of which a robot's description has no such
    numbers; they stand in the result alone, and so do mu and T_p.
    """
    rigid = {name: part for name in RIGID if (part := layout.part(name, values)) is not None}
    logs = "1 log" if log_count == 1 else f"{log_count} logs"
    lines = {name: (f"friction.{name}",) for name in FRICTION} | {name: _LINES[name] for name in rigid}
    sources = {}
    for name, places in lines.items():
        part = layout.part(name, standard_errors)
        assert part is not None
        if name in FRICTION or np.isfinite(part).any():
            told = ", ".join(f"{one:.2g}" if np.isfinite(one) else "none" for one in part)
            of = " of S_x, S_y, S_z" if name == "second_moment" else ""
            sources |= dict.fromkeys(places, f"identified: from {logs}, standard error{of} {told}")
    moved = with_rigid_body(with_friction(robot, values), rigid) if rigid else with_friction(robot, values)
    return moved.replace(sources={**robot.sources, **sources})
