"""Compare additions to the feedback: a lean limit, a predictive controller, a notch.

.venv/bin/python -m campaigns.evidence feedback_options
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.signal import welch

from ballbot import Controller, Log, Model, Robot, lqr, simulate
from ballbot.control.controller import grip_torque_limit
from ballbot.control.interface import Feedback
from ballbot.control.lqr import LqrDesign, held
from ballbot.control.parts import Parts
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.notch import Notch
from ballbot.control.presets import (
    PRECISE_STATE_WEIGHTS,
    PRECISE_TORQUE_WEIGHT,
    nominal_controller,
    precise_controller,
)
from ballbot.control.references import change_pose, hold, square
from ballbot.estimation import named_estimator
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.processes import worker_pool
from ballbot.simulation.imperfections import FALLING_PART, Push
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement
from ballbot.twin import Scenario, Twin
from ballbot.workflows.limits import leaning_state, pushed_state
from ballbot.workflows.metrics import score
from ballbot.workflows.recovery_region import top_speed
from campaigns.predictive import Predictive
from campaigns.section import Section
from campaigns.twin_observed import residual_spectrum

ROBOT = Robot.load("alten")
NOMINAL = Scenario.nominal(ROBOT)
#: who knows the twin's friction
KNOWING = ROBOT.replace(friction=NOMINAL.friction)
LIMITS = (6.0, 2.0)  # [N m]
DIRECTIONS = (0.0, 0.5 * math.pi)
SEEDS = (1, 2, 3)
BOUND = LeanLimit()
#: a step has arrived within this [m] for good
ARRIVED = 0.05
_PLAIN = ("alone", "bound", "predictive")
_HARDEST = 60.0  # impulse tried [N s]
_BLOW = 0.02  # how long one is on the twin [s]


class WithSpeedLimit:
    """The model whose motors run out of voltage near their highest speed, as a batch's do."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._plant, self._top = ModelPlant(Model(robot, step=0.005)), top_speed(robot)
        self._speeds = np.zeros(robot.wheel_count)

    def reset(self, initial_state: NDArray[np.float64] | None = None, *, seed: int = 0) -> Measurement:
        """Start again."""
        return self._seen(self._plant.reset(initial_state, seed=seed))

    def step(self, torques: NDArray[np.float64], duration: float) -> Measurement:
        """Hold what the motors have of the torques."""
        share = np.clip((self._top - np.sign(torques) * self._speeds) / (FALLING_PART * self._top), 0.0, 1.0)
        return self._seen(self._plant.step(torques * share, duration))

    def _seen(self, measured: Measurement) -> Measurement:
        self._speeds = measured.wheel_speeds
        return measured


def stiff() -> LqrDesign:
    """Return the precise controller's weights as a plain LQR, whose Riccati equation the predictive one needs."""
    return lqr(
        Model(ROBOT),
        PRECISE_STATE_WEIGHTS,
        (PRECISE_TORQUE_WEIGHT,) * 3,
        sample_time=ROBOT.sensors.sample_time,
    )


def controller_named(name: str, limit: float, robot: Robot = ROBOT) -> Controller | Predictive:
    """Return the stiff gain alone, with the bound, or with the predictive correction; friction, if any, compensated."""
    design, parts = stiff(), Parts(lean_limit=BOUND) if name == "bound" else Parts()
    compensation = "full" if max(robot.friction.coulomb) > 0.0 else "none"
    law = Controller(robot, design.gain, torque_limit=limit, compensation=compensation, parts=parts)
    return Predictive(law, design, torque_weight=PRECISE_TORQUE_WEIGHT) if name == "predictive" else law


@dataclass(frozen=True, kw_only=True)
class Reached:
    """The limits and the steps of a controller."""

    lean: float  #: the smaller of both directions [rad]
    impulse: float  #: [N s]
    settled: tuple[float, ...]  #: settling time of each run of the step [s]; NaN if it fell
    past: float = math.nan  #: overshoot [m]
    times: tuple[float, ...] = ()  #: of the quadratic programs [s]


