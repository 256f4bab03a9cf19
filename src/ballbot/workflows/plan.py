"""Fast moves: the fastest motion between poses, along a path, or to a stop, as a reference that controllers follow.

A plan is made of legs (`ballbot.workflows.collocation`): one from rest to rest, or a run-up to a speed, a moment at it
and the stop. The reference holds the states at the robot's sample time. A controller with feed-forward follows them
without shaping; the margin of the limits is what it has against disturbances.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from ballbot.arrays import Floats, positive_number, real_array
from ballbot.control.controller import Controller, assumed_grip, grip_torque_limit
from ballbot.control.references import Reference, read_poses, sampled_reference, write_reference
from ballbot.errors import InputError, every
from ballbot.log import Log
from ballbot.results import left_out
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.rounding import percent
from ballbot.summary import Reported
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.workflows.collocation import (
    FAMILIES,
    Leg,
    MoveLimits,
    PlannedMotion,
    PlannedPath,
    Planner,
    course_through,
)
from ballbot.workflows.grid import Condition, GridRun, LoopRobot, TwinRobot, grid_runs, run_grid
from ballbot.workflows.metrics import position_error

#: at the speed from which it is to stop [s]
_CRUISE = 0.5
#: after the plan, in which the robot stands [s]
_AFTER = 2.0
#: a limit binds if a per cent more of it saves more than this part of what the first one saves
_BINDS = 0.1
#: for a guess of the time: acceleration [m/s^2], turning [rad/s], speed along a path [m/s]
_USUAL, _USUAL_TURN, _USUAL_SPEED = 1.0, 2.0, 0.5


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Plan(Reported):
    """A fast move, sampled."""

    robot: Robot = field(metadata=left_out)
    limits: MoveLimits
    what: str  #: "the move to [2 0 0]"
    t: Floats = field(metadata=left_out)  #: (k,) [s]
    states: Floats = field(metadata=left_out)  #: (k, 10)
    torques: Floats = field(metadata=left_out)  #: (k, n) of the motors [N m]
    used: Floats = field(metadata=left_out)  #: (k, 7) shares of the limits of `FAMILIES`
    duration: float  #: of what is to be fast: the move, or the stop [s]
    distance: float  #: over the floor in this time [m]
    begins: float  #: when the stop begins; 0 of a move [s]
    savings: dict[str, float]  #: by which a per cent more of each limit would shorten it [s]
    top_speed: float  #: largest steady speed in the direction of the move [m/s]
    top_speed_bound: str  #: the limit that bounds that

    @property
    def bound(self) -> str:
        """The limit that bounds the time most."""
        return max(FAMILIES, key=lambda name: self.savings[name])

    @property
    def reference(self) -> Reference:
        """The reference f(t) -> (10,); it rests at the end."""
        return sampled_reference(self.t, self.states)

    def write(self, path: str | Path) -> None:
        """Write the reference as a log file, in the format of its suffix."""
        write_reference(self.t, self.states, path)

    def c_table(self) -> str:
        """Return the states as a C header: a row for each sample, for `ballbot_update`."""
        step = self.robot.sensors.sample_time
        rows = ",\n".join(
            "    { " + ", ".join(f"{value:.8e}f" for value in row) + " }" for row in self.states.tolist()
        )
        return (
            f"/* {self.what} of the robot {self.robot.name}, by `ballbot plan`: the reference (10) of each sample of\n"
            f" * {1e3 * step:g} ms, in the frame of the start. Give row k to ballbot_update at sample k, and the\n"
            " * last row from there on. */\n"
            f"#define BALLBOT_PLAN_ROWS {len(self.states)}\n"
            f"static const float ballbot_plan[BALLBOT_PLAN_ROWS][10] = {{\n{rows}\n}};\n"
        )


def plan(
    robot: RobotLike,
    *,
    to: Sequence[float] | None = None,
    along: str | Path | Floats | None = None,
    stop_from: float | None = None,
    within: float | None = None,
    corridor: float = 0.02,
    limits: MoveLimits | None = None,
) -> Plan:
    """Return the fastest move to a pose, along a path, or to a stop; it starts at rest at the origin.

    Parameters
    ----------
    robot : Robot, preset or robot file
        With its friction.
    to : (x, y, psi), optional
        Where it ends, at rest [m, m, rad].
    along : path or array (k, 3), optional
        A reference file, whose times do not count, or places x, y [m] and psi [rad]; the first becomes the origin.
    stop_from : float, optional
        The speed [m/s], forward, from which it is to stop, wherever that is; a run-up to it comes before.
    within : float, optional
        The longest time allowed [s].
    corridor : float
        How far the ball may be from the path [m].
    limits : MoveLimits, optional
        `default_limits(robot)` if not given.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If not one of `to`, `along` and `stop_from` is given, CasADi is not installed, or a limit forbids the move: it
        says which, and by how much.

    Examples
    --------
    >>> plan("alten", to=(2.0, 0.0, 0.0)).bound
    'wheel torque'
    """
    robot = as_robot(robot)
    if (to is not None) + (along is not None) + (stop_from is not None) != 1:
        raise InputError("A plan needs one of to, along and stop_from.")
    planner = Planner(robot=robot, limits=limits or default_limits(robot))
    ahead = np.array([1.0, 0.0])
    if stop_from is not None:
        legs, what = _stop_legs(planner, stop_from, ahead), f"the stop from {stop_from:g} m/s"
    elif along is not None:
        legs, what = [_path_leg(planner, along, corridor)], "the path"
    else:
        pose = np.array(to, dtype=np.float64)
        if pose.shape != (3,) or not np.isfinite(pose).all() or not pose.any():
            raise InputError(
                "The pose to move to is three numbers, x and y in m and psi in rad, not all zero."
            )
        time = 1.0 + 2.0 * np.sqrt(np.hypot(*pose[:2]) / _USUAL) + abs(pose[2]) / _USUAL_TURN
        legs = [_leg_to(planner, pose, float(time))]
        what = f"the move to [{pose[0]:g} {pose[1]:g} {pose[2]:g}]"
        ahead = pose[:2] / max(float(np.hypot(*pose[:2])), 1e-9) if pose[:2].any() else ahead
    motions = [planner.fastest(leg) for leg in legs]
    if within is not None and motions[-1].t[-1] > within:
        raise InputError(_too_slow(planner, legs[-1], motions[-1], within, what))
    return _sampled(planner, motions, what, ahead)


def default_limits(robot: RobotLike) -> MoveLimits:
    """Return the limits of the precise controller: its torque, which keeps the wheels' grip, and a lean of 0.35 rad."""
    robot = as_robot(robot)
    return MoveLimits(torque=grip_torque_limit(robot), grip=assumed_grip(robot))


