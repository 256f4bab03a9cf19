"""Whether the compiled loop and the physics-engine twin agree: the same scenarios, courses and controllers on both.

.venv/bin/python -m campaigns.evidence agreement

One scenario drives both. Controllers know the robot and the friction of the nominal scenario, nothing of the harder
ones. Where a median differs, the twin runs the cheapest course again with one effect after another switched off.

The runs on the twin are some hours of work. They are kept in build/agreement, and a campaign that was stopped goes on;
AGREEMENT_RUNS=600 uses the first 600 of them only. The loop runs anew each time.
"""

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.file import controller_text
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.fitting.sweep import identity
from ballbot.robot import Robot
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario
from ballbot.twin.faults import CurrentLoop, Payload, Timing
from ballbot.twin.imperfections import imperfections_of, true_model
from ballbot.workflows.controller_choice import SQUARE
from ballbot.workflows.courses import Course, PlantName, ReferenceSpec
from ballbot.workflows.grid import Condition, GridRun, GridTable, LoopRobot, run_grid
from ballbot.workflows.metrics import SETTLE, Rules, Score
from ballbot.workflows.statistics import fraction_with_interval, median_with_interval
from campaigns.section import Section, compared, markdown_table
from campaigns.twin_logs import asymmetric

KEPT = Path(__file__).parents[1] / "build" / "agreement"
LOOP_SEEDS, TWIN_SEEDS = range(200), range(40)
#: fewest runs that give a median a 95 % interval
FEWEST = 6

NOMINAL = Scenario.nominal("alten")
ROBOT = Robot.load("alten").replace(friction=NOMINAL.friction)
SAMPLE_TIME = ROBOT.sensors.sample_time
SCENARIOS: Mapping[str, Scenario] = {
    "nominal": NOMINAL,
    # every lag that a loop can have: 5 ms of torque, 5 ms of the IMU, 4 ms of the motors, 1 ms of jitter
    "late": replace(
        NOMINAL,
        timing=Timing(delay=1, jitter=0.001),
        current_loop=CurrentLoop(bandwidth=40.0),
        sensor_faults=SensorFaults(latency=SAMPLE_TIME),
    ),
    # another robot on another floor: 1 kg beside the axis, 1 deg of slope, friction that depends on the direction
    "loaded": replace(
        NOMINAL,
        payload=Payload(mass=1.0, position=(0.05, 0.0, 0.6)),
        floor_tilt=(0.0, float(np.radians(1.0))),
        friction=asymmetric(NOMINAL.friction, 0.2),
    ),
    # a cheap robot: rows of rollers far apart, twice the play, three times the noise, gyro and lean off
    "cheap": replace(
        Scenario.named("wide_rows", "alten"),
        backlash=2.0 * NOMINAL.backlash,
        sensors=replace(
            NOMINAL.sensors,
            gyro_noise=3.0 * NOMINAL.sensors.gyro_noise,
            attitude_noise=3.0 * NOMINAL.sensors.attitude_noise,
        ),
        sensor_faults=SensorFaults(gyro_bias=0.005, lean_error=0.003),
    ),
}
#: the nominal scenario without one effect: first those that only the twin has
WITHOUT: Mapping[str, Scenario] = {
    "rollers": replace(NOMINAL, wheel_contact="point"),
    "slip": replace(NOMINAL, floor_grip=5.0, roller_grip=5.0),
    "pivoting": replace(NOMINAL, pivoting=10.0 * NOMINAL.pivoting),
    "half of the softness": replace(
        NOMINAL, contact_time=0.5 * NOMINAL.contact_time, timestep=0.5 * NOMINAL.timestep
    ),
    "play": replace(NOMINAL, backlash=0.0),
}
#: by name, how each controller is made
CONTROLLERS: Mapping[str, Callable[[], Controller]] = {
    "soft": partial(nominal_controller, ROBOT),
    "full": partial(nominal_controller, ROBOT, compensation="full"),
    "partial": partial(nominal_controller, ROBOT, compensation="partial"),
    "precise": partial(precise_controller, ROBOT),
    "precise without": partial(precise_controller, ROBOT, compensation="none"),
}
_STEP = (("x", 0.5), ("y", 0.0), ("psi", 0.0), ("at", 1.0), ("ramp", 0.0))
#: reference, duration and from when errors count [s]
TASKS: Mapping[str, tuple[ReferenceSpec, float, float]] = {
    "hold": (ReferenceSpec(name="hold"), 8.0, 3.0),
    "step": (ReferenceSpec(name="change_pose", options=_STEP), 8.0, 3.0),
    "square": (SQUARE.reference_spec, SQUARE.duration, SETTLE),
}