def largest(recovers: Callable[[float], bool], most: float, halvings: int) -> float:
    """Return the largest size from which the robot recovers, by bisection."""
    low, high = 0.0, most
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if recovers(middle) else (low, middle)
    return low


def on_model(job: tuple[str, float]) -> Reached:
    """Return the results on the model with perfect sensors and wheels that never slip."""
    name, limit = job
    controller, plant, model = controller_named(name, limit), WithSpeedLimit(ROBOT), Model(ROBOT)

    def recovers(start: NDArray[np.float64]) -> bool:
        return simulate(plant, controller, hold(), duration=5.0, initial_state=start).ended is None

    height = ROBOT.body.center_of_mass
    lean = min(largest(lambda s, d=d: recovers(leaning_state(d, s)), LARGEST_LEAN, 9) for d in DIRECTIONS)
    impulse = min(
        largest(lambda s, d=d: recovers(pushed_state(model, d, s, height)), _HARDEST, 9) for d in DIRECTIONS
    )
    log = simulate(plant, controller, change_pose(at=0.0, ramp=0.0), duration=10.0)
    settled, past = arrived(log, begins=0.0)
    times = tuple(controller.times) if isinstance(controller, Predictive) else ()
    return Reached(lean=lean, impulse=impulse, settled=(settled,), past=past, times=times)


def on_twin(job: tuple[float, bool]) -> Reached:
    """Return how far the precise controller goes on the twin, with a bound besides or without."""
    limit, bound = job
    whole = precise_controller(KNOWING)
    controller = Controller(
        KNOWING,
        whole.gain,
        compensation="full",
        torque_limit=limit,
        speed_band=whole.speed_band,
        parts=replace(whole.parts, lean_limit=BOUND if bound else None),
    )
    return _twin_edges(controller, steps(controller))


def steps(controller: Feedback) -> tuple[float, ...]:
    """Return how long the step took to arrive on the twin, by seed; NaN where it fell."""
    wanted = change_pose(at=1.0, ramp=0.0)
    return tuple(arrived(_run(NOMINAL, controller, wanted, 12.0, seed), begins=1.0)[0] for seed in SEEDS)


def steps_on_twin(name: str) -> tuple[float, ...]:
    """Return the steps of the stiff gain at 2 N m, friction compensated and nothing else."""
    return steps(controller_named(name, 2.0, ROBOT.replace(friction=NOMINAL.friction)))


def _twin_edges(controller: Feedback, settled: tuple[float, ...]) -> Reached:
    lenient = replace(NOMINAL, fallen_lean=LARGEST_LEAN)

    def leans(size: float, direction: float) -> bool:
        return _run(lenient, controller, hold(), 3.0, 1, leaning_state(direction, size)).ended is None

    def struck(size: float, direction: float) -> bool:
        force = (size / _BLOW * math.cos(direction), size / _BLOW * math.sin(direction), 0.0)
        push = Push(time=0.5, duration=_BLOW, force=force, height=ROBOT.body.center_of_mass)
        return _run(replace(lenient, pushes=(push,)), controller, hold(), 3.5, 1).ended is None

    lean = min(largest(lambda s, d=d: leans(s, d), 0.5, 5) for d in DIRECTIONS)
    impulse = min(largest(lambda s, d=d: struck(s, d), 40.0, 5) for d in DIRECTIONS)
    return Reached(lean=lean, impulse=impulse, settled=settled)


def _run(
    scenario: Scenario,
    controller: Feedback,
    reference: Callable[[float], NDArray[np.float64]],
    duration: float,
    seed: int,
    start: NDArray[np.float64] | None = None,
) -> Log:
    twin = Twin(ROBOT, scenario, estimator=named_estimator("kalman", ROBOT, sample_time=0.005))
    return simulate(twin, controller, reference, duration=duration, seed=seed, initial_state=start)


def arrived(log: Log, *, begins: float) -> tuple[float, float]:
    """Return how long after a step to (1, -1) the true place is right for good [s], and how far it went past [m]."""
    if log.ended is not None:
        return math.nan, math.nan
    true = log.truth().states
    away = np.flatnonzero(np.hypot(true[:, 0] - 1.0, true[:, 1] + 1.0) > ARRIVED)
    return float(log.t[away[-1]] - begins), max(0.0, float(true[:, 0].max() - 1.0))


