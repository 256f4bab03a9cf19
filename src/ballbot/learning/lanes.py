"""Many robots side by side on the compiled loop, commanded from outside: what every environment and training runs on.

A step of all robots is one compiled call in each thread: torques are limited and remembered, samples are simulated,
rewarded and ended, commands change, episodes start, and observations are filled in place. Each robot draws
from a stream of its own (`ballbot.learning.streams`), so that its episodes depend on its seed and its torques, not on
threads.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import real_array, whole_number
from ballbot.control.controller import Controller
from ballbot.control.parts.policy import HISTORY, observation_size
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName
from ballbot.learning.streams import fill_normal, stream_of, uniform
from ballbot.learning.tasks import Task, TaskNumbers, action_limit, observe, reward
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.tracing import borrowed
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.inputs import empty_outcome, inputs_of, new_commands
from ballbot.simulation.loop import (
    ADVANCED,
    LEFT,
    STARTED,
    Commands,
    Draws,
    Inputs,
    LoopMemory,
    Outcome,
    Sampling,
    advance_block,
    command,
    new_memory,
)
from ballbot.workflows.grid import LoopRobot

#: for which an action's torques are held, as near as whole samples come [s]: a policy decides at 100 Hz
PERIOD = 0.01
#: what becomes of an episode's end: nothing, a start by the next step's torques, or by the same step's
KEPT, NEXT_STEP, SAME_STEP = 0, 1, 2
_NEVER = np.iinfo(np.int64).max


class Episodes(NamedTuple):
    """What is known of each lane's episode."""

    streams: NDArray[np.uint64]  #: (lanes, 4)
    drawn: NDArray[np.int64]  #: (lanes,) which robot of the pool
    actions: NDArray[np.float64]  #: (lanes, n) torques given from outside [N m]
    history: NDArray[np.float64]  #: (lanes, HISTORY, n) those of the last steps, limited, newest first [N m]
    references: NDArray[np.float64]  #: (lanes, 10) the reference, with the velocity
    late: NDArray[np.float64]  #: (lanes,) by which the last sampling instant was late [s]
    changes: NDArray[np.int64]  #: (lanes,) age at which something else is asked for
    started: NDArray[np.bool_]  #: (lanes,) whether an episode is to start
    active: NDArray[np.bool_]  #: (lanes,) whether an episode goes on
    fallen: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    rewards: NDArray[np.float64]
    observations: NDArray[np.float32]
    final_observations: NDArray[
        np.float32
    ]  #: at the end of an episode after which another one started at once
    final_truths: NDArray[np.float64]
    final_references: NDArray[np.float64]


@inlined
def _take(task, commands, episodes, lane, ending):
    """Take a lane's torques."""
    asked, torques = episodes.actions[lane], commands.torques[lane]
    episodes.rewards[lane] = 0.0
    if not episodes.active[lane]:
        episodes.started[lane] = ending == NEXT_STEP
        return
    episodes.fallen[lane] = episodes.ended[lane] = False
    past = episodes.history[lane]
    for k in range(len(past) - 1, 0, -1):
        fill(past[k], past[k - 1])
    for i in range(len(asked)):
        torques[i] = past[0, i] = min(max(asked[i], -task.torque_limit), task.torque_limit)


@inlined
def _draw_sample(draws, inputs, task, episodes, lane):
    """Draw what is random in a sample."""
    stream = episodes.streams[lane]
    fill_normal(stream, draws.noise[lane, 0 if task.sensing else 6 :])  # of the AHRS, then of the torques
    if task.sensing:
        fill_normal(stream, draws.faults[lane])
    if draws.durations.shape[1] > 0:
        jitter, before = inputs.loops[lane].jitter, episodes.late[lane]
        episodes.late[lane] = jitter * uniform(stream, -1.0, 1.0)
        draws.durations[lane, 0] = task.sample_time + episodes.late[lane] - before


@inlined
def _begin(draws, inputs, task, commands, episodes, lane):
    """Prepare a lane's sample; return whether there is one."""
    commands.todo[lane] = LEFT
    if not episodes.active[lane]:
        return False
    commands.todo[lane] = ADVANCED
    _draw_sample(draws, inputs, task, episodes, lane)
    asked = episodes.references[lane]
    if task.drive > 0.0:
        asked[0] += task.sample_time * asked[5]
        asked[1] += task.sample_time * asked[6]
    # a base controller is shown a pose alone, as on a course: with a velocity it would be a plan
    for i in (0, 1, 4):
        commands.references[lane, i] = asked[i]
    return True


