"""The main job: a robot and its logs in; friction, validation, controller and what the controller gains out.

    identify -> validate on what was held out -> design -> compare the compensations in closed loop

The gain is designed with the weights of the nominal scenario (design section 11) on the exact model without
friction, at the logs' sample time, whatever gain the logs were recorded with: so that studies of different robots
can be compared. The logs' own gain is recovered for the closed-loop validation, and the report shows both.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign
from ballbot.control.nominal import design_gain
from ballbot.control.references import square
from ballbot.errors import InputError
from ballbot.experiments.compare import Comparison, start
from ballbot.experiments.held_out import held_out_stretches, without
from ballbot.experiments.score import Score, score
from ballbot.findings import Finding
from ballbot.identification import Bounds, Identification, identify
from ballbot.identification.checkpoint import Recall, afresh
from ballbot.identification.progress import Progress
from ballbot.identification.spread import Spread
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checked import CheckedLogs, checked_logs
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate
from ballbot.validation import ModelPair, Validation, join_validations, validate_pair
from ballbot.validation.windows import Interval

PlantName = Literal["model", "twin"]

COMPENSATIONS: tuple[Compensation, ...] = ("none", "full", "partial")

#: told what is being done and the share of the whole that is done
StudyProgress = Callable[[str, float], None]

#: shares of the whole that are done when each stage ends, from timings on the logs of a square and a hold
_IDENTIFIED, _VALIDATED = 0.75, 0.9
#: share of the windows that identification keeps for its own verdict; the study's is on the stretches held out
_OWN_HELD_OUT = 0.1


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
    duration: float = 32.0  #: of each run of the comparison [s]
    runs: int = 3  #: of each compensation


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Everything a study found."""

    robot: Robot  #: as given
    logs: tuple[StudiedLog, ...]
    found: Identification
    by_log: tuple[Validation, ...]  #: on what each log held out
    validation: Validation  #: all of them together
    design: LqrDesign
    plant: PlantName
    comparison: Comparison  #: by compensation: "none", "full", "partial"
    runs: Mapping[str, Log]  #: the first run of each compensation
    chosen: Controller  #: the nominal gain with the compensation that did best
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
    plant: PlantName = "model",
    bounds: Bounds | None = None,
    left_out: Sequence[str] = (),
    back_emf: float = 0.0,
    seed: int = 0,
    effort: Effort | None = None,
    spread: Spread | None = None,
    recall: Recall = afresh,
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
    plant : {"model", "twin"}
        What the compensations are compared on: the model with the friction found, or the nominal twin, whose friction
        is its own.
    bounds : Bounds, optional
        Within which the friction is sought.
    left_out : sequence of str
        States whose errors do not count in the fit, as the heading on a floor on which the ball pivots; they are
        judged all the same.
    back_emf : float
        What a motor driven by voltage brakes with [N m s/rad], if the logs' torques contain it; see
        `ballbot.identification.back_emf`.
    seed : int
        Of all that is random.
    effort : Effort, optional
        How much work is done.
    spread : Spread, optional
        Where the identification does its work; by default a thread for each core.
    recall : Recall, optional
        A checkpoint's, for a study that can be resumed: it answers for the identification's steps and for the runs of
        the comparison, but for those that are drawn.
    progress : callable, optional
        Told the stage and the share of the whole that is done.

    Raises
    ------
    InputError
        If a log lacks a column or is not of this robot, its checks find an error whose code is not accepted, or
        there is nothing to find in the logs.
    """
    effort, tell = effort or Effort(), progress or _nobody
    checked = checked_logs(robot, logs, accept=accept)
    studied = tuple(
        StudiedLog(name=name, log=log, held_out=held_out_stretches(log)) for name, log in checked.logs.items()
    )
    check_columns(robot, studied)
    make_plant = plant_factory(robot, plant)
    found = _identify(robot, studied, checked, bounds, left_out, back_emf, seed, effort, spread, recall, tell)
    by_log = _validate(found.robot, studied, seed, tell)
    sample_time = studied[0].log.sample_time
    design = design_gain(found.robot, sample_time=sample_time)
    controllers: dict[str, Controller] = {
        name: Controller(found.robot, design.gain, sample_time=sample_time, compensation=name)
        for name in COMPENSATIONS
    }
    factory = make_plant or (lambda: Model(found.robot))
    comparison, runs = _compare(factory(), controllers, seed, effort, recall, tell)
    tell("done", 1.0)
    return Study(
        robot=robot,
        logs=studied,
        found=found,
        by_log=by_log,
        validation=join_validations(by_log),
        design=design,
        plant=plant,
        comparison=comparison,
        runs=runs,
        chosen=controllers[best_compensation(comparison)],
        effort=effort,
        seed=seed,
    )


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


def plant_factory(robot: Robot, plant: PlantName) -> Callable[[], Plant] | None:
    """Return what makes the twin, or None for the model, which needs the friction first.

    Raises
    ------
    InputError
        Where there is no such plant, or the twin's engine is not installed.
    """
    if plant == "model":
        return None
    if plant != "twin":
        raise InputError(f"The plant is {plant!r}; it must be 'model' or 'twin'.")
    from ballbot.twin import Scenario, Twin

    scenario = Scenario.nominal(robot)
    return lambda: Twin(robot, scenario)


def best_compensation(comparison: Comparison) -> Compensation:
    """Return the compensation with the fewest falls and, among these, the smallest peak position error."""

    def badness(name: Compensation) -> tuple[int, float]:
        summary = comparison.summary(name)
        return summary.falls, float(np.nan_to_num(summary.peak_position_error, nan=np.inf))

    return min(COMPENSATIONS, key=badness)


def _nobody(stage: str, share: float) -> None:
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
    spread: Spread | None,
    recall: Recall,
    tell: StudyProgress,
) -> Identification:
    def told(progress: Progress) -> None:
        tell("identifying friction", _IDENTIFIED * progress.share)

    return identify(
        robot,
        checked.with_logs({studied.name: without(studied.log, studied.held_out) for studied in logs}),
        bounds=bounds,
        left_out=left_out,
        back_emf=back_emf,
        held_out=_OWN_HELD_OUT,
        seed=seed,
        generations=effort.generations,
        spread=spread,
        recall=recall,
        progress=told,
    )


def _validate(
    robot: Robot, logs: Sequence[StudiedLog], seed: int, tell: StudyProgress
) -> tuple[Validation, ...]:
    validations, models = [], ModelPair.by_friction(Model(robot))
    for number, studied in enumerate(logs):
        tell(f"validating on {studied.name}", _IDENTIFIED + (_VALIDATED - _IDENTIFIED) * number / len(logs))
        validations.append(validate_pair(models, studied.log, held_out=studied.held_out, seed=seed))
    return tuple(validations)


def _compare(
    plant: Plant | Model,
    controllers: Mapping[str, Controller],
    seed: int,
    effort: Effort,
    recall: Recall,
    tell: StudyProgress,
) -> tuple[Comparison, dict[str, Log]]:
    """Compare on the 0.5 m square; the logs of the first seed's runs are kept, to be drawn."""
    reference, seeds = square(), tuple(range(seed, seed + effort.runs))

    def run(name: str, one: int) -> Log:
        return simulate(
            plant,
            controllers[name],
            reference,
            duration=effort.duration,
            initial_state=start(one),
            seed=one,
        )

    runs: dict[str, Log] = {}
    scores: dict[str, list[Score]] = {name: [] for name in controllers}
    for number, (one, name) in enumerate(product(seeds, controllers)):
        share = number / (len(seeds) * len(controllers))
        tell("comparing compensations", _VALIDATED + (1.0 - _VALIDATED) * share)
        if one == seed:
            runs[name] = run(name, one)
            scores[name].append(score(runs[name]))
        else:
            asked = np.array([list(controllers).index(name), one], dtype=float)
            answer = recall("comparison", asked, lambda name=name, one=one: score(run(name, one)).to_arrays())
            scores[name].append(Score.from_arrays(*answer))
    return Comparison(seeds=seeds, scores={name: tuple(found) for name, found in scores.items()}), runs