def _leg_to(planner: Planner, pose: Floats, time: float, course: PlannedPath | None = None) -> Leg:
    """Return a leg from rest at the origin to rest at a pose (3,), with a guess of its time [s]."""
    end = np.zeros(10)
    end[[0, 1, 4]] = pose
    torques = np.zeros((2, planner.robot.wheel_count))
    return Leg(start=np.zeros(10), end=end, torques=torques, course=course, time=time)


def _path_leg(planner: Planner, along: str | Path | Floats, corridor: float) -> Leg:
    """Return the leg along places, moved so that the first is the origin."""
    given = along if isinstance(along, np.ndarray) else read_poses(along)[1]
    places = real_array(given, ("k", 3), "The path")
    if len(places) < 2:
        raise InputError("A path is at least two places x, y and psi.")
    course = course_through(places - places[0], positive_number(corridor, "The corridor"))
    return _leg_to(planner, places[-1] - places[0], 1.0 + course.length / _USUAL_SPEED, course)


def _stop_legs(planner: Planner, speed: float, ahead: Floats) -> list[Leg]:
    """Return the run-up to a speed and the stop; InputError if the speed is above the largest."""
    speed = positive_number(speed, "The speed to stop from")
    top, bound = planner.top_speed(ahead)
    if speed > top:
        needed = planner.steady_use(speed * ahead)[FAMILIES.index(bound)]
        raise InputError(
            f"A speed of {speed:g} m/s cannot be held: the {bound} forbids it. It needs {percent(needed)} of the limit "
            f"less the margin of {percent(planner.limits.margin)}; the largest speed in this direction is {top:.3g} "
            "m/s."
        )
    state, torques = planner.steady(speed * ahead)
    moving, rest = state.copy(), np.zeros(10)
    moving[:2] = rest[:2] = np.nan
    none = np.zeros_like(torques)
    time = 1.0 + speed / _USUAL
    up = Leg(start=np.zeros(10), end=moving, torques=np.array([none, torques]), line=ahead, time=time)
    return [up, Leg(start=state, end=rest, torques=np.array([torques, none]), line=ahead, time=time)]


