"""Compare controllers with and without prediction on twins with delayed torques.

.venv/bin/python -m campaigns.evidence delay

The friction is identified from two logs of the nominal twin without compensation (`campaigns.compensation`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ballbot import Controller, Model, Robot
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import hold, square
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Timing
from ballbot.workflows.grid import Condition, GridRun, run_grid
from ballbot.workflows.metrics import Score
from campaigns.compensation import identified_robot
from campaigns.section import Section

ALTEN = Robot.load("alten")
SAMPLE_TIME = 0.005
SEEDS = (700, 701, 702)
#: whole samples by which torques come late
DELAYS = (0, 2, 4, 8, 12)

#: by the name in the table
CONTROLLERS: Mapping[str, Callable[[Robot], Controller]] = {
    "nominal, full": partial(nominal_controller, compensation="full"),
    "precise": precise_controller,
}
#: what is taken for the delay, less the delay itself, in samples; None predicts nothing
BELIEFS: Mapping[str, int | None] = {
    "no prediction": None,
    "prediction": 0,
    "a sample too little": -1,
    "a sample too much": 1,
}


def controller_for(known: Robot, name: str, belief: str, delay: int) -> Controller | None:
    """Return a controller that assumes a delay; None if a controller cannot have that delay."""
    plain, off = CONTROLLERS[name](known), BELIEFS[belief]
    if off is None:
        return plain
    if delay == 0 or delay + off < 1:
        return None
    prediction = DelayPrediction(delay=(delay + off) * SAMPLE_TIME)
    return plain.with_parts(replace(plain.parts, prediction=prediction))


def compared_run(known: Robot, name: str, belief: str, delay: int, seed: int) -> GridRun | None:
    """Return a run once around the square on the nominal twin, torques late; None if there is no such controller."""
    controller = controller_for(known, name, belief, delay)
    if controller is None:
        return None
    return GridRun(
        candidate=f"{name}, {belief}",
        controller=controller,
        condition=Condition(
            plant=partial(_twin, delay),
            reference=partial(square, side=0.5, period=32.0),
            duration=32.0,
            seed=seed,
            course=f"{delay} samples late",
        ),
    )


def _twin(delay: int, _: EstimatorName) -> Twin:
    scenario = replace(Scenario.nominal(ALTEN), timing=Timing(delay=delay))
    return Twin(ALTEN, scenario, estimator=named_estimator("kalman", ALTEN, sample_time=SAMPLE_TIME))


def largest_lean(robot: Robot, controller: Controller, delay: int) -> float:
    """Return the largest lean [degrees] from which the exact model comes back, of one in every 0.25 degrees."""
    leans = np.arange(0.25, 40.1, 0.25)
    starts = np.zeros((len(leans), 10))
    starts[:, 2] = np.radians(leans)
    batch = simulate_batch(
        Model(robot),
        controller,
        hold(),
        duration=8.0,
        initial_states=starts,
        imperfections=[Imperfections(delay=delay)],
    )
    fell = np.isfinite(batch.ended)
    return float(leans[np.argmax(fell)] - 0.25) if fell.any() else float(leans[-1])


def campaign() -> Section:
    """Run everything with every seed and return the table."""
    known = identified_robot(ALTEN)
    runs = [
        compared_run(known, name, belief, delay, seed)
        for name in CONTROLLERS
        for belief in BELIEFS
        for delay in DELAYS
        for seed in SEEDS
    ]
    found = run_grid([one for one in runs if one is not None])
    rows = []
    for name in CONTROLLERS:
        for delay in DELAYS:
            for belief in BELIEFS:
                controller = controller_for(known, name, belief, delay)
                if controller is not None:
                    scores = found.of(f"{name}, {belief}", f"{delay} samples late")
                    lean = largest_lean(known, controller, delay)
                    rows.append(_row(name, belief, delay, scores, lean))
    return Section(
        title="Delayed torques",
        before=f"The nominal twin with delayed torques, friction identified from two of its logs, on-board "
        f"sensors only (Kalman filter), {len(SEEDS)} seeds of 32 s of a 0.5 m square: RMS error of the true position "
        "once settled and its peak [mm], torque above 10 Hz [N m], means. `prediction` feeds back the predicted state "
        "at which the torque acts (`ballbot.control.parts.prediction`); the last two rows of each delay assume a "
        "sample less or more. Lean: the largest at rest from which the exact model with known friction recovers with "
        "the same delay.",
        columns=[
            "controller, delay",
            "RMS",
            "peak",
            "torque above 10 Hz",
            "lean [deg]",
            "falls",
        ],
        rows=rows,
    )


def _row(name: str, belief: str, delay: int, scores: Sequence[Score], lean: float) -> list[str]:
    stood = [one for one in scores if one.ended is None]

    def mean(values: Sequence[float], form: str) -> str:
        return format(float(np.mean(values)), form) if values else "-"

    return [
        f"{name}, {1e3 * SAMPLE_TIME * delay:.0f} ms, {belief}",
        mean([1e3 * one.rms_position_error for one in stood], ".1f"),
        mean([1e3 * one.peak_position_error for one in stood], ".1f"),
        mean([one.high_frequency_torque for one in stood], ".3f"),
        f"{lean:.2f}",
        f"{len(scores) - len(stood)} of {len(scores)}",
    ]
