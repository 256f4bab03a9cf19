"""Robots that nobody tuned for: each with logs, a study, and the study's controller on the same robot.

.venv/bin/python -m campaigns.evidence strangers     the judged robots of the last of `RUNS`, unless its table is there
.venv/bin/python -m campaigns.strangers 0 12         tuning robots 0 to 11, and the discrepancies of the prediction

The rule and the first judged seed were committed before the work that they judge began, and a judged seed is run once.
A rerun is a new seed in `RUNS` with the change that caused it. The tables of all runs are kept
(docs/generated/strangers_SEED.json). A robot is what the rule gives, however it fares.

A team has a robot file. It is one of the presets, in turn, as another team would build it:

    masses       of body and ball 0.7 to 1.4 times, each: another battery, computer, payload, ball
    height       of the body's centre 0.85 to 1.2 times: a column shorter or longer by a module
    rollers      one or two rows of 7 to 12 (one row: twice as many), radius 0.11 to 0.17 of the wheel's, rows 0.1 to
                 0.35 of it apart: from the thesis's wheels to cheap ones
    play         the true one, to half a degree: felt by hand
    wheels       rob311's of a quarter of the preset's inertia, which the preset says is four times too much
    drift        of the heading 5.33 deg/min, the thesis's; noise as in the preset: data sheets
    friction     none: unknown until identified

What is true differs from the file. Factors are drawn evenly on a logarithmic scale, all else evenly:

    values       lengths, masses, heights, inertias off by their default deviations, normal (`Parameter.error`), the
                 first draw that a body can have
    friction     0.4 to 2 times the nominal scenario's for that wheel load, each wheel 0.8 to 1.2 times that: cold oil
                 to run in; v_s 0.3 to 1 rad/s and delta 0.8 to 1.6 as measured on machines (Armstrong-Helouvry); C_rr
                 0.4 to 2 times the nominal 0.007: hard floor to thin carpet
    pivoting     0.001 to 0.05 m: a hard ball on a hard floor to a basketball on carpet
    play         0 to 2 degrees: none, as in direct drives, to twice the thesis's
    grip         of floor and rollers 0.5 to 1.2, each: dusty to clean rubber
    torque       0.85 to 1.18 times what is commanded (magnets' tolerance, warm windings, gear losses), each wheel
                 within 3 % of that
    delay        0 to 8 ms to the nearest whole sample, of the AHRS another 0 to 5 ms; drivers of 30 to 200 Hz
    IMU's mount  turned by up to 2 degrees about the vertical, which is a robot whose wheels are turned the other way;
                 leaning by 0.1 to 0.6 degrees (standard deviation of each axis), as a centre of mass beside the axis is
    noise        of gyro and lean 0.5 to 3 times the file's; biases of the gyro of 2e-4 to 2e-3 rad/s; the heading
                 drifts by up to 5.33 deg/min either way; torques of 1/1200 to 1/300 of their limit

The team records the square and the figure of eight with the soft gain, 48 s each, checks the logs, and studies them
with the options that `ballbot study` has by default, but for the confirmation on the twin, which changes no choice. An
error of a check or a refusal of the study ends there: what the team would do about it is not simulated. Truth is the
twin, with rollers. A robot that is refused or falls is outside its prediction, and in percentiles the worst.
"""

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import named_reference
from ballbot.errors import InputError, about
from ballbot.estimation import named_estimator
from ballbot.files import read_text, write_text
from ballbot.fitting.run import ALL_CORES, Executor, Processes, Run, Threads
from ballbot.log import Log
from ballbot.log.checks import CheckedLogs, findings_of
from ballbot.robot import Robot, Rollers
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.robot.variations import draw_robots, with_default_errors
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import CurrentLoop, Timing
from ballbot.twin.recording import twin_findings
from ballbot.twin.scenario import assumed_friction
from ballbot.workflows.controller_choice import CANDIDATES
from ballbot.workflows.controller_prediction import evaluate_log, lognormal_interval
from ballbot.workflows.metrics import QUANTITIES, LogScore, score
from ballbot.workflows.study import Study, StudyOptions, study
from campaigns.section import Section, finished, markdown_table, share_words
from tests.support.failing_motor import FailingMotor, Fault

