"""Simulated robots on one floor, for a view that pushes them and changes their world while they balance.

    every 20 ms of real time:  requests -> friction, floor, reference, push -> samples of each robot -> one frame

A page may ask for what `Request` has: numbers and names of settings, in their ranges.

Each robot is the exact model or the twin (`bodies`), with a controller of its own behind the safety layer.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.control.overcompensation import has_friction
from ballbot.control.references import Reference, circle, figure_eight, hold, square
from ballbot.control.safety import SafeController
from ballbot.errors import InputError, every
from ballbot.mechanics.floor import rolling_friction
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.schema import validate_table
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario
from ballbot.viewer.bodies import Body, ModelBody, TwinBody
from ballbot.viewer.motion import INTERVAL
from ballbot.viewer.page import LivePage, live_page
from ballbot.workflows.candidates import Candidate
from ballbot.workflows.courses import PlantName

#: of every controller; "own" is that of its file
CompensationChoice = Literal["own", "none", "full", "partial"]
#: of the whole weight: the largest force of a push
MAX_PUSH = 0.6
#: speed [m/s] and turning rate [rad/s] with which the reference goes to where it is dragged
REFERENCE_SPEED, REFERENCE_TURN = 0.5, 1.0
_MOTIONS: dict[str, Reference] = {
    "hold": hold(),
    "square": square(),
    "circle": circle(),
    "figure_eight": figure_eight(),
}


@dataclass(frozen=True, kw_only=True)
class LiveEntry:
    """A robot to put on the floor."""

    name: str
    robot: Robot
    candidate: Candidate
    plant: PlantName = "model"
    scenario: str | None = None  #: of the twin, and for the friction of a model (name or file)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the view may change while the robots balance; the page knows these names."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    paused: bool = False
    motors: bool = True
    pace: Annotated[float, Field(ge=0.05, le=1.0)] = 1.0  #: simulated time over real time
    compensation: CompensationChoice = "own"
    friction: Annotated[float, Field(ge=0.0, le=4.0)] = 1.0  #: of each robot's driveline, over its own
    rolling: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0  #: C_rr
    slope_x: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0  #: rise of the floor along x [-]
    motion: Literal["hold", "square", "circle", "figure_eight"] = "hold"  #: of the reference
    x: Annotated[float, Field(ge=-20.0, le=20.0)] = 0.0  #: where that motion begins [m]
    y: Annotated[float, Field(ge=-20.0, le=20.0)] = 0.0
    psi: Annotated[float, Field(ge=-math.pi, le=math.pi)] = 0.0  #: heading [rad]

    def changed(self, changes: dict[str, object]) -> Settings:
        """Return a copy with other values; InputError if a name is unknown or a value is out of its range."""
        return validate_table(Settings, asdict(self) | changes, of="the settings of a live view")


@dataclass(frozen=True, kw_only=True)
class LivePush:
    """A force on one robot's body, or on all."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    force: tuple[float, float]  #: along x and y [N]; at most `MAX_PUSH` of the weight acts
    height: Annotated[float, Field(ge=-1.0, le=10.0)]  #: above the ball's centre along the body's axis [m]
    duration: Annotated[float, Field(gt=0.0, le=0.5)] = 0.1  #: simulated time [s]; a new push takes its place
    robot: Annotated[int, Field(ge=0)] | None = None  #: all, if not given


@dataclass(frozen=True, kw_only=True)
class Request:
    """What a page may ask for: other settings, a push, a reset."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    change: dict[str, float | str | bool] | None = None
    push: LivePush | None = None
    reset: bool = False


def read_request(text: str | bytes) -> Request:
    """Return the request in a page's message.

    InputError if it is no JSON, or asks for anything else or for a value out of its range.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("The request is not valid JSON.") from None
    request = validate_table(Request, tree, of="a request to a live view")
    if request.change is not None:
        Settings().changed(dict(request.change))
    return request


#: ready-made controllers whose names on the command line say too little on the page
_SHOWN_AS = {"none": "no compensation", "full": "full compensation", "partial": "partial compensation"}


def live_entries(
    robots: Mapping[str, Robot],
    candidates: Sequence[Candidate],
    *,
    plant: PlantName = "model",
    scenario: str | None = None,
) -> tuple[LiveEntry, ...]:
    """Return an entry for each robot with each controller, named by what differs among them.

    InputError if there is no such controller or scenario, or it does not fit its robot.
    """
    entries = []
    for robot_name, robot in robots.items():
        for candidate in candidates:
            controller = _SHOWN_AS.get(candidate.name, candidate.name)
            parts = (robot_name if len(robots) > 1 else "", controller if len(candidates) > 1 else "")
            name = " · ".join(part for part in parts if part) or robot_name
            entries.append(
                LiveEntry(name=name, robot=robot, candidate=candidate, plant=plant, scenario=scenario)
            )
            _known(entries[-1], load_scenario(scenario or "nominal", robot))
    return tuple(entries)


