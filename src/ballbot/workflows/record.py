"""Recording the twin into folders: one run or hundreds, each with all that made it.

log, truth, motion_capture   see `ballbot.twin.recording`; in a format that `ballbot.log.formats` writes
results.json                 the run in numbers
report.html                  the run to look at; of several seeds one page beside their folders
robot.toml, scenario.toml, controller.toml
record.toml                  version of Ballbot, seed, experiment, the cameras' frame and clock

The files appear together (`ballbot.result_folder`), so that a folder that has them is whole. Several runs are a sweep
(`ballbot.fitting.sweep`), which goes on where it was stopped; the checksums of the runs that are there are checked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import tomli_w

from ballbot.control.controller import Controller
from ballbot.control.file import controller_text
from ballbot.control.references import as_reference, is_reference_file, reference_text
from ballbot.errors import InputError
from ballbot.estimation import named_estimator
from ballbot.file_formats import read_results, results_text, without_format
from ballbot.files import write_bytes, write_text
from ballbot.fitting.sweep import ALL_CORES, HEADER, RunFolder, Workers, identity
from ballbot.log.formats import WRITTEN_SUFFIXES
from ballbot.progress import ProgressCallback, ignore_progress
from ballbot.result_folder import read_manifest, result_folder
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from ballbot.twin.recording import Experiment, MotionCapture, Recording, record_balance, record_bench
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import scenario_text
from ballbot.twin.twin import Twin
from ballbot.workflows.metrics import run_results

_LOGS = ("log", "truth", "motion_capture")
_SETTINGS = ("robot.toml", "scenario.toml", "controller.toml", "reference.csv", "record.toml")
#: what people read of a run, or of several
PAGE = "report.html"
#: all that a run may leave
_FILES = (
    *(f"{name}{suffix}" for name in _LOGS for suffix in WRITTEN_SUFFIXES),
    "results.json",
    PAGE,
    *_SETTINGS,
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
    """What to record, but for the seed."""

    robot: Robot
    scenario: Scenario
    controller: Controller
    experiment: Experiment = "balance"
    reference: str = "square"  #: a name of `ballbot.control.references`, or a file; nothing to the bench
    duration: float  #: [s]
    log_format: str = "csv"


@dataclass(frozen=True, kw_only=True)
class RecordOutcome:
    """What became of one run."""

    seed: int
    folder: Path
    ended: str | None = None  #: why it stopped early
    was_there: bool = False  #: whole on disk from before


def record_run(
    job: RecordJob,
    seed: int,
    folder: Path,
    *,
    page: Callable[[Recording], str] | None = None,
    progress: ProgressCallback = ignore_progress,
) -> RecordOutcome:
    """Record one run into a folder, with its page if `page` makes one; a run that is in it is replaced.

    InputError if the job cannot be run, a file not be written, or the folder is another result's.
    """
    if (folder / HEADER).exists():
        raise InputError(f"{folder} holds runs of several seeds (--seeds); choose another folder with --out.")
    with result_folder(folder, command="record", names=_FILES, inputs=_inputs(job)) as held:
        recording = _record(job, seed, progress)
        with held.replaced() as new:
            for name, log in recording.logs.items():
                log.write(new / f"{name}.{job.log_format}")
            write_text(new / "results.json", results_text(_results(job, recording)))
            if page is not None:
                write_text(new / PAGE, page(recording))
            for name, text in settings(job, seed).items():
                write_text(new / name, text)
    return RecordOutcome(seed=seed, folder=folder, ended=recording.ended)


def _results(job: RecordJob, recording: Recording) -> dict[str, object]:
    """Return a run in numbers; of one on the bench there are few."""
    own = run_results(recording.with_truth()) if job.experiment == "balance" else {}
    return {**own, **recording.results}


def record_runs(
    job: RecordJob,
    seeds: Sequence[int],
    folder: Path,
    *,
    workers: Workers = ALL_CORES,
    page: Callable[[list[RecordOutcome]], str] | None = None,
    progress: ProgressCallback = ignore_progress,
) -> list[RecordOutcome]:
    """Record a run for each seed into folders seed_0001, seed_0002 and so on; runs that are there are kept.

    Return the outcomes in the order of the seeds. `page` makes the page of all runs. InputError if the folder holds
    runs of other settings, or a run cannot be made.
    """
    # the folder has no file of its own but the page, and the seeds' folders
    with result_folder(folder, command="record --seeds", names=(PAGE,)) as held:
        runs = RunFolder(path=folder, made_from=_made_from(job), write=_write_run, read=_finished)
        named = {f"seed_{seed:04d}": seed for seed in seeds}
        found, before = runs.complete(
            partial(_made, job), named, workers=workers, stage="recording", progress=progress
        )
        outcomes = [replace(one, was_there=name in before) for name, one in found.items()]
        if page is not None:
            with held.replaced() as new:
                write_text(new / PAGE, page(outcomes))
        return outcomes


def _made_from(job: RecordJob) -> dict[str, str]:
    """Return what all runs of a job depend on, whatever their seeds."""
    texts = {name: text for name, text in settings(job, 0).items() if name != "record.toml"}
    options = {"experiment": job.experiment, "duration": job.duration, "format": job.log_format}
    if job.experiment == "balance":
        options["reference"] = "reference.csv" if "reference.csv" in texts else job.reference
    return identity({name: [without_format(text)] for name, text in texts.items()}, options)


def _made(job: RecordJob, seed: int) -> dict[str, bytes]:
    """Return the files of a run; a worker need not see the folder that they are for."""
    with TemporaryDirectory() as name:
        record_run(job, seed, Path(name))
        return {
            path.name: path.read_bytes() for path in Path(name).iterdir() if not path.name.startswith(".")
        }


def _write_run(folder: Path, files: Mapping[str, bytes]) -> None:
    with result_folder(folder, command="record", names=_FILES) as held, held.replaced() as new:
        for name, content in files.items():
            write_bytes(new / name, content)


def _finished(folder: Path) -> RecordOutcome | None:
    """Return the outcome of a run that is whole in its folder, every file as it was written; None if it is not.

    InputError if a file of it was changed.
    """
    manifest = read_manifest(folder)
    if manifest is None or manifest.command != "record":
        return None
    changed = manifest.changed_file(folder)
    if changed:
        raise InputError(
            f"{folder / changed} was changed since it was recorded; delete {folder} to record that run again."
        )
    if manifest.missing_file(folder):
        return None
    ended = cast("dict[str, str | None]", read_results(folder / "results.json"))["ended"]
    return RecordOutcome(seed=int(folder.name.removeprefix("seed_")), folder=folder, ended=ended)


def settings(job: RecordJob, seed: int) -> dict[str, str]:
    """Return the texts of the files that describe a run, by name; record.toml comes last."""
    texts = {"robot.toml": robot_text(job.robot), "scenario.toml": scenario_text(job.scenario)}
    run: dict[str, object] = {
        "ballbot": version("ballbot"),
        "seed": seed,
        "experiment": job.experiment,
        "duration": job.duration,
        "format": job.log_format,
    }
    options = (
        f"--experiment {job.experiment} --duration {job.duration!r} --seed {seed} --format {job.log_format}"
    )
    tables: dict[str, object] = {"run": run}
    header = _HEADER
    if job.experiment == "balance":
        texts["controller.toml"] = controller_text(job.controller)
        reference = job.reference
        if is_reference_file(reference):  # its text goes along, so that the folder has all that made the run
            reference = "reference.csv"
            texts[reference] = reference_text(job.reference)
        run |= {"reference": reference, "compensation": job.controller.compensation}
        run["estimator"] = job.controller.estimator
        options += f" --reference {reference} --controller controller.toml"
        tables["motion_capture"] = asdict(MotionCapture.drawn(seed))
        header += _CAMERAS
    run["command"] = f"ballbot record scenario.toml --robot robot.toml {options} --out again"
    texts["record.toml"] = f"{header}\n{tomli_w.dumps(tables)}"
    return texts


def _record(job: RecordJob, seed: int, progress: ProgressCallback) -> Recording:
    if job.experiment != "balance":
        return record_bench(
            job.robot, job.scenario, job.experiment, duration=job.duration, seed=seed, progress=progress
        )
    sample_time = job.scenario.sensors.sample_time
    estimator = named_estimator(job.controller.estimator, job.robot, sample_time=sample_time)
    twin = Twin(job.robot, job.scenario, estimator=estimator)
    reference = as_reference(job.reference)
    return record_balance(
        twin, job.controller, reference, duration=job.duration, seed=seed, progress=progress
    )


def _inputs(job: RecordJob) -> list[Path]:
    return [Path(job.reference)] if is_reference_file(job.reference) else []
