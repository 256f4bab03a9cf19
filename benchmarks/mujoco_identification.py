"""A balancing robot's friction for mujoco.sysid: an equivalent problem on the same windows.

Five freedoms; each wheel is a fixed tendon, whose length is its angle about upright at heading zero, with the wheel's
inertia as armature, b as damping, c as friction loss and the motor's torque. Stribeck friction is left out: MuJoCo has
no such law. Needs pip install 'mujoco[sysid]'.
"""

import io
from collections.abc import Callable
from contextlib import redirect_stdout
from time import process_time

import mujoco
import numpy as np
from mujoco.sysid import (
    ModelSequences,
    Parameter,
    ParameterDict,
    TimeSeries,
    build_residual_fn,
    create_initial_state,
    optimize,
)
from numpy.typing import NDArray

from ballbot.identification.windows import Windows
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot

STEP = 1e-3  #: [s]
JOINTS = ("x", "y", "theta", "phi", "psi")


def seconds_a_window(robot: Robot, windows: Windows) -> float:
    """Return seconds a window and set of parameters of mujoco.sysid's finite differences.

    The residuals are asked for as `mujoco.sysid.optimize` asks for a Jacobian: all sets of parameters in one call.
    """
    residuals, parameters = problem(robot, windows)
    start = parameters.as_vector()
    sets = np.column_stack([start, start[:, None] + 1e-6 * np.eye(len(start))])
    best = float("inf")
    for _ in range(3):
        started = process_time()
        residuals(sets, parameters)
        best = min(best, process_time() - started)
    return best / (sets.shape[1] * len(windows))


def seconds_a_fit(robot: Robot, windows: Windows, *, start: float) -> float:
    """Return seconds of a whole fit from a share of the robot's own friction."""
    residuals, parameters = problem(robot, windows)
    parameters.update_from_vector(start * parameters.as_vector())
    started = process_time()
    with redirect_stdout(io.StringIO()):
        optimize(parameters, residuals, optimizer="mujoco", verbose=False)
    return process_time() - started


def problem(robot: Robot, windows: Windows) -> tuple[Callable, ParameterDict]:
    """Return what `mujoco.sysid.optimize` takes: residuals on the windows, and b, c of each wheel and C_rr."""
    measured = sequences(robot, windows)
    return build_residual_fn(models_sequences=[measured], n_threads=1), friction_parameters(robot)


def friction_parameters(robot: Robot) -> ParameterDict:
    """Return b and c of each wheel and C_rr at the robot's own values."""
    parameters, friction = ParameterDict(), robot.friction
    for i in range(robot.wheel_count):
        parameters.add(Parameter(f"b{i + 1}", friction.viscous[i], 0.0, 0.1, modifier=_damping(i)))
        parameters.add(Parameter(f"c{i + 1}", friction.coulomb[i], 0.0, 0.5, modifier=_friction_loss(i)))
    parameters.add(Parameter("C_rr", friction.rolling, 0.0, 0.05, modifier=_rolling(robot)))
    return parameters


def sequences(robot: Robot, windows: Windows) -> ModelSequences:
    """Return the windows: starts, torques held over each sample, states at the times of comparison."""
    spec = mujoco.MjSpec.from_string(mechanism(robot))
    model = spec.compile()
    steps = round(windows.sample_time / STEP)
    every = windows.comparison_interval
    times = STEP * np.arange(windows.samples * steps + 1)
    none = np.zeros(0)
    return ModelSequences(
        "balancing",
        spec,
        [str(window) for window in range(len(windows))],
        [create_initial_state(model, state[:5], state[5:], none) for state in windows.initial],
        [
            TimeSeries(times, np.concatenate([np.repeat(torques, steps, axis=0), torques[-1:]]))
            for torques in windows.torques
        ],
        [
            TimeSeries.from_names(times[steps * every :: steps * every], states[every - 1 :: every], model)
            for states in windows.measured
        ],
    )


def mechanism(robot: Robot) -> str:
    """Return the robot in MuJoCo's XML."""
    drive, r_b = robot.drive, robot.ball.radius
    inertia = robot.wheels.inertia + drive.reflected_inertia
    A, E = transforms(robot).T_owb, np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    tendons = "".join(
        f'<fixed name="wheel{i + 1}" armature="{inertia}">{_combination(row)}</fixed>'
        for i, row in enumerate(np.hstack([A @ E / r_b, -A]))
    )
    motors = "".join(f'<motor tendon="wheel{i + 1}"/>' for i in range(robot.wheel_count))
    sensors = "".join(f'<jointpos name="{name}" joint="{name}"/>' for name in JOINTS)
    sensors += "".join(f'<jointvel name="{name}_dot" joint="{name}"/>' for name in JOINTS)
    roll = robot.ball.inertia / r_b**2
    height, mass = robot.body.center_of_mass, robot.body.mass
    J = robot.body.inertia_about_ball_center() - mass * height**2 * np.diag([1.0, 1.0, 0.0])
    inertias = " ".join(str(J[index]) for index in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return f"""<mujoco><compiler angle="radian"/>
<option timestep="{STEP}" gravity="0 0 {-robot.gravity}"><flag contact="disable"/></option>
<worldbody><body><joint name="x" type="slide" axis="1 0 0" armature="{roll}"/>
<joint name="y" type="slide" axis="0 1 0" armature="{roll}"/>
<inertial pos="0 0 0" mass="{robot.ball.mass}" diaginertia="1e-3 1e-3 1e-3"/>
<body><joint name="theta" axis="1 0 0"/><joint name="phi" axis="0 1 0"/><joint name="psi" axis="0 0 1"/>
<inertial pos="0 0 {height}" mass="{mass}" fullinertia="{inertias}"/></body></body></worldbody>
<tendon>{tendons}</tendon><actuator>{motors}</actuator><sensor>{sensors}</sensor></mujoco>"""


def _combination(row: NDArray[np.float64]) -> str:
    return "".join(f'<joint joint="{name}" coef="{value}"/>' for name, value in zip(JOINTS, row, strict=True))


def _damping(wheel: int) -> Callable[[mujoco.MjSpec, Parameter], None]:
    def set_it(spec: mujoco.MjSpec, parameter: Parameter) -> None:
        tendon = spec.tendon(f"wheel{wheel + 1}")
        tendon.damping = [parameter.value[0], 0.0, 0.0]

    return set_it


def _friction_loss(wheel: int) -> Callable[[mujoco.MjSpec, Parameter], None]:
    def set_it(spec: mujoco.MjSpec, parameter: Parameter) -> None:
        spec.tendon(f"wheel{wheel + 1}").frictionloss = parameter.value[0]

    return set_it


def _rolling(robot: Robot) -> Callable[[mujoco.MjSpec, Parameter], None]:
    weight = (robot.ball.mass + robot.body.mass) * robot.gravity

    def set_it(spec: mujoco.MjSpec, parameter: Parameter) -> None:
        for joint in JOINTS[:2]:
            spec.joint(joint).frictionloss = weight * parameter.value[0]

    return set_it