def _course(scenario: str, task: str) -> Course:
    spec, duration, settle = TASKS[task]
    return Course(
        name=f"{scenario}, {task}",
        about="",
        reference_spec=spec,
        duration=duration,
        rules=Rules(settle=settle),
        scenario={**SCENARIOS, **WITHOUT}[scenario],
        on="model",
    )


COURSES = tuple(_course(scenario, task) for scenario in SCENARIOS for task in TASKS)
#: the controllers that single effects are looked at with
EXPLAINED = ("soft", "precise")
EFFECTS = tuple(_course(scenario, "hold") for scenario in WITHOUT)


def runs_of(
    courses: Sequence[Course], seeds: Sequence[int], *, on: PlantName, names: Collection[str] = ()
) -> list[GridRun]:
    """Return the runs of controllers, all if no names are given, on courses, seed by seed."""
    made = {name: make() for name, make in CONTROLLERS.items() if not names or name in names}
    return [
        GridRun(
            candidate=name,
            controller=controller,
            condition=Condition(
                plant=_loop_robot(course) if on == "model" else replace(course, on=on).plant(ROBOT),
                reference=course.reference_spec.reference,
                duration=course.duration,
                seed=seed,
                course=course.name,
                rules=course.rules,
            ),
        )
        for seed in seeds
        for course in courses
        for name, controller in made.items()
    ]


def _loop_robot(course: Course) -> LoopRobot:
    """Return the robot of a course on the loop with all of the scenario, friction and rollers as on the twin."""
    scenario = course.scenario
    return LoopRobot(model=true_model(ROBOT, scenario), imperfections=imperfections_of(scenario, known=ROBOT))


def twin_plan() -> list[GridRun]:
    """Return all runs on the twin: of the first seeds hold, single effects, step, square; then the other seeds."""
    first, rest = TWIN_SEEDS[:FEWEST], TWIN_SEEDS[FEWEST:]
    hold, step, square = (COURSES[number :: len(TASKS)] for number in range(len(TASKS)))
    return [
        *runs_of(hold, first, on="twin"),
        *runs_of(EFFECTS, first, on="twin", names=EXPLAINED),
        *(run for courses in (step, square) for run in runs_of(courses, first, on="twin")),
        *runs_of(COURSES, rest, on="twin"),
    ]


def run_twin(
    runs: Sequence[GridRun], *, folder: Path = KEPT, processes: int | None = None
) -> GridTable[Score]:
    """Make the runs that the folder lacks, and return all."""
    inputs = {name: [controller_text(make())] for name, make in CONTROLLERS.items()}
    made_from = identity({**inputs, "courses": [COURSES, EFFECTS], "robot": [ROBOT]}, {})
    files = {f"{run.condition.course}, {run.candidate}, {run.condition.seed:02d}.json": run for run in runs}
    return compared(folder, files, made_from=made_from, stage="running the twin", processes=processes)


#: what is compared: of a score, its unit, how many of that unit are one of SI, decimals shown
QUANTITIES: Mapping[str, tuple[str, str, float, int]] = {
    "peak": ("peak_position_error", "mm", 1e3, 1),
    "RMS": ("rms_position_error", "mm", 1e3, 1),
    "roughness": ("rms_torque_change", "N m", 1.0, 3),
}

LOOP, TWIN = 0, 1


