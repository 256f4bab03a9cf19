"""Many robots side by side on the compiled loop, commanded from outside: what every environment and training runs on."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.law import law_code
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName
from ballbot.estimation.kalman import filter_row
from ballbot.estimation.kalman_model import sample_code
from ballbot.learning.tasks import HISTORY, SCALES, Task, observation_size, observe, pay
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.play import play_code_of
from ballbot.mechanics.engine.run import code_of
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.simulation.draws import empty_outcome
from ballbot.simulation.imperfections import LOOP, loop_record, packed_on_floor
from ballbot.simulation.loop import ADVANCED, LEFT, STARTED, Commands, Draws, Inputs, Sampling, advance_lanes, new_blocks
from ballbot.simulation.model_plant import lift_off, pack_contacts
from ballbot.workflows.grid import LoopRobot

Floats = NDArray[np.float64]

#: samples of random numbers that are drawn at a time
DRAWN = 32
#: samples for which a policy's torques are held: it decides at 100 Hz where the loop has 200
REPEAT = 2


class Lanes:
    """Robots that do a task, each with its own episode; each is one of `robots`, drawn at its start.

    All that is random of a lane follows from its seed. The arrays `observations` (lanes, size), `rewards` (lanes,),
    `fallen`, `ended` (lanes,) and `truths` (lanes, 10) are filled by `step`, in place.

    InputError if robots differ in kind, or the estimator's sample time is not the loop's.
    """

    def __init__(
        self,
        robots: Sequence[LoopRobot],
        task: Task,
        *,
        lanes: int,
        seed: int = 0,
        base: Controller | None = None,
        estimator: EstimatorName | None = "kalman",
        repeat: int = REPEAT,
        threads: int | None = None,
    ) -> None:
        first = robots[0]
        known = first.imperfections.known or first.model.robot
        self.task, self.robot, self.lanes = task, known, lanes
        self.sample_time, self.repeat = known.sensors.sample_time, repeat
        self.wheels = n = known.wheel_count
        self.torque_limit = known.drive.torque_limit
        self.steps_in_episode = round(task.duration / self.sample_time)
        self._pool = self._rows(robots, estimator)
        self._selected = first.model.selected
        filters = np.empty((0, 0))
        if estimator == "kalman":
            filters = filter_row(known, sample_time=self.sample_time)[None]
        plays = any(robot.imperfections.backlash > 0.0 for robot in robots)
        self._inputs = Inputs(
            code=code_of(self._selected),
            play_code=play_code_of(self._selected) if plays else 0,
            law_code=law_code() if base else 0,
            filter_code=sample_code() if len(filters) else 0,
            parameters=np.repeat(self._pool[0][:1], lanes, axis=0),
            lift_offs=np.repeat(self._pool[1][:1], lanes),
            laws=base.packed[None].copy() if base else np.zeros((1, 0)),
            loops=np.repeat(self._pool[2][:1], lanes),
            filters=filters,
            contacts=np.repeat(self._pool[3][:1], lanes, axis=0),
            initial=np.zeros((lanes, 10)),
            pushes=np.zeros((lanes, 1 if task.impulse else 0, 6)),
            bumps=np.zeros((1, 0, 4)),
        )
        self._sampling = Sampling(
            references=np.zeros((1, 10)),
            sample_time=self.sample_time,
            steps=first.model.steps_in(self.sample_time),
            every=1,
            settled=np.zeros((0, 10)),
            lost=LARGEST_LEAN,
            grip=np.inf,
        )
        noisy = any(robot.imperfections.random for robot in robots)
        faulty = any(robot.imperfections.sensor_faults is not None for robot in robots)
        self._draws = Draws(
            noise=np.zeros((lanes, DRAWN * (6 + n) if noisy else 0)),
            faults=np.zeros((lanes, 5 * (DRAWN + 1) if faulty else 0)),
            positions=np.zeros((lanes, n)),
            turns=np.zeros((lanes, n)),
            durations=np.zeros((lanes, 0)),
        )
        self._blocks = new_blocks(self._pool[2], lanes, n, filtering=len(filters) > 0)
        self._out = empty_outcome(lanes, 0, np.iinfo(np.int64).max, n)
        self._commands = Commands(
            todo=np.zeros(lanes, np.int64),
            ages=np.zeros(lanes, np.int64),
            torques=np.zeros((lanes, n)),
            references=np.zeros((lanes, 10)),
        )
        self._history = np.zeros((lanes, HISTORY, n))
        self._weights = task.weights.per_si()
        self._next_command = np.zeros(lanes, np.int64)
        self.ages, self.references = self._commands.ages, self._commands.references
        self.truths, self.states = self._blocks.truths, self._blocks.states
        self.observations = np.zeros((lanes, observation_size(n)))
        self.rewards = np.zeros(lanes)
        self.fallen, self.ended = np.zeros(lanes, np.bool_), np.zeros(lanes, np.bool_)
        self._generators = [np.random.default_rng([seed, lane]) for lane in range(lanes)]
        workers = min(threads or os.cpu_count() or 1, -(-lanes // LANES))
        blocks = -(-lanes // LANES)
        ends = [min(lanes, LANES * (blocks * k // workers)) for k in range(workers + 1)]
        self._parts = list(zip(ends[:-1], ends[1:], strict=True))
        self._threads = ThreadPoolExecutor(workers) if workers > 1 else None

    def _rows(self, robots: Sequence[LoopRobot], estimator: EstimatorName | None) -> tuple[Floats, Floats, NDArray[np.void], Floats]:
        if len({(r.model.formulation, r.model.step, r.model.pivots, r.imperfections.backlash > 0.0) for r in robots}) > 1:
            raise InputError("The robots of an environment must be of one kind: the same formulation and inner step, and play in all or in none.")
        loops = [
            loop_record(r.imperfections, r.model.robot, estimator=estimator, sample_time=self.sample_time).view(LOOP.dtype())
            for r in robots
        ]
        return (
            np.array([packed_on_floor(r.model, r.imperfections) for r in robots]),
            np.array([lift_off(r.model.robot) for r in robots]),
            np.concatenate([record.ravel() for record in loops]),
            np.array([pack_contacts(r.model.robot) for r in robots]),
        )

    def reseed(self, lane: int, seed: int) -> None:
        """Let all that is random in a lane's next episodes follow from a seed."""
        self._generators[lane] = np.random.default_rng(seed)

    def start(self, which: NDArray[np.bool_] | None = None) -> None:
        """Start the episodes of some lanes, all by default, at random states and with random robots."""
        chosen = np.arange(self.lanes) if which is None else np.flatnonzero(which)
        if len(chosen) == 0:
            return
        self._commands.todo[:] = LEFT
        self._commands.todo[chosen] = STARTED
        for lane in chosen.tolist():
            self._draw_start(lane)
        self._in_parts(self._advance)
        self._observe()

    def _draw_start(self, lane: int) -> None:
        task, random, inputs = self.task, self._generators[lane], self._inputs
        which = int(random.integers(len(self._pool[0])))
        inputs.parameters[lane], inputs.lift_offs[lane] = self._pool[0][which], self._pool[1][which]
        inputs.loops[lane], inputs.contacts[lane] = self._pool[2][which], self._pool[3][which]
        u = random.uniform(-1.0, 1.0, 10 + 2 * self.wheels)
        x = inputs.initial[lane]
        x[0:2], x[5:7] = task.offset * u[0:2], task.speed * u[5:7]
        x[2:4], x[4] = task.lean * u[2:4], task.turn * u[4]
        x[7:10] = 0.0
        self._draws.positions[lane] = 0.5 * u[10 : 10 + self.wheels]
        self._draws.turns[lane] = np.pi * (1.0 + u[10 + self.wheels :])
        random.standard_normal(out=self._draws.noise[lane])
        random.standard_normal(out=self._draws.faults[lane])
        self.references[lane] = 0.0
        self._history[lane] = 0.0
        self._commands.ages[lane] = 0
        self._out.ended[lane] = np.iinfo(np.int64).max
        self._out.lifted[lane] = False
        self.fallen[lane] = self.ended[lane] = False
        self._ask(lane)

    def _ask(self, lane: int) -> None:
        """Draw what is asked for from now on, and when it changes."""
        task, random, reference = self.task, self._generators[lane], self.references[lane]
        age = int(self._commands.ages[lane])
        wait = random.uniform(0.3, 1.0) * task.interval
        self._next_command[lane] = age + max(1, round(wait / self.sample_time))
        if task.reach or task.reach_heading:
            reference[0:2] += task.reach * random.uniform(-1.0, 1.0, 2)
            reference[4] += task.reach_heading * random.uniform(-1.0, 1.0)
        if task.drive:
            reference[5:7] = task.drive * random.uniform(-1.0, 1.0, 2)
        if task.impulse:
            size, angle = task.impulse * random.uniform(0.0, 1.0), random.uniform(0.0, 2.0 * np.pi)
            samples = max(1, round(0.1 / self.sample_time))
            force = size / (samples * self.sample_time)
            begin = age + int(random.integers(1, max(2, self._next_command[lane] - age)))
            height = self.robot.body.center_of_mass
            self._inputs.pushes[lane, 0] = [begin, begin + samples, force * np.cos(angle), force * np.sin(angle), 0.0, height]

    def step(self, torques: Floats) -> None:
        """Advance every lane that has not ended by `repeat` samples with torques (lanes, n) [N m].

        The torques are limited; with a base controller they are added to its own. A lane that ends within the samples
        stays where it is. InputError if the torques are not finite.
        """
        if not np.isfinite(torques).all():
            lane = int(np.flatnonzero(~np.isfinite(torques).all(axis=1))[0])
            raise InputError(f"The action of lane {lane} is {torques[lane].tolist()}; it must be finite.")
        commands = self._commands
        np.clip(torques, -self.torque_limit, self.torque_limit, out=commands.torques)
        self._history[:, 1:] = self._history[:, :-1]
        self._history[:, 0] = commands.torques
        self.rewards[:] = 0.0
        for _ in range(self.repeat):
            self._step_once()
        self._observe()

    def _step_once(self) -> None:
        commands, ages, running = self._commands, self._commands.ages, ~self.ended
        commands.todo[:] = running  # LEFT or ADVANCED
        if self.task.drive:
            self.references[running, 0:2] += self.sample_time * self.references[running, 5:7]
        self._in_parts(self._take)
        ages += running
        lean = np.abs(self.truths[:, 2:4]).max(axis=1)
        self.fallen |= running & ((self._out.ended <= ages) | ~(lean <= self.task.fallen))
        self.ended |= self.fallen | (running & (ages >= self.steps_in_episode))
        for lane in np.flatnonzero((self._next_command == ages) & ~self.ended).tolist():
            self._ask(lane)

    def _take(self, begin: int, end: int) -> None:
        spent = begin + np.flatnonzero((self._commands.ages[begin:end] + 1) % DRAWN == 0)
        for lane in spent.tolist():
            self._generators[lane].standard_normal(out=self._draws.noise[lane])
            self._generators[lane].standard_normal(out=self._draws.faults[lane][5:])
        self._advance(begin, end)
        pay(
            begin,
            end,
            self._commands.todo,
            self.truths,
            self.references,
            self._blocks.commanded,
            self._blocks.last,
            self.torque_limit,
            self._weights,
            self.sample_time,
            self.rewards,
        )

    def _advance(self, begin: int, end: int) -> None:
        advance_lanes(
            self._selected, self._inputs, self._draws, self._sampling, self._blocks, begin, end, self._commands, self._out
        )

    def _observe(self) -> None:
        observe(
            0, self.lanes, self.states, self.references, self._history, self.torque_limit, SCALES, self.observations
        )

    def _in_parts(self, run) -> None:
        if self._threads is None:
            run(0, self.lanes)
            return
        list(self._threads.map(run, *zip(*self._parts, strict=True)))

    def close(self) -> None:
        """End the threads."""
        if self._threads is not None:
            self._threads.shutdown()
