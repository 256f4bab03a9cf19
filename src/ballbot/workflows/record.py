"""Recording the twin: a run, or one for each of many seeds, and the files that say how it was made.

log, truth, motion_capture   see `ballbot.twin.recording`; in a format that `ballbot.log.formats` writes
robot.toml, scenario.toml, controller.toml (or a user's own, controller.py)
record.toml                  version of Ballbot, seed, experiment, the cameras' frame and clock

Runs of many seeds are a sweep (`ballbot.fitting.sweep`), which goes on where it was stopped.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import tomli_w

from ballbot.control.controller import Controller
from ballbot.control.file import controller_text
from ballbot.control.interface import Feedback, estimator_of
from ballbot.control.references import as_reference, is_reference_file, reference_text
from ballbot.control.source import ControllerLike, UserController, as_controller
from ballbot.estimation import named_estimator
from ballbot.file_formats import read_results, results_text, without_format
from ballbot.files import read_text, write_bytes
from ballbot.fitting.run import ALL_CORES, Executor
from ballbot.fitting.sweep import RunFolder, identity
from ballbot.log.formats import WRITTEN_SUFFIXES
from ballbot.progress import ProgressCallback, ignore_progress, in_notebook
from ballbot.result_folder import MANIFEST, result_folder
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.file import robot_text
from ballbot.twin.recording import (
    DURATIONS,
    Experiment,
    MotionCapture,
    Recording,
    record_balance,
    record_bench,
)
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario, scenario_text
from ballbot.twin.twin import Twin
from ballbot.workflows.metrics import run_results

#: files that a run may write besides its page and results.json
RECORD_FILES = (
    *(f"{name}{suffix}" for name in ("log", "truth", "motion_capture") for suffix in WRITTEN_SUFFIXES),
    *("robot.toml", "scenario.toml", "controller.toml", "controller.py", "reference.csv", "record.toml"),
)

_HEADER = (
    "# How this run of the twin was made. The command, run in this folder, repeats the run bit for bit.\n"
)
_CAMERAS = """\
# motion_capture: t_camera = (1 + clock_rate) t + clock_offset; p_camera = R_camera_world p + origin;
# rotation_wxyz is the quaternion of R_camera_world.
"""


@dataclass(frozen=True, kw_only=True)
class RecordJob:
    """What to record."""

    robot: Robot
    scenario: Scenario
    controller: Feedback
    experiment: Experiment = "balance"
    reference: str = "square"  #: a name of `ballbot.control.references`, or a file; nothing to the bench
    duration: float  #: [s]
    seed: int = 1
    log_format: str = "csv"


def record(
    scenario: Scenario | str | Path = "nominal",
    *,
    robot: RobotLike = "alten",
    controller: ControllerLike = "nominal",
    reference: str = "square",
    duration: float = DURATIONS["balance"],
    seed: int = 1,
) -> Recording:
    """Record a run of the twin as `ballbot record` does, but write nothing.

    Parameters
    ----------
    scenario : Scenario, scenario's name or scenario file
    robot : Robot, preset or robot file
    controller : Controller, its name or file, or a function of time, state and reference
    reference : str
        The name of a course, or a reference file.
    duration : float
        [s].
    seed : int
        Of all that is random.

    Returns
    -------
    Recording
        `logs["log"]` is what the robot logs.

    Raises
    ------
    InputError
        If it cannot run.

    Examples
    --------
    >>> run = record("ideal", controller="precise", reference="hold", duration=0.5)
    >>> len(run.logs["log"])
    100
    """
    job = RecordJob(
        robot=(described := as_robot(robot)),
        scenario=load_scenario(scenario, described),
        controller=as_controller(controller, described),
        reference=reference,
        duration=duration,
        seed=seed,
    )
    return record_run(job, in_notebook)


def settings(job: RecordJob) -> dict[str, str]:
    """Return the texts of the files that describe a run, by name; record.toml comes last."""
    texts = {"robot.toml": robot_text(job.robot), "scenario.toml": scenario_text(job.scenario)}
    run: dict[str, object] = {
        "ballbot": version("ballbot"),
        "seed": job.seed,
        "experiment": job.experiment,
        "duration": job.duration,
        "format": job.log_format,
    }
    options = f"--experiment {job.experiment} --duration {job.duration!r} --seed {job.seed} --format {job.log_format}"
    tables: dict[str, object] = {"run": run}
    header = _HEADER
    if job.experiment == "balance":
        own, reference, given = job.controller, job.reference, "controller.toml"
        run["reference"] = reference
        if is_reference_file(reference):  # its text goes along, so that the folder has all that made the run
            run["reference"] = reference = "reference.csv"
            texts[reference] = reference_text(job.reference)
        if isinstance(own, Controller):
            texts[given] = controller_text(own)
            run["compensation"] = own.compensation
        elif isinstance(own, UserController):
            texts["controller.py"] = read_text(Path(own.path))
            given = f"controller.py:{own.made_by} --estimator {own.estimator}"
        run["estimator"] = estimator_of(own)
        options += f" --reference {reference} --controller {given}"
        tables["motion_capture"] = asdict(MotionCapture.drawn(job.seed))
        header += _CAMERAS
    run["command"] = f"ballbot record scenario.toml --robot robot.toml {options} --out again"
    texts["record.toml"] = f"{header}\n{tomli_w.dumps(tables)}"
    return texts


def record_run(job: RecordJob, progress: ProgressCallback = ignore_progress) -> Recording:
    """Run the twin as the job says; InputError if it cannot be run."""
    scenario, duration, seed = job.scenario, job.duration, job.seed
    if job.experiment != "balance":
        return record_bench(
            job.robot, scenario, job.experiment, duration=duration, seed=seed, progress=progress
        )
    sample_time = scenario.sensors.sample_time
    estimator = named_estimator(estimator_of(job.controller), job.robot, sample_time=sample_time)
    twin = Twin(job.robot, scenario, estimator=estimator)
    reference = as_reference(job.reference)
    return record_balance(twin, job.controller, reference, duration=duration, seed=seed, progress=progress)


def record_runs(
    job: RecordJob,
    seeds: Sequence[int],
    folder: Path,
    *,
    workers: Executor = ALL_CORES,
    progress: ProgressCallback = ignore_progress,
) -> dict[str, Mapping[str, object]]:
    """Record a run for each seed into folders seed_0001 and so on; runs that are there are kept.

    Return the results of each run by the name of its folder. InputError if the folder holds runs of other settings.
    """
    texts = {name: text for name, text in settings(job).items() if name != "record.toml"}
    options = {"experiment": job.experiment, "duration": job.duration, "format": job.log_format}
    if job.experiment == "balance":
        options["reference"] = "reference.csv" if "reference.csv" in texts else job.reference
    runs = RunFolder(
        path=folder,
        made_from=identity({name: [without_format(text)] for name, text in texts.items()}, options),
        write=_write_run,
        read=_finished,
    )
    named = {f"seed_{seed:04d}": replace(job, seed=seed) for seed in seeds}
    return runs.complete(_made, named, workers=workers, stage="recording", progress=progress)


def _made(job: RecordJob) -> dict[str, bytes]:
    """Return the files of a run; a worker need not see the folder that they are for."""
    recording = record_run(job)
    results = {**(run_results(recording.run) if job.experiment == "balance" else {}), **recording.results}
    texts = {**settings(job), "results.json": results_text(results)}
    files = {name: text.encode() for name, text in texts.items()}
    with TemporaryDirectory() as name:
        for log_name, log in recording.logs.items():
            path = Path(name) / f"{log_name}.{job.log_format}"
            log.write(path)
            files[path.name] = path.read_bytes()
    return files


def _write_run(folder: Path, files: Mapping[str, bytes]) -> None:
    with result_folder(folder, command="record", names=files) as held, held.replaced() as new:
        for name, content in files.items():
            write_bytes(new / name, content)


def _finished(folder: Path) -> Mapping[str, object] | None:
    """Return the results of a run that is complete in its folder: its list of files is written last."""
    if not (folder / MANIFEST).is_file():
        return None
    return cast("Mapping[str, object]", read_results(folder / "results.json"))