#: seeds of judged robots, each with the change that caused its run; the last one is to be run, the others have been
RUNS: Mapping[int, str] = {
    826_914_075: "none: the first run",
    482_173_363: "gain of light robots, usual friction by load, radius and turn of the wheels always weighed",
    552_001_361: "soft gain at most twice as fast as the fall, its fast ones on the filter's state",
}
#: of robots that may be tuned on
TUNING = 71
ROBOTS = 60
BASES = ("alten", "cmu", "kugle", "rezero", "rob311")
#: the references of the logs, and how long each is [s]
RECORDED, DURATION = ("square", "figure_eight"), 48.0
#: of the study's controller: once around [s]
COURSES: Mapping[str, float] = {"square": 32.0, "circle": 40.0, "figure_eight": 46.0}
#: peak error that nine of ten robots are to stay below [m]
CLOSE = 0.015
FOLDER = Path(__file__).parents[1] / "docs" / "generated"
#: whose code a robot's outcome depends on
PACKAGES = (
    *("robot", "mechanics", "log", "estimation", "control", "simulation"),
    *("twin", "fitting", "identification", "validation", "workflows"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Stranger:
    """A robot as its team has it in a file, and as it is."""

    seed: int  #: of its runs
    file: Robot
    true: Robot
    scenario: Scenario  #: of the true robot
    torque_scale: tuple[float, ...]  #: what the motors give of the torques commanded

    def run(self, controller: Controller, known: Robot, course: str, duration: float, *, seed: int) -> Log:
        """Return the log of a course, whose estimator has the robot that is known, with the truth."""
        period = self.scenario.sensors.sample_time
        estimator = named_estimator(controller.estimator, known, sample_time=period)
        plant: Plant = Twin(self.true, self.scenario, estimator=estimator)
        for wheel, scale in enumerate(self.torque_scale):
            plant = FailingMotor(plant, Fault(kind=str(scale), motors=(wheel,), start=0.0, length=math.inf))
        return simulate(plant, controller, named_reference(course), duration=duration, seed=self.seed + seed)


def stranger(seed: int, number: int) -> Stranger:
    """Return a robot by the rule; it depends on the seed and its number alone."""
    random = np.random.default_rng([seed, number])

    def between(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    def factor(low: float, high: float) -> float:
        return low * (high / low) ** between(0.0, 1.0)

    base = Robot.load(BASES[number % len(BASES)])
    if base.name == "rob311":
        base = base.replace({"wheels.inertia": 0.25 * base.wheels.inertia})
    wheels, double, row = base.wheels, between(0.0, 1.0) < 0.5, int(random.integers(7, 13))
    rollers = Rollers(
        rows=1 + double,
        per_row=row if double else 2 * row,
        radius=between(0.11, 0.17) * wheels.radius,
        row_spacing=double * between(0.1, 0.35) * wheels.radius,
    )
    play, ball = math.radians(between(0.0, 2.0)), factor(0.7, 1.4)
    file = base.replace(
        ball=replace(base.ball, mass=ball * base.ball.mass, inertia=ball * base.ball.inertia),
        body=scaled_body(base.body, mass=factor(0.7, 1.4), height=between(0.85, 1.2)),
        wheels=replace(wheels, rollers=rollers),
        drive=replace(base.drive, backlash=math.radians(0.5 * round(math.degrees(play) / 0.5))),
        sensors=replace(base.sensors, heading_drift=math.radians(5.33) / 60.0),
    )
    drawn = draw_robots(with_default_errors(file), 50, seed=int(random.integers(2**31)))
    built = next(robot for robot in drawn if not twin_findings(robot))  # independent moments may fit no body
    mount, dry = math.radians(between(-2.0, 2.0)), factor(0.4, 2.0)
    true = built.replace({"wheels.azimuths": tuple(azimuth + mount for azimuth in wheels.azimuths)})
    friction = scaled_friction(
        assumed_friction(file),
        (dry * random.uniform(0.8, 1.2, file.wheel_count)).tolist(),
        rolling_factor=factor(0.4, 2.0),
    )
    sensors = replace(
        file.sensors,
        gyro_noise=factor(0.5, 3.0) * file.sensors.gyro_noise,
        attitude_noise=factor(0.5, 3.0) * file.sensors.attitude_noise,
        heading_drift=between(-1.0, 1.0) * file.sensors.heading_drift,
    )
    scenario = Scenario(
        name=f"stranger {seed} {number}",
        friction=replace(friction, stribeck_speed=between(0.3, 1.0), stribeck_exponent=between(0.8, 1.6)),
        pivoting=factor(0.001, 0.05),
        backlash=play,
        torque_noise=factor(0.5, 2.0) * file.drive.torque_limit / 600.0,  # the nominal scenario's share
        rollers=rollers,
        sensors=sensors,
        floor_grip=between(0.5, 1.2),
        roller_grip=between(0.5, 1.2),
        timing=Timing(delay=round(between(0.0, 0.008) / sensors.sample_time)),
        current_loop=CurrentLoop(bandwidth=factor(30.0, 200.0)),
        sensor_faults=SensorFaults(
            gyro_bias=factor(2e-4, 2e-3),
            gyro_bias_walk=1e-5,
            lean_error=math.radians(between(0.1, 0.6)),
            lean_error_time=1e6,  # constant over any run
            latency=between(0.0, 0.005),
        ),
    )
    scale = factor(0.85, 1.0 / 0.85) * random.uniform(0.97, 1.03, file.wheel_count)
    return Stranger(
        seed=int(random.integers(2**31)),
        file=file,
        true=true,
        scenario=scenario,
        torque_scale=tuple(scale.tolist()),
    )


@dataclass(frozen=True, kw_only=True)
class Row:
    """What became of a robot; a row of a run's table. Errors are of the true position and heading, once settled."""

    robot: str  #: preset and number
    pivoting: float  #: [m]
    play: float  #: [rad]
    friction: float  #: mean over the nominal one
    torque: float  #: mean over the commanded one
    delay: float  #: of torques and AHRS, together [s]
    controller: str = ""  #: that the study chose
    refused: str = ""  #: by what, and why
    fell: str = ""  #: on which courses
    square: float = math.inf  #: peak errors, infinite if refused or fallen [m]
    circle: float = math.inf
    figure_eight: float = math.inf
    heading: float = math.nan  #: peak error on the square [rad]
    logged: float = math.nan  #: peak error on the square in the robot's own log, which the study predicts [m]
    low: float = math.nan  #: of the prediction interval [m]
    high: float = math.nan
    #: squared logarithms by which each quantity of a run that stood is off the median of the study's robots, less what
    #: their spread covers: below and above
    excess: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])

    @property
    def places(self) -> tuple[str, str]:
        """Where the log's and the true peak error on the square lie in the prediction; or why nowhere."""
        if reason := self.refused or (self.fell and f"fell: {self.fell}"):
            return reason, reason
        log, truth = np.searchsorted([self.low, self.high], [self.logged, self.square]).tolist()
        return _PLACES[log], _PLACES[truth]


_PLACES = ("better", "inside", "worse")


def judged(piece: tuple[int, int]) -> Row:
    """Return what becomes of a robot, given the seed of the set and the robot's number."""
    robot = stranger(*piece)
    scenario, period = robot.scenario, robot.scenario.sensors.sample_time
    assert scenario.timing
    assert scenario.sensor_faults
    row = Row(
        robot=f"{robot.file.name} {piece[1]}",
        pivoting=scenario.pivoting,
        play=scenario.backlash,
        friction=float(np.mean(scenario.friction.coulomb) / np.mean(assumed_friction(robot.file).coulomb)),
        torque=float(np.mean(robot.torque_scale)),
        delay=period * (scenario.timing.delay + round(scenario.sensor_faults.latency / period)),
    )
    try:
        return _driven(robot, row, _studied(robot))
    except Exception as error:  # a traceback is a refusal too
        kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        return replace(row, refused=f"{kind}{error}")


def _studied(robot: Stranger) -> Study:
    """Return the study of a robot's logs; InputError if it falls, or a check or the study refuses."""
    soft, logs = nominal_controller(robot.file), dict[str, Log]()
    for seed, course in enumerate(RECORDED):
        logs[course] = robot.run(soft, robot.file, course, DURATION, seed=seed).without_truth()
        if logs[course].ended:
            raise InputError(f"record: {logs[course].ended}")
    findings = findings_of(robot.file, logs)
    if errors := [finding.code for finding in findings if finding.severity == "error"]:
        raise InputError(f"check-log: {', '.join(dict.fromkeys(errors))}")
    with about("study"):
        made = study(
            robot.file,
            CheckedLogs(logs=logs, findings=findings),
            options=StudyOptions(confirm=False),
            run=Run(executor=Threads(count=1)),
        )
    if made.prediction is None:
        raise InputError("study: every candidate falls on some robot")
    return made


def _driven(robot: Stranger, row: Row, made: Study) -> Row:
    """Return the row of a robot that drives the courses with the controller of its study."""
    chosen, prediction = made.choice.chosen, made.prediction
    assert chosen
    assert prediction
    trial = made.choice.trials[chosen]
    controller, drawn = trial.controller, [performance.sizes() for performance in trial.performances]
    runs = {
        course: robot.run(controller, made.found.robot, course, duration, seed=len(RECORDED) + seed)
        for seed, (course, duration) in enumerate(COURSES.items())
    }
    square, interval = runs["square"], prediction.chosen["peak_error"]
    verdict = evaluate_log(prediction, square.without_truth(), controller)
    seen = LogScore.of(square, torque_limit=controller.torque_limit)
    excess = {name: _excess([sizes[name] for sizes in drawn], value) for name, value in seen.sizes().items()}
    return replace(
        row,
        controller=chosen,
        fell=", ".join(course for course, run in runs.items() if run.ended),
        **{name: math.inf if run.ended else score(run).peak_position_error for name, run in runs.items()},
        heading=score(square).peak_heading_error,
        logged=verdict.quantities[QUANTITIES.index("peak_error")].value,
        low=interval.low,
        high=interval.high,
        excess={} if square.ended else excess,
    )


def _excess(drawn: Sequence[float], value: float) -> tuple[float, float]:
    plain, value = lognormal_interval(np.array(drawn)), max(value, 1e-9)
    below, above = math.log(plain.median / value), math.log(value / plain.median)
    covered = math.log(plain.median / plain.low), math.log(plain.high / plain.median)
    return max(below, 0.0) ** 2 - covered[0] ** 2, max(above, 0.0) ** 2 - covered[1] ** 2


def rows_of(seed: int, numbers: Sequence[int], *, workers: Executor = ALL_CORES) -> list[Row]:
    """Return the rows of robots of a set; finished ones are kept in build/strangers_SEED."""
    pieces = {f"{number:03d}": (seed, number) for number in numbers}
    return list(finished(f"strangers_{seed}", judged, pieces, packages=PACKAGES, workers=workers).values())


def campaign() -> Section:
    """Judge the robots of the last seed, unless their table is there; return the section of the evidence."""
    last = list(RUNS)[-1]
    if not _table_of(last).exists():
        rows = [asdict(row) for row in rows_of(last, range(ROBOTS))]
        write_text(_table_of(last), json.dumps(rows, indent=0) + "\n")
    return section({seed: [Row(**row) for row in json.loads(read_text(_table_of(seed)))] for seed in RUNS})


def _table_of(seed: int) -> Path:
    return FOLDER / f"strangers_{seed}.json"


def section(runs: Mapping[int, Sequence[Row]]) -> Section:
    """Return the section of the page: a row of each run, and below the robots of each, the last run first."""
    tables = [
        f"**Seed {seed}.**\n\n{markdown_table(ROW_COLUMNS, [_cells(row) for row in rows])}"
        for seed, rows in reversed([*runs.items()])
    ]
    return Section(
        title="Robots that nobody tuned for",
        before=f"{ROBOTS} robots of each seed, drawn by the rule of `campaigns/strangers.py`: what is true differs "
        f"from the robot file in every number. Two logs of {DURATION:g} s with the soft gain on the physics-engine "
        "twin, `check-log`, `study`, and the study's controller on the same robot. Rule and first seed were committed "
        "before the work that they judge. Peak error of the true position once settled [mm]; "
        "a robot that is refused or falls counts as outside its prediction and as worst. A prediction is of the peak "
        "error on the square in the robot's own log; whether the true one is inside too is stated beside it.",
        columns=[
            *(
                "seed",
                "caused by",
                "log inside",
                "truth inside",
                *(f"{course}: median, worst" for course in COURSES),
            ),
            *(f"square within {1e3 * CLOSE:g} mm", "falls", "refused"),
        ],
        rows=[[str(seed), RUNS.get(seed, "tuning"), *_summary(rows)] for seed, rows in runs.items()],
        after="\n\n".join(tables),
    )


def _summary(rows: Sequence[Row]) -> list[str]:
    of_courses = [np.array([getattr(row, course) for row in rows]) for course in COURSES]
    return [
        *(share_words(sum(row.places[k] == "inside" for row in rows), len(rows)) for k in (0, 1)),
        *(f"{_shown(float(np.median(peaks)))}, {_shown(peaks.max())}" for peaks in of_courses),
        share_words(sum(row.square <= CLOSE for row in rows), len(rows)),
        str(sum(bool(row.fell) for row in rows)),
        str(sum(bool(row.refused) for row in rows)),
    ]


ROW_COLUMNS = (
    *("robot", "pivoting [mm]", "play [deg]", "friction", "torque", "late [ms]", "controller", *COURSES),
    *("heading [deg]", "in its log", "predicted", "outcome"),
)


def _cells(row: Row) -> list[str]:
    predicted = "" if row.refused else f"{_shown(row.low)} to {_shown(row.high)}"
    return [
        *(row.robot, f"{1e3 * row.pivoting:.1f}", f"{math.degrees(row.play):.1f}", f"{row.friction:.2f}"),
        *(f"{row.torque:.2f}", f"{1e3 * row.delay:.0f}", row.controller),
        *(_shown(getattr(row, course)) for course in COURSES),
        *(_shown(row.heading, math.degrees(1.0)), _shown(row.logged), predicted),
        ", truth ".join(dict.fromkeys(row.places)).replace("|", "/"),
    ]


def _shown(value: float, unit: float = 1e3) -> str:
    return f"{unit * value:.1f}" if math.isfinite(value) else "–"


def discrepancy(excess: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the factors (lower, upper) that widen predictions until they hold a new robot's value in 95 % of cases.

    Split conformal: on each side the score of rank ceil(0.975 (n + 1)), the largest if there are too few.
    """
    rank = min(math.ceil(0.975 * (len(excess) + 1)), len(excess))
    below, above = np.sqrt(np.maximum(np.sort(excess, axis=0)[rank - 1], 0.0)).tolist()
    return math.exp(-below), math.exp(above)


def tune(numbers: Sequence[int]) -> None:
    """Print the section that tuning robots make, and the constants of `ballbot.workflows.controller_prediction`."""
    rows = rows_of(TUNING, numbers, workers=Processes(count=1))
    print(section({TUNING: rows}).markdown())
    for kind in dict.fromkeys(kind.name for kind, _ in CANDIDATES.values()):
        kinds = [row.excess for row in rows if row.excess and CANDIDATES[row.controller][0].name == kind]
        for name in QUANTITIES if kinds else ():
            low, high = discrepancy([excess[name] for excess in kinds])
            print(f'{kind}, {len(kinds)} robots that stood: "{name}": ({low:.2g}, {high:.2g}),')


if __name__ == "__main__":
    from campaigns import strangers  # what is kept names this module's classes, not those of __main__

    strangers.tune(range(*map(int, sys.argv[1:])))
