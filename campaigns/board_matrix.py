"""From a robot to its board: drawn robots times kinds of controllers, from the design to a stop by the exported C.

.venv/bin/python -m campaigns.board_matrix --seed 68               forty robots of a seed: one line a case
.venv/bin/python -m campaigns.board_matrix --seed 68 --robots 3-5 --kinds precise
.venv/bin/python -m campaigns.evidence board_matrix                those of the seed that judges, as a section

A case goes through `STAGES` in order, by the library's own functions. The C runs as on a board: readings in, torques
out, on the compiled loop's plant with the robot's own delay, counts, noise, play and friction. What `design` refuses
is designed all the same, and must fall. Finished robots are kept in build/board_matrix_SEED, which belongs to the code
that made them: delete it after a change. OPENBLAS_NUM_THREADS=1 makes `design` several times faster.
"""

import argparse
import math
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import KINDS
from ballbot.control.references import hold
from ballbot.control.safety import StopReason
from ballbot.errors import InputError
from ballbot.estimation.interface import Reading
from ballbot.files import write_text
from ballbot.firmware.build import compile_sources, source_files
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.export import LIBRARY, Export, export_controller
from ballbot.firmware.records import SelfTestOutcome
from ballbot.fitting.run import Processes, Run
from ballbot.learning.learn import learn
from ballbot.learning.robots import drawn_robots as learning_robots
from ballbot.learning.tasks import TASKS
from ballbot.mechanics.model import Model
from ballbot.progress import ignore_progress
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.held_robot import HeldRobot
from ballbot.simulation.imperfections import Later, Push
from ballbot.simulation.plant import Measurement, Plant
from ballbot.simulation.run import initial_state_of
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.workflows.controller_design import GainOptions, PartOptions, design_controller
from ballbot.workflows.grid import LoopRobot
from campaigns.drawn_robots import TRAINING_SEED, DrawnRobot, drawn_robots, lean_torque
from campaigns.section import Section, finished, share_words
from tests.support.compiled_firmware import Firmware

#: of the forty robots that judge: the first four digits of commit 210d2d80, the last change of what they judge
JUDGING_SEED = 8461
ROBOTS = 40
POLICY = "policy"
CASE_KINDS = ("nominal", "precise", POLICY)
#: in order; a case that fails fails in one of them
STAGES = ("design", "export", "compile", "allowed", "self test", "balance", "push", "stuck wheel", "stop")
COMPILERS = ("gcc", "zig")
#: how long a robot balances [s]
BALANCE = 20.0
#: when a push or a fault of a wheel comes, and how long is looked at what follows [s]
BEGINS, AFTERWARDS = 2.0, 4.0
PUSH_DURATION = 0.1  # [s]
#: within this time the wheel that sticks must be named [s]: the others can balance the robot for a while, turning it
FOUND_WITHIN = 10.0
_STICKS = 150.0  # dry friction of a wheel that no motor of these robots turns [N m]
#: runs of a refused controller, one of which must fall
REFUSED_RUNS = 5
#: sizes of a push at which the nominal gain is tried, in so many directions; then as many between two of them
SIZES, DIRECTIONS = 10, 4
#: lean at which the firmware stops [rad], as `export_controller` has it
STOP_LEAN = 0.35


