"""Whether the physics-engine twin agrees with the compiled loop on the controller that a study chose.

The loop has no slip and, with identified friction, no rollers. So the chosen controller and the soft gain run on the
twin too, on the first robots that were drawn, and stand beside the same course on the loop. The twin contradicts the
loop if a run falls there that falls nowhere on the loop, or if on the twin the other of the two is better.

The rolling friction under the twin needs care. An identified C_rr is effective: it contains what the rollers' bumps and
gaps, play and noise take from the ball, and the twin has rollers, play and noise of its own. With the identified C_rr
on its floor it would have them twice. So the twin, with the identified friction and a trial floor, is driven by the
nominal controller, and its log is identified as the robot's were. What it gives above the trial floor is the twin's own
share:

    added = C_rr(log of the twin) - C_rr(floor of the twin)          floor = max(C_rr(robot's logs) - added, 0)

The share hardly depends on the floor (`python -m campaigns.evidence effective` has it for the twin's faults), so one
trial, with half of the identified C_rr, is enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import named_reference
from ballbot.errors import InputError
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification import Identification
from ballbot.identification.parameters import scale_between
from ballbot.identification.quantities import FRICTION
from ballbot.identification.stages import INNER_STEP, IdentificationOptions, prepare, refine
from ballbot.progress import ignore_progress
from ballbot.robot import Friction
from ballbot.simulation.run import simulate
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.comparison import Comparison, run_comparison
from ballbot.workflows.controller_choice import ControllerChoice, NamedCourse, PlantDraw, Trial, loop_run

#: of the log that shows what the twin adds [s]; the share varies by a tenth between seeds
_DURATION = 24.0
#: two sides of the square: twice the last two seconds of a side count
CONFIRMED_ON = NamedCourse(name="square", duration=16.0)
#: robots on which the twin runs
CONFIRMED_RUNS = 3


@dataclass(frozen=True, kw_only=True)
class TwinRolling:
    """The C_rr that the robot's logs gave, and how the twin comes to it."""

    identified: float  #: by the robot's logs
    added: (
        float  #: what the twin's rollers, play and noise add to that of its floor; NaN if its log shows none
    )

    def on_twin(self, friction: Friction) -> Friction:
        """Return a robot's friction with the rolling friction that the floor under its twin has."""
        return replace(friction, rolling=max(friction.rolling - np.nan_to_num(self.added), 0.0))


def twin_rolling(found: Identification, scenario: Scenario, *, run: Run = DEFAULT_RUN) -> TwinRolling:
    """Return the rolling friction for the twin's floor.

    Parameters
    ----------
    found : Identification
        By the robot's logs.
    scenario : Scenario
        Of the twin; its friction is not used.
    run : Run, optional
        Its seed draws the twin's noise.
    """
    identified = found.robot.friction.rolling
    if not np.isfinite(found.parameters["C_rr"]) or identified == 0.0:
        return TwinRolling(identified=identified, added=0.0)
    return TwinRolling(identified=identified, added=_added(found, scenario, run))


def _added(found: Identification, scenario: Scenario, run: Run) -> float:
    """Return by how much C_rr of the twin's log is above that of its floor."""
    robot, trial = found.robot, 0.5 * found.robot.friction.rolling
    friction = replace(robot.friction, rolling=trial)
    gain = design_gain(robot, sample_time=scenario.sensors.sample_time).gain
    log = simulate(
        Twin(robot, replace(scenario, friction=friction)),
        Controller(robot, gain, sample_time=scenario.sensors.sample_time),
        named_reference("square"),
        duration=_DURATION,
        seed=run.seed,
        progress=ignore_progress,
    ).without_truth()
    options = IdentificationOptions(excluded_states=found.excluded_states)
    coordinates = scale_between(robot, free=FRICTION)
    predictor = replace(found.predictor, step=INNER_STEP, layout=coordinates.layout)
    try:
        prepared = prepare(predictor, coordinates, [log], window=found.window, options=options, run=run)
    except InputError:  # the twin fell, or hardly moved
        return np.nan
    begin = coordinates.scaled(
        np.clip(coordinates.layout.nominal(robot), coordinates.lower, coordinates.upper)
    )
    estimate = refine(prepared, begin, options=options, run=replace(run, progress=ignore_progress))
    place = coordinates.labels.index("C_rr")
    return float(estimate.values[place] - trial) if not estimate.unknown[place] else np.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class Confirmation:
    """The chosen controller and the soft gain on the twin and on the loop."""

    course: NamedCourse
    rolling: TwinRolling  #: of the twins' floor
    on_loop: Mapping[str, Trial]  #: by candidate, on every robot drawn
    on_twin: Mapping[str, Trial]  #: on the first of them

    @property
    def contradiction(self) -> str | None:
        """What the twin contradicts, in a sentence; None if it does not."""
        for name, trial in self.on_twin.items():
            if trial.falls and not self.on_loop[name].falls:
                return (
                    f"On the physics-engine twin the candidate {name} fell in {trial.falls} of "
                    f"{len(trial.scores)} runs, and in none on the compiled loop: do not trust this choice."
                )
        names = list(self.on_twin)
        if len(names) == 2:
            soft, chosen = names
            loop, twin = (on[soft].ratio_to(on[chosen]) for on in (self.on_loop, self.on_twin))
            if twin.runs and loop.low > 1.0 > twin.high:
                return (
                    f"On the physics-engine twin the candidate {chosen} was worse than {soft} in every run, and better "
                    "on the compiled loop: do not trust this choice."
                )
        return None


def confirm(
    found: Identification, choice: ControllerChoice, *, run: Run = DEFAULT_RUN
) -> Confirmation | None:
    """Run the chosen controller and the soft gain on the twin.

    Parameters
    ----------
    found : Identification
        The robots of the choice were drawn from it.
    choice : ControllerChoice
    run : Run, optional
        Its seed draws the noise of the log that shows what the twin's rollers add.

    Returns
    -------
    Confirmation or None
        None if every candidate fell.

    Raises
    ------
    InputError
        If the twin cannot be made.
    """
    if choice.chosen is None:
        return None
    rolling = twin_rolling(found, choice.plants[0].scenario, run=run)
    names = tuple(dict.fromkeys(("none", choice.chosen)))
    few = choice.plants[:CONFIRMED_RUNS]
    runs = [
        loop_run(name, choice.trials[name].controller, plant, CONFIRMED_ON)
        for name in names
        for plant in choice.plants
    ]
    twins = [
        replace(
            loop_run(name, choice.trials[name].controller, plant, CONFIRMED_ON),
            plant=partial(_twin, plant, rolling),
        )
        for name in names
        for plant in few
    ]
    return Confirmation(
        course=CONFIRMED_ON,
        rolling=rolling,
        on_loop=_trials(choice, names, run_comparison(runs, run=replace(run, progress=ignore_progress))),
        on_twin=_trials(choice, names, run_comparison(twins, run=run)),
    )


def _trials(choice: ControllerChoice, names: Sequence[str], made: Comparison) -> dict[str, Trial]:
    return {
        name: Trial.of(choice.trials[name].controller, made.of(name, CONFIRMED_ON.name)) for name in names
    }


def _twin(plant: PlantDraw, rolling: TwinRolling, estimator: EstimatorName) -> Twin:
    scenario = replace(plant.scenario, friction=rolling.on_twin(plant.robot.friction))
    state = named_estimator(estimator, plant.known, sample_time=scenario.sensors.sample_time)
    return Twin(plant.robot, scenario, estimator=state)
