"""A notch where the residuals' spectrum finds a resonance: the twin whose drivelines twist, with and without it."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.signal import welch

from ballbot import Controller, Log, Model, Robot, simulate
from ballbot.control.lqr import held
from ballbot.control.parts import Parts
from ballbot.control.parts.notch import Notch
from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.processes import worker_pool
from ballbot.twin import Scenario, Twin
from ballbot.workflows.metrics import score
from campaigns.observations import residual_spectrum

ROBOT = Robot.load("alten")
RESONANT = Scenario.resonant(ROBOT)
SCENARIOS = {
    "nominal": Scenario.nominal(ROBOT),
    "resonance, no play": replace(RESONANT, backlash=0.0),
    "resonance, 1 degree of play": RESONANT,
}
SEEDS = (1, 2, 3)
_DURATION = 24.0  # [s]


def controller(frequency: float | None) -> Controller:
    """Return the nominal gain with the friction compensated, with a notch at a frequency [Hz] or without."""
    plain = nominal_controller(ROBOT.replace(friction=RESONANT.friction), compensation="full")
    return plain if frequency is None else plain.with_parts(Parts(notch=Notch(frequency=frequency)))


def run(job: tuple[str, float | None, int]) -> Log:
    """Run the square on the twin."""
    name, frequency, seed = job
    reference = square(side=0.5, period=32.0)
    return simulate(
        Twin(ROBOT, SCENARIOS[name]), controller(frequency), reference, duration=_DURATION, seed=seed
    )


def margin(notch: Notch | None) -> float:
    """Return how near the linear loop comes to its border of stability: the least singular value of I + L."""
    linear, loop = Model(ROBOT).linearize(), controller(None)
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
        bare = _logs(pool, dict.fromkeys(SCENARIOS))
        peaks = {
            name: float(np.mean([residual_spectrum(log, RESONANT.friction).peak for log in logs]))
            for name, logs in bare.items()
        }
        peaks["nominal"] = peaks["resonance, no play"]  # it has none of its own
        notched = _logs(pool, peaks)
    lines = ["| twin, nominal gain, full compensation | torque above 8 Hz (N m) | RMS error (mm) | falls |"]
    lines.append("|---|---:|---:|---:|")
    for name in SCENARIOS:
        lines.append(_line(name, bare[name]))
        lines.append(_line(f"{name}, notch at {peaks[name]:.0f} Hz", notched[name]))
    told = []
    for name in list(SCENARIOS)[1:]:
        notch = Notch(frequency=peaks[name])
        lag = -np.degrees(np.angle(notch.response(3.0, 0.005)))
        told.append(
            f"{margin(notch):.2f} with the notch at {peaks[name]:.0f} Hz, late by {lag:.0f} degrees at 3 Hz"
        )
    return (
        "\n".join(lines)
        + f"\n\nThe notch stands where the one-step residuals of x_dot peak. The least singular value of"
        f" I + L of the linear loop without resonance is {margin(None):.2f} without a notch, {'; '.join(told)}."
    )


def _logs(pool: ProcessPoolExecutor, frequencies: dict[str, float | None]) -> dict[str, list[Log]]:
    jobs = [(name, frequency, seed) for name, frequency in frequencies.items() for seed in SEEDS]
    logs = list(pool.map(run, jobs))
    return {name: logs[k * len(SEEDS) : (k + 1) * len(SEEDS)] for k, name in enumerate(frequencies)}


def _line(name: str, logs: list[Log]) -> str:
    shakes = np.mean([shaking(log) for log in logs])
    errors = np.mean([score(log).rms_position_error for log in logs])
    falls = sum(log.ended is not None for log in logs)
    return f"| {name} | {shakes:.3f} | {1e3 * errors:.0f} | {falls} of {len(logs)} |"