class StageError(Exception):
    """A case failed; the message says what happened."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """What became of a case."""

    number: int  #: of the robot
    kind: str
    refused: str = ""  #: the sentence of `design`
    fell: int = 0  #: of `REFUSED_RUNS` runs with the controller that was refused
    failures: tuple[tuple[str, str], ...] = ()  #: stages that failed, and what happened
    push: float = 0.0  #: that the case stood, or should have [N s]
    found: float = math.nan  #: after which the wheel that sticks was named [s]
    wandered: float = math.nan  #: largest distance from the start while it balanced [m]

    @property
    def end(self) -> str:
        """What became of it: passed, refused, refused wrongly, or the first stage that failed."""
        if self.refused:
            return "refused" if self.fell else "refused wrongly"
        return self.failures[0][0] if self.failures else "passed"

    @property
    def sentence(self) -> str:
        """What went wrong, in words."""
        fell = f'"{self.refused}" It falls in {self.fell} of {REFUSED_RUNS} runs.' if self.refused else ""
        return fell or "; ".join(f"{stage}: {what}" for stage, what in self.failures)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A robot and a kind of controller."""

    number: int
    drawn: DrawnRobot
    kind: str

    @property
    def loop(self) -> LoopRobot:
        """The robot on the compiled loop."""
        return LoopRobot.of(self.drawn.robot, self.drawn.scenario, known=self.drawn.robot)

    def designed(self) -> Controller:
        """Return the controller by the product's own functions; InputError if they refuse it."""
        robot, delay = self.drawn.robot, self.drawn.delay
        if self.kind == POLICY:
            robots = learning_robots(robot, self.drawn.scenario, None)
            return learn(robots, TASKS["Balance"], run=Run(progress=ignore_progress)).controller
        return design_controller(
            robot, gain=GainOptions(kind=self.kind), parts=PartOptions(delay=delay or None)
        ).controller

    def unchecked(self) -> Controller:
        """Return the controller as `design` makes it before its checks; InputError if there is none."""
        made = KINDS["nominal" if self.kind == POLICY else self.kind].made(self.drawn.robot)
        late = DelayPrediction(delay=self.drawn.delay) if self.drawn.delay else None
        return made.with_parts(replace(made.parts, prediction=late))


def judged(piece: tuple[int, int, Sequence[str]]) -> list[Result]:
    """Take a robot of a seed, by its number, with some kinds through the stages."""
    seed, number, kinds = piece
    drawn = drawn_robots(seed, number + 1)[number]
    push = 0.5 * recovered_push(number, drawn)
    return [judged_case(Case(number=number, drawn=drawn, kind=kind), push) for kind in kinds]


def judged_case(case: Case, push: float) -> Result:
    """Take a case through the stages, with a push [N s], and return what became of it."""
    made = Result(number=case.number, kind=case.kind, push=push)
    try:
        controller = case.designed()
    except InputError as error:
        return _judged_refusal(case, made, str(error))
    stage = "export"
    try:
        export = export_controller(controller, described=case.drawn.robot)
        stage = "compile"
        compile_export(export)
        stage = "allowed"
        board = Board(case, export)
    except InputError as error:
        return replace(made, failures=((stage, str(error)),))
    failures, found, wandered = [], math.nan, math.nan
    for stage in STAGES[STAGES.index("self test") :]:  # each begins anew, so that all that fails is seen
        try:
            match stage:
                case "self test":
                    board.self_test()
                case "balance":
                    wandered = board.balance()
                case "push":
                    board.stand_push(made.push)
                case "stuck wheel":
                    found = board.find_stuck_wheel(0.5 * made.push)
                case _:
                    board.halt()
        except StageError as error:
            failures.append((stage, str(error)))
    return replace(made, failures=tuple(failures), found=found, wandered=wandered)


def _judged_refusal(case: Case, made: Result, words: str) -> Result:
    try:
        fell = falls(case, case.unchecked())
    except InputError as error:
        fell, words = 0, f"{words} It cannot be built at all: {error}"
    return replace(made, refused=words, fell=fell)


def falls(case: Case, controller: Controller) -> int:
    """Return how many of `REFUSED_RUNS` runs with a controller end in a fall."""
    loop = case.loop
    imperfections = [replace(loop.imperfections, seed=seed) for seed in range(REFUSED_RUNS)]
    starts = [initial_state_of(seed) for seed in range(REFUSED_RUNS)]
    survived = simulate_batch(
        loop.model,
        controller,
        hold(),
        duration=BALANCE,
        initial_states=starts,
        imperfections=imperfections,
        every=0,
    ).survived
    return REFUSED_RUNS - int(survived.sum())


