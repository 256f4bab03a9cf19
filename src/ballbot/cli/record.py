"""`ballbot record`: runs of the twin, written as log files."""

from ballbot.cli import options
from ballbot.cli.context import Content, open_result, parse_seeds
from ballbot.cli.controllers import Chosen, warn_of_idle_compensation
from ballbot.cli.findings import checked_robot
from ballbot.control.references import as_reference
from ballbot.control.source import read_source
from ballbot.estimation.interface import EstimatorName
from ballbot.progress import in_stage
from ballbot.report.run import recording_report, recordings_report
from ballbot.simulation.run import sample_count
from ballbot.summary import counted
from ballbot.twin.recording import DURATIONS, Experiment
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.record import RECORD_FILES, RecordJob, record_run, record_runs, settings


def record(
    scenario: str,
    /,
    *,
    robot: options.Robot = "alten",
    experiment: Experiment = "balance",
    reference: options.Reference = "square",
    duration: float | None = None,
    format: options.LogFormat = "csv",
    controller: Chosen = "nominal",
    estimator: EstimatorName | None = None,
    seed: options.Seed = 1,
    seeds: str | None = None,
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
    experiment
        balance; driveline_sweep (wheels in the air, 1 N m, a sine of 62.83 s); or upside_down (the ball on the
        wheels).
    duration
        Duration [s]. If not given, 40 s balancing, 125.66 s for the sweep, or 60 s upside down.
    seeds
        Several seeds, such as 1-200 or 1,4,7-9: runs on all cores, each in its own folder. Existing runs with the same
        settings are kept: after an interruption, the same command resumes.
    estimator
        The state estimate that the controller feeds back and the log contains: onboard (a sum of wheel
        speeds); or kalman, a filter that also uses the scenario's fixes. If not given, the one that the
        controller's file names.
    """
    described, findings = checked_robot(robot, change, accept=accept)
    # raise InputError before anything runs
    as_reference(reference)
    several = None if seeds is None else parse_seeds(seeds)
    driver = read_source(controller, described)
    warn_of_idle_compensation(controller, driver)
    job = RecordJob(
        robot=described,
        scenario=load_scenario(scenario, described),
        controller=driver if estimator is None else driver.with_estimator(estimator),
        experiment=experiment,
        reference=reference,
        duration=DURATIONS[experiment] if duration is None else duration,
        seed=seed,
        log_format=format,
    )
    sample_count(job.duration, job.controller.sample_time)
    doing = f"recording {job.duration:g} s"
    if seeds is not None and several is not None:
        doing = f"recording {counted(len(several), 'run')} of {job.duration:g} s"
        with open_result(out, command="record --seeds", doing=doing, seed=seeds) as result:
            runs = record_runs(job, several, out, progress=result.report)
            paths = " ".join(str(out / next(iter(runs)) / name) for name in ("robot.toml", f"log.{format}"))
            step = f"`ballbot {_NEXT[experiment]} {paths} --out found`"
            result.write(recordings_report(job, runs, findings), next_step=step)
        return
    with open_result(out, doing=doing, writes=RECORD_FILES, seed=job.seed) as result:
        recording = record_run(job, in_stage(result.report, doing))
        files: dict[str, Content] = {
            f"{name}.{job.log_format}": log.write for name, log in recording.logs.items()
        }
        files |= settings(job)
        paths = f"{result.path('robot.toml')} {result.path(f'log.{format}')}"
        step = f"`ballbot {_NEXT[experiment]} {paths} --out found`"
        result.write(recording_report(job, recording, findings), files=files, named=[*files], next_step=step)


#: the command that takes the log of an experiment
_NEXT = {
    "balance": "identify",
    "driveline_sweep": "identify-driveline",
    "upside_down": "identify-upside-down",
}