@inlined
def _end(task, inputs, memory, commands, out, episodes, lane):
    """Reward a lane's sample, and end its episode where that is due."""
    if commands.todo[lane] != ADVANCED:
        return
    truth, age = memory.truths[lane], commands.ages[lane]
    episodes.rewards[lane] += reward(
        task, truth, episodes.references[lane], memory.commanded[lane], memory.last[lane]
    )
    lean = max(abs(truth[2]), abs(truth[3]))
    if out.ended[lane] <= age or not lean <= task.fallen:
        episodes.fallen[lane] = True
    if episodes.fallen[lane] or age >= task.samples:
        episodes.ended[lane] = True
        episodes.active[lane] = False
    elif episodes.changes[lane] == age:
        _ask(task, inputs, commands, episodes, lane)


@inlined
def _ask(task, inputs, commands, episodes, lane):
    """Draw what a lane is asked for from now on, and when that changes: U(0.3, 1) of the task's interval."""
    stream, asked, age = episodes.streams[lane], episodes.references[lane], commands.ages[lane]
    wait = max(1, int(uniform(stream, 0.3, 1.0) * task.interval))
    episodes.changes[lane] = age + wait
    if task.reach > 0.0 or task.reach_heading > 0.0:
        asked[0] += task.reach * uniform(stream, -1.0, 1.0)
        asked[1] += task.reach * uniform(stream, -1.0, 1.0)
        asked[4] += task.reach_heading * uniform(stream, -1.0, 1.0)
    if task.drive > 0.0:
        asked[5] = task.drive * uniform(stream, -1.0, 1.0)
        asked[6] = task.drive * uniform(stream, -1.0, 1.0)
    if task.impulse > 0.0:
        # a push of U(0, 1) of the largest impulse, in any direction, at any time of the interval
        force = task.impulse * uniform(stream, 0.0, 1.0) / (task.push_samples * task.sample_time)
        angle, push = uniform(stream, 0.0, 2.0 * np.pi), inputs.pushes[lane, 0]
        push[0] = age + int(uniform(stream, 0.0, 1.0) * wait)
        push[1] = push[0] + task.push_samples
        push[2], push[3], push[4] = force * np.cos(angle), force * np.sin(angle), 0.0
        push[5] = task.push_height


@inlined
def _end_for_good(task, memory, episodes, lane):
    """Keep the end of a lane's episode, after which another one starts in the same step."""
    fill(episodes.final_truths[lane], memory.truths[lane])
    fill(episodes.final_references[lane], episodes.references[lane])
    out = episodes.final_observations[lane]
    observe(memory.states[lane], episodes.references[lane], episodes.history[lane], task.torque_limit, out)


@inlined
def _start(inputs, draws, pool, task, commands, out, episodes, lane):
    """Draw a lane's robot, its start and what it is asked for."""
    stream, x, n = episodes.streams[lane], inputs.initial[lane], draws.positions.shape[1]
    which = min(int(uniform(stream, 0.0, float(len(pool.loops)))), len(pool.loops) - 1)
    episodes.drawn[lane] = which
    inputs.lift_offs[lane], inputs.loops[lane] = pool.lift_offs[which], pool.loops[which]
    fill(inputs.parameters[lane], pool.parameters[which if len(pool.parameters) > 1 else 0])
    fill(inputs.contacts[lane], pool.contacts[which])
    own = inputs.pushes.shape[1] - pool.pushes.shape[1]
    for k in range(pool.pushes.shape[1]):
        fill(inputs.pushes[lane, own + k], pool.pushes[which, k])
    for k in range(pool.bumps.shape[1]):
        fill(inputs.bumps[lane, k], pool.bumps[which, k])
    for i in range(2):
        x[i], x[5 + i] = task.offset * uniform(stream, -1.0, 1.0), task.speed * uniform(stream, -1.0, 1.0)
        x[2 + i] = task.lean * uniform(stream, -1.0, 1.0)
    x[4] = task.turn * uniform(stream, -1.0, 1.0)
    for i in range(n):
        draws.positions[lane, i] = uniform(stream, -0.5, 0.5)
        draws.turns[lane, i] = uniform(stream, 0.0, 2.0 * np.pi)
    for i in range(10):
        episodes.references[lane, i] = 0.0
    for k in range(HISTORY):
        for i in range(n):
            episodes.history[lane, k, i] = 0.0
    episodes.late[lane] = 0.0
    _draw_sample(draws, inputs, task, episodes, lane)
    episodes.late[lane] = 0.0  # the first instant is on the grid
    commands.ages[lane] = 0
    commands.todo[lane] = STARTED
    out.ended[lane], out.lifted[lane] = _NEVER, False
    episodes.active[lane], episodes.started[lane] = True, False
    _ask(task, inputs, commands, episodes, lane)


