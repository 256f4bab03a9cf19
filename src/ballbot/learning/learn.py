"""A learned controller: training on the compiled loop, the policy in a controller, and its trial."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller, torque_of_lean
from ballbot.control.lqr import frictionless_model
from ballbot.control.parts.disturbance_observer import idle_torques
from ballbot.control.parts.policy import SCALES, VERSION, Policy
from ballbot.control.presets import nominal_controller
from ballbot.control.presets.nominal import design_gain
from ballbot.control.presets.precise import ERROR_LEAN, PRECISE_STATE_WEIGHTS
from ballbot.control.references import hold
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.learning.contract import Contract
from ballbot.learning.lanes import TaskLanes
from ballbot.learning.ppo import Layers, Training, TrainingState, new_actor, random_of, train
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import PUSH, Task, task_named
from ballbot.log import Log
from ballbot.progress import Progress, sparkline
from ballbot.results import left_out
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Push
from ballbot.summary import Reported
from ballbot.twin.scenario import Scenario
from ballbot.workflows.grid import Condition, GridRun, LoopRobot, TwinRobot, run_grid
from ballbot.workflows.metrics import position_error, true_place

#: largest speed at which a policy acts [m/s], and largest lean [rad]; beyond them the linear law does
LARGEST_SPEED, LARGEST_LEAN = 2.0, 0.12
#: shares of these at which a policy is tried to act, and of the law's largest push, from which it must recover: acting
#: up to all of it, 5 of 40 drawn robots fell after half of that push (`python -m campaigns.board_matrix --seed 68`)
_ACTING, _RECOVERED = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12), (0.35, 0.7)
#: sizes of a push that are tried with the law, up to that which no robot recovers from, and directions
_SIZES, _DIRECTIONS = 20, 12
#: how long is looked whether it recovers [s]
_RECOVERED_WITHIN = 5.0
#: torque of an output of 1, over that of an action: of a policy alone, and of one that is added to a controller
SCALE, RESIDUAL_SCALE = 2.0, 0.8
#: weight of an error into a unit that is to stay nearly straight
_STRAIGHT = 0.2
#: weights of x and y in the law that a policy starts as [1/m^2]: with the precise controller's 2000 its dry friction
#: moves `alten` by 30 mm from its place, with this by 13
_START_WEIGHT = 8000.0
#: seconds of the loop in which a baseline's reward is measured, and robots
_BASELINE_TIME, _BASELINE_ROBOTS = 10.0, 80
#: the film has the policies after these parts of a training, which are 0, 5, 10 and 30 s of one that takes 30 s, and so
#: long a run of each [s]
FILM_PARTS, FILM_DURATION = (0.0, 1.0 / 6.0, 1.0 / 3.0, 1.0), 15.0


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """A learning curve after an update."""

    samples: int  #: of the loop, of all robots
    seconds: float  #: by the clock since the training began
    reward: float  #: mean a second, with the noise of the exploration
    fallen: float  #: fraction of the episodes that ended, that fell; NaN if none ended
    length: float  #: mean of the episodes that ended [s]; NaN if none did
    episodes: int  #: that ended since the update before


@dataclass(frozen=True, kw_only=True)
class Confirmed:
    """A controller on fresh robots, from start to end of a task."""

    plant: str  #: "loop" or "twin"
    runs: int
    duration: float  #: of each run [s]
    fell: int
    rms_position: float  #: root mean square over the runs that did not fall [m]
    rms_velocity: float  #: likewise, of the velocity's difference from the one that is asked for [m/s]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Learned(Reported):
    """A learned controller, how it was learned, and what it is worth; `plot()` shows the learning curve."""

    controller: Controller = field(metadata=left_out)
    task: Task
    training: Training
    seed: int
    residual: bool  #: whether the policy is added to a controller
    contract: Contract = field(metadata=left_out)  #: what the policy observes and does
    #: with the best policy after each of `FILM_PARTS`, by the seconds of learning
    stages: Mapping[float, Controller] = field(metadata=left_out)
    curve: tuple[CurvePoint, ...]
    baseline: float  #: reward a second of the linear law alone, or of the controller to which it is added
    stopped: bool  #: by the user before its end
    confirmed: tuple[Confirmed, ...] = ()
    baseline_confirmed: tuple[Confirmed, ...] = ()


def base_controller(robot: Robot) -> Controller:
    """Return the linear law that acts where the policy was not trained."""
    return nominal_controller(robot).with_estimator("kalman")


def start_law(lanes: TaskLanes, scale: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the law that a policy alone starts as: weights of 8 units of tanh (10, 8), and of its outputs (8, n).

    It is the precise gain for torques as they are held. A unit is small, so that its tanh is nearly straight, except
    for the errors of position and velocity along an axis: together they command at most a lean as precise controllers'.
    """
    robot, held = lanes.robot, lanes.repeat * lanes.sample_time
    weights = (_START_WEIGHT, _START_WEIGHT, *PRECISE_STATE_WEIGHTS[2:])
    gain = design_gain(robot, state_weights=weights, sample_time=held).gain * SCALES / scale
    size = np.linalg.norm(gain, axis=0)
    left = max(lanes.torque_limit - max(robot.friction.breakaway), 0.1 * lanes.torque_limit)
    lean = ERROR_LEAN * left / torque_of_lean(robot)
    into = _STRAIGHT * np.eye(10)
    for place, axis in ((0, 3), (1, 2)):
        into[place, place] = size[place] / (size[axis] * lean / SCALES[axis])
        into[5 + place, place] = into[place, place] * size[5 + place] / size[place]
    kept = [0, 1, 2, 3, 4, 7, 8, 9]
    return into[:, kept], (gain / np.diag(into)).T[kept]


