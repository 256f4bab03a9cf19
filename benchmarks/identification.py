"""The cost of an identification, beside the same cost by SciPy and an equivalent problem by mujoco.sysid, on one core.

.venv/bin/python -m benchmarks.identification
"""

from collections.abc import Callable
from dataclasses import replace
from time import process_time

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ballbot.fitting.fit import descend
from ballbot.fitting.run import Threads
from ballbot.identification.balancing import Balancing
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import Bounds, Layout, scale_between
from ballbot.identification.windows import Windows, cut_windows
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.robot import Friction, Robot
from benchmarks.numpy_form import rate_of_change
from benchmarks.workloads import measured_square, nominal_robot

#: of a generation of the evolution as it is by default
SETS, WINDOWS = 24, 64
#: sgn(w) becomes w/sqrt(w^2 + SMOOTHING^2) for SciPy, whose steps shrink to nothing where a wheel sticks [rad/s]
SMOOTHING = 0.02
#: sets of parameters and windows that SciPy and MuJoCo are timed on; a whole generation would take minutes
SAMPLED = 32
#: fits begin at this share of the friction that made the windows
START = 0.5

Row = tuple[str, str, str]  #: name, measured, asked


def rows() -> list[Row]:
    """Time all in this process, by its processor time, and return what the page of timings says."""
    robot = nominal_robot()
    windows = windows_of(robot)
    ours, (scipy, error) = batched(robot, windows, candidates(robot)), by_scipy(robot, windows)
    return [
        (
            "identification: the cost of one set of parameters on a window of 0.25 s",
            f"{1e6 * ours:.0f} us",
            "",
        ),
        (
            f"the same by a loop over SciPy's solve_ivp, sgn smoothed over {SMOOTHING} rad/s, cost off by {error:.2f}",
            f"{scipy / ours:,.0f} times",
            "300",
        ),
        *mujoco_rows(without_stribeck(robot)),
    ]


def mujoco_rows(robot: Robot) -> list[Row]:
    """Return the rows on mujoco.sysid."""
    fit, window = "not installed", "not installed"
    try:
        from benchmarks import mujoco_identification as peer
    except ImportError:
        pass
    else:
        windows = windows_of(robot).take(np.arange(SAMPLED))
        fit = f"{peer.seconds_a_fit(robot, windows, start=START) / whole_fit(robot, windows):,.0f} times"
        same = [robot.friction] * (2 * robot.wheel_count + 2)  # the point and its seven differences, as there
        window = f"{peer.seconds_a_window(robot, windows) / batched(robot, windows, same):,.0f} times"
    return [
        ("an equivalent fit by mujoco.sysid: b, c and C_rr from half their values", fit, "30"),
        ("a window predicted by one set of parameters in mujoco.sysid's Jacobian", window, ""),
    ]


def without_stribeck(robot: Robot) -> Robot:
    """Return the robot with viscous, Coulomb and rolling friction only, which MuJoCo has too."""
    return robot.replace(friction=replace(robot.friction, stribeck=(0.0,) * robot.wheel_count))


def windows_of(robot: Robot) -> Windows:
    """Return windows of a run around a square, with noise."""
    log = measured_square(robot, duration=32.0, period=32.0)
    windows = cut_windows([log], wheel_count=robot.wheel_count, duration=0.25)
    return windows.take(np.linspace(0, len(windows) - 1, WINDOWS).astype(int))


def candidates(robot: Robot) -> list[Friction]:
    """Return frictions about the robot's own, each number between nothing and twice of it but for v_s and delta."""
    random, friction = np.random.default_rng(2), robot.friction

    def drawn(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(float(value) for value in np.array(values) * random.uniform(0.0, 2.0, len(values)))

    return [
        replace(
            friction,
            viscous=drawn(friction.viscous),
            coulomb=drawn(friction.coulomb),
            stribeck=drawn(friction.stribeck),
            rolling=drawn((friction.rolling,))[0],
        )
        for _ in range(SETS)
    ]


def batched(robot: Robot, windows: Windows, frictions: list[Friction]) -> float:
    """Return seconds a window of the cost as identification computes it, 1 ms steps, one thread."""
    layout = Layout(wheel_count=robot.wheel_count)
    predictor = Predictor(robot=robot, step=1e-3, layout=layout, threads=1)
    values = np.array([layout.nominal(robot.replace(friction=law)) for law in frictions])
    every = windows.comparison_interval
    seconds = shortest(lambda: predictor.square_sums(values, windows, every=every))
    return seconds / (len(values) * len(windows))


def by_scipy(robot: Robot, windows: Windows) -> tuple[float, float]:
    """Return seconds a window of the same cost in a Python loop, and by how much its cost is off."""
    layout = Layout(wheel_count=robot.wheel_count)
    fine = Predictor(robot=robot, step=1e-4, layout=layout, threads=1)
    seconds, off, frictions = 0.0, 0.0, candidates(robot)
    for friction, number in np.random.default_rng(3).integers(0, [[SETS, WINDOWS]] * SAMPLED):
        window, candidate = windows.take(np.array([number])), robot.replace(friction=frictions[friction])
        started = process_time()
        sums = square_sum_by_scipy(candidate, window)
        seconds += process_time() - started
        values = layout.nominal(candidate)[None]
        right = fine.square_sums(values, window, every=window.comparison_interval)[0]
        off += float(np.abs(0.5 * np.log(sums / right)).mean())
    return seconds / SAMPLED, off / SAMPLED


def whole_fit(robot: Robot, windows: Windows) -> float:
    """Return seconds of a fit of b, c, C_rr and the windows' initial states, which the peer holds."""
    friction, wide = robot.friction, {"viscous": (0.0, 0.1), "coulomb": (0.0, 0.5), "rolling": (0.0, 0.05)}
    held = {"stribeck": (0.0, 0.0), "stribeck_speed": (friction.stribeck_speed,) * 2}
    held |= {"stribeck_exponent": (friction.stribeck_exponent,) * 2}
    coordinates = scale_between(robot, bounds=Bounds(wide | held))
    predictor = Predictor(robot=robot, step=1e-3, layout=coordinates.layout, threads=1)
    experiment = Balancing(
        predictor=predictor, windows=windows, coordinates=coordinates, executor=Threads(count=1)
    )
    start = coordinates.scaled(START * coordinates.nominal)
    return shortest(lambda: descend(experiment, start, free=coordinates.free, most_steps=25))


def square_sum_by_scipy(robot: Robot, window: Windows) -> NDArray[np.float64]:
    """Return the sums of squares (10,) of one window."""
    f = rate_of_change(robot, smoothing=SMOOTHING)
    h, every, torques = window.sample_time, window.comparison_interval, window.torques[0]

    def rate(t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return f(x, torques[min(int(t / h), len(torques) - 1)])

    start = window.initial[0].copy()
    start[7:] = body_rates_matrix(*start[2:5]) @ start[7:]
    times = h * every * np.arange(1, len(torques) // every + 1)
    states = solve_ivp(rate, (0.0, h * len(torques)), start, t_eval=times).y.T
    for state in states:
        state[7:] = np.linalg.solve(body_rates_matrix(*state[2:5]), state[7:])
    return ((states - window.measured[0, every - 1 :: every]) ** 2).sum(axis=0)


def shortest(run: Callable[[], object]) -> float:
    """Return the shortest time of five runs, after one that does not count."""
    run()
    times = []
    for _ in range(5):
        started = process_time()
        run()
        times.append(process_time() - started)
    return min(times)


if __name__ == "__main__":
    for name, measured, asked in rows():
        print(f"{name}: {measured}" + (f" (asked: {asked})" if asked else ""))