def _known(entry: LiveEntry, scenario: Scenario) -> tuple[Robot, Feedback]:
    """Return the robot as its controller knows it, and the controller."""
    robot = entry.robot
    known = robot if has_friction(robot.friction) else robot.replace(friction=scenario.friction)
    return known, entry.candidate.controller(known)


class RobotOnFloor:
    """One robot on the floor: body, controller, and what acts on them now."""

    def __init__(self, entry: LiveEntry, home: tuple[float, float]) -> None:
        scenario = load_scenario(entry.scenario or "nominal", entry.robot)
        self.home = home
        known, self.controller = _known(entry, scenario)
        self._safe = SafeController(self.controller, known)
        if entry.plant == "twin":
            self.friction = scenario.friction
            self.body: Body = TwinBody(known, scenario, self.controller)
        else:
            self.friction = scenario.friction if entry.scenario else known.friction
            self.body = ModelBody(known.replace(friction=self.friction))
        self.reset()

    def reset(self) -> None:
        """Put the robot upright and at rest to its home."""
        state = np.zeros(10)
        state[:2] = self.home
        self._safe.reset()
        self.push, self.push_height, self._push_left = (0.0, 0.0), 0.0, 0.0
        self._due = 0.0  # time [s] that no sample has simulated yet; below zero, a sample has gone ahead
        self.torques = np.zeros(self.body.robot.wheel_count)
        self.measured = self.body.reset(state)
        self.ended: str | None = None

    def compensate(self, kind: CompensationChoice) -> None:
        """Let the controller compensate friction in another way; it keeps what it remembers. A user's own stays."""
        now = self._safe.controller
        if not isinstance(self.controller, Controller):
            return
        other = self.controller.with_compensation(self.controller.compensation if kind == "own" else kind)
        if isinstance(now, Controller):
            other.memory[:] = now.memory
        self._safe.controller = other

    def be_pushed(self, push: LivePush) -> None:
        """Take a push in place of the one before; a force of zero ends it."""
        size, most = math.hypot(*push.force), MAX_PUSH * self.body.robot.weight
        share = min(1.0, most / size) if size > 0.0 else 0.0
        self.push = (share * push.force[0], share * push.force[1])
        self.push_height, self._push_left = push.height, push.duration

    def advance(self, duration: float, reference: Floats, *, motors: bool) -> None:
        """Run the samples that begin within a duration [s], with a reference (10,) for this robot."""
        self._due += duration
        while self.ended is None and self._due > 1e-6:
            seen, time = self.measured, self._safe.sample_time
            self._due -= time
            try:
                self.torques = np.zeros_like(self.torques)
                if motors:
                    self.torques = self._safe.update(seen.t, seen.state, reference, measured=seen.valid)
            except InputError as error:  # of a user's controller
                self.ended = str(error).removesuffix(".")
                break
            if self._safe.stop is not None:
                self.ended = self._safe.stop.text.removesuffix(".")
                break
            if self._push_left <= 1e-9:
                self.push = (0.0, 0.0)
            self.measured = self.body.step(self.torques, time, self.push, self.push_height)
            self._push_left -= time
            if self.measured.ended is not None:  # without its time, which counts from the last start
                self.ended = self.measured.ended.partition(" at t =")[0]
        if self.ended is not None:
            self.torques, self.push = np.zeros_like(self.torques), (0.0, 0.0)

    def frame(self, reference: Floats) -> list[float]:
        """Return the values of `robot_names` now."""
        measured, robot = self.measured, self.body.robot
        friction = np.zeros_like(self.torques)
        floor = np.zeros(2)
        if self.ended is None:
            friction = wheel_friction(measured.wheel_speeds, robot.friction, torque=self.torques)
            floor = rolling_friction(measured.truth[5:7], robot.rolling_force, slowest=1e-3)
        return [
            float(self.ended is not None),
            *measured.truth[:5].tolist(),
            *self.body.ball().tolist(),
            *reference[[0, 1, 4]].tolist(),
            *self.push,
            self.push_height,
            *floor.tolist(),
            *measured.wheel_angles.tolist(),
            *self.torques.tolist(),
            *friction.tolist(),
        ]


#: values of a frame that stand before those of the robots
WORLD_NAMES = ("t", "paused", "rate")


def robot_names(wheel_count: int) -> tuple[str, ...]:
    """Return the names of one robot's values in a frame."""
    wheels = range(1, wheel_count + 1)
    return (
        *("ended", "x", "y", "theta", "phi", "psi", "ball_w", "ball_x", "ball_y", "ball_z"),
        *("ref_x", "ref_y", "ref_psi", "push_x", "push_y", "push_height", "floor_x", "floor_y"),
        *(f"wheel{i}" for i in wheels),
        *(f"u{i}" for i in wheels),
        *(f"friction{i}" for i in wheels),
    )


def homes(entries: Sequence[LiveEntry]) -> list[tuple[float, float]]:
    """Return where the robots start [m], beside one another along y."""
    apart = 6.0 * max(entry.robot.ball.radius for entry in entries)
    middle = (len(entries) - 1) / 2.0
    return [(0.0, apart * (middle - number)) for number in range(len(entries))]