def recovered_push(number: int, drawn: DrawnRobot) -> float:
    """Return the largest push [N s] from which the nominal gain recovers, the least over directions; 0 if it falls.

    It falls where the firmware would stop it: at the lean of its safety layer.
    """
    case = Case(number=number, drawn=drawn, kind="nominal")
    loop, nominal, body = case.loop, case.unchecked(), drawn.robot.body
    directions = 2.0 * math.pi * (np.arange(DIRECTIONS) + 0.3) / DIRECTIONS  # not along a wheel

    def stood(sizes: Floats) -> int:
        """Return how many of the sizes, from the first on, it recovers from in every direction."""
        pushes = [push_of(drawn, size, towards) for size in sizes.tolist() for towards in directions.tolist()]
        survived = simulate_batch(
            loop.model,
            nominal,
            hold(),
            duration=_samples_of(drawn, BEGINS + AFTERWARDS) * drawn.robot.sensors.sample_time,
            initial_states=initial_state_of(number),
            imperfections=[
                replace(loop.imperfections, fallen_lean=STOP_LEAN, seed=lane, pushes=push)
                for lane, push in enumerate(pushes)
            ],
            every=0,
        ).survived
        kept = [bool(all(survived[k : k + DIRECTIONS])) for k in range(0, len(survived), DIRECTIONS)]
        return kept.index(False) if False in kept else len(kept)

    falling = float(Model(drawn.robot).linearize().poles().real.max())
    # twice the momentum of a body that falls through its largest lean
    ends = np.linspace(0.0, 2.0 * body.mass * STOP_LEAN * falling * body.center_of_mass, SIZES + 1)
    count = stood(ends)
    if count in (0, len(ends)):
        return 0.0 if count == 0 else float(ends[-1])
    between = np.linspace(ends[count - 1], ends[count], SIZES + 1)
    return float(between[stood(between[1:-1])])


def push_of(drawn: DrawnRobot, impulse: float, angle: float) -> tuple[Push, ...]:
    """Return a push [N s] on the centre of mass towards an angle [rad]."""
    h = drawn.robot.sensors.sample_time
    duration = max(1, round(PUSH_DURATION / h)) * h
    height = drawn.robot.body.center_of_mass
    return (Push.of_impulse(impulse, angle, time=BEGINS, duration=duration, height=height),)


def _samples_of(drawn: DrawnRobot, duration: float) -> int:
    return round(duration / drawn.robot.sensors.sample_time)


@cache
def _library_compiles(compiler: str) -> None:
    """Compile all of the library's sources, which every export has; InputError with what the compiler says."""
    with tempfile.TemporaryDirectory() as folder:
        compile_sources(Path(folder) / "library.so", source_files(), compiler=compiler)