@dataclass(frozen=True, kw_only=True)
class Both:
    """The scores of a controller on a course, on the loop and on the twin."""

    course: str
    controller: str
    scores: tuple[tuple[Score, ...], tuple[Score, ...]]

    def values(self, quantity: str, side: int) -> NDArray[np.float64]:
        """Return a quantity's values in shown units, of the runs that did not fall."""
        key, _, scale, _ = QUANTITIES[quantity]
        return np.array([scale * getattr(score, key) for score in self.scores[side] if score.ended is None])

    def falls(self, side: int) -> int:
        """Return the number of runs that fell."""
        return sum(score.ended is not None for score in self.scores[side])

    def interval(self, quantity: str, side: int) -> tuple[float, float]:
        """Return the 95 % interval of the median, or of the share of falls; without bounds of too few runs."""
        if quantity == "falls":
            return fraction_with_interval(self.falls(side), max(len(self.scores[side]), 1))
        estimate = median_with_interval(self.values(quantity, side))
        return (estimate.low, estimate.high) if estimate.runs >= FEWEST else (-np.inf, np.inf)

    def ratio(self, quantity: str) -> float:
        """Return the loop's median over the twin's; NaN if all runs fell."""
        loop, twin = (median_with_interval(self.values(quantity, side)).median for side in (LOOP, TWIN))
        return loop / twin

    def outside(self, quantity: str) -> bool:
        """Return whether the loop's median lies outside the twin's 95 % interval."""
        low, high = self.interval(quantity, TWIN)
        median = median_with_interval(self.values(quantity, LOOP)).median
        return median < low or median > high

    def orders(self, other: Self, quantity: str) -> int:
        """Return 1 if intervals put two controllers in the same order on both, -1 if not, 0 if they overlap on one."""
        order = 1
        for side in (LOOP, TWIN):
            (a, b), (c, d) = self.interval(quantity, side), other.interval(quantity, side)
            order *= int(a > d) - int(b < c)
        return order


def campaign() -> Section:
    """Run both and return the section of docs/generated/evidence.md."""
    plan = twin_plan()
    twin = run_twin(plan[: int(os.environ.get("AGREEMENT_RUNS", len(plan)))])
    alike = runs_of(EFFECTS, LOOP_SEEDS, on="model", names=EXPLAINED)
    loop = run_grid([*runs_of(COURSES, LOOP_SEEDS, on="model"), *alike])
    return section(both(COURSES, loop, twin), both(EFFECTS, loop, twin))


def both(courses: Sequence[Course], loop: GridTable[Score], twin: GridTable[Score]) -> list[Both]:
    """Return the scores of every controller on courses."""
    return [
        Both(
            course=course.name,
            controller=name,
            scores=(loop.of(name, course.name), twin.of(name, course.name)),
        )
        for course in courses
        for name in CONTROLLERS
    ]


def section(cases: Sequence[Both], effects: Sequence[Both]) -> Section:
    """Return the section of the page: every controller on every course, orders, and what the loop lacks."""
    heads = [f"{name}, {side} [{unit}]" for name, (_, unit, *_) in QUANTITIES.items() for side in _SIDES]
    return Section(
        title="The compiled loop and the physics-engine twin",
        before=f"{_ABOUT} Medians of the runs that did not fall, in brackets the 10th and 90th percentile. Bold: the "
        "loop's median lies outside the twin's 95 % interval of the median.",
        columns=["scenario, course", "controller", *heads, *(f"falls, {side}" for side in _SIDES)],
        rows=[_row(case) for case in cases],
        after=f"{_orders(cases)}\n\n{_outside(cases)}\n\n{_effects_table(cases, effects)}",
    )


_SIDES = ("loop", "twin")
_ABOUT = (
    "The same scenarios, courses and controllers on the loop and on the twin. *late*: torques and IMU a sample "
    "late, motors of 40 Hz, 1 ms of jitter; *loaded*: 1 kg 5 cm off the axis, a floor tilted by 1 deg, dry friction "
    "20 % larger forward than in the mean; *cheap*: rows of rollers 22 mm apart, twice the play, three times the IMU's "
    "noise, its gyro and lean off. Controllers know the robot and the friction of the nominal scenario. Errors are "
    "those of the true position: on the square (32 s) 6 s after each corner, in the hold and after a step of 0.5 m "
    "(8 s each) from 3 s on; roughness is the RMS change of the torques from sample to sample."
)


def _row(case: Both) -> list[str]:
    cells = []
    for quantity, (*_, decimals) in QUANTITIES.items():
        for side in (LOOP, TWIN):
            values = case.values(quantity, side)
            low, middle, high = np.quantile(values, (0.1, 0.5, 0.9)) if len(values) else [np.nan] * 3
            bold = "**" if side == LOOP and case.outside(quantity) else ""
            cells.append(
                f"{bold}{middle:.{decimals}f}{bold} ({low:.{decimals}f}–{high:.{decimals}f})"
                if len(values)
                else "–"
            )
    return [
        *(case.course, case.controller, *cells),
        *(f"{case.falls(side)} of {len(case.scores[side])}" for side in (LOOP, TWIN)),
    ]


