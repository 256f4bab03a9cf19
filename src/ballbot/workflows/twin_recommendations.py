"""The recommendations of the thesis (chapter 6 and Appendix IV) on the twin, before and after with the same seeds.

Single-row wheels, a stiffer ball, gearboxes with less play, and an external fix that is fused with the on-board
sensors, one at a time and together. The nominal twin has two rows, a hard ball, 1 degree of play and on-board sensors
only; the effect of a stiffer ball is therefore its difference to a softer one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ballbot.control.controller import Compensation
from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.progress import ProgressCallback, ignore_progress, in_stage
from ballbot.robot import Robot
from ballbot.simulation.sensors import FixSource
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.comparison import Comparison, compare

#: the controllers: without compensation, and with the better of the thesis's two, of the true friction
COMPENSATIONS: tuple[Compensation, ...] = ("none", "partial")

#: the name of the robot that the others are compared with
NOMINAL = "nominal: hard ball"

_LESS_PLAY = math.radians(0.1)  # of a precision gearbox
_FIX = FixSource(rate=10.0)


@dataclass(frozen=True, kw_only=True)
class Variant:
    """The nominal robot with a recommendation applied."""

    name: str
    scenario: Scenario
    estimator: EstimatorName = "onboard"

    def twin(self, robot: Robot) -> Twin:
        """Return the twin of this variant."""
        sample_time = self.scenario.sensors.sample_time
        estimator = named_estimator(self.estimator, robot, sample_time=sample_time)
        return Twin(robot, self.scenario, estimator=estimator)


def variants(robot: Robot) -> list[Variant]:
    """Return the nominal robot, a softer ball, and each recommendation by itself and all together."""
    nominal = Scenario.nominal(robot)
    single_row = Scenario.named("single_row", robot)
    return [
        Variant(name="softer ball, 30 kN/m", scenario=Scenario.named("soft_ball", robot)),
        Variant(name=NOMINAL, scenario=nominal),
        Variant(name="single-row wheels", scenario=single_row),
        Variant(name="play 0.1 degrees", scenario=replace(nominal, backlash=_LESS_PLAY)),
        Variant(name="fix at 10 Hz, fused", scenario=replace(nominal, fix=_FIX), estimator="kalman"),
        Variant(
            name="all of these",
            scenario=replace(single_row, backlash=_LESS_PLAY, fix=_FIX),
            estimator="kalman",
        ),
    ]


def try_recommendations(
    robot: Robot,
    *,
    seeds: Sequence[int],
    duration: float = 64.0,
    threads: int = 1,
    progress: ProgressCallback = ignore_progress,
) -> dict[str, Comparison]:
    """Run every variant around a square of 0.5 m and return its scores with and without compensation, by name.

    Parameters
    ----------
    robot : Robot
    seeds : sequence of int
    duration : float
        Duration of a run [s].
    threads : int
        Runs at a time.
    progress : callable, optional
        Called with the progress of each variant's runs.
    """
    with_true_friction = robot.replace(friction=Scenario.nominal(robot).friction)
    controllers = {kind: nominal_controller(with_true_friction, compensation=kind) for kind in COMPENSATIONS}
    every = variants(robot)
    found: dict[str, Comparison] = {}
    for variant in every:
        found[variant.name] = compare(
            lambda variant=variant: variant.twin(robot),
            controllers,
            square(side=0.5, period=32.0),
            duration=duration,
            seeds=seeds,
            threads=threads,
            progress=in_stage(progress, variant.name),
        )
    return found


HEADINGS = (
    "robot",
    "RMS [m]",
    "peak [m]",
    "RMS, compensated [m]",
    "peak, compensated [m]",
    "torque noise [N m]",
    "compensated [N m]",
    "falls",
)


def rows(found: Mapping[str, Comparison]) -> list[list[str]]:
    """Return the table's rows: means over the seeds; torque noise is the RMS change from sample to sample."""
    table = []
    for name, comparison in found.items():
        none, partial = (comparison.summary(kind) for kind in COMPENSATIONS)
        numbers = [
            none.rms_position_error,
            none.peak_position_error,
            partial.rms_position_error,
            partial.peak_position_error,
            none.rms_torque_change,
            partial.rms_torque_change,
        ]
        table.append([name, *(f"{one:.3f}" for one in numbers), f"{none.falls + partial.falls}"])
    return table