class LaneArrays(NamedTuple):
    """All lanes with their tasks, as compiled code has them."""

    inputs: Inputs
    draws: Draws
    sampling: Sampling
    memory: LoopMemory
    commands: Commands
    out: Outcome
    pool: Inputs  #: the robots of which each episode has one, a row for each
    task: TaskNumbers
    episodes: Episodes


@inlined
def _prepare(world, first, last, sample, samples, ending):
    """Say what the loop does next with lanes first .. last - 1; return with how many of them it does anything.

    Before a step's first sample torques are taken; after all of its samples episodes start.
    """
    inputs, draws, _, memory, commands, out, pool, task, episodes = world
    moving = 0
    for lane in range(first, last):
        if sample < samples:
            if sample == 0:
                _take(task, commands, episodes, lane, ending)
            moving += 1 if _begin(draws, inputs, task, commands, episodes, lane) else 0
            continue
        commands.todo[lane] = LEFT
        if episodes.started[lane] or (ending == SAME_STEP and not episodes.active[lane]):
            if ending == SAME_STEP and episodes.ended[lane]:
                _end_for_good(task, memory, episodes, lane)
            else:
                episodes.fallen[lane] = episodes.ended[lane] = False
            _start(inputs, draws, pool, task, commands, out, episodes, lane)
            moving += 1
    return moving


@inlined
def _conclude(world, first, last, sample, samples):
    """Reward what lanes did in a sample; after all of a step's samples, and starts, fill their observations."""
    inputs, _, _, memory, commands, out, _, task, episodes = world
    for lane in range(first, last):
        if sample < samples:
            _end(task, inputs, memory, commands, out, episodes, lane)
        else:
            seen, asked = memory.states[lane], episodes.references[lane]
            observe(seen, asked, episodes.history[lane], task.torque_limit, episodes.observations[lane])


@compiled
def play(selected, world, span, samples, ending):
    """Take lanes span[0] .. span[1] - 1 through a step of so many samples; without samples only episodes start.

    The span begins at a multiple of `LANES`. `ending` is `KEPT`, `NEXT_STEP` or `SAME_STEP`.
    """
    world = borrowed(world)
    inputs, draws, sampling, memory, commands, out, _, _, _ = world
    for first in range(span[0], span[1], LANES):
        last = min(first + LANES, span[1])
        for sample in range(samples + 1):
            moving = _prepare(world, first, last, sample, samples, ending)
            if moving > 0:
                advance_block(selected, inputs, draws, sampling, memory, commands, out, first, last - first)
            _conclude(world, first, last, sample, samples)


@compiled
def prepare(world, sample, samples, ending):
    """Say what is done next with all lanes, and by what torques, where the loop does not do it: see `_prepare`."""
    world = borrowed(world)
    inputs, _, _, memory, commands, _, _, _, _ = world
    _prepare(world, 0, len(commands.todo), sample, samples, ending)
    for lane in range(len(commands.todo)):
        if commands.todo[lane] == ADVANCED:
            command(inputs, memory, commands, lane)


@compiled
def conclude(world, sample, samples):
    """Take what was done with all lanes: see `_conclude`."""
    _conclude(borrowed(world), 0, len(world.commands.todo), sample, samples)


