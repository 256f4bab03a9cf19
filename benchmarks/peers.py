"""What else steps such a robot: SciPy, python-control and MuJoCo, in the same process and on one core."""

from collections.abc import Callable
from time import perf_counter

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.numpy_form import rate_of_change
from benchmarks.workloads import nominal_robot, smooth

_MJCF = """<mujoco><option timestep="0.001" integrator="{integrator}"/><worldbody>
<body pos="0 0 0.11"><joint type="slide" axis="1 0 0" frictionloss="1.4"/>
<joint type="slide" axis="0 1 0" frictionloss="1.4"/><geom type="sphere" size="0.11" mass="5"/>
<body><joint name="theta" axis="1 0 0" damping="0.05"/><joint name="phi" axis="0 1 0" damping="0.05"/>
<joint name="psi" axis="0 0 1" damping="0.05" frictionloss="0.4"/>
<inertial pos="0 0 0.393" mass="17.076" diaginertia="1.73 1.73 0.193"/></body></body></worldbody>
<actuator><motor joint="theta"/><motor joint="phi"/><motor joint="psi"/></actuator></mujoco>"""


def seconds_a_step(run: Callable[[], int]) -> float:
    """Return the shortest time a step of three calls; each call returns how many steps it took."""
    best = float("inf")
    for _ in range(3):
        started = perf_counter()
        steps = run()
        best = min(best, (perf_counter() - started) / steps)
    return best


def numpy_rk4() -> float:
    """Return seconds a step of RK4 in plain NumPy."""
    f, (starts, torques) = rate_of_change(nominal_robot()), smooth(1)

    def run() -> int:
        x, h = starts[0], 1e-3
        for u in torques[0]:
            k1 = f(x, u)
            k2 = f(x + h / 2 * k1, u)
            k3 = f(x + h / 2 * k2, u)
            k4 = f(x + h * k3, u)
            x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        return torques.shape[1]

    return seconds_a_step(run)


def scipy_solve_ivp() -> float:
    """Return seconds a millisecond of motion by SciPy's adaptive RK45 at its tolerance 1e-8, on the NumPy form."""
    f, (starts, torques) = rate_of_change(nominal_robot()), smooth(1)

    def run() -> int:
        solve_ivp(lambda _, x: f(x, torques[0, 0]), (0.0, 0.1), starts[0], rtol=1e-8, atol=1e-8)
        return 100

    return seconds_a_step(run)


def python_control() -> float | None:
    """Return seconds a millisecond of motion by python-control's nonlinear simulation, None where missing."""
    try:
        import control
    except ImportError:
        return None
    f, (starts, torques) = rate_of_change(nominal_robot()), smooth(1)
    system = control.nlsys(lambda t, x, u, p: f(x, u), inputs=3, states=10)  # noqa: ARG005

    def run() -> int:
        t = np.linspace(0.0, 0.1, 101)
        control.input_output_response(system, t, np.tile(torques[0, 0][:, None], len(t)), starts[0])
        return 100

    return seconds_a_step(run)


def mujoco(integrator: str) -> float | None:
    """Return seconds a step of MuJoCo on five freedoms with friction loss, None where missing."""
    try:
        import mujoco as mj
    except ImportError:
        return None
    model = mj.MjModel.from_xml_string(_MJCF.format(integrator=integrator))
    data = mj.MjData(model)

    def run() -> int:
        mj.mj_resetData(model, data)
        data.qvel[:] = 0.1
        mj.mj_step(model, data, 2000)
        return 2000

    return seconds_a_step(run)
