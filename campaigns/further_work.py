"""The further work that the thesis names: a resonance cancelled, play, rolling friction's direction, commanded speeds.

.venv/bin/python -m campaigns.evidence further_work

The resonance is on the twin, the rest on the compiled loop and on the nominal twin; motors that take speeds run both
one sample of their driver at a time. Runs that are finished are kept in build/further_work.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.lqr import frictionless_model
from ballbot.control.parts.notch import Notch
from ballbot.control.presets import design_integral_gain, nominal_controller, precise_controller
from ballbot.control.references import Reference, hold, square
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName, Reading
from ballbot.fitting.run import Processes, Threads
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.imperfections import imperfections_of, true_model
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.grid import Condition, GridRun, LoopRobot, TwinRobot, grid_runs, run_grid
from ballbot.workflows.metrics import Score, falls_of, score, values_of
from campaigns.section import Section, finished

ALTEN = Robot.load("alten")
NOMINAL = Scenario.nominal(ALTEN)
#: the robot with the friction of the scenario, as well known as can be
KNOWN = ALTEN.replace(friction=NOMINAL.friction)
SEEDS, TWIN_SEEDS = tuple(range(700, 720)), tuple(range(1, 4))
COURSES: Mapping[str, tuple[Reference, float]] = {"hold": (hold(), 26.0), "square": (square(), 32.0)}
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "workflows")
#: scores of a course by its name
Scores = Mapping[str, Sequence[Score]]


# --- the resonance ---

RESONANT = TwinRobot(robot=ALTEN, scenario=Scenario.named("resonant", ALTEN), known=KNOWN)
#: weights of the torque from soft to stiff, without the notch and with it; with the last of each robots fall
LADDERS = {
    "without notch": (120.0, 60.0, 30.0, 20.0, 14.0),
    "with notch": (60.0, 30.0, 20.0, 14.0, 10.0, 7.0),
}
#: between the peaks of the residuals without play and with it; see the section on what the thesis observed
NOTCH = Notch(frequency=30.0)
RESONANT_SEEDS, RESONANT_DURATION = tuple(range(1, 11)), 10.0


@dataclass(frozen=True, kw_only=True)
class Stiff:
    """A run of the precise controller with another torque weight, on the resonant twin."""

    weight: float
    notched: bool
    seed: int


def stiff_controller(weight: float, *, notched: bool) -> Controller:
    """Return the precise controller with another torque weight, with or without the notch."""
    precise = precise_controller(KNOWN, design=design_integral_gain(KNOWN, torque_weight=weight))
    return precise.with_parts(replace(precise.parts, notch=NOTCH if notched else None))


def stiff_run(run: Stiff) -> Score:
    """Hold on the resonant twin."""
    condition = Condition(plant=RESONANT, reference=hold, duration=RESONANT_DURATION, seed=run.seed)
    controller = stiff_controller(run.weight, notched=run.notched)
    grid_run = GridRun(candidate="", controller=controller, condition=condition)
    return grid_run.score(grid_run.log())


def resonance() -> list[list[str]]:
    """Return a row for each gain, without the notch and with it."""
    runs = {
        f"{words}, {weight:g}, {seed}": Stiff(weight=weight, notched=words == "with notch", seed=seed)
        for seed in RESONANT_SEEDS
        for words, ladder in LADDERS.items()
        for weight in ladder
    }
    made = finished("further_work", stiff_run, runs, packages=_PACKAGES, workers=Processes(count=1))
    rows = []
    for words, ladder in LADDERS.items():
        for weight in ladder:
            gain = stiff_controller(weight, notched=False).gain[:, 0]
            scores = {"hold": [made[f"{words}, {weight:g}, {seed}"] for seed in RESONANT_SEEDS]}
            rows.append(_row(f"resonance, {words}, {np.linalg.norm(gain):.0f} N m/m", scores))
    return rows


# --- play and rolling friction ---

#: in words, the play [deg] and the factors on the rolling friction that is compensated and on the ball's speed below
#: which its direction is a ramp
CHANGES = {
    "as it is": (1.0, 1.0, 1.0),
    "no play": (0.0, 1.0, 1.0),
    "rolling friction not compensated": (1.0, 0.0, 1.0),
    "its ramp three times as wide": (1.0, 1.0, 3.0),
}


@dataclass(frozen=True, kw_only=True)
class Changed:
    """Runs of the soft or the precise controller, named with one of the changes, on the compiled loop or the twin."""

    name: str
    words: str
    twin: bool = False
    seeds: tuple[int, ...] = SEEDS


def changed_scores(runs: Changed) -> Scores:
    """Run the courses."""
    play, share, wider = CHANGES[runs.words]
    controller = (
        nominal_controller(KNOWN, compensation="full") if runs.name == "soft" else precise_controller(KNOWN)
    )
    record = controller.record["compensation"]
    record["rolling"] *= share
    record["rolling_steepness"] /= wider
    scenario = replace(NOMINAL, backlash=math.radians(play))
    plant = (
        TwinRobot(robot=ALTEN, scenario=scenario, known=KNOWN)
        if runs.twin
        else LoopRobot.of(KNOWN, scenario, known=KNOWN)
    )
    conditions = [
        Condition(plant=plant, reference=lambda made=made: made, duration=duration, seed=seed, course=course)
        for course, (made, duration) in COURSES.items()
        for seed in runs.seeds
    ]
    table = run_grid(grid_runs({"": controller}, conditions), workers=Threads(count=1))
    return {course: table.of("", course) for course in COURSES}


def play_and_rolling() -> list[list[str]]:
    """Return a row for each change and controller, on the loop and on the twin."""
    pairs = [(words, name) for words in CHANGES for name in ("soft", "precise")]
    runs = {f"{name}, {words}": Changed(name=name, words=words) for words, name in pairs}
    runs |= {
        f"twin: {name}, {words}": Changed(name=name, words=words, twin=True, seeds=TWIN_SEEDS)
        for words, name in pairs
    }
    made = finished("further_work", changed_scores, runs, packages=_PACKAGES, workers=Processes(count=1))
    return [_row(words, scores) for words, scores in made.items()]


# --- motors that take speeds ---

#: the driver's sample time [s], and its samples in one of the controller
DRIVER, EVERY = 0.0025, 2
#: of the driver: N m for an error of 1 rad/s and for one of 1 rad; half the gain makes the stiff controllers fall
PROPORTIONAL, INTEGRAL = 1.0, 10.0
SPEED_SEEDS = tuple(range(700, 705))


class Board:
    """An estimator at the controller's rate behind sensors read at the driver's; it keeps what the driver sees."""

    def __init__(self, name: EstimatorName) -> None:
        self._estimator = named_estimator(name, ALTEN, sample_time=EVERY * DRIVER)
        self.sample_time = DRIVER
        self.reset()

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Start at a position."""
        self._estimator.reset(position=position)
        self._samples, self._angles, self._state = 0, np.zeros(3), np.full(10, np.nan)
        self.speeds = np.zeros(3)  #: of the motors, at the last sample [rad/s]
        self.fresh = False  #: whether the state is of the last sample

    def update(self, reading: Reading) -> NDArray[np.float64]:
        """Return the state, renewed at the controller's rate with speeds counted over its sample."""
        self.speeds, self.fresh = reading.wheel_speeds, self._samples % EVERY == 0
        if self.fresh:
            moved = reading.wheel_angles - self._angles if self._samples else np.zeros(3)
            self._angles = reading.wheel_angles.copy()
            self._state = self._estimator.update(replace(reading, wheel_speeds=moved / (EVERY * DRIVER)))
        self._samples += 1
        return self._state


