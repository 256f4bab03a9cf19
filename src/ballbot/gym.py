"""Gymnasium environments on the compiled loop and on the twin.

`import ballbot.gym` registers ballbot/Balance-v0, Track-v0, Drive-v0 and Push-v0:

    envs = gymnasium.make_vec("ballbot/Drive-v0", num_envs=1000, robot="found/robot.toml", randomize="boxes")

Observation and action are those of `ballbot.learning.contract`, task and reward those of `ballbot.learning.tasks`.
`info` holds the true state and the reference, for a privileged critic.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.control.parts.policy import VERSION
from ballbot.control.source import ControllerLike, as_controller, designed
from ballbot.errors import InputError, check_known, missing_package
from ballbot.learning.contract import Contract
from ballbot.learning.lanes import KEPT, NEXT_STEP, SAME_STEP, TaskLanes
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import TASKS, Task, task_named
from ballbot.learning.twin_lanes import Twins, twin_scenario
from ballbot.robot import RobotLike, as_robot
from ballbot.twin.rendering import StateRenderer
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario

try:
    import gymnasium
except ImportError:
    raise missing_package("An environment for learning", "gymnasium", extra="gym") from None
from gymnasium import spaces
from gymnasium.error import InvalidAction
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

Floats, Flags = NDArray[np.float64], NDArray[np.bool_]
Observations = NDArray[np.float32]
Number = TypeVar("Number", bound=np.generic)

_ENDINGS = {
    AutoresetMode.NEXT_STEP: NEXT_STEP,
    AutoresetMode.SAME_STEP: SAME_STEP,
    AutoresetMode.DISABLED: KEPT,
}


@dataclass(kw_only=True, eq=False, repr=False)
class EnvironmentOptions:
    """What an environment is made of: the options of `gymnasium.make` and `gymnasium.make_vec`.

    InputError if they do not fit each other.
    """

    #: what is done; `ballbot.learning.tasks.Task` has reward and termination as parameters
    task: Task | str = "Balance"
    #: a preset or robot file, with friction that was identified
    robot: RobotLike = "alten"
    #: sensors, drive and floor, and the true friction of a robot without any
    scenario: Scenario | str | Path = "nominal"
    #: "model" for the compiled loop, "twin" for the physics engine
    plant: Literal["model", "twin"] = "model"
    #: None or "boxes"; see `ballbot.learning.robots`
    randomize: str | None = None
    #: a controller whose torques the actions are added to; by default the actions are the torques
    base: ControllerLike | None = None
    #: "sensors" for what the robot's estimator shows, "state" for the true state
    observe: Literal["sensors", "state"] = "sensors"
    #: samples for which an action is held; by default as many as come nearest to 0.01 s
    repeat: int | None = None

    def _prepare(self, count: int, threads: int | None) -> None:
        """Make the robots, the contract and the spaces."""
        for name, choices in (("plant", ("model", "twin")), ("observe", ("sensors", "state"))):
            given = str(getattr(self, name))
            check_known(given, choices, f"{name} is {given!r}", otherwise="it is one of")
        task = task_named(self.task)
        robot = as_robot(self.robot)
        scenario = load_scenario(self.scenario, robot)
        robots = drawn_robots(robot, scenario, self.randomize)
        known = robots[0].imperfections.known or robot
        base = None if self.base is None else designed(as_controller(self.base, known), name="the base")
        estimator = None if self.observe == "state" else base.estimator if base else "kalman"
        self._lanes = TaskLanes(
            robots, task, lanes=count, base=base, estimator=estimator, repeat=self.repeat, threads=threads
        )
        if self.plant == "twin":
            twins = [(robot, scenario)]
            if self.randomize is not None:
                twins = [(drawn.model.robot, twin_scenario(drawn, scenario)) for drawn in robots]
            self._lanes.move = Twins(twins=twins, known=known, estimator=estimator)
        self.contract = Contract.of(
            known.name,
            wheels=known.wheel_count,
            torque_limit=self._lanes.torque_limit,
            period=self._lanes.repeat * known.sensors.sample_time,
            base=base,
            observed=self.observe,
            delay=scenario.timing.delay if scenario.timing else 0,
        )
        limits = np.array([channel.limit for channel in self.contract.observation], np.float32)
        self._seen = spaces.Box(-limits, limits, dtype=np.float32)
        self._done = spaces.Box(-1.0, 1.0, (known.wheel_count,), np.float32)

    def _torques(self, action: ArrayLike, out: Floats) -> Floats:
        """Fill the torques of actions; InvalidAction if they have another shape or are no finite numbers."""
        try:
            numbers = np.asarray(action)
        except ValueError:  # rows of different lengths
            numbers = np.array("")
        if numbers.dtype.kind not in "fiu":
            raise InvalidAction(f"The action is {action!r}; it must be numbers.")
        if numbers.shape != out.shape:
            raise InvalidAction(f"The action has the shape {numbers.shape}; it must have {out.shape}.")
        if not np.isfinite(numbers).all():
            raise InvalidAction("The action holds a value that is not a number; every value must be finite.")
        return np.multiply(numbers, self._lanes.torque_limit, out=out)

    def close(self, **_: object) -> None:
        """End the threads."""
        self._lanes.close()


@dataclass(kw_only=True, eq=False, repr=False)
class BallbotEnv(EnvironmentOptions, gymnasium.Env[Observations, Observations]):
    """One robot that does a task.

    An action that is not finite, or has another shape, raises `gymnasium.error.InvalidAction`, and the robot stays as
    it is.

    Examples
    --------
    >>> env = gymnasium.make("ballbot/Balance-v0", robot="alten")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["truth"].shape
    ((19,), (10,))
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012 (Gymnasium's)
    #: "rgb_array" for pictures (`render`); Gymnasium shows them for "human"
    render_mode: str | None = None

    def __post_init__(self) -> None:
        if self.render_mode is not None:
            given, modes = f"render_mode is {self.render_mode!r}", self.metadata["render_modes"]
            check_known(self.render_mode, modes, given, otherwise="it is one of")
        self._prepare(1, 1)
        self.observation_space, self.action_space = self._seen, self._done
        self.metadata = self.metadata | {"render_fps": round(1.0 / self.contract.period)}
        self._renderer = StateRenderer(self.robot) if self.render_mode else None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start an episode; all that is random follows from the seed, which Gymnasium draws if none was ever given."""
        drawn = seed is None and self._np_random is None
        super().reset(seed=seed, options=options)
        if seed is not None or drawn:
            self._lanes.reseed(0, int(self.np_random.integers(2**62)) if seed is None else seed)
        self._lanes.start()
        return self._lanes.observations[0].copy(), self._info()

    def step(self, action: ArrayLike) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Hold the action's torques for `repeat` samples; return observation, reward, fallen, out of time, and info."""
        torques, lanes = self._torques(action, np.empty(self._lanes.wheels)), self._lanes
        lanes.step(torques[None])
        fallen, ended = bool(lanes.fallen[0]), bool(lanes.ended[0])
        return (
            lanes.observations[0].copy(),
            float(lanes.rewards[0]),
            fallen,
            ended and not fallen,
            self._info(),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture (480, 480, 3) of the robot, with a mark where it should be; None without `render_mode`."""
        if self._renderer is None:
            return None
        return self._renderer.frame(self._lanes.truths[0], self._lanes.references[0])

    def close(self, **_: object) -> None:
        """End the threads and what draws."""
        super().close()
        if self._renderer is not None:
            self._renderer.close()

    def _info(self) -> dict[str, Any]:
        return {"truth": self._lanes.truths[0].copy(), "reference": self._lanes.references[0].copy()}


@dataclass(kw_only=True, eq=False, repr=False)
class BallbotVectorEnv(EnvironmentOptions, gymnasium.vector.VectorEnv[Observations, Observations, Any]):
    """Robots side by side that do a task, each with its own episodes, in all threads.

    Lane k of the seed s draws as the single environment of the seed s + k does, in any number of threads. Actions that
    are not finite, or have another shape, raise `gymnasium.error.InvalidAction`, and the robots stay as they are.

    Examples
    --------
    >>> envs = gymnasium.make_vec("ballbot/Balance-v0", num_envs=4, autoreset_mode="SameStep")
    >>> envs.reset(seed=1)[0].shape
    (4, 19)
    """

    num_envs: int = 1
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP
    #: False returns the same arrays from each step, which allocates nothing
    copy: bool = True
    #: all cores by default
    threads: int | None = None

    def __post_init__(self) -> None:
        self.autoreset_mode = AutoresetMode(self.autoreset_mode)
        self._prepare(self.num_envs, self.threads)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = self._seen, self._done
        self.observation_space = batch_space(self._seen, self.num_envs)
        self.action_space = batch_space(self._done, self.num_envs)
        everywhere, lanes = np.ones(self.num_envs, np.bool_), self._lanes
        self._truncated, self._asked = (
            np.zeros(self.num_envs, np.bool_),
            np.zeros((self.num_envs, lanes.wheels)),
        )
        self._known = {"truth": lanes.truths, "reference": lanes.references}
        self._last = {"truth": lanes.final_truths, "reference": lanes.final_references}
        self._everywhere = {f"_{name}": everywhere for name in self._known}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start all episodes, or those of `options["reset_mask"]` (lanes,); see `BallbotEnv.reset` for the seed."""
        which = None if options is None else options.get("reset_mask")
        if which is not None and (np.shape(which) != (self.num_envs,) or np.asarray(which).dtype != np.bool_):
            raise InputError(f"reset_mask must be an array of {self.num_envs} truth values.")
        drawn = seed is None and self._np_random is None
        super().reset(seed=seed if isinstance(seed, int) else None)
        if drawn:
            seed = int(self.np_random.integers(2**62))
        seeds = [seed + lane for lane in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None:
            if len(seeds) != self.num_envs:
                raise InputError(
                    f"There are {len(seeds)} seeds; there must be one for each of {self.num_envs} lanes."
                )
            for lane, own in enumerate(seeds):
                if own is not None and (which is None or which[lane]):
                    self._lanes.reseed(lane, own)
        self._lanes.start(which)
        return self._given(self._lanes.observations), self._info()

    def step(self, actions: ArrayLike) -> tuple[Observations, Floats, Flags, Flags, dict[str, Any]]:
        """Hold the actions' torques for `repeat` samples; return Gymnasium's batches."""
        lanes = self._lanes
        lanes.step(self._torques(actions, self._asked), ending=_ENDINGS[AutoresetMode(self.autoreset_mode)])
        np.greater(lanes.ended, lanes.fallen, out=self._truncated)
        info = self._info()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and lanes.ended.any():
            info |= self._final_info()
        flags = self._given(lanes.fallen), self._given(self._truncated)
        return self._given(lanes.observations), self._given(lanes.rewards), *flags, info

    def _given(self, array: NDArray[Number]) -> NDArray[Number]:
        return array.copy() if self.copy else array

    def _info(self) -> dict[str, Any]:
        if not self.copy:
            return self._known | self._everywhere
        return {name: array.copy() for name, array in (self._known | self._everywhere).items()}

    def _final_info(self) -> dict[str, Any]:
        """Return what Gymnasium's vectors have where an episode has ended and another one has started."""
        ended = self._lanes.ended.copy()
        observations = np.full(self.num_envs, None, object)
        for lane in np.flatnonzero(ended).tolist():
            observations[lane] = self._lanes.final_observations[lane].copy()
        last = {name: np.where(ended[:, None], array, 0.0) for name, array in self._last.items()}
        final = last | {f"_{name}": ended.copy() for name in last}
        return {
            "final_obs": observations,
            "_final_obs": ended,
            "final_info": final,
            "_final_info": ended.copy(),
        }


for _name in TASKS:
    gymnasium.register(
        id=f"ballbot/{_name}-v{VERSION}",
        entry_point="ballbot.gym:BallbotEnv",
        vector_entry_point="ballbot.gym:BallbotVectorEnv",
        kwargs={"task": _name},
    )