def compile_export(export: Export) -> None:
    """Compile what is exported by both compilers; InputError with the first warning."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in export.files.items():
            write_text(folder / path, text)
        for compiler in COMPILERS:
            _library_compiles(compiler)
            flags = ("-O2", "-c", f"-I{folder / LIBRARY}")
            # all that includes the controller's numbers or its weights
            for source in ("robot.c", "parts/policy.c"):
                target = (folder / LIBRARY / source).with_suffix(f".{compiler}.o")
                compile_sources(target, [folder / LIBRARY / source], flags=flags, compiler=compiler)


class Board:
    """The exported C in a loop with its robot; its clock and its encoders go on from run to run."""

    def __init__(self, case: Case, export: Export) -> None:
        self._case, self._robot = case, case.drawn.robot
        self._period = self._robot.sensors.sample_time
        self._export, loop = export, case.loop
        self._begin()
        self._held = HeldRobot(
            loop.model.robot, sensors=self._robot.sensors, torque_noise=case.drawn.scenario.torque_noise
        )
        self._model, self._imperfections = loop.model, loop.imperfections

    def _begin(self) -> None:
        """Start the firmware as after a reset; what `ballbot_are_allowed` refuses is an InputError."""
        weights = self._export.weights if self._export.weight_bytes else ""
        self._firmware = Firmware(self._export.parameters, weights=weights)
        self._firmware.skip_imu_check()
        self._sample, self._turned = 0, np.zeros(self._robot.wheel_count)

    def _update(self, measured: Measurement) -> Floats:
        assert measured.attitude is not None
        reading = Reading(
            wheel_angles=self._turned + measured.wheel_angles,
            wheel_speeds=measured.wheel_speeds,
            gyro=measured.gyro,
            attitude=measured.attitude,
        )
        self._sample += 1
        time = round(1e6 * self._sample * self._period)
        return self._firmware.update(reading_record(reading, robot=self._robot), time, None).astype(
            np.float64
        )

    def _run(self, plant: Plant, measured: Measurement, duration: float) -> tuple[Measurement, float]:
        """Run until a stop, a fall or the end; return the last measurement and the largest distance from the start."""
        farthest = 0.0
        for _ in range(_samples_of(self._case.drawn, duration)):
            torques = self._update(measured)
            if self._firmware.stop is not None:
                break
            measured = plant.step(torques, self._period)
            farthest = max(farthest, float(np.hypot(*measured.truth[:2])))
            if measured.ended:
                break
        self._turned = self._turned + measured.wheel_angles
        return measured, farthest

    def _hold(self, duration: float, attitude: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        measured = self._held.reset(seed=self._sample)
        self._held.tilt(attitude)
        for _ in range(_samples_of(self._case.drawn, duration)):
            measured = self._held.step(self._update(measured), self._period)
        self._turned = self._turned + measured.wheel_angles

    def self_test(self) -> None:
        """Let the robot test motors and encoders while it is held on its ball."""
        self._hold(0.2)
        self._firmware.start_self_test()
        measured = self._held.reset(seed=self._sample)
        for _ in range(_samples_of(self._case.drawn, 20.0)):
            measured = self._held.step(self._update(measured), self._period)
            if self._firmware.self_test not in (SelfTestOutcome.NOT_RUN, SelfTestOutcome.RUNNING):
                break
        self._turned = self._turned + measured.wheel_angles
        if (outcome := self._firmware.self_test) is not SelfTestOutcome.PASSED:
            wheel = int(self._firmware.state["self_test"]["wheel"][0])
            raise StageError(f"{outcome.name.lower()}, wheel {wheel}")

    def _armed(self, plant: Plant) -> Measurement:
        """Hold the robot about upright, arm it and let it go."""
        start = initial_state_of(self._case.number)
        self._begin()
        self._firmware.skip_self_test()  # it is a stage of its own
        self._hold(1.0, start[2:5].tolist())
        if not self._firmware.arm():
            raise StageError("it does not arm")
        return plant.reset(start, seed=self._case.number)

    def _ending(self, measured: Measurement) -> str:
        stop, wheel = self._firmware.stop, int(self._firmware.state["safety"]["stop_wheel"][0])
        why = f"stopped: {stop}, wheel {wheel}" if stop else measured.ended
        return f"{why} at {measured.t:.2f} s; lean {np.abs(measured.truth[2:4]).max():.3f} rad"

    def balance(self) -> float:
        """Balance for `BALANCE`; return the largest distance from the start [m]."""
        plant = SensedPlant(self._model, self._imperfections)
        measured, farthest = self._run(plant, self._armed(plant), BALANCE)
        if self._firmware.stop or measured.ended:
            raise StageError(self._ending(measured))
        return farthest

    def stand_push(self, impulse: float) -> None:
        """Stand a push [N s] on the centre of mass."""
        pushes = push_of(self._case.drawn, impulse, 2.4 * self._case.number)
        plant = SensedPlant(self._model, replace(self._imperfections, pushes=pushes))
        measured, _ = self._run(plant, self._armed(plant), BEGINS + AFTERWARDS)
        if self._firmware.stop or measured.ended:
            raise StageError(f"{impulse:.3g} N s: {self._ending(measured)}")

    def find_stuck_wheel(self, impulse: float) -> float:
        """Let a wheel stick when a push [N s] comes; return after which time it is named [s]."""
        wheel = self._case.number % self._robot.wheel_count
        friction = self._robot.friction
        sticking = list(friction.coulomb)
        sticking[wheel] = _STICKS
        stuck = Model(self._robot.replace(friction=replace(friction, coulomb=tuple(sticking))))
        pushes = push_of(self._case.drawn, impulse, 2.4 * self._case.number)
        later = (Later(time=BEGINS, model=stuck),)
        plant = SensedPlant(self._model, replace(self._imperfections, later=later, pushes=pushes))
        measured, _ = self._run(plant, self._armed(plant), BEGINS + FOUND_WITHIN)
        safety = self._firmware.state["safety"][0]
        if self._firmware.stop is not StopReason.STUCK or safety["stop_wheel"] != wheel + 1:
            raise StageError(f"wheel {wheel + 1} sticks: {self._ending(measured)}")
        return measured.t - BEGINS

    def halt(self) -> None:
        """Stop the robot while it balances: every torque is zero from then on."""
        plant = SensedPlant(self._model, self._imperfections)
        measured, _ = self._run(plant, self._armed(plant), 1.0)
        if self._firmware.stop or measured.ended:
            raise StageError(self._ending(measured))
        self._firmware.halt(StopReason.LINK)
        if self._update(measured).any() or self._firmware.stop is not StopReason.LINK:
            raise StageError("torques come after a stop")


def results(seed: int, numbers: Sequence[int], kinds: Sequence[str]) -> list[Result]:
    """Judge those robots of a seed that are not finished, in two processes."""
    pieces = {f"robot_{number}": (seed, number, tuple(kinds)) for number in numbers}
    done = finished(f"board_matrix_{seed}", judged, pieces, workers=Processes(count=2))
    return [one for robot in done.values() for one in robot]


def campaign() -> Section:
    """Judge the robots of the seed that judges and return the section of docs/generated/evidence.md."""
    made = results(JUDGING_SEED, range(ROBOTS), CASE_KINDS)
    ends = {(one.number, one.kind): one.end for one in made}
    rows = [
        [*_words(number, drawn), *(ends[number, kind] for kind in CASE_KINDS)]
        for number, drawn in enumerate(drawn_robots(JUDGING_SEED, ROBOTS))
    ]
    passed, refused = (sum(one.end == end for one in made) for end in ("passed", "refused"))
    failures = [f"- robot {one.number}, {one.kind}: {one.sentence}" for one in made if one.end != "passed"]
    found = [one.found for one in made if one.end == "passed"]
    return Section(
        title="From any robot to its board",
        before=f"{ROBOTS} robots of the seed {JUDGING_SEED}, drawn by the rule of `campaigns/drawn_robots.py`, with a "
        "nominal, a precise and a learned controller each: designed, exported, compiled by GCC and by Clang "
        f"(ziglang) without a warning; the exported C allows its numbers, passes its self-test, balances {BALANCE:g} s "
        "on the compiled loop's plant, recovers from half of the nominal gain's largest push, names a wheel that "
        f"sticks within {FOUND_WITHIN:g} s of a push half as large, and gives no torque after a stop. Motors: times "
        "the torque that a lean of 8 degrees needs. Counts: of a turn of the wheel. Friction: break-away over the "
        "motors' torque.",
        columns=["robot", "body", "motors", "loop", "counts", "friction", *CASE_KINDS],
        rows=rows,
        after=f"{share_words(passed, len(made))} of {len(made)} cases passed; {refused} were refused by `design`, and "
        f"fall with what was refused; {len(made) - passed - refused} failed. A wheel that sticks was named after "
        f"{np.median(found):.2f} s (median; at most {max(found):.2f} s).\n\n" + "\n".join(failures),
    )


def _words(number: int, drawn: DrawnRobot) -> list[str]:
    """Return the first cells of a robot's row."""
    robot = drawn.robot
    drive, h = robot.drive, robot.sensors.sample_time
    return [
        f"{number}",
        f"{robot.body.mass:.1f} kg, {robot.body.center_of_mass:.2f} m",
        f"{drive.torque_limit / lean_torque(robot):.1f}, {drawn.input}",
        f"{1.0 / h:.0f} Hz, {drawn.delay / h:.1f}",
        f"{robot.sensors.encoder_counts * drive.gear_ratio:.0f}",
        f"{100.0 * max(robot.friction.breakaway) / drive.torque_limit:.0f} %",
    ]


def main() -> None:
    """Judge the robots of a seed and print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=TRAINING_SEED)
    parser.add_argument("--robots", default=f"0-{ROBOTS - 1}")
    parser.add_argument("--kinds", default=",".join(CASE_KINDS))
    given = parser.parse_args()
    first, _, last = given.robots.partition("-")
    numbers = range(int(first), int(last or first) + 1)
    made = results(given.seed, numbers, given.kinds.split(","))
    for one in made:
        print(
            f"{one.number:3d} {one.kind:8s} {one.end:15s} {one.push:7.3g} N s {one.found:5.2f} s "
            f"{one.wandered:6.3f} m {one.sentence}"
        )
    print(Counter((one.kind, one.end) for one in made).most_common())


if __name__ == "__main__":
    import_module("campaigns.board_matrix").main()  # what is pickled belongs to the module of that name