def policy_of(actor: Layers, lanes: TaskLanes, *, torque_scale: float, residual: bool) -> Policy:
    """Return a network as the part of a controller, before `acting_share`."""
    first, second, last = (np.vstack([actor[k], actor[k + 1]]).T.astype(np.float64) for k in (0, 2, 4))
    return Policy(
        version=VERSION,
        feedback=1.0 if residual else 0.0,
        torque_scale=torque_scale,
        torque_limit=lanes.torque_limit,
        period=lanes.repeat * lanes.sample_time,
        largest_lean=LARGEST_LEAN,
        largest_speed=LARGEST_SPEED,
        first=first,
        second=second,
        last=last,
    )


def acting_share(controller: Controller, loop: LoopRobot) -> float:
    """Return the share of the largest lean and speed up to which a controller's policy acts on a robot.

    It is the largest share tried with which the robot recovers from 35 and 70 % of the largest push that it recovers
    from without the policy; if it recovers with none of them, the smallest share tried.
    """
    parts = controller.parts
    assert parts.policy is not None
    growth = float(loop.model.linearize().poles().real.max())
    body = loop.model.robot.body
    # twice the momentum of a body that falls through 0.35 rad, the lean at which firmware stops
    sizes = np.linspace(0.0, 0.7 * body.mass * growth * body.center_of_mass, _SIZES + 1)
    law = _recovers(controller.with_parts(replace(parts, policy=None)), loop, sizes)
    largest = sizes[-1] if law.all() else sizes[max(0, int(law.argmin()) - 1)]
    for share in _ACTING:
        policy = replace(parts.policy, largest_lean=share * LARGEST_LEAN, largest_speed=share * LARGEST_SPEED)
        tried = controller.with_parts(replace(parts, policy=policy))
        if _recovers(tried, loop, largest * np.array(_RECOVERED)).all():
            return share
    return _ACTING[-1]


