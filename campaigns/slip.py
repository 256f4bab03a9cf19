"""Pushes after which wheels slip, on the twin; and how often the filter leaves wheels out that do not, on the loop.

.venv/bin/python -m campaigns.evidence slip slip_alarms

Runs that are finished are kept in build/slip.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.control.controller import Controller
from ballbot.control.presets import precise_controller
from ballbot.control.references import hold
from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman import KalmanFilter, kalman_record
from ballbot.estimation.kalman_model import PIVOTING_SEEN
from ballbot.estimation.slip import PIVOTS, SLIPS
from ballbot.fitting.run import Processes
from ballbot.log import Log
from ballbot.mechanics.geometry import rotation, transforms
from ballbot.robot import Robot
from ballbot.simulation.imperfections import Push
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario, Twin
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.grid import Condition, GridRun, LoopRobot, grid_runs, run_grid
from campaigns.section import Section, finished, share_words
from campaigns.strangers import BASES, TUNING, stranger

#: [N s]; of each, directions, evenly spread, and seeds
IMPULSES, DIRECTIONS, SEEDS = (30.0, 15.0), 8, range(10)
#: of a push: when, for how long [s], and how far above the ball's centre [m]; a run ends once the robot is back
BEGINS, LASTS, HEIGHT, ENDS = 1.0, 0.1, 0.4, 5.0
#: distance of the estimated position from the true one that is aimed at [m]
CLOSE = 0.05
PACKAGES = ("control", "estimation", "mechanics", "robot", "simulation", "twin")


@dataclass
class Watched:
    """A Kalman filter, by how much the ball slides on the floor meanwhile, and whether wheels were left out."""

    filter: KalmanFilter
    twin: Twin | None = None
    slides: list[Floats] = field(default_factory=list)  #: [m/s]
    left_out: list[bool] = field(default_factory=list)

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Forget the past."""
        self.filter.reset(position=position)
        self.slides.clear()
        self.left_out.clear()

    def update(self, reading: Reading) -> Floats:
        """Return the filter's state."""
        if self.twin:
            self.slides.append(_slide(self.twin))
        state = self.filter.update(reading)
        self.left_out.append(self.filter._memory["slip"]["lasting"][0] > 0.0)
        return state


def _slide(twin: Twin) -> Floats:
    """Return the speed (2,) of the ball's lowest point on the floor [m/s]."""
    v, place = twin.engine.velocity("ball"), twin.engine.position("ball")
    w, x, y, z = place[3:7]
    # MuJoCo has the ball's turning in its own frame
    own = np.array([[w, -z, y], [z, w, -x], [-y, x, w]])
    turning = v[3:] + 2.0 * np.cross([x, y, z], own @ v[3:])
    return v[:2] - twin.robot.ball.radius * np.array([turning[1], -turning[0]])


@dataclass(frozen=True, kw_only=True)
class Pushed:
    """What became of a robot that was pushed."""

    recovered: bool
    error: float  #: distance of the estimated position from the true one over the last second, its mean [m]
    largest: float  #: the largest of the run [m]
    left_out: float  #: for how long the filter left the wheels out [s]
    slid: float  #: how far the ball slid on the floor, end from start [m]
    heading: float  #: error at the end [rad]


def gripping(name: str = "alten") -> Robot:
    """Return a robot with the nominal scenario's friction, and its grip in its file: 1 with a deviation of 0.1."""
    robot = Robot.load(name)
    robot = robot.replace(friction=Scenario.nominal(robot).friction).replace({"wheels.grip": 1.0})
    return replace(robot, standard_deviations={**robot.standard_deviations, "wheels.grip": 0.1})


def pushed_log(robot: Robot, impulse: float, direction: int, seed: int) -> tuple[Log, Watched]:
    """Return the log of a push on the twin, and the filter that watched it."""
    angle = 2.0 * np.pi * direction / DIRECTIONS
    push = Push.of_impulse(impulse, angle, time=BEGINS, duration=LASTS, height=HEIGHT)
    scenario = replace(Scenario.nominal(robot), pushes=(push,))
    watched = Watched(KalmanFilter(robot, sample_time=scenario.sensors.sample_time))
    watched.twin = Twin(robot, scenario, estimator=watched)
    log = simulate(watched.twin, precise_controller(robot), hold(), duration=ENDS, seed=seed)
    return log, watched


def pushed(run: tuple[float, int, int]) -> Pushed:
    """Return what becomes of the thesis's robot after a push [N s] in a direction, with a seed."""
    robot = gripping()
    log, watched = pushed_log(robot, *run)
    true, h = log.truth().states, robot.sensors.sample_time
    errors = np.hypot(*(log.states - true)[:, :2].T)
    return Pushed(
        recovered=log.ended is None,
        error=float(errors[-round(1.0 / h) :].mean()),
        largest=float(errors.max()),
        left_out=h * sum(watched.left_out),
        slid=float(h * np.hypot(*np.sum(watched.slides, axis=0))),
        heading=float(log["psi"][-1] - log.truth()["psi"][-1]),
    )


