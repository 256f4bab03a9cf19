"""The pages of the twin: a recorded run, and runs of several seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from ballbot.control.references import is_reference_file
from ballbot.file_formats import read_results
from ballbot.report.blocks import Provenance, Result, Sheet, provenance, section
from ballbot.report.run import run_report
from ballbot.report.words import millimetres
from ballbot.twin.recording import Recording
from ballbot.workflows.record import RecordJob, RecordOutcome, settings

_HELD = {"driveline_sweep": "the wheels in the air", "upside_down": "upside down with the ball on its wheels"}
_NOT_A_ROBOT = (
    "How the real robot runs: the twin has the faults of its scenario, and a robot has others. Compare a log with "
    "`ballbot validate`."
)


def recording_report(job: RecordJob, seed: int, recording: Recording) -> Result:
    """Return the page of one recorded run."""
    held = job.experiment != "balance"
    if held:
        lead = f"The robot held, {_HELD[job.experiment]}"
    else:
        reference = "reference.csv" if is_reference_file(job.reference) else job.reference
        compensation = job.controller.compensation
        lead = (
            f"The reference {reference}, {'without' if compensation == 'none' else compensation} compensation"
        )
    log = recording.with_truth()
    made = run_report(
        log,
        job.robot,
        title=f"{job.robot.name}: a run of the twin",
        lead=f"{lead}; scenario {job.scenario.name}, seed {seed}.",
        undecided=[_NOT_A_ROBOT, "How much runs differ: this is one seed (--seeds records more)."],
        held=held,
        ending=f"{float(log.t[-1] - log.t[0]):.1f} s were recorded." if held else "",
    )
    # the command that stands in record.toml: it does not depend on the folder that the run was written into
    origin = provenance(command=_command(job, seed), files=(), seed=seed)
    return replace(made, made=origin)


def _command(job: RecordJob, seed: int) -> str:
    text = settings(job, seed)["record.toml"]
    return next(
        line.partition('"')[2].rstrip('"') for line in text.splitlines() if line.startswith("command")
    )


#: in the results of each run: the largest distance from the reference, and its root mean square [m]
_DISTANCES = ("peak_position_error_whole_run", "rms_position_error_whole_run")


def seeds_report(job: RecordJob, outcomes: Sequence[RecordOutcome], made: Provenance) -> Result:
    """Return the page of runs of several seeds, each in a folder of its own."""
    found = [cast("dict[str, float]", read_results(one.folder / "results.json")) for one in outcomes]
    early = sum(outcome.ended is not None for outcome in outcomes)
    verdict = [("Runs", f"{len(outcomes)} runs of {job.duration:g} s; {early} ended early.")]
    peaks = [one[_DISTANCES[0]] for one in found if _DISTANCES[0] in one]
    if peaks:
        low, middle, high = map(millimetres, np.quantile(peaks, [0.0, 0.5, 1.0]))
        text = f"From the reference, over the whole run: {low} to {high} mm, median {middle} mm."
        verdict.append(("Largest distance", text))
    rows = [
        (
            *(str(outcome.seed), outcome.folder.name),
            *(millimetres(one.get(name, np.nan)) for name in _DISTANCES),
            outcome.ended or "",
        )
        for outcome, one in zip(outcomes, found, strict=True)
    ]
    caption = "The distance is that of the true position from the reference, over the whole run."
    headings = ("seed", "folder", "largest distance [mm]", "distance, RMS [mm]", "ended early")
    return Result(
        title=f"{job.robot.name}: {len(outcomes)} runs of the twin",
        lead=f"Scenario {job.scenario.name}, experiment {job.experiment}, reference {job.reference}.",
        verdict=verdict,
        sections=[section("Each run", Sheet(headings=headings, rows=rows, caption=caption))],
        undecided=[_NOT_A_ROBOT],
        made=made,
    )
