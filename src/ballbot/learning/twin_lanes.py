"""The tasks on the physics engine: twins in place of the compiled loop's robots, one after another, called from Python.

Starts, commands, rewards and observations are computed by the same compiled code from the same streams.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.law import LIMIT_AT, control_law
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.learning.lanes import BEGIN, END, KEPT, OBSERVE, REPEAT, START, TAKE, TaskLanes
from ballbot.learning.tasks import Task
from ballbot.robot import Robot
from ballbot.simulation.loop import ADVANCED, STARTED
from ballbot.simulation.plant import Measurement
from ballbot.twin.faults import Timing
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import BodyForce, Twin
from ballbot.workflows.grid import LoopRobot


def twin_scenario(drawn: LoopRobot, scenario: Scenario) -> Scenario:
    """Return the scenario in which a twin has the friction, the delay and the floor of a robot that was drawn."""
    borne = drawn.imperfections
    about_x = math.atan(borne.slope[1])
    timing = Timing(delay=borne.delay, jitter=borne.jitter) if borne.delay or borne.jitter else None
    return replace(
        with_identified(scenario, drawn.model.robot.friction),
        timing=timing,
        floor_tilt=(about_x, -math.atan(borne.slope[0] * math.cos(about_x))),
        payload=None,  # the robot that was drawn carries it
    )


@dataclass(eq=False)
class _Placed:
    """A twin, and the force of a task's pushes on it."""

    twin: Twin
    push: BodyForce


class TwinLanes(TaskLanes):
    """Twins that do a task; they are used as `TaskLanes` are.

    `twins` are the robots of `robots` on the physics engine, in the same order, each with its scenario. A scenario's
    own pushes act only if the task has none. InputError as of `TaskLanes`, or if MuJoCo is not installed.
    """

    def __init__(
        self,
        robots: Sequence[LoopRobot],
        twins: Sequence[tuple[Robot, Scenario]],
        task: Task,
        *,
        lanes: int,
        base: Controller | None = None,
        estimator: EstimatorName | None = "kalman",
        repeat: int = REPEAT,
    ) -> None:
        super().__init__(robots, task, lanes=lanes, base=base, estimator=estimator, repeat=repeat, threads=1)
        self._known, self._sees_truth = twins, estimator is None
        self._shown_by: EstimatorName = "onboard" if estimator is None else estimator
        self._law = base.packed if base else None
        self._placed: dict[tuple[int, int], _Placed] = {}

    def _play(self, parts: int, ending: int, samples: int) -> None:
        if parts & TAKE:
            super()._play(TAKE, ending, 0)
        for _ in range(samples):
            super()._play(BEGIN, KEPT, 1)
            for lane in np.flatnonzero(self._world.commands.todo == ADVANCED).tolist():
                self._move(lane)
            super()._play(END, KEPT, 1)
        if parts & START:
            super()._play(START, ending, 0)
            for lane in np.flatnonzero(self._world.commands.todo == STARTED).tolist():
                self._reset(lane)
        if parts & OBSERVE:
            super()._play(OBSERVE, KEPT, 0)

    def _of(self, lane: int) -> _Placed:
        """Return the twin of a lane's robot; it is built where the lane has this robot for the first time."""
        which = int(self._world.episodes.drawn[lane])
        if (lane, which) not in self._placed:
            robot, scenario = self._known[which]
            if self.task.impulse > 0.0:
                scenario = replace(scenario, pushes=())
            estimator = named_estimator(self._shown_by, self.robot, sample_time=self.sample_time)
            twin = Twin(robot, scenario, estimator=estimator)
            self._placed[lane, which] = _Placed(twin, BodyForce(twin.engine))
        return self._placed[lane, which]

    def _reset(self, lane: int) -> None:
        for memory in (self._world.blocks.memories, self._world.blocks.commanded, self._world.blocks.last):
            memory[lane] = 0.0
        seed = int(self._world.episodes.streams[lane, 0] >> np.uint64(33))
        placed = self._of(lane)
        if self.task.impulse > 0.0:
            placed.push.clear()
        self._take(lane, placed.twin.reset(self._world.inputs.initial[lane], seed=seed))

    def _move(self, lane: int) -> None:
        """Move a lane's twin on by a sample."""
        placed, age = self._of(lane), int(self.ages[lane])
        torques, last = self._world.blocks.commanded[lane], self._world.blocks.last[lane]
        last[:] = torques
        torques[:] = self._world.commands.torques[lane]
        if self._law is not None:
            memory, own = self._world.blocks.memories[lane], np.zeros(self.wheels)
            control_law(self._law, memory, self.states[lane], self._world.commands.references[lane], own)
            limit = self._law[LIMIT_AT]
            torques[:] = np.clip(torques + own, -limit, limit)
            memory[: self.wheels] = torques  # the law's history begins with the torques that act
        if self.task.impulse > 0.0:
            begin, end, *force, height = self._world.inputs.pushes[lane, 0].tolist()
            placed.push.clear()
            if begin <= age < end:
                placed.push.add(force, height)
        measured = placed.twin.step(torques, self.sample_time)
        if measured.ended:
            self._world.out.ended[lane] = age + 1
        self._take(lane, measured)

    def _take(self, lane: int, measured: Measurement) -> None:
        truth = measured.state if measured.truth is None else measured.truth
        self.truths[lane] = truth
        self.states[lane] = truth if self._sees_truth else measured.state