class SpeedDriven:
    """A law's torques integrated through the rigid model into speeds of the wheels, which the drivers follow by PI."""

    sample_time = DRIVER

    def __init__(self, board: Board, law: Controller) -> None:
        self._board, self._law = board, law
        model = frictionless_model(ALTEN)
        wheels, linear = model.wheel_jacobian(np.zeros(5)), model.linearize()
        self._by_lean, self._by_torque = wheels @ linear.A[5:, 2:4], wheels @ linear.B[5:]
        self.reset()

    def reset(self) -> None:
        """Begin at rest."""
        self._law.reset()
        self._wanted, self._sum = np.zeros(3), np.zeros(3)

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the drivers' torques."""
        if self._board.fresh:
            torques = self._law.update(t, state, reference)
            theta, phi, psi = state[2:5]
            lean = np.array([[theta, phi], [phi, -theta]]) @ (math.cos(psi), math.sin(psi))
            self._wanted = self._wanted + EVERY * DRIVER * (self._by_lean @ lean + self._by_torque @ torques)
        error = self._wanted - self._board.speeds
        asked, limit = PROPORTIONAL * error + INTEGRAL * self._sum, ALTEN.drive.torque_limit
        if np.abs(asked).max() <= limit:
            self._sum = self._sum + DRIVER * error
        return np.clip(asked, -limit, limit)


