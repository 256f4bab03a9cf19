"""The main job: a robot and its logs in; friction, validation and the best controller out.

    identify -> validate on held-out intervals -> design the candidates -> choose one on perturbed plants

Identification fits short windows. Validation in closed loop, and in open loop to a fall, needs seconds in one piece.
So whole intervals are held out: 8 s of every 28 s. As 28 s is not a multiple of the 8 s or 32 s with which references
often repeat, the intervals do not always hold the same piece of the path.

The nominal gain is designed with the weights of the nominal scenario on the exact model without friction, at the logs'
sample time, whatever gain the logs were recorded with, so that studies of different robots can be compared. The logs'
own gain is recovered for the closed-loop validation, and the report shows both.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import LqrDesign
from ballbot.control.presets import design_gain
from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.fitting.checkpoint import Memoize, no_checkpoint
from ballbot.fitting.run import Executor, Progress
from ballbot.identification import Bounds, Identification, identify
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import CheckedLogs, checked_logs
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from ballbot.validation import ModelPair, Validation, join_validations, validate_pair
from ballbot.validation.models import Interval
from ballbot.workflows.controller_choice import (
    SQUARE,
    ControllerChoice,
    NamedCourse,
    candidates,
    choose_controller,
)
from ballbot.workflows.controller_prediction import Prediction, predict
from ballbot.workflows.courses import PlantName
from ballbot.workflows.plant_draws import PlantDraw, available_plant, draw_plants

_HOLDOUT_CYCLE = 28.0  #: [s] from one stretch's start to the next one's
_HOLDOUT_OFFSET = 12.0  #: [s] of a cycle before its stretch
_HOLDOUT_LENGTH = 8.0  #: [s]


def holdout_intervals(log: Log) -> tuple[Interval, ...]:
    """Return the (start, end) [s] of the stretches; a log shorter than a cycle has one, in proportion."""
    first, duration = float(log.t[0]), float(log.t[-1] - log.t[0])
    scale = min(1.0, duration / _HOLDOUT_CYCLE)
    starts = np.arange(
        _HOLDOUT_OFFSET * scale, duration - 0.5 * _HOLDOUT_LENGTH * scale, _HOLDOUT_CYCLE * scale
    )
    ends = np.minimum(starts + _HOLDOUT_LENGTH * scale, duration)
    return tuple((first + float(start), first + float(end)) for start, end in zip(starts, ends, strict=True))


def without_intervals(log: Log, stretches: Sequence[Interval]) -> Log:
    """Return the log with its states missing in the stretches; identification passes over what is missing."""
    kept = np.ones(len(log), dtype=bool)
    for start, end in stretches:
        kept &= (log.t < start) | (log.t >= end)
    return log.with_columns({name: np.where(kept, log[name], np.nan) for name in STATE_NAMES})


#: told what is being done and the share of the whole that is done
StudyProgress = Callable[[str, float], None]

#: plants that candidates can be compared on; a run of each takes a second or more
MAX_DRAWS = 1000
#: shares of the whole that are done when the friction is identified, and when it is validated, from timings of the demo
_STAGES: Mapping[PlantName, tuple[float, float]] = {"model": (0.45, 0.5), "twin": (0.25, 0.28)}
#: share of the windows that identification keeps for its own verdict; the study's is on the stretches held out
_OWN_HOLDOUT = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class StudiedLog:
    """A log of the study and the stretches of it that were kept from the fit."""

    name: str
    log: Log
    held_out: tuple[Interval, ...]  #: (start, end) [s]

    def wheel_speeds(self, robot: Robot) -> NDArray[np.float64]:
        """Return the wheels' speeds (N, n) [rad/s]: measured, else from the states by kinematics."""
        names = wheel_speed_names(robot.wheel_count)
        if all(name in self.log and np.isfinite(self.log[name]).all() for name in names):
            return self.log.wheel_speeds
        states = self.log.states
        return Model(robot).wheel_speed(states[:, :5], states[:, 5:])