def bound_of_any(limit: float) -> tuple[float, float]:
    """Return the least lean [rad] and impulse [N s] from which no torques bring the linearised model back."""
    model = Model(ROBOT)
    linear = model.linearize()
    values, vectors = np.linalg.eig(linear.A.T)
    falls = values.real > 1.0
    rates, left = values[falls].real, vectors[:, falls].real.T

    def most(start: NDArray[np.float64]) -> float:
        kept = np.column_stack([rates * (left @ start), left @ linear.B])
        bounds = [(0, None), *[(-limit, limit)] * 3]
        return float(linprog([-1, 0, 0, 0], A_eq=kept, b_eq=np.zeros(2), bounds=bounds).x[0])

    height = ROBOT.body.center_of_mass
    return (
        min(most(leaning_state(d, 1.0)) for d in DIRECTIONS),
        min(most(pushed_state(model, d, 1.0, height)) for d in DIRECTIONS),
    )


def campaign() -> Section:
    """Run everything and return the section of docs/generated/evidence.md."""
    models = [(name, limit) for limit in LIMITS for name in ("alone", "bound", "predictive")]
    twins = [(limit, bound) for limit in LIMITS for bound in (False, True)]
    twins.append((grip_torque_limit(KNOWING), True))  # as it comes
    with worker_pool(os.cpu_count()) as pool:
        on_twins = pool.map(on_twin, twins)
        plain = pool.map(steps_on_twin, _PLAIN)
        found = list(pool.map(on_model, models))
        rows = [
            _row(f"model, {name}, {limit:g} N m", one)
            for (name, limit), one in zip(models, found, strict=True)
        ]
        for limit in LIMITS:
            lean, impulse = bound_of_any(limit)
            rows.append(
                [
                    f"no torques of {limit:g} N m do more",
                    f"{math.degrees(lean):.1f}",
                    f"{impulse:.1f}",
                    "",
                    "",
                ]
            )
        for (limit, bound), one in zip(twins, on_twins, strict=True):
            rows.append(_row(f"twin, precise{', bound' if bound else ''}, {limit:.2g} N m", one))
        jumps = "; ".join(f"{name} {_settled(one)}" for name, one in zip(_PLAIN, plain, strict=True))
    times = 1e3 * np.concatenate([one.times for one in found])
    return Section(
        title="Large disturbances and resonances: lean limit, predictive controller, notch",
        before="The precise controller's weights as a plain LQR on the model with perfect sensors, its motors' highest"
        " speed and wheels that always hold: alone, with `LeanLimit` at its defaults, and with a predictive"
        " correction (`campaigns/predictive.py`). Then the precise controller on the nominal twin, the true friction"
        " compensated. The smallest over two directions of the lean at rest and of the impulse from which the robot"
        f" recovers; the unshaped step to [1 -1 pi]: time until it stays within {1e3 * ARRIVED:.0f} mm, by seed on the"
        " twin, and overshoot.",
        columns=["where", "lean [deg]", "impulse [N s]", "step [s]", "overshoot [mm]"],
        rows=rows,
        after=f"A predictive update whose limits bind took {np.median(times):.1f} ms in the median and"
        f" {np.quantile(times, 0.99):.1f} ms in one of a hundred, on a machine that was busy. The same step on the"
        f" twin at 2 N m, plain LQR with friction compensated: {jumps}.\n\n" + notch_table(),
    )


def _row(name: str, one: Reached) -> list[str]:
    past = "" if math.isnan(one.past) else f"{1e3 * one.past:.0f}"
    return [name, f"{math.degrees(one.lean):.1f}", f"{one.impulse:.1f}", _settled(one.settled), past]


def _settled(times: tuple[float, ...]) -> str:
    return ", ".join("falls" if math.isnan(time) else f"{time:.1f}" for time in times)


RESONANT = Scenario.named("resonant", ROBOT)
RESONANT_TWINS = {
    "nominal": Scenario.nominal(ROBOT),
    "resonance, no play": replace(RESONANT, backlash=0.0),
    "resonance, 1 degree of play": RESONANT,
}
_SQUARE_DURATION = 24.0  # [s]


