"""Falls that changes of a running controller add, over random changes, references and pushes.

.venv/bin/python -m campaigns.evidence tune_sequences

The rule: five presets with the nominal and the precise controller, each with a second gain that shares a Lyapunov
function with its own, as `ballbot export --with` demands. The robots are drawn from the presets' default errors, with 0.8
to 1.2 times the friction that the controller knows. A run lasts 16 s; every 4 s the reference jumps, twice the body is
pushed by 50 to 90 % of what this robot recovers from at rest in this direction with the exported setting, and about once
a second the setting changes: any mixture, any compensation, or a step back. The same run without the changes tells which
falls the changes add.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from ballbot.control.controller import Controller
from ballbot.control.gain_set import certified, tunable
from ballbot.control.law import MEMORY_TYPE, law_code
from ballbot.control.lqr import LqrDesign
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.tuning import Setting, take_setting
from ballbot.errors import InputError
from ballbot.estimation.kalman import filter_row
from ballbot.estimation.kalman_model import sample_code
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.run import code_of
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.robot.variations import draw_robots, with_default_errors
from ballbot.simulation.batch import OutcomeBounds, simulate_batch
from ballbot.simulation.draws import bump_table, draws_of, empty_outcome, push_table
from ballbot.simulation.imperfections import LOOP, Imperfections, Push, loop_record, packed_on_floor
from ballbot.simulation.loop import Inputs, Sampling, new_block, run_block
from ballbot.simulation.model_plant import lift_off, pack_contacts
from ballbot.simulation.run import initial_state_of, sample_count
from ballbot.twin import Scenario
from campaigns.section import Section

PRESETS = ("alten", "rob311", "kugle", "rezero", "cmu")
#: of everything random, and the runs of each preset and kind
SEED, RUNS = 6804, 100
DURATION, JUMP_EVERY = 16.0, 4.0  # [s]
#: largest jumps of x and y [m], and of the heading [rad]
JUMP, TURN = 0.3, 0.5
#: mean time between two changes, and the time on whose multiples they come [s]
CHANGES_EVERY, CHUNK = 1.0, 0.25
PUSHES = ((2.0, 6.0), (9.0, 13.0))  # between which each begins [s]
PUSH_DURATION, PUSHED = 0.1, (0.5, 0.9)
#: break-away torque over the motors' limit
BREAKAWAY = 0.03
#: of the search for the largest push
_HALVINGS, _HORIZON = 7, 5.0
#: lean beyond which a robot has fallen [rad]
FALLEN = 0.6
#: the second gain is this much of the way to one that is softer by half, or less until the gains share a function
SOFTER = (1.0, 0.5, 0.25)


@dataclass(frozen=True, kw_only=True)
class Counted:
    """The runs of a preset with a kind of controller."""

    name: str
    runs: int
    untuned: int  #: falls without changes
    added: int  #: falls of runs that did not fall without
    spared: int  #: runs that fell without changes only
    changes: int  #: that were made


def upper_bound(count: int, runs: int) -> float:
    """Return the upper 95 % bound of a share, one-sided (Clopper and Pearson)."""
    return 1.0 if count == runs else float(beta.ppf(0.95, count + 1, runs - count))


def designed(preset: str, kind: str) -> Controller:
    """Return a preset's controller with friction that it compensates, and a second gain."""
    robot = Robot.load(preset)
    friction = Scenario.nominal(robot).friction
    share = BREAKAWAY * robot.drive.torque_limit / max(friction.breakaway)
    robot = robot.replace(friction=scaled_friction(friction, share))
    if kind == "nominal":
        own = nominal_controller(robot, compensation="partial")
    else:
        own = precise_controller(robot)
    for share in SOFTER:
        controller = tunable(own, [softer(own, 1.0 - 0.5 * share)])
        try:
            certified(controller)
        except InputError:
            continue
        return controller
    raise InputError(f"{preset}, {kind}: no softer gain shares a Lyapunov function with its own.")


def softer(own: Controller, factor: float) -> Controller:
    """Return a controller whose gains for position, heading and their integrals are smaller by a factor."""
    other = own.with_parts(own.parts)
    scale = np.ones(10)
    scale[[0, 1, 4]], scale[[5, 6, 9]] = factor, np.sqrt(factor)
    other.record["gain"][0] *= scale
    other.record["integral"]["gain"][0] *= factor
    other.record["lean_limit"]["asked"][0] *= scale[[0, 1, 5, 6]]
    return other