@dataclass(frozen=True, kw_only=True, eq=False)
class Effort:
    """How much work a study does; less is for tests."""

    generations: int = 150  #: of the identification's evolution, at most
    duration: float = SQUARE.duration  #: of each run of a candidate [s]
    draws: int = 20  #: plants on which the candidates are compared
    ablation_draws: int = (
        10  #: of them, plants on which the parts of the precise controller are removed by turns
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Everything a study found."""

    robot: Robot  #: as given
    logs: tuple[StudiedLog, ...]
    found: Identification
    by_log: tuple[Validation, ...]  #: on what each log held out
    validation: Validation  #: all of them together
    design: LqrDesign
    plant: PlantName  #: on which the candidates were compared
    scenario: Scenario  #: whose delay, play, noise, sensors and floor the plants had
    choice: ControllerChoice
    prediction: (
        Prediction | None
    )  #: of the chosen controller's next run; None if none is chosen or draws are few
    effort: Effort
    seed: int

    @property
    def log_findings(self) -> tuple[Finding, ...]:
        """What the checks of the logs found, errors first."""
        return self.found.log_findings


def study(
    robot: Robot,
    logs: Mapping[str, Log] | CheckedLogs,
    *,
    accept: Collection[str] = (),
    plant: PlantName | None = None,
    scenario: Scenario | None = None,
    bounds: Bounds | None = None,
    left_out: Sequence[str] = (),
    back_emf: float = 0.0,
    seed: int = 0,
    effort: Effort | None = None,
    spread: Executor | None = None,
    recall: Memoize = no_checkpoint,
    progress: StudyProgress | None = None,
) -> Study:
    """Find a robot's friction in its logs, judge it, and show what compensating it gains.

    Parameters
    ----------
    robot : Robot
        Its own friction is not used.
    logs : mapping of str to Log, or CheckedLogs
        By a name to call each; with torques and states, and with the reference for the closed-loop validation. They
        are checked first, unless they come as `CheckedLogs`.
    accept : collection of str
        Codes of errors found in the logs to go on in spite of; see `ballbot.findings.CODES`.
    plant : {"model", "twin"}, optional
        What the candidates are compared on, with the friction drawn from what the identification leaves uncertain: the
        equations of motion, or the physics-engine twin; by default the twin if its engine is installed.
    scenario : Scenario, optional
        Delay, play, noise, sensors and floor of these plants; the nominal one by default.
    bounds : Bounds, optional
        Within which the friction is sought.
    left_out : sequence of str
        States whose errors do not count in the fit, as the heading on a floor on which the ball pivots; they are
        judged all the same.
    back_emf : float
        What a motor driven by voltage brakes with [N m s/rad], if the logs' torques contain it; see
        `ballbot.identification.windows`.
    seed : int
        Of all that is random.
    effort : Effort, optional
        How much work is done.
    spread : Spread, optional
        Where the identification does its work; by default a thread for each core.
    recall : Recall, optional
        A checkpoint's, for a study that can be resumed: it answers for the identification's steps and for the runs of
        the candidates.
    progress : callable, optional
        Told the stage and the share of the whole that is done.

    Raises
    ------
    InputError
        If a log lacks a column or is not of this robot, its checks find an error whose code is not accepted, or
        there is nothing to find in the logs.
    """
    effort, tell = effort or Effort(), progress or _no_progress
    checked = checked_logs(robot, logs, accept=accept)
    studied = tuple(
        StudiedLog(name=name, log=log, held_out=holdout_intervals(log)) for name, log in checked.logs.items()
    )
    check_columns(robot, studied)
    if not 2 <= effort.draws <= MAX_DRAWS:
        raise InputError(f"The number of draws is {effort.draws}; it must be 2 to {MAX_DRAWS}, such as 20.")
    # whole nanoseconds: the rounding of a log's time stamps does not belong into a controller file
    sample_time = round(studied[0].log.sample_time, 9)
    chosen_plant = available_plant(plant)
    tried = sampled_at(scenario or Scenario.nominal(robot), sample_time)
    _check_plant(robot, tried, chosen_plant)
    identified, validated = _STAGES[chosen_plant]

    def identifying(share: float) -> None:
        tell("identifying friction", identified * share)

    def validating(name: str, share: float) -> None:
        tell(f"validating on {name}", identified + (validated - identified) * share)

    def choosing(share: float) -> None:
        tell("comparing controllers", validated + (1.0 - validated) * share)

    found = _identify(
        robot, studied, checked, bounds, left_out, back_emf, seed, effort, spread, recall, identifying
    )
    by_log = _validate(found.robot, studied, seed, validating)
    choice = choose_controller(
        candidates(found, sample_time=sample_time),
        draw_plants(found, plant=chosen_plant, scenario=tried, count=effort.draws, seed=seed),
        course=NamedCourse(name=SQUARE.name, duration=effort.duration),
        ablation_plants=effort.ablation_draws,
        recall=recall,
        progress=choosing,
    )
    tell("done", 1.0)
    return Study(
        robot=robot,
        logs=studied,
        found=found,
        by_log=by_log,
        validation=join_validations(by_log),
        design=design_gain(found.robot, sample_time=sample_time),
        plant=chosen_plant,
        scenario=tried,
        choice=choice,
        prediction=predict(choice, logs=[one.log for one in studied]),
        effort=effort,
        seed=seed,
    )


def sampled_at(scenario: Scenario, sample_time: float) -> Scenario:
    """Return the scenario with sensors read at a sample time [s], its engine's steps a whole number in each."""
    steps = max(1, round(sample_time / scenario.timestep))
    sensors = replace(scenario.sensors, sample_time=sample_time)
    return replace(scenario, sensors=sensors, timestep=sample_time / steps)


def check_columns(robot: Robot, logs: Sequence[StudiedLog]) -> None:
    """Refuse what a study cannot work with before it works for minutes.

    Raises
    ------
    InputError
        Naming the log and what it lacks.
    """
    if not logs:
        raise InputError("A study needs at least one log.")
    for studied in logs:
        try:
            studied.log.require(*torque_names(robot.wheel_count), *STATE_NAMES)
            more = torque_names(robot.wheel_count + 1)[-1]
            if more in studied.log:
                raise InputError(
                    f"The log has a torque {more}, but the robot {robot.name} has {robot.wheel_count} wheels."
                )
        except InputError as error:
            raise InputError(f"{studied.name}: {error}") from None


def _check_plant(robot: Robot, scenario: Scenario, plant: PlantName) -> None:
    """Raise InputError if the plant cannot be made, before minutes of work."""
    PlantDraw(robot=robot, known=robot, scenario=scenario, plant=plant, seed=0).make("onboard")


def _no_progress(stage: str, share: float) -> None:
    """Tell nobody."""


def _identify(
    robot: Robot,
    logs: Sequence[StudiedLog],
    checked: CheckedLogs,
    bounds: Bounds | None,
    left_out: Sequence[str],
    back_emf: float,
    seed: int,
    effort: Effort,
    spread: Executor | None,
    recall: Memoize,
    tell: Callable[[float], None],
) -> Identification:
    def told(progress: Progress) -> None:
        tell(progress.share)

    return identify(
        robot,
        checked.with_logs(
            {studied.name: without_intervals(studied.log, studied.held_out) for studied in logs}
        ),
        bounds=bounds,
        left_out=left_out,
        back_emf=back_emf,
        held_out=_OWN_HOLDOUT,
        seed=seed,
        generations=effort.generations,
        spread=spread,
        recall=recall,
        progress=told,
    )


def _validate(
    robot: Robot, logs: Sequence[StudiedLog], seed: int, tell: Callable[[str, float], None]
) -> tuple[Validation, ...]:
    validations, models = [], ModelPair.by_friction(Model(robot))
    for number, studied in enumerate(logs):
        tell(studied.name, number / len(logs))
        validations.append(validate_pair(models, studied.log, held_out=studied.held_out, seed=seed))
    return tuple(validations)