def _orders(cases: Sequence[Both]) -> str:
    """Return how many pairs of controllers that intervals separate on both have one order."""
    pairs = [(case, other) for case, other in combinations(cases, 2) if case.course == other.course]
    words, contrary = [], []
    for quantity in (*QUANTITIES, "falls"):
        signs = [case.orders(other, quantity) for case, other in pairs]
        words.append(f"{signs.count(1)} of {signs.count(1) + signs.count(-1)} by {quantity}")
        contrary += [
            f"{quantity} of {case.controller} and {other.controller} ({case.course})"
            for (case, other), sign in zip(pairs, signs, strict=True)
            if sign < 0
        ]
    return (
        "Pairs of controllers on one course whose intervals are apart on both, and whose order agrees: "
        f"{', '.join(words)}. Contrary: {'; '.join(contrary) or 'none'}."
    )


def _outside(cases: Sequence[Both]) -> str:
    """Return how many of the loop's medians lie outside the twin's interval, and how far."""
    words = []
    for quantity in QUANTITIES:
        known = [case for case in cases if np.isfinite(case.interval(quantity, TWIN)).all()]
        ratios = [case.ratio(quantity) for case in known if case.outside(quantity)]
        span = f", loop over twin {min(ratios):.2f} to {max(ratios):.2f}" if ratios else ""
        words.append(f"{len(ratios)} of {len(known)} by {quantity}{span}")
    return f"Medians of the loop outside the twin's interval: {'; '.join(words)}."


def _named(cases: Sequence[Both], effects: Sequence[Both]) -> str:
    """Return which effect, switched off, brings each ratio that lies outside in the hold nearest to 1."""
    words = []
    for case in cases:
        if case.course != "nominal, hold" or case.controller not in EXPLAINED:
            continue
        without = {
            other.course.rpartition(",")[0]: other for other in effects if other.controller == case.controller
        }
        for quantity in QUANTITIES:
            ratios = {
                name: other.ratio(quantity)
                for name, other in without.items()
                if len(other.values(quantity, TWIN)) >= FEWEST // 2
            }
            if case.outside(quantity) and ratios:
                name = min(ratios, key=lambda effect: abs(np.log(ratios[effect])))
                words.append(
                    f"{case.controller}, {quantity}: {name} "
                    f"({case.ratio(quantity):.2f} with, {ratios[name]:.2f} without)"
                )
    return f"Of those outside in the hold, nearest to 1 without: {'; '.join(words) or 'none is outside'}."


def _effects_table(compared: Sequence[Both], effects: Sequence[Both]) -> str:
    """Return the loop's medians over the twin's with one effect after another switched off on both."""
    heads = [f"{name}: {quantity}" for name in EXPLAINED for quantity in QUANTITIES]
    seeds = [len(case.scores[TWIN]) for case in effects if case.controller in EXPLAINED]
    words = (
        "What makes the difference: the hold in the nominal scenario, loop over twin (ratio of medians), with one "
        f"effect after another switched off on both ({min(seeds, default=0)} seeds or more on the twin). Rollers: "
        "each wheel touches in one point; slip: grip 5; pivoting: ten times the ball's resistance. Of the contacts "
        "the loop has what rollers do that touch side by side, but no other slip, pivoting or softness. What brings a "
        "ratio to 1 is what the loop lacks or has otherwise. One effect cannot be switched off: MuJoCo's convex "
        "friction presses a roller that slips harder onto the ball, most with rows far apart (*cheap*); the loop's "
        "is Coulomb's."
    )
    rows = []
    cases = {"nothing": "nominal, hold"} | {effect: f"{effect}, hold" for effect in WITHOUT}
    for effect, course in cases.items():
        cells = [
            case for case in (*compared, *effects) if case.course == course and case.controller in EXPLAINED
        ]
        ratios = [
            f"{cell.ratio(quantity):.2f}" if len(cell.values(quantity, TWIN)) else "–"
            for cell in cells
            for quantity in QUANTITIES
        ]
        rows.append([effect, *ratios])
    return "\n\n".join([words, markdown_table(["without", *heads], rows), _named(compared, effects)])
