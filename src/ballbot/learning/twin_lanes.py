"""The tasks on the physics engine: twins in place of the compiled loop's robots, one after another, called from Python.

Starts, commands, rewards and observations are computed by the same compiled code from the same streams.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.learning.lanes import LaneArrays
from ballbot.robot import Robot
from ballbot.simulation.imperfections import Grip
from ballbot.simulation.loop import ADVANCED, STARTED
from ballbot.simulation.plant import Measurement
from ballbot.twin.faults import Timing
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import BodyForce, Twin
from ballbot.workflows.grid import LoopRobot


def twin_scenario(drawn: LoopRobot, scenario: Scenario) -> Scenario:
    """Return the scenario in which a twin has friction, delay, floor and grip of a robot that was drawn."""
    given = drawn.imperfections
    (along, across), delay, jitter = given.slope, given.delay, given.jitter
    about_x = math.atan(across)
    grip = given.grip or Grip(wheels=scenario.roller_grip, floor=scenario.floor_grip)
    timing = Timing(delay=delay, jitter=jitter) if delay or jitter else None
    return replace(
        with_identified(scenario, drawn.model.robot.friction),
        timing=timing,
        roller_grip=grip.wheels,
        floor_grip=grip.floor,
        floor_tilt=(about_x, -math.atan(along * math.cos(about_x))),
        payload=None,  # the robot that was drawn carries it
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Twins:
    """Moves the robots of `TaskLanes` on the physics engine: its `move`.

    A scenario's own pushes act only if the task has none. InputError, when a lane starts, if MuJoCo is not installed.
    """

    #: the robots that episodes draw from, in the order of the lanes' robots, each with its scenario
    twins: Sequence[tuple[Robot, Scenario]]
    known: Robot  #: by the estimator
    estimator: EstimatorName | None = "kalman"
    _placed: dict[tuple[int, int], tuple[Twin, BodyForce]] = field(default_factory=dict, init=False)

    def __call__(self, world: LaneArrays) -> None:
        """Move lanes that are advanced on by a sample, and set lanes that are started to their start."""
        for lane in np.flatnonzero(world.commands.todo == ADVANCED).tolist():
            self._move(world, lane)
        for lane in np.flatnonzero(world.commands.todo == STARTED).tolist():
            self._reset(world, lane)

    def _of(self, world: LaneArrays, lane: int) -> tuple[Twin, BodyForce]:
        """Return the twin of a lane's robot, built where the lane first has this robot, and the pushes on it."""
        which = int(world.episodes.drawn[lane])
        if (lane, which) not in self._placed:
            robot, scenario = self.twins[which]
            if world.task.impulse > 0.0:
                scenario = replace(scenario, pushes=())
            name, sample_time = self.estimator or "onboard", world.task.sample_time
            twin = Twin(robot, scenario, estimator=named_estimator(name, self.known, sample_time=sample_time))
            self._placed[lane, which] = twin, BodyForce(twin.engine)
        return self._placed[lane, which]

    def _reset(self, world: LaneArrays, lane: int) -> None:
        for memory in (world.memory.laws, world.memory.commanded, world.memory.last):
            memory[lane] = 0.0
        seed = int(world.episodes.streams[lane, 0] >> np.uint64(33))
        twin, push = self._of(world, lane)
        if world.task.impulse > 0.0:
            push.clear()
        self._take(world, lane, twin.reset(world.inputs.initial[lane], seed=seed))

    def _move(self, world: LaneArrays, lane: int) -> None:
        (twin, push), age = self._of(world, lane), int(world.commands.ages[lane])
        world.commands.ages[lane] += 1
        if world.task.impulse > 0.0:
            begin, end, *force, height = world.inputs.pushes[lane, 0].tolist()
            push.clear()
            if begin <= age < end:
                push.add(force, height)
        measured = twin.step(world.memory.commanded[lane], world.task.sample_time)
        if measured.ended:
            world.out.ended[lane] = age + 1
        self._take(world, lane, measured)

    def _take(self, world: LaneArrays, lane: int, measured: Measurement) -> None:
        truth = measured.state if measured.truth is None else measured.truth
        world.memory.truths[lane] = truth
        world.memory.states[lane] = truth if self.estimator is None else measured.state
