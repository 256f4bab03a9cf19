"""The rolling friction under the twin, so that its logs give the C_rr that the robot's logs gave.

An identified C_rr is effective: it contains what the rollers' bumps and gaps, play and noise take from the ball. The
twin has rollers, play and noise of its own. With the identified C_rr on its floor it would have them twice, and a
controller would be judged on robots that roll worse than any.

So the twin, with the identified friction and a trial floor, is driven by the nominal controller, and its log is
identified as the robot's were. What it gives above the trial floor is the twin's own share:

    added = C_rr(log of the twin) - C_rr(floor of the twin)          floor = max(C_rr(robot's logs) - added, 0)

The share hardly depends on the floor (`python -m campaigns.evidence effective` has it for the twin's faults), so one
trial, with half of the identified C_rr, is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import named_reference
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification import Identification
from ballbot.identification.parameters import scale_between
from ballbot.identification.quantities import FRICTION
from ballbot.identification.stages import (
    EVOLUTION_STEP,
    IdentificationOptions,
    prepare,
    refine,
)
from ballbot.robot import Friction
from ballbot.simulation.run import simulate
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin

#: of the twin's log [s]; with 24 s the share varies by a tenth between seeds
_DURATION = 48.0


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
    """Return by how much C_rr of the twin's log is above that of its floor; NaN if the log does not show it."""
    robot, trial = found.robot, 0.5 * found.robot.friction.rolling
    friction = replace(robot.friction, rolling=trial)
    gain = design_gain(robot, sample_time=scenario.sensors.sample_time).gain
    log = simulate(
        Twin(robot, replace(scenario, friction=friction)),
        Controller(robot, gain, sample_time=scenario.sensors.sample_time),
        named_reference("square"),
        duration=_DURATION,
        seed=run.seed,
        progress=run.progress,
    ).without_truth()
    options = IdentificationOptions(excluded_states=found.excluded_states)
    coordinates = scale_between(robot, free=FRICTION)
    predictor = replace(found.predictor, step=EVOLUTION_STEP, layout=coordinates.layout)
    try:
        prepared = prepare(predictor, coordinates, [log], window=found.window, options=options, run=run)
    except InputError:  # the twin fell, or hardly moved
        return np.nan
    begin = coordinates.scaled(
        np.clip(coordinates.layout.nominal(robot), coordinates.lower, coordinates.upper)
    )
    estimate = refine(prepared, begin, options=options, run=run)
    place = coordinates.labels.index("C_rr")
    return np.nan if estimate.unknown[place] else float(estimate.values[place] - trial)
