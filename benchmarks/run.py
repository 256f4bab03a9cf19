"""The engine's timings beside its peers', in one run: writes docs/generated/benchmarks.md.

.venv/bin/python -m benchmarks.run          (make bench)
"""

import os
import platform
import subprocess
import sys
import tempfile
from collections import Counter
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain, precise_controller
from ballbot.control.references import hold
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import Reading
from ballbot.files import write_text
from ballbot.mechanics.engine.lanes import LANES, ROWS
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from benchmarks import closed_loop, environments, identification, jax_peer, peers
from benchmarks.accuracy import accelerations
from benchmarks.numpy_form import rate_of_change
from benchmarks.operations import operations_of_a_step, peak_rate
from benchmarks.workloads import PAGE, balancing, nominal_robot, processor, smooth

STEPS = 5
_FIRST_CALL = """
import time; t = time.perf_counter()
import ballbot; imported = time.perf_counter() - t
import numpy as np
ballbot.Model(ballbot.Robot.load("alten")).advance(np.zeros(10), np.full(3, 0.01), 0.005)
print(imported, time.perf_counter() - t)
"""


def steps_a_second(
    model: Model, initial: NDArray[np.float64], torques: NDArray[np.float64], *, threads: int = 1
) -> float:
    """Return robot steps a second, the best of eight spells of 0.2 s."""
    robots = len(initial)
    lanes = Lanes(parameters=model.packed[None], initial=initial, torques=torques)

    def run() -> None:
        simulate_lanes(
            model.selected,
            lanes,
            sample_time=0.005,
            steps=STEPS,
            every=torques.shape[1],
            threads=threads,
        )

    run()
    best = 0.0
    for _ in range(8):
        started, calls = perf_counter(), 0
        while perf_counter() - started < 0.2:
            run()
            calls += 1
        best = max(best, robots * torques.shape[1] * STEPS * calls / (perf_counter() - started))
    return best


def closed_loop_minute(model: Model) -> float:
    """Return the time [s] of 60 s in closed loop at 1 kHz, controller and stick-slip included, one robot."""
    frictionless_gain = design_gain(model.robot, sample_time=1e-3).gain
    controller = Controller(model.robot, frictionless_gain, sample_time=1e-3, compensation="full")
    start = np.zeros(10)
    start[2] = 0.01
    best = float("inf")
    for duration in (0.1, 60.0, 60.0, 60.0):
        started = perf_counter()
        simulate_batch(model, controller, hold(), duration=duration, initial_states=start, every=0)
        best = min(best, perf_counter() - started) if duration == 60.0 else best
    return best


def update_time(controller: Controller) -> float:
    """Return the time [s] of one update by Python, the median of 20 spells over 2,000 states near upright."""
    states = 0.02 * np.random.default_rng(5).standard_normal((2000, 10))
    reference, times = np.zeros(10), controller.sample_time * np.arange(len(states))
    spells = []
    for _ in range(21):
        controller.reset()
        started = perf_counter()
        for t, state in zip(times, states, strict=True):
            controller.update(t, state, reference)
        spells.append((perf_counter() - started) / len(states))
    return float(np.median(spells[1:]))  # the first compiles


def filter_time(robot: Robot) -> float:
    """Return the time [s] of one update of the Kalman filter by Python, the median of 20 spells over 600 readings."""
    random = np.random.default_rng(5)
    n, spells = robot.wheel_count, []
    readings = [
        Reading(
            wheel_angles=0.02 * random.standard_normal(n),
            wheel_speeds=0.1 * random.standard_normal(n),
            gyro=0.1 * random.standard_normal(3),
            attitude=0.02 * random.standard_normal(3),
        )
        for _ in range(600)
    ]
    for _ in range(21):
        state = named_estimator("kalman", robot, sample_time=0.005)
        started = perf_counter()
        for reading in readings:
            state.update(reading)
        spells.append((perf_counter() - started) / len(readings))
    return float(np.median(spells[1:]))  # the first compiles


def first_calls() -> tuple[float, float, float]:
    """Return seconds: import, import and first call without compiled code on disk, and with it."""
    with tempfile.TemporaryDirectory() as folder:
        times = []
        for _ in range(2):
            done = subprocess.run(
                [sys.executable, "-c", _FIRST_CALL],
                env={**os.environ, "NUMBA_CACHE_DIR": folder},
                capture_output=True,
                text=True,
                check=True,
            )
            times.append([float(number) for number in done.stdout.split()])
    return times[1][0], times[0][1], times[1][1]


def largest_error(model: Model) -> float:
    """Return the largest relative error of accelerations with friction against the NumPy form.

    At 2,000 states with |theta|, |phi| up to 1.2 rad and headings up to 10,000 rad.
    """
    random = np.random.default_rng(3)
    f = rate_of_change(model.robot)
    worst = 0.0
    states = np.concatenate(
        [
            np.zeros((2000, 2)),
            random.uniform(-1.2, 1.2, (2000, 2)),
            random.uniform(-1e4, 1e4, (2000, 1)),
            random.normal(0, 1.5, (2000, 5)),
        ],
        axis=1,
    )
    torques = random.normal(0, 2.0, (2000, 3))
    for state, u, acceleration in zip(states, torques, accelerations(model, states, torques), strict=True):
        expected = f(state, u)[5:]
        worst = max(worst, float(np.abs(acceleration - expected).max() / np.abs(expected).max()))
    return worst