class TaskLanes:
    """Robots that do a task, each with its own episode; each is one of `robots`, drawn at its start.

    The arrays below are filled in place by `start` and `step`. All that is random of a lane follows from its seed.

    Parameters
    ----------
    robots : sequence of LoopRobot
        Of one kind: formulation, inner step, sample time, number of wheels, and play in all or in none.
    task : Task
        What they do.
    lanes : int
        Number of robots side by side.
    seed : int
        Lane k draws from the seed (seed, k), until it is given another one by `reseed`.
    base : Controller, optional
        Its torques are added to those given to `step`. It sees what the estimator shows.
    estimator : "kalman", "onboard" or None
        Estimates the states that are observed; None shows the true ones.
    repeat : int, optional
        Samples for which the torques of a step are held; by default those of `PERIOD`.
    threads : int, optional
        All cores by default. The results do not depend on it.

    Attributes
    ----------
    move : callable or None
        Moves and starts the lanes of `commands.todo` in place of the loop, as `ballbot.learning.twin_lanes.Twins` do.
    observations : (lanes, size) of float32
    rewards : (lanes,), of the last step
    fallen, ended : (lanes,)
        Whether an episode ended in the last step, or before if no other has started: by a fall, or at all.
    truths, states : (lanes, 10)
        True and estimated states.
    references : (lanes, 10)
        What is asked for, with the velocity.
    ages : (lanes,)
        Samples since each episode's start.
    torque_limit : float
        Of the torques given to `step` [N m], by `ballbot.learning.tasks.action_limit`.
    final_observations, final_truths, final_references : (lanes, size), (lanes, 10), (lanes, 10)
        Where `ended`, those at the end of the episode that ended in the last step, with `SAME_STEP`.

    Raises
    ------
    InputError
        If robots differ in kind, have what environments have not, or the base controller is for another sample time.
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
        repeat: int | None = None,
        threads: int | None = None,
    ) -> None:
        self.task, self.robot = task, robots[0].imperfections.known or robots[0].model.robot
        self.lanes = whole_number(lanes, "lanes", least=1)
        self.sample_time, self.wheels = self.robot.sensors.sample_time, self.robot.wheel_count
        usual = max(1, round(PERIOD / self.sample_time))
        self.repeat = usual if repeat is None else whole_number(repeat, "repeat", least=1)
        self.torque_limit = action_limit(task, self.robot)
        _check_kinds(robots, self.sample_time, base)
        self.move: Callable[[LaneArrays], None] | None = None
        self._selected = robots[0].model.selected
        self._world = world = self._new_world(robots, base, estimator, seed)
        self.ages, self.references = world.commands.ages, world.episodes.references
        self.truths, self.states = world.memory.truths, world.memory.states
        episodes = world.episodes
        self.observations, self.rewards = episodes.observations, episodes.rewards
        self.fallen, self.ended = episodes.fallen, episodes.ended
        self.final_observations, self.final_truths = episodes.final_observations, episodes.final_truths
        self.final_references = episodes.final_references
        memory = -(-lanes // LANES)
        workers = min(whole_number(threads or os.cpu_count() or 1, "threads", least=1), memory)
        ends = [min(lanes, LANES * (memory * k // workers)) for k in range(workers + 1)]
        self._spans = list(pairwise(ends))
        self._threads = ThreadPoolExecutor(max(workers - 1, 1))

    def _new_world(
        self,
        robots: Sequence[LoopRobot],
        base: Controller | None,
        estimator: EstimatorName | None,
        seed: int,
    ) -> LaneArrays:
        lanes, n, own = self.lanes, self.wheels, 1 if self.task.impulse > 0.0 else 0
        models, by_lane = [robot.model for robot in robots], [robot.imperfections for robot in robots]
        pool = inputs_of(
            models,
            by_lane,
            sample_time=self.sample_time,
            laws=[base] if base else (),
            estimators=[estimator],
        )
        inputs = pool._replace(
            parameters=np.repeat(pool.parameters[:1], lanes, axis=0),
            lift_offs=np.repeat(pool.lift_offs[:1], lanes),
            loops=np.repeat(pool.loops[:1], lanes),
            filters=pool.filters[:1],
            contacts=np.repeat(pool.contacts[:1], lanes, axis=0),
            initial=np.zeros((lanes, 10)),
            pushes=np.zeros((lanes, own + pool.pushes.shape[1], 6)),
            bumps=np.zeros((lanes, pool.bumps.shape[1], 4)),
        )
        return LaneArrays(
            inputs=inputs,
            draws=_new_draws(by_lane, lanes, n),
            sampling=Sampling(
                references=np.zeros((1, 10)),
                sample_time=self.sample_time,
                steps=models[0].steps_in(self.sample_time),
            ),
            memory=new_memory(pool.loops, lanes, n, filtering=inputs.filter_code != 0),
            commands=new_commands(lanes, n, references=lanes),
            out=empty_outcome(lanes, 0, _NEVER, n),
            pool=pool,
            task=TaskNumbers.of(
                self.task, self.robot, torque_limit=self.torque_limit, sensing=estimator is not None
            ),
            episodes=_new_episodes(lanes, n, seed),
        )

    def reseed(self, lane: int, seed: int) -> None:
        """Let all that is random in a lane's next episodes follow from a seed."""
        self._world.episodes.streams[lane] = stream_of(seed)

    def start(self, which: NDArray[np.bool_] | None = None) -> None:
        """Start the episodes of some lanes (lanes,), all by default, at random states and with random robots."""
        self._world.episodes.started[:] = True if which is None else which
        self._play(0, KEPT)

    def step(self, torques: ArrayLike, *, ending: int = KEPT) -> None:
        """Advance every lane whose episode goes on by `repeat` samples with torques (lanes, n) [N m].

        The torques are limited; those of a base controller are added. A lane whose episode ends within the samples
        stays where it is: until `start`, or with `ending` `NEXT_STEP` until the next step, which starts another
        episode and ignores its torques; with `SAME_STEP` another one starts at once.

        InputError if the torques have another shape or are not finite; then no lane advances.
        """
        actions = self._world.episodes.actions
        actions[:] = real_array(torques, actions.shape, "The array of torques")
        self._play(self.repeat, ending)

    def _play(self, samples: int, ending: int) -> None:
        """Take all lanes through a step of so many samples."""
        if self.move is not None:
            for sample in range(samples + 1):
                prepare(self._world, sample, samples, ending)
                self.move(self._world)
                conclude(self._world, sample, samples)
            return
        own, *others = ((self._selected, self._world, span, samples, ending) for span in self._spans)
        playing = [self._threads.submit(play, *other) for other in others]
        play(*own)
        for other in playing:
            other.result()

    def close(self) -> None:
        """End the threads."""
        self._threads.shutdown()


