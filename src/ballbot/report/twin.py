"""The pages of the twin: a recorded run, and runs of several seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from ballbot.control.references import is_reference_file
from ballbot.file_formats import read_results
from ballbot.report.blocks import Report, Sheet, section
from ballbot.report.provenance import Provenance, provenance
from ballbot.report.run import over_time, run_sections, run_verdict
from ballbot.rounding import digits
from ballbot.twin.recording import Recording
from ballbot.workflows.record import RecordJob, RecordOutcome, settings

_HELD = {"driveline_sweep": "the wheels in the air", "upside_down": "upside down with the ball on its wheels"}
_NOT_A_ROBOT = (
    "How the real robot runs: the twin has the faults of its scenario, and a robot has others. Compare a log with "
    "`ballbot validate`."
)


def recording_report(job: RecordJob, seed: int, recording: Recording) -> Report:
    """Return the page of one recorded run."""
    log, robot = recording.with_truth(), job.robot
    undecided = [_NOT_A_ROBOT, "How much runs differ: this is one seed (--seeds records more)."]
    if job.experiment == "balance":
        reference = "reference.csv" if is_reference_file(job.reference) else job.reference
        compensation = job.controller.compensation
        lead = (
            f"The reference {reference}, {'without' if compensation == 'none' else compensation} compensation"
        )
        verdict, sections = run_verdict(log), run_sections(log, robot)
    else:
        lead = f"The robot held, {_HELD[job.experiment]}"
        verdict = [("", f"{float(log.t[-1] - log.t[0]):.1f} s were recorded.")]
        sections = [section("Over time", *over_time(log, robot))]
    return Report(
        title=f"{robot.name}: a run of the twin",
        lead=f"{lead}; scenario {job.scenario.name}, seed {seed}.",
        verdict=verdict,
        sections=[
            *sections,
            section("Files", Sheet(headings=("file", "what is in it"), rows=_files(job, recording))),
        ],
        undecided=undecided,
        # the command that stands in record.toml: it does not depend on the folder that the run was written into
        made=provenance(command=_command(job, seed), files=(), seed=seed),
    )


def _command(job: RecordJob, seed: int) -> str:
    text = settings(job, seed)["record.toml"]
    return next(
        line.partition('"')[2].rstrip('"') for line in text.splitlines() if line.startswith("command")
    )


def _files(job: RecordJob, recording: Recording) -> list[tuple[str, str]]:
    what = {
        "log": "the columns that a real robot logs",
        "truth": "the same rows with the true values",
        "motion_capture": "the ball's centre and the body's orientation by cameras, on a clock of their own",
    }
    return [
        *((f"{name}.{job.log_format}", what[name]) for name in recording.logs),
        ("record.toml", "how the run was made; its command, run in this folder, repeats it"),
    ]


#: in the results of each run: the largest distance from the reference, and its root mean square [m]
_DISTANCES = ("peak_position_error_whole_run", "rms_position_error_whole_run")


def seeds_report(job: RecordJob, outcomes: Sequence[RecordOutcome], made: Provenance) -> Report:
    """Return the page of runs of several seeds, each in a folder of its own."""
    found = [cast("dict[str, float]", read_results(one.folder / "results.json")) for one in outcomes]
    table = [
        (
            str(outcome.seed),
            outcome.folder.name,
            *(_millimetres(one.get(name)) for name in _DISTANCES),
            outcome.ended or "",
        )
        for outcome, one in zip(outcomes, found, strict=True)
    ]
    early = sum(outcome.ended is not None for outcome in outcomes)
    text = f"{len(outcomes)} runs of {job.duration:g} s; {early} ended early."
    peaks = [1e3 * one[_DISTANCES[0]] for one in found if _DISTANCES[0] in one]
    verdict = [("Runs", text)]
    if peaks:
        low, middle, high = np.quantile(peaks, [0.0, 0.5, 1.0])
        spread = f"{digits(float(low))} to {digits(float(high))} mm, median {digits(float(middle))} mm"
        verdict.append(("Largest distance", f"From the reference, over the whole run: {spread}."))
    caption = "The distance is that of the true position from the reference, over the whole run."
    headings = ("seed", "folder", "largest distance [mm]", "distance, RMS [mm]", "ended early")
    return Report(
        title=f"{job.robot.name}: {len(outcomes)} runs of the twin",
        lead=f"Scenario {job.scenario.name}, experiment {job.experiment}, reference {job.reference}.",
        verdict=verdict,
        sections=[section("Each run", Sheet(headings=headings, rows=table, caption=caption))],
        undecided=[_NOT_A_ROBOT],
        made=made,
    )


def _millimetres(metres: float | None) -> str:
    return "–" if metres is None else digits(1e3 * metres)
