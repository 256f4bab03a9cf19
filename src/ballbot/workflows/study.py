"""The main job: a robot and its logs in; friction, validation and the best controller out.

    identify -> validate on held-out intervals -> design the candidates -> choose one on perturbed plants

Identification is that of `ballbot identify` with the same logs and seed. It holds out whole intervals, as validation in
closed loop, and in open loop to a fall, needs seconds in one piece.

The nominal gain is designed with the nominal weights on the exact model without friction, at the logs' sample time,
whatever gain the logs were recorded with. Their own gain is recovered for the closed-loop validation.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from ballbot.control.lqr import LqrDesign
from ballbot.control.presets import design_gain
from ballbot.errors import InputError, about
from ballbot.findings import Finding
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification import Bounds, Identification, identify
from ballbot.identification.identify import IdentificationOptions
from ballbot.identification.windows import holdout_intervals
from ballbot.log import STATE_NAMES, Log, LogsLike
from ballbot.log.checks import CheckedLogs, checked_logs
from ballbot.log.columns import torque_names
from ballbot.progress import in_stage
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.summary import Reported
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario
from ballbot.validation import ModelPair, Validation, join_validations, validate_logs
from ballbot.validation.models import Interval, model_of
from ballbot.workflows.controller_choice import (
    SQUARE,
    Confirmation,
    ControllerChoice,
    NamedCourse,
    PlantDraw,
    candidates,
    choose_controller,
    confirm,
    draw_plants,
)
from ballbot.workflows.controller_prediction import MIN_RUNS, ControllerPrediction, predict

#: robots that candidates can be compared on
MAX_DRAWS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class StudiedLog:
    """A log of the study and the stretches of it that were kept from the fit."""

    name: str
    log: Log
    held_out: tuple[Interval, ...]  #: (start, end) [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyOptions:
    """Options of `study`; the defaults suit most logs."""

    accept: Collection[str] = ()  #: codes of errors found in the logs to ignore; see `ballbot.findings.CODES`
    bounds: Bounds | None = None  #: of the friction that is estimated
    excluded_states: Sequence[str] = ()  #: whose errors do not count in the fit
    back_emf: float = 0.0  #: b_e of motors on a voltage [N m s/rad], if the torques contain it
    duration: float = SQUARE.duration  #: of each run of a candidate [s]
    draws: int = 100  #: robots on which the candidates are compared, `MIN_RUNS` or more
    confirm: bool = True  #: whether the twin confirms the choice, if its engine is installed


#: suits most logs
DEFAULT_STUDY = StudyOptions()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Study(Reported):
    """The result of a study."""

    robot: Robot  #: as given
    logs: tuple[StudiedLog, ...]
    found: Identification
    by_log: tuple[Validation, ...]  #: on what each log held out
    validation: Validation  #: all of them together
    design: LqrDesign
    scenario: Scenario  #: whose delay, play, noise, sensors and floor the robots had
    choice: ControllerChoice
    confirmation: Confirmation | None  #: of the choice by the twin; None if there was none
    prediction: ControllerPrediction | None  #: of the chosen controller's next run
    options: StudyOptions
    seed: int

    @property
    def log_findings(self) -> tuple[Finding, ...]:
        """The findings of the checks of the logs, errors first."""
        return self.found.log_findings


def study(
    robot: RobotLike,
    logs: LogsLike | CheckedLogs,
    *,
    scenario: Scenario | str | Path | None = None,
    options: StudyOptions = DEFAULT_STUDY,
    run: Run = DEFAULT_RUN,
) -> Study:
    """Identify a robot's friction from its logs, validate it, and choose a controller on simulated robots.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Of its friction only a registered law, and parameters without influence on the logs, are used.
    logs : Log or log file, several in a list or a mapping, or CheckedLogs
        With torques and states, and with the reference for the closed-loop validation; the names of a mapping are
        those of the report. They are checked first, unless they come as `CheckedLogs`.
    scenario : Scenario, scenario's name or scenario file, optional
        Delay, play, noise, sensors and floor of the simulated robots; the nominal one by default. Their friction is
        drawn from the uncertainty of the identification.
    options : StudyOptions, optional
    run : Run, optional
        Its seed draws the robots.

    Returns
    -------
    Study
        `found` is the identification, `validation` its test, `choice` the controllers compared.

    Raises
    ------
    InputError
        If a log lacks a column or is not of this robot, its checks find an error whose code is not accepted, or
        the friction cannot be identified from the logs.

    Examples
    --------
    On two short logs of a simulated robot with friction, and few robots drawn from what the logs leave open:

    >>> from ballbot import Robot, simulate
    >>> rubbing = Robot.load("alten").replace({"friction.coulomb": 0.15})
    >>> courses = ("square", "circle")
    >>> logs = [simulate(rubbing, "nominal", course, duration=10.0, scenario="nominal") for course in courses]
    >>> whole = study("alten", logs, options=StudyOptions(draws=6, confirm=False))
    >>> bool(0.1 < max(whole.found.robot.friction.breakaway) < 0.3)
    True
    """
    robot = as_robot(robot)
    checked = checked_logs(robot, logs, accept=options.accept)
    studied = _studied_logs(checked, robot)
    if not MIN_RUNS <= options.draws <= MAX_DRAWS:
        raise InputError(
            f"The number of draws is {options.draws}; it must be {MIN_RUNS} to {MAX_DRAWS}, such as 100."
        )
    # whole nanoseconds: a controller file needs no rounding errors of a log's time stamps
    sample_time = round(studied[0].log.sample_time, 9)
    tried = sampled_at(load_scenario(scenario or "nominal", robot), sample_time)
    _ = PlantDraw(robot=robot, known=robot, scenario=tried, seed=0).on_loop  # refused before the work begins
    confirmed = options.confirm and find_spec("mujoco") is not None
    fitting = IdentificationOptions(
        excluded_states=tuple(options.excluded_states), back_emf=options.back_emf, accept=options.accept
    )
    identifying = _named(run, "identifying friction")
    law = robot.friction.law if robot.friction.own_law else "stribeck"
    fit = identify(robot, checked, law=law, bounds=options.bounds, options=fitting, run=identifying)
    if not fit.verdict.usable:
        raise InputError(
            f"{fit.verdict.sentence} A study compensates the friction that it finds, so it ends here; `ballbot "
            "identify` shows the fit."
        )
    models = ModelPair.by_friction(model_of(fit.robot_of_logs))
    by_log = tuple(
        validate_logs(
            models,
            {entry.name: entry.log for entry in studied},
            holdouts={entry.name: entry.held_out for entry in studied},
            run=_named(run, "validating"),
        ).values()
    )
    choice = choose_controller(
        candidates(fit, sample_time=sample_time),
        draw_plants(fit, scenario=tried, count=options.draws, seed=run.seed),
        course=NamedCourse(name=SQUARE.name, duration=options.duration),
        run=_named(run, "comparing controllers"),
    )
    confirmation = confirm(choice, run=_named(run, "confirming on the twin")) if confirmed else None
    return Study(
        robot=robot,
        logs=studied,
        found=fit,
        by_log=by_log,
        validation=join_validations(by_log),
        design=design_gain(fit.robot, sample_time=sample_time),
        scenario=tried,
        choice=choice,
        confirmation=confirmation,
        prediction=predict(choice, log_findings=checked.findings),
        options=options,
        seed=run.seed,
    )


def _named(run: Run, stage: str) -> Run:
    """Return the run with a name for all its stages."""
    return replace(run, progress=in_stage(run.progress, stage))


def sampled_at(scenario: Scenario, sample_time: float) -> Scenario:
    """Return the scenario with sensors read at a sample time [s], its engine's steps a whole number in each."""
    steps = max(1, round(sample_time / scenario.timestep))
    sensors = replace(scenario.sensors, sample_time=sample_time)
    return replace(scenario, sensors=sensors, timestep=sample_time / steps)


def _studied_logs(checked: CheckedLogs, robot: Robot) -> tuple[StudiedLog, ...]:
    """Return the rows that have torques and states; raise InputError before the work if there are none."""
    studied: list[StudiedLog] = []
    for name, log in checked.logs.items():
        named = name or "the log"
        with about(named):
            rows = log.complete(*torque_names(robot.wheel_count), *STATE_NAMES)
        studied.append(StudiedLog(name=named, log=rows, held_out=holdout_intervals(log)))
    return tuple(studied)