def _check_kinds(robots: Sequence[LoopRobot], sample_time: float, base: Controller | None) -> None:
    """Raise InputError unless robots can stand side by side, in front of a base controller."""
    kinds = {
        (
            r.model.formulation,
            r.model.step,
            r.model.pivots,
            r.model.robot.wheel_count,
            r.imperfections.backlash > 0.0,
        )
        for r in robots
    }
    if len(kinds) > 1:
        raise InputError(
            "The robots of an environment must be of one kind: the same formulation, inner step and number of wheels, "
            "and play in all or in none."
        )
    if any(r.imperfections.later for r in robots) or any(r.imperfections.fix for r in robots):
        raise InputError(
            "An environment has no payload or floor that changes within an episode, and no external position sensor."
        )
    times = [r.imperfections.sensors.sample_time for r in robots if r.imperfections.sensors]
    if base is not None:
        times.append(base.sample_time)
    for time in times:
        if abs(time - sample_time) > 1e-9 * sample_time:
            raise InputError(
                f"Sensors or base controller have a sample time of {time:g} s, the robot one of {sample_time:g} s; "
                "they must be the same."
            )


def _new_draws(by_lane: Sequence[Imperfections], lanes: int, n: int) -> Draws:
    """Return room for the random numbers of one sample."""
    return Draws(
        noise=np.zeros((lanes, 6 + n if any(one.random for one in by_lane) else 0)),
        faults=np.zeros((lanes, 10 if any(one.sensor_faults is not None for one in by_lane) else 0)),
        positions=np.zeros((lanes, n)),
        turns=np.zeros((lanes, n)),
        durations=np.zeros((lanes, 1 if any(one.jitter > 0.0 for one in by_lane) else 0)),
        samples=1,
    )


def _new_episodes(lanes: int, n: int, seed: int) -> Episodes:
    """Return the episodes of lanes with n wheels; none goes on."""
    size = observation_size(n)
    flags = {name: np.zeros(lanes, np.bool_) for name in ("started", "active", "fallen", "ended")}
    return Episodes(
        streams=np.array([stream_of((seed, lane)) for lane in range(lanes)]),
        drawn=np.zeros(lanes, np.int64),
        actions=np.zeros((lanes, n)),
        history=np.zeros((lanes, HISTORY, n)),
        references=np.zeros((lanes, 10)),
        late=np.zeros(lanes),
        changes=np.zeros(lanes, np.int64),
        rewards=np.zeros(lanes),
        observations=np.zeros((lanes, size), np.float32),
        final_observations=np.zeros((lanes, size), np.float32),
        final_truths=np.zeros((lanes, 10)),
        final_references=np.zeros((lanes, 10)),
        **flags,
    )