def notched_controller(frequency: float | None) -> Controller:
    """Return the nominal gain with the friction compensated, with a notch at a frequency [Hz] or without."""
    plain = nominal_controller(ROBOT.replace(friction=RESONANT.friction), compensation="full")
    return plain if frequency is None else plain.with_parts(Parts(notch=Notch(frequency=frequency)))


def notched_run(job: tuple[str, float | None, int]) -> Log:
    """Run the square on the twin."""
    name, frequency, seed = job
    reference = square(side=0.5, period=32.0)
    return simulate(
        Twin(ROBOT, RESONANT_TWINS[name]),
        notched_controller(frequency),
        reference,
        duration=_SQUARE_DURATION,
        seed=seed,
    )


def least_singular_value(notch: Notch | None) -> float:
    """Return how near the linear loop comes to its border of stability: the least singular value of I + L."""
    linear, loop = Model(ROBOT).linearize(), notched_controller(None)
    F, G = held(linear.A, linear.B, loop.sample_time)
    frequencies = np.geomspace(0.02, 99.0, 2000)
    z = np.exp(2j * np.pi * frequencies * loop.sample_time)
    L = loop.gain @ np.linalg.solve(z[:, None, None] * np.eye(10) - F, G)
    if notch is not None:
        L = notch.response(frequencies, loop.sample_time)[:, None, None] * L
    return float(np.linalg.svd(np.eye(3) + L, compute_uv=False)[:, -1].min())


def shaking(log: Log) -> float:
    """Return the RMS of the first wheel's torque above 8 Hz, once settled [N m]."""
    frequency, power = welch(log.torques[1000:, 0], 1.0 / log.sample_time, nperseg=512)
    above = frequency > 8.0
    return float(np.sqrt(np.trapezoid(power[above], frequency[above])))


def notch_table() -> str:
    """Run it and return a table with words below it."""
    with worker_pool(os.cpu_count()) as pool:
        bare = _logs(pool, dict.fromkeys(RESONANT_TWINS))
        peaks = {
            name: float(np.mean([residual_spectrum(log, RESONANT.friction).peak for log in logs]))
            for name, logs in bare.items()
        }
        peaks["nominal"] = peaks["resonance, no play"]  # it has none of its own
        notched = _logs(pool, peaks)
    lines = ["| twin, nominal gain, full compensation | torque above 8 Hz [N m] | RMS error [mm] | falls |"]
    lines.append("|---|---:|---:|---:|")
    for name in RESONANT_TWINS:
        lines.append(_line(name, bare[name]))
        lines.append(_line(f"{name}, notch at {peaks[name]:.0f} Hz", notched[name]))
    lags = []
    for name in list(RESONANT_TWINS)[1:]:
        notch = Notch(frequency=peaks[name])
        lag = -np.degrees(np.angle(notch.response(3.0, 0.005)))
        lags.append(
            f"{least_singular_value(notch):.2f} with the notch at {peaks[name]:.0f} Hz, late by {lag:.0f} degrees "
            "at 3 Hz"
        )
    return (
        "\n".join(lines)
        + f"\n\nThe notch is at the peak of the one-step residuals of x_dot. The smallest singular value of"
        f" I + L of the linear loop without resonance is {least_singular_value(None):.2f} without a notch, "
        f"{'; '.join(lags)}."
    )


def _logs(pool: ProcessPoolExecutor, frequencies: dict[str, float | None]) -> dict[str, list[Log]]:
    jobs = [(name, frequency, seed) for name, frequency in frequencies.items() for seed in SEEDS]
    logs = list(pool.map(notched_run, jobs))
    return {name: logs[k * len(SEEDS) : (k + 1) * len(SEEDS)] for k, name in enumerate(frequencies)}


def _line(name: str, logs: list[Log]) -> str:
    shakes = np.mean([shaking(log) for log in logs])
    errors = np.mean([score(log).rms_position_error for log in logs])
    falls = sum(log.ended is not None for log in logs)
    return f"| {name} | {shakes:.3f} | {1e3 * errors:.0f} | {falls} of {len(logs)} |"