def _too_slow(planner: Planner, leg: Leg, fastest: PlannedMotion, within: float, what: str) -> str:
    """Return which limits forbid a time, and by how much they would have to be larger."""
    time, most = fastest.t[-1], max(fastest.savings.values())
    text = f"{what[0].upper()}{what[1:]} takes at least {time:.3f} s, {time - within:.3f} s more than {within:g} s"
    binding = [name for name, saving in fastest.savings.items() if saving > _BINDS * most]
    binding.sort(key=lambda name: -fastest.savings[name])
    forbid = f"the {every(binding)} {'forbids' if len(binding) == 1 else 'forbid'} it"
    try:
        factor = planner.fastest(replace(leg, time=float(time)), time=within, larger=binding).factor
    except InputError:  # another limit bounds it then
        return f"{text}: {forbid}, and larger ones alone would not do."
    return f"{text}: {forbid}, which would have to be {factor:.2f} times as large."


def _sampled(planner: Planner, motions: Sequence[PlannedMotion], what: str, ahead: Floats) -> Plan:
    """Return the plan of one motion, or of a run-up and a stop with a moment between them."""
    run_up, last = motions[0] if len(motions) == 2 else None, motions[-1]
    begins = run_up.t[-1] + _CRUISE if run_up else 0.0
    step = planner.robot.sensors.sample_time
    t = np.asarray(step * np.arange(int(np.ceil((begins + last.t[-1]) / step - 1e-9)) + 1), dtype=np.float64)
    states, torques = last.at(np.clip(t - begins, 0.0, last.t[-1]))
    states[-1, 2:4] = states[-1, 5:] = 0.0  # rest, without rounding
    if run_up:
        before = t < begins
        first, first_torques = run_up.at(np.minimum(t, run_up.t[-1]))
        first[:, :2] += first[:, 5:7] * np.maximum(t - run_up.t[-1], 0.0)[:, None]
        states[:, :2] += run_up.states[-1, :2] + _CRUISE * run_up.states[-1, 5:7]
        states[before], torques[before] = first[before], first_torques[before]
    used, motors = planner.used(states, torques)
    way = states[t >= begins, :2]
    top, bound = planner.top_speed(ahead)
    return Plan(
        robot=planner.robot,
        limits=planner.limits,
        what=what,
        t=t,
        states=states,
        torques=motors,
        used=used,
        duration=float(last.t[-1]),
        distance=float(np.hypot(*np.diff(way, axis=0).T).sum()),
        begins=float(begins),
        savings=last.savings,
        top_speed=top,
        top_speed_bound=bound,
    )


@dataclass(frozen=True, kw_only=True)
class Followed:
    """How a controller followed a plan on simulated robots."""

    runs: int
    fell: int
    peak_error: float  #: largest distance from the reference, of the runs that did not fall [m]
    end_error: float  #: the same once the robot has stood for two seconds [m]


def follow(
    plan: Plan,
    controller: Controller,
    scenario: Scenario,
    *,
    runs: int = 20,
    twin: bool = False,
) -> Followed:
    """Return how robots follow a plan, on the loop or on the twin, each with a seed; friction is the robot's."""
    robot, truth = plan.robot, with_identified(scenario, plan.robot.friction)
    on_twin = TwinRobot(robot=robot, scenario=truth, known=robot)
    plant = on_twin if twin else LoopRobot.of(robot, truth, known=robot)
    reference = partial(sampled_reference, plan.t, plan.states)
    conditions = [
        Condition(plant=plant, reference=reference, duration=float(plan.t[-1]) + _AFTER, seed=seed)
        for seed in range(1, runs + 1)
    ]
    errors = np.array(run_grid(grid_runs({"plan": controller}, conditions), _errors).answers)
    return Followed(
        runs=runs,
        fell=int(np.isnan(errors[:, 0]).sum()),
        peak_error=float(np.nanmax(errors[:, 0], initial=0.0)),
        end_error=float(np.nanmax(errors[:, 1], initial=0.0)),
    )


def _errors(_: GridRun, log: Log) -> tuple[float, float]:
    """Return the largest distance from the reference and the last one; NaN after a fall."""
    distance = position_error(log) if log.ended is None else np.array([np.nan])
    return float(distance.max()), float(distance[-1])