def campaign() -> Section:
    """Return the section of docs/generated/evidence.md on pushes."""
    runs = {
        f"{impulse:g}_{k}_{seed}": (impulse, k, seed)
        for impulse, seed, k in product(IMPULSES, SEEDS, range(DIRECTIONS))
    }
    made = finished("slip", pushed, runs, packages=PACKAGES, workers=Processes(count=1))
    by_impulse = {
        impulse: [one for name, one in made.items() if runs[name][0] == impulse] for impulse in IMPULSES
    }
    return Section(
        title="Where a robot believes to stand after a push that makes its wheels slip",
        before=f"`alten` on the nominal twin, held by the precise controller; its file states a grip of 1 with a "
        f"deviation of 0.1. One push of {LASTS:g} s, {HEIGHT:g} m above the ball's centre, from each of {DIRECTIONS} "
        f"directions, {len(SEEDS)} seeds. The error is the distance of the estimated position from the true one "
        f"{ENDS - BEGINS - 1.0:g} to {ENDS - BEGINS:g} s after the push; aimed at are {1e3 * CLOSE:g} mm in nine of "
        "ten. No sensor sees the ball slide on the floor: by so much the error would be with perfect wheels.",
        columns=[
            "impulse [N s]",
            "recovered",
            f"within {1e3 * CLOSE:g} mm",
            "error, median [mm]",
            "largest",
            "on the way, largest",
            "wheels left out, median [s]",
            "ball slid, largest [mm]",
        ],
        rows=[_row(impulse, those) for impulse, those in by_impulse.items()],
    )


def _row(impulse: float, runs: Sequence[Pushed]) -> list[str]:
    kept = [one for one in runs if one.recovered]
    errors = 1e3 * np.array([one.error for one in kept])
    close = int((errors <= 1e3 * CLOSE).sum())
    return [
        f"{impulse:g}",
        f"{len(kept)} of {len(runs)}",
        f"{close} of {len(kept)}",
        f"{np.median(errors):.0f}",
        f"{errors.max():.0f}",
        f"{1e3 * max(one.largest for one in kept):.0f}",
        f"{np.median([one.left_out for one in kept]):.2f}",
        f"{1e3 * max(one.slid for one in kept):.0f}",
    ]


# --- false alarms ---

#: strangers' robots, courses with their set where it is not the motions', and seeds of each robot and controller
STRANGERS, COURSES, ALARM_SEEDS = 20, ("square", "figure_eight", "hold", "velocity_steps"), range(9)


def samples_left_out(log: Log, known: Robot) -> Bools:
    """Return at which samples (N - 1,) a filter of the known robot took wheels to slip, by its own rule.

    By the state that it gave then; that which it had expected differs by what gravity adds in a sample. The ball's
    pivoting lately, for which the rule allows besides, counts as none: there are no more than these.
    """
    record = kalman_record(known, sample_time=known.sensors.sample_time)
    relative = np.diff(log.wheel_angles, axis=0) @ transforms(known).T_obw.T / record.sample_time
    state = log.states[1:]
    turning = np.einsum(
        "nij,nj->ni",
        rotation(*state[:, 2:5].T),
        relative + np.column_stack([log[f"gyro_{axis}"] for axis in "xyz"])[1:],
    )
    faster = known.ball.radius * np.stack([turning[:, 1], -turning[:, 0]], axis=-1) - state[:, 5:7]
    pivots = np.abs(turning[:, 2]) > PIVOTS * np.sqrt(record.variances[PIVOTING_SEEN])
    return pivots & (np.hypot(*faster.T) > 0.95 * SLIPS * np.sqrt(record.variances[0]))


@dataclass(frozen=True, kw_only=True)
class Alarms:
    """The samples of a run in which wheels were taken to slip; none can, as its contacts hold."""

    count: int
    time: float  #: of the run [s]
    ended: bool


def alarms(known: Mapping[str, Robot], run: GridRun, log: Log) -> Alarms:
    """Return the false alarms of a run."""
    robot = known[str(run.candidate)]
    return Alarms(
        count=int(samples_left_out(log, robot).sum()), time=float(log.t[-1]), ended=log.ended is not None
    )


def alarm_runs(strangers: int, seeds: Sequence[int]) -> tuple[list[GridRun], dict[str, Robot]]:
    """Return runs of presets and strangers on ordinary courses, and the robots that their filters know."""
    robots: dict[str, tuple[Robot, Robot, Scenario]] = {}
    for name in BASES:
        robot = gripping(name)
        robots[name] = (robot, robot, Scenario.nominal(robot))
    for number in range(strangers):
        one = stranger(TUNING, number)
        known = one.file.replace(friction=one.scenario.friction)
        robots[one.scenario.name] = (known, one.true.replace(friction=one.scenario.friction), one.scenario)
    runs = []
    for name, (known, true, scenario) in robots.items():
        controllers: dict[str, Controller] = {name: precise_controller(known)}
        plant = LoopRobot.of(true, scenario, known=known)
        conditions = [
            Condition(
                plant=plant,
                reference=course.reference_spec.reference,
                duration=course.duration,
                seed=seed,
                course=course.name,
            )
            for course in choose_courses(",".join(COURSES), known, "model")
            for seed in seeds
        ]
        runs += grid_runs(controllers, conditions)
    return runs, {name: known for name, (known, _, _) in robots.items()}


def false_alarms() -> Section:
    """Return the section of docs/generated/evidence.md on false alarms."""
    runs, known = alarm_runs(STRANGERS, ALARM_SEEDS)
    table = run_grid(runs, partial(alarms, known), workers=Processes(count=1))
    rows = []
    for course in COURSES:
        these = [
            one for run, one in zip(table.runs, table.answers, strict=True) if run.condition.course == course
        ]
        alarmed = sum(one.count > 0 for one in these)
        rows.append(
            [
                course,
                f"{sum(one.time for one in these) / 3600.0:.1f}",
                f"{sum(one.ended for one in these)} of {len(these)}",
                str(sum(one.count for one in these)),
                share_words(alarmed, len(these)),
            ]
        )
    return Section(
        title="Wheels that do not slip and are left out",
        before=f"The presets, and {STRANGERS} strangers' robots with play up to 2 degrees, on the compiled loop with "
        "contacts that hold, rollers, play and sensors, by the precise controller with their friction known: samples "
        "in which the filter takes the wheels to slip.",
        columns=["course", "time [h]", "falls", "samples with an alarm", "runs with an alarm"],
        rows=rows,
    )