def _recovers(controller: Controller, loop: LoopRobot, sizes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return from which pushes (k,) [N s] a robot recovers in every direction."""
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    height = loop.model.robot.body.center_of_mass
    lanes = [
        replace(
            loop.imperfections,
            seed=k,
            pushes=(Push.of_impulse(size, a, time=1.0, duration=PUSH, height=height),),
        )
        for k, (size, a) in enumerate(itertools.product(sizes.tolist(), angles.tolist()))
    ]
    batch = simulate_batch(
        loop.model,
        controller,
        hold(),
        duration=_RECOVERED_WITHIN,
        initial_states=np.zeros(10),
        imperfections=lanes,
        every=0,
    )
    return np.asarray(batch.survived.reshape(len(sizes), -1).all(axis=1), dtype=np.bool_)


def learn(
    robots: RobotLike | Sequence[LoopRobot],
    task: Task | str,
    *,
    base: Controller | None = None,
    training: Training = Training(),  # noqa: B008 (frozen)
    run: Run = DEFAULT_RUN,
) -> Learned:
    """Learn a controller for a task; interrupted (KeyboardInterrupt) after the first update, keep the best policy.

    Parameters
    ----------
    robots : Robot, preset or robot file, or sequence of LoopRobot
        Each episode has one of them, drawn at its start; see `ballbot.learning.robots.drawn_robots`. A single robot is
        in the nominal scenario.
    task : Task, or its name
    base : Controller, optional
        The policy is added to its torques. Without it the policy acts alone, and a linear law where it was not trained.
    training : Training, optional
        Lanes, updates and what else belongs to the training.
    run : Run, optional
        Seed and progress.

    Returns
    -------
    Learned
        `controller` is what was learned.

    Raises
    ------
    InputError
        If the robots differ in kind, or the controller's sample time is not the robots'.

    Examples
    --------
    Too short to learn anything:

    >>> learned = learn("alten", "balance", training=Training(lanes=40, decisions=8, updates=1))
    >>> learned.controller.parts.policy.first.shape
    (64, 20)
    """
    if isinstance(robots, Robot | str | Path):
        robots = drawn_robots(as_robot(robots), Scenario.nominal(robots), None)
    task, known = task_named(task), robots[0].imperfections.known or robots[0].model.robot
    residual, around = base is not None, base or base_controller(known)
    lanes = TaskLanes(
        robots, task, lanes=training.lanes, seed=run.seed, base=base, estimator=around.estimator
    )
    scale = (RESIDUAL_SCALE if residual else SCALE) * lanes.torque_limit
    start = None if residual else start_law(lanes, scale)
    untrained = new_actor(lanes, training, random_of(run.seed), start)
    idle = idle_torques(frictionless_model(known).linearize().B)
    moving = np.eye(lanes.wheels) - idle @ idle.T
    try:
        curve, actors, stopped = _followed(
            train(lanes, training, moving=moving, torque_scale=scale, seed=run.seed, start=start),
            untrained,
            lanes,
            training,
            run,
        )
    finally:
        lanes.close()

    def controller(actor: Layers, share: float = 1.0) -> Controller:
        policy = policy_of(actor, lanes, torque_scale=scale, residual=residual)
        lean, speed = share * policy.largest_lean, share * policy.largest_speed
        policy = replace(policy, largest_lean=lean, largest_speed=speed)
        return around.with_parts(replace(around.parts, policy=policy))

    share = acting_share(controller(actors[-1]), robots[0])

    return Learned(
        controller=controller(actors[-1], share),
        stages={seconds: controller(actor, share) for seconds, actor in _stages(curve, actors)},
        task=task,
        training=training,
        seed=run.seed,
        residual=residual,
        contract=Contract.of(
            known.name,
            wheels=lanes.wheels,
            torque_limit=lanes.torque_limit,
            period=lanes.repeat * lanes.sample_time,
            base=base,
            delay=robots[0].imperfections.delay,
        ),
        curve=curve,
        baseline=baseline_reward(robots, task, around, seed=run.seed),
        stopped=stopped,
    )


def _followed(
    updates: Iterator[TrainingState], untrained: Layers, lanes: TaskLanes, training: Training, run: Run
) -> tuple[tuple[CurvePoint, ...], list[Layers], bool]:
    """Return the learning curve, the best policy before and at each of its points, and whether the user stopped it."""
    curve: list[CurvePoint] = []
    actors, best = [untrained], None
    begun, stopped = monotonic(), False
    run.progress(Progress(stage="learning", total=training.updates))
    try:
        for update in updates:
            ended = update.fallen + update.finished
            curve.append(
                CurvePoint(
                    samples=(len(curve) + 1) * training.lanes * training.decisions * lanes.repeat,
                    seconds=monotonic() - begun,
                    reward=update.reward,
                    fallen=update.fallen / ended if ended else math.nan,
                    length=update.length,
                    episodes=ended,
                )
            )
            if best is None or update.fallen == 0 or _worth(update) >= _worth(best):
                best = update
            actors.append(best.actor)
            note = f"reward {update.reward:.2f} a second {sparkline([point.reward for point in curve])}"
            run.progress(Progress(stage="learning", done=len(curve), total=training.updates, note=note))
    except KeyboardInterrupt:
        if best is None:
            raise
        stopped = True
    return tuple(curve), actors, stopped


def _stages(curve: Sequence[CurvePoint], actors: Sequence[Layers]) -> Iterator[tuple[float, Layers]]:
    """Yield the seconds of learning and the best policy after each of `FILM_PARTS`."""
    for part in FILM_PARTS:
        done = round(part * len(curve))
        yield curve[done - 1].seconds if done else 0.0, actors[done]


def _worth(update: TrainingState) -> tuple[bool, float]:
    """Return what makes an update better than another: no falls, then the reward."""
    return update.fallen == 0, update.reward


def baseline_reward(robots: Sequence[LoopRobot], task: Task, controller: Controller, *, seed: int) -> float:
    """Return the mean reward a second of a controller without a policy in the task, until it falls."""
    short = replace(task, duration=_BASELINE_TIME)
    lanes = TaskLanes(
        robots, short, lanes=_BASELINE_ROBOTS, seed=seed + 1, base=controller, estimator=controller.estimator
    )
    lanes.start()
    none, total = np.zeros((lanes.lanes, lanes.wheels)), 0.0
    while not lanes.ended.all():
        lanes.step(none)
        total += float(lanes.rewards.sum())
    lanes.close()
    return total / float(lanes.ages.sum() * lanes.sample_time)


@dataclass(frozen=True, kw_only=True)
class TaskReference:
    """A reference f(t) -> (10,) that asks for what a task may ask for at most, turn by turn."""

    task: Task

    def __call__(self, t: float) -> NDArray[np.float64]:
        """Return the reference at a time [s]."""
        task, wanted, turn = self.task, np.zeros(10), int(t / self.task.interval)
        if task.drive:
            # the corners of a square, and a place that moves along its sides
            corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]) * task.drive * task.interval
            side, share = turn % 4, t / task.interval - turn
            wanted[:2] = (1.0 - share) * corners[side] + share * corners[(side + 1) % 4]
        elif task.reach:
            wanted[:2] = task.reach * np.array([(0, 0), (1, 0), (1, -1), (0, -1)][turn % 4])
            wanted[4] = task.reach_heading * (0, 1, 0, -1)[turn % 4]
        return wanted


def confirm(
    controller: Controller,
    task: Task,
    robot: Robot,
    scenario: Scenario,
    *,
    runs: int = 100,
    duration: float = 60.0,
    twin: bool = False,
    run: Run = DEFAULT_RUN,
) -> Confirmed:
    """Return how a controller does a task on robots that it was not trained on, each with a seed of its own.

    The scenario is as it is: on the twin with its own friction, rollers and play.
    """
    conditions = fresh_conditions(
        task, robot, scenario, runs=runs, duration=duration, seed=run.seed, twin=twin
    )
    tried = [
        GridRun(candidate="learned", controller=controller, condition=condition) for condition in conditions
    ]
    errors = np.array(run_grid(tried, _errors, run=run).answers)
    return Confirmed(
        plant="twin" if twin else "loop",
        runs=runs,
        duration=duration,
        fell=int(np.isnan(errors[:, 0]).sum()),
        rms_position=_rms(errors[:, 0]),
        rms_velocity=_rms(errors[:, 1]),
    )


def _alone(controller: Controller, task: Task) -> Controller:
    """Return a controller whose policy acts until the robot falls, with no law to catch it."""
    policy = controller.parts.policy
    assert policy is not None
    return controller.with_parts(replace(controller.parts, policy=replace(policy, largest_lean=task.fallen)))


def film(learned: Learned, robot: Robot, scenario: Scenario, *, run: Run = DEFAULT_RUN) -> dict[str, Log]:
    """Return a run on the loop of the policy after each part of the training, from the same start, until it falls."""
    (condition,) = fresh_conditions(
        learned.task, robot, scenario, runs=1, duration=FILM_DURATION, seed=run.seed
    )
    runs = [
        GridRun(
            candidate=f"{round(seconds, 1):g} s",
            controller=_alone(controller, learned.task),
            condition=condition,
        )
        for seconds, controller in learned.stages.items()
    ]
    logs = run_grid(runs, lambda _, log: log, run=run).answers
    return {str(shown.candidate): log for shown, log in zip(runs, logs, strict=True)}


def fresh_conditions(
    task: Task, robot: Robot, scenario: Scenario, *, runs: int, duration: float, seed: int, twin: bool = False
) -> list[Condition]:
    """Return the conditions of runs that are asked for the most that a task asks for, each with a seed of its own.

    The true robot is in the scenario, with its friction; `robot` is what the estimator knows.
    """
    if task.impulse:
        times = np.arange(2.0, duration, task.interval)
        angles = 2.0 * np.pi * 0.618 * np.arange(len(times))  # of the golden section: every direction in turn
        height = robot.body.center_of_mass
        pushes = tuple(
            Push.of_impulse(task.impulse, a, time=t, duration=PUSH, height=height)
            for t, a in zip(times.tolist(), angles.tolist(), strict=True)
        )
        scenario = replace(scenario, pushes=pushes)
    plant = (
        TwinRobot(robot=robot, scenario=scenario, known=robot)
        if twin
        else LoopRobot.of(robot.replace(friction=scenario.friction), scenario, known=robot)
    )
    return [
        Condition(
            plant=plant,
            reference=partial(TaskReference, task=task),
            duration=duration,
            seed=seed + 1000 + k,
        )
        for k in range(runs)
    ]


def _errors(_: GridRun, log: Log) -> tuple[float, float]:
    """Return the root mean squares of the errors of position and velocity; NaN after a fall."""
    if log.ended is not None:
        return math.nan, math.nan
    place, asked = true_place(log), velocity_asked(log)
    velocity = np.stack([np.gradient(place[axis], log.sample_time) for axis in "xy"], axis=1)
    return _rms(position_error(log)), _rms(np.hypot(*(velocity - asked).T))


def velocity_asked(log: Log) -> NDArray[np.float64]:
    """Return the velocity of the reference (N, 2) [m/s]; zero where the reference jumps."""
    asked = np.stack([np.gradient(log[f"ref_{axis}"], log.sample_time) for axis in "xy"], axis=1)
    return np.where(np.abs(asked) > LARGEST_SPEED, 0.0, asked)


def _rms(values: NDArray[np.float64]) -> float:
    counted_values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(counted_values**2))) if len(counted_values) else math.nan