def main() -> None:
    """Measure everything and write the page."""
    model = Model(nominal_robot())
    (starts, torques), (resting, gentle) = smooth(4096), balancing(4096)
    batched, stick_slip = steps_a_second(model, starts, torques), steps_a_second(model, resting, gentle)
    single = steps_a_second(model, starts[:1], torques[:1])
    single_stick = steps_a_second(model, resting[:1], gentle[:1])
    two = steps_a_second(model, starts, torques, threads=2)
    minute = closed_loop_minute(model)
    imported, cold, cached = first_calls()
    rows = [
        ("batched RK4, full Stribeck, known signs", f"{batched / 1e6:.1f} million steps/s", "18, aim 25"),
        (
            "batched stick-slip, balancing without compensation",
            f"{stick_slip / 1e6:.1f} million steps/s",
            "8, aim 12",
        ),
        ("one robot, RK4", f"{single / 1e6:.2f} million steps/s", "2"),
        ("one robot, stick-slip, the same", f"{single_stick / 1e6:.2f} million steps/s", ""),
        ("two threads over one, batched RK4", f"{two / batched:.2f} times", "1.8"),
        ("60 s closed loop at 1 kHz, controller and stick-slip", f"{1e3 * minute:.0f} ms", "80"),
        (
            "one update of the precise controller, called from Python",
            f"{1e6 * update_time(precise_controller(model.robot)):.1f} us",
            "10",
        ),
        (
            "one update of the Kalman filter, called from Python",
            f"{1e6 * filter_time(model.robot):.1f} us",
            "50",
        ),
        ("import ballbot", f"{imported:.3f} s", "0.5"),
        ("first call in a fresh process, compiled code on disk", f"{cached:.2f} s", "3"),
        ("first call in a fresh process, nothing on disk", f"{cold:.1f} s", "15"),
        ("largest relative error against the NumPy form", f"{largest_error(model):.1e}", "1e-12"),
        *closed_loop.rows(),
        *identification.rows(),
    ]
    others = [
        ("RK4 in plain NumPy", peers.numpy_rk4()),
        ("SciPy solve_ivp (RK45, 1e-8) on the NumPy form", peers.scipy_solve_ivp()),
        ("python-control, nonlinear simulation of the NumPy form", peers.python_control()),
        ("JAX, the NumPy form jitted and mapped over 4,096 robots, RK4", jax_peer.seconds_a_step()),
        ("MuJoCo, 5 freedoms with friction loss, RK4", peers.mujoco("RK4")),
        ("MuJoCo, 5 freedoms with friction loss, implicitfast", peers.mujoco("implicitfast")),
    ]
    write_text(PAGE, page(rows, others, batched, single, model))
    print(PAGE.read_text())


def page(rows: list, others: list, batched: float, single: float, model: Model) -> str:
    """Return the page's text."""
    counts, peak = operations_of_a_step(model), peak_rate()
    arithmetic = sum(counts[name] for name in ("fadd", "fsub", "fmul", "fneg"))
    lines = [
        "# Timings",
        "",
        f"`make bench` writes this page. {processor()}, {os.cpu_count()} cores, Python {platform.python_version()},"
        f" NumPy {np.__version__}; float64, one core unless stated, 1 ms steps, the true exponential and power.",
        "",
        "| | measured | target |",
        "|---|---:|---:|",
        *(f"| {name} | {value} | {asked} |" for name, value, asked in rows),
        "",
        "Peers in the same run, a millisecond of motion of one robot each:",
        "",
        "| | time | times slower than one robot here | than batched |",
        "|---|---:|---:|---:|",
    ]
    for name, seconds in others:
        if seconds is None:
            lines.append(f"| {name} | not installed | | |")
        else:
            lines.append(
                f"| {name} | {1e6 * seconds:.3g} us | {seconds * single:,.0f} | {seconds * batched:,.0f} |"
            )
    lines += ["", *limits(counts, arithmetic, peak, batched), "", environments.section()]
    return "\n".join(lines)


def limits(counts: Counter[str], arithmetic: int, peak: float, batched: float) -> list[str]:
    """Return the paragraph on a step's operations and this machine's limit."""
    compared = counts["fcmp"] + counts["select"]
    fused, alone = 2 * peak / arithmetic / 1e6, peak / arithmetic / 1e6
    size = ROWS * LANES * 8 // 1024
    return [
        f"One step with its checks is {arithmetic} additions, multiplications and changes of sign, {counts['fdiv']}",
        f"divisions, {counts['sqrt']} roots and {compared} comparisons and selections in LLVM's code of one lane",
        f"(`benchmarks/operations.py`). This core does {peak / 1e9:.1f} thousand million fused multiply-adds a second,",
        f"so that the first alone allow {fused:.0f} million steps a second if all were fused, and {alone:.0f} if none;",
        f"measured: {batched / 1e6:.1f}. What a block of {LANES} robots needs is {size} KiB at most and stays in the",
        "first cache, so that memory does not limit it; the rest is divisions, comparisons and waiting, since a step",
        "is a long chain of dependent operations.",
    ]


if __name__ == "__main__":
    main()
