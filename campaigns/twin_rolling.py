"""Whether a study's twins roll as the robot does: the floor found from logs of a twin whose floor is known.

.venv/bin/python -m campaigns.evidence twin_rolling

The logs and their fits are those of `campaigns.between_logs`, kept in build/between_logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import design_integral_gain, precise_controller
from ballbot.control.references import named_reference
from ballbot.estimation import named_estimator
from ballbot.fitting.run import Run, Threads
from ballbot.identification import Identification
from ballbot.identification.prediction import Predictor
from ballbot.identification.result import estimated_robot
from ballbot.robot import Friction, Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin
from ballbot.workflows.metrics import score
from ballbot.workflows.twin_confirmation import TwinRolling, twin_rolling
from campaigns.between_logs import NOMINAL, ROBOT, fit_of, nominal_log
from campaigns.section import Section

SEEDS = range(1, 11)


def found_from(seed: int) -> Identification:
    """Return as much of an identification from the nominal twin's log of a seed as `twin_rolling` reads."""
    fit = fit_of(nominal_log(seed), f"nominal_{seed:02d}")
    layout = fit.coordinates.layout
    values = np.where(np.isfinite(fit.values), fit.values, fit.coordinates.nominal)
    robot = estimated_robot(ROBOT, layout, values, asymmetric=False)
    found = SimpleNamespace(
        robot=robot,
        values=values,
        parameters={"C_rr": robot.friction.rolling},
        window=0.25,
        excluded_states=(),
        predictor=Predictor(robot=robot, formulation="exact", step=1e-3, layout=layout, threads=1),
    )
    return cast(Identification, found)


def rolling_from(seed: int) -> TwinRolling:
    """Return what a study would do with the log of a seed; the study's own seed is another one."""
    run = Run(seed=1000 + seed, executor=Threads(count=1))
    return twin_rolling(found_from(seed), NOMINAL, run=run)


def peak(controller: Controller, known: Robot, friction: Friction, seed: int) -> float:
    """Return the largest distance from the square [mm] of a twin with this friction."""
    state = named_estimator("kalman", known, sample_time=NOMINAL.sensors.sample_time)
    twin = Twin(ROBOT, replace(NOMINAL, friction=friction), estimator=state)
    log = simulate(twin, controller, named_reference("square"), duration=32.0, seed=seed)
    return 1e3 * score(log).peak_position_error


def campaign(seeds: Sequence[int] = SEEDS) -> Section:
    """Return the section of docs/generated/evidence.md."""
    rows, floors = [], []
    for seed in seeds:
        found, rolling = found_from(seed), rolling_from(seed)
        known = found.robot
        controller = precise_controller(known, design=design_integral_gain(known, sample_time=0.005))
        matched = rolling.on_twin(known.friction)
        floors.append(matched.rolling)
        peaks = [
            peak(controller, known, friction, 2000 + seed)
            for friction in (NOMINAL.friction, known.friction, matched)
        ]
        rows.append(
            [str(seed), f"{rolling.identified:.4f}", f"{rolling.added:.4f}", f"{matched.rolling:.4f}"]
            + [f"{one:.1f}" for one in peaks]
        )
    true = NOMINAL.friction.rolling
    return Section(
        title="Rolling friction under the twins of a study",
        before=f"Ten logs of 48 s of the nominal twin around the square, whose floor has C_rr {true:g}, each "
        "identified as by `ballbot identify`. `ballbot study` takes what the twin itself adds to C_rr off the floor of "
        "its twins. "
        "Then the precise controller, designed for the identified robot, once around the square: largest distance from "
        "the reference on the nominal twin, on one with the identified friction, and on one with the floor found.",
        columns=[
            "seed",
            "C_rr identified",
            "the twin adds",
            "C_rr of the floor",
            "nominal [mm]",
            "identified [mm]",
            "floor found [mm]",
        ],
        rows=rows,
        after=f"The floor found is {np.mean(floors):.4f} in the mean, with a standard deviation of "
        f"{np.std(floors, ddof=1):.4f}; the true one is {true:g}.",
    )
