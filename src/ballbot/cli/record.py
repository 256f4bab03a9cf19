"""`ballbot record`: runs of the twin, written as log files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cyclopts import Parameter

from ballbot.cli import OUTPUT, options
from ballbot.cli.context import changed_robot, command_line, parse_seeds, workers
from ballbot.cli.controllers import ControllerOptions, warn_of_idle_compensation
from ballbot.cli.findings import check_robot
from ballbot.cli.output import emit, print_parts, progress_bar, standard_output
from ballbot.control.references import as_reference
from ballbot.estimation.interface import EstimatorName
from ballbot.file_formats import read_results
from ballbot.files import check_folder
from ballbot.fitting.run import check_seed
from ballbot.log.formats import check_format
from ballbot.progress import Progress, in_stage
from ballbot.report.blocks import provenance, verdict_lines
from ballbot.report.page import page_of
from ballbot.report.twin import recording_report, seeds_report
from ballbot.results import to_results
from ballbot.simulation.run import sample_count
from ballbot.summary import counted
from ballbot.twin.recording import DURATIONS, Experiment, Recording
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.record import (
    RecordJob,
    RecordOutcome,
    record_run,
    record_runs,
)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExperimentOptions:
    """What the robot does, and what is recorded."""

    experiment: Experiment = "balance"
    """balance; driveline_sweep (wheels in the air, 1 N m, a sine of 62.83 s); or upside_down (the ball on the
    wheels)."""

    reference: options.Reference = "square"

    duration: float | None = None
    """Duration [s]. If not given, 40 s balancing, 125.66 s for the sweep, or 60 s upside down."""

    format: options.LogFormat = "csv"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SeedOptions:
    """Random seeds, and where the runs of several are made."""

    seed: options.Seed = 1

    seeds: str | None = None
    """Several seeds, such as 1-200 or 1,4,7-9: runs on all cores, each in its own folder. Runs that are there are kept
    if they have the same settings and their files are unchanged: the same command goes on after it was stopped."""

    cluster: options.Cluster = None


_EXPERIMENT, _SEEDS, _CONTROLLER = ExperimentOptions(), SeedOptions(), ControllerOptions()


def record(
    scenario: str,
    /,
    *,
    robot: options.Robot = "alten",
    run: ExperimentOptions = _EXPERIMENT,
    chosen: ControllerOptions = _CONTROLLER,
    estimator: EstimatorName | None = None,
    random: SeedOptions = _SEEDS,
    accept: options.Accept = None,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Record logs from the twin, a MuJoCo robot with real rollers, sensors and faults.

    The controller compensates the friction in the robot's file; the twin has the friction of its scenario.

    Example: ballbot record nominal --robot alten --reference square --duration 40 --seed 1 --out run1

    Example: ballbot record mine.toml --estimator kalman --seeds 1-200 --out runs

    Parameters
    ----------
    scenario
        The twin's true properties, unknown to the controller: nominal, ideal, wide_rows, single_row, single_point,
        resonant, soft_ball, or a scenario file (ballbot twin scenario writes one to start from).
    estimator
        The state estimate that the controller feeds back and the log contains: onboard (a sum of wheel
        speeds); or kalman, a filter that also uses the scenario's fixes. If not given, the one that the
        controller's file names.
    """
    described = changed_robot(robot, change)
    check_robot(described, accept=accept)
    # refused before anything is run or made
    as_reference(run.reference)
    check_seed(random.seed)
    all_seeds = None if random.seeds is None else parse_seeds(random.seeds)
    controller = chosen.read(described)
    job = RecordJob(
        robot=described,
        scenario=load_scenario(scenario, described),
        controller=controller if estimator is None else controller.with_estimator(estimator),
        experiment=run.experiment,
        reference=run.reference,
        duration=DURATIONS[run.experiment] if run.duration is None else run.duration,
        log_format=check_format(run.format),
    )
    if run.experiment == "balance":
        warn_of_idle_compensation({chosen.controller or "nominal controller": job.controller})
    sample_count(job.duration, job.controller.sample_time)
    check_folder(out)
    if all_seeds is None:
        outcomes = [_one(job, random.seed, out)]
    else:
        outcomes = _many(job, all_seeds, out, cluster=random.cluster)
    if OUTPUT.get().json:
        runs = [to_results(one) | {"results": read_results(one.folder / "results.json")} for one in outcomes]
        emit({"runs": runs})


def _one(job: RecordJob, seed: int, out: Path) -> RecordOutcome:
    console, doing, verdict = standard_output(), f"recording {job.duration:g} s", list[tuple[str, str]]()
    with progress_bar(console, doing) as report:

        def page(recording: Recording) -> str:
            report(Progress(stage="writing the files"))
            made = recording_report(job, seed, recording)
            verdict.extend(made.verdict)
            return page_of(made)

        outcome = record_run(job, seed, out, page=page, progress=in_stage(report, doing))
    named = (str(out / one.name) for one in sorted(out.iterdir()) if not one.name.startswith("."))
    print_parts([*verdict_lines(verdict), *named, f"Next: {_next(job, out)}"], console)
    return outcome


def _next(job: RecordJob, folder: Path) -> str:
    log, robot = folder / f"log.{job.log_format}", folder / "robot.toml"
    command = {
        "balance": "identify",
        "driveline_sweep": "identify-driveline",
        "upside_down": "identify-upside-down",
    }
    return f"`ballbot {command[job.experiment]} {robot} {log} --out found`"


def _many(job: RecordJob, seeds: list[int], out: Path, *, cluster: str | None) -> list[RecordOutcome]:
    console, doing = standard_output(), f"recording {counted(len(seeds), 'run')} of {job.duration:g} s"
    listed = f"{seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else str(seeds[0])
    made = provenance(command=command_line(), files=(), seed=listed)
    with workers(cluster) as made_by, progress_bar(console, doing) as report:
        outcomes = record_runs(
            job,
            seeds,
            out,
            workers=made_by,
            page=lambda runs: page_of(seeds_report(job, runs, made)),
            progress=report,
        )
    before = sum(outcome.was_there for outcome in outcomes)
    early = [outcome for outcome in outcomes if outcome.ended is not None]
    kept = f", {before} of them kept from before" if before else ""
    lines = [f"{counted(len(outcomes), 'run')} in {out}{kept}; {len(early)} ended early."]
    lines += [f"{outcome.folder}: ended early, {outcome.ended}." for outcome in early]
    lines.append(f"Next: {_next(job, outcomes[0].folder)}")
    print_parts(lines, console)
    return outcomes