def live_view_page(entries: Sequence[LiveEntry]) -> LivePage:
    """Return the page of a live view; InputError if there are too many robots."""
    first = entries[0]
    plant = (
        "The exact equations of motion with stick-slip friction, simulated in real time; its sensors are perfect."
        if first.plant == "model"
        else f"The twin in the scenario {first.scenario or 'nominal'}, in real time; drawn is its true pose."
    )
    notes = [
        plant,
        "Robots pass through one another.",
        "The floor is drawn level. A slope acts; it is the rise towards x, the robot's mark in front.",
    ]
    bare = [entry.name for entry in entries if not has_friction(entry.robot.friction)]
    if bare:
        notes.append(
            f"The robot file of {', '.join(bare)} has no friction: the robot has that of the scenario "
            f"{first.scenario or 'nominal'}, and its controller knows it."
        )
    names = tuple(robot_names(entry.robot.wheel_count) for entry in entries)
    return live_page(
        {entry.name: entry.robot for entry in entries},
        world=WORLD_NAMES,
        names=names,
        homes=homes(entries),
        notes=notes,
        title=every(dict.fromkeys(entry.robot.name for entry in entries)),
    )


class World:
    """Robots on one floor with one reference, each from its own home."""

    def __init__(self, entries: Sequence[LiveEntry]) -> None:
        self.robots = [RobotOnFloor(*pair) for pair in zip(entries, homes(entries), strict=True)]
        self.settings = Settings(rolling=min(0.1, self.robots[0].friction.rolling))
        self.t = 0.0
        self._message = ""  # why a change was not made
        self._changes: dict[str, object] = {}  # that the next tick makes: to change a world may take a while
        self._reset_reference()

    def prepare(self) -> None:
        """Compile what every sample needs."""
        self.push(LivePush(force=(1.0, 0.0), height=0.1))
        self.tick()
        self.frame(1.0)
        self.reset()

    def take(self, request: Request) -> None:
        """Do what a page asks for."""
        self._changes |= request.change or {}
        if request.reset:
            self._make_changes()
            self.reset()
        if request.push is not None:
            self.push(request.push)

    def _make_changes(self) -> None:
        changes, self._changes = self._changes, {}
        if changes:
            try:
                self._message = ""
                self.change(changes)
            except InputError as error:
                self._message = str(error)

    def status(self) -> str:
        """Return as JSON what changes seldom: settings, why robots' runs ended, why a change was not made."""
        ended = [robot.ended for robot in self.robots]
        return json.dumps({"message": self._message, "settings": asdict(self.settings), "ended": ended})

    def _reset_reference(self) -> None:
        chosen = self.settings
        self._place = np.array([chosen.x, chosen.y, chosen.psi])
        self._motion_start = self.t

    def change(self, changes: dict[str, object]) -> None:
        """Take other settings; InputError if one is invalid, and then none is taken."""
        before, now = self.settings, self.settings.changed(changes)
        self.settings = now
        if now.motion != before.motion:
            self._motion_start = self.t
        if now.compensation != before.compensation:
            for robot in self.robots:
                robot.compensate(now.compensation)
        acting = ("friction", "rolling", "slope_x")
        if any(getattr(now, name) != getattr(before, name) for name in acting):
            for robot in self.robots:
                scaled = scaled_friction(robot.friction, now.friction)
                robot.body.change(replace(scaled, rolling=now.rolling), now.slope_x)

    def push(self, push: LivePush) -> None:
        """Push one robot or all."""
        for number, robot in enumerate(self.robots):
            if push.robot is None or push.robot == number:
                robot.be_pushed(push)

    def reset(self) -> None:
        """Put every robot upright to its home, and the reference too; time goes on and the settings stay."""
        self.settings = replace(self.settings, x=0.0, y=0.0, psi=0.0, motors=True)
        self._reset_reference()
        for robot in self.robots:
            robot.reset()

    def tick(self) -> None:
        """Make the changes that were asked for, and advance by what passes in one interval of real time."""
        self._make_changes()
        if self.settings.paused:
            return
        duration = INTERVAL * self.settings.pace
        wanted = np.array([self.settings.x, self.settings.y, self.settings.psi])
        step = wanted - self._place
        distance, most = math.hypot(step[0], step[1]), REFERENCE_SPEED * duration
        step[:2] *= min(1.0, most / distance) if distance > 0.0 else 0.0
        step[2] = np.clip(step[2], -REFERENCE_TURN * duration, REFERENCE_TURN * duration)
        self._place += step
        for robot in self.robots:
            robot.advance(duration, self._reference(robot), motors=self.settings.motors)
        self.t += duration

    def _reference(self, robot: RobotOnFloor) -> Floats:
        reference = _MOTIONS[self.settings.motion](self.t - self._motion_start).copy()
        reference[:2] += robot.home
        reference[[0, 1, 4]] += self._place
        return reference

    def frame(self, rate: float) -> list[float]:
        """Return the values of `WORLD_NAMES` and of each robot; `rate` is the achieved over the wanted pace."""
        values = [self.t, float(self.settings.paused), rate]
        for robot in self.robots:
            values += robot.frame(self._reference(robot))
        return values