def speed_run(course: tuple[str, int, bool]) -> Score:
    """Follow a course, named with a seed, on the loop or the twin, by the nominal gain without compensation."""
    name, seed, twin = course
    reference, duration = COURSES[name]
    sensors = replace(NOMINAL.sensors, sample_time=DRIVER)
    fast = replace(NOMINAL, sensors=sensors, speed_window=2)
    board = Board("onboard")
    plant = (
        Twin(ALTEN, fast, estimator=board)
        if twin
        else SensedPlant(true_model(KNOWN, fast), imperfections_of(fast, known=KNOWN), estimator=board)
    )
    driven = SpeedDriven(board, nominal_controller(KNOWN, compensation="none"))
    return score(simulate(plant, driven, reference, duration=duration, seed=seed))


def speeds() -> list[list[str]]:
    """Return a row of the nominal gain through speeds, on the loop and on the twin."""
    rows = []
    for plant, seeds in (("", SPEED_SEEDS), ("twin: ", TWIN_SEEDS)):
        runs = {
            f"{plant}speeds, {name}, {seed}": (name, seed, bool(plant)) for seed in seeds for name in COURSES
        }
        made = finished("further_work", speed_run, runs, packages=_PACKAGES, workers=Processes(count=1))
        scores = {name: [made[f"{plant}speeds, {name}, {seed}"] for seed in seeds] for name in COURSES}
        rows.append(_row(f"{plant}soft without compensation, through speeds", scores))
    return rows


# --- the section ---


def _row(words: str, scores: Scores) -> list[str]:
    cells = [words]
    for name in COURSES:
        runs = scores.get(name, ())
        for number in ("rms_position_error", "peak_position_error", "high_frequency_torque"):
            known = values_of(runs, number)[:, None] if runs else np.empty((0, 1))
            known = known[~np.isnan(known)]
            cells.append(f"{1e3 * known.mean():.1f}" if len(known) else "–")
    runs = [run for course in scores.values() for run in course]
    return [*cells, f"{falls_of(runs)} of {len(runs)}"]


def campaign() -> Section:
    """Return the section of docs/generated/evidence.md."""
    numbers = ("rms [mm]", "peak [mm]", "rough [mN m]")
    return Section(
        title="The thesis's further work",
        before="The thesis's robot with the nominal scenario's friction, which the controllers know; soft is the "
        "nominal gain with full compensation. Means of the true position's error once settled, and of the torque above "
        f"10 Hz. Resonance: the twin of that name, {len(RESONANT_SEEDS)} seeds, {RESONANT_DURATION:g} s of hold by the "
        "precise controller with other torque weights, named by their gain of x; its own is the third without "
        f"notch. Play and rolling friction: the compiled loop, {len(SEEDS)} seeds. Speeds: the same loop at "
        f"{1 / DRIVER:g} Hz, the rate of the drivers' PI loop, {len(SPEED_SEEDS)} seeds. Of all three, "
        f"{len(TWIN_SEEDS)} seeds on the nominal twin.",
        columns=["", *(f"{course}, {number}" for course in COURSES for number in numbers), "falls"],
        rows=[*resonance(), *play_and_rolling(), *speeds()],
        after="A run that fell enters no mean. What follows is in [Control](../control.md#the-thesiss-further-work).",
    )
