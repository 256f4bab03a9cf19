"""How many correct logs the checks stop: 300 logs of the twin, over all presets, each checked with its preset.

.venv/bin/python -m campaigns.evidence false_alarms

Recorded logs are kept in build/false_alarms, each as soon as it is there, and are not recorded again: a campaign
that was ended goes on, and another version of the checks takes minutes. Delete the folder after a change of
`campaigns.correct_logs`.
"""

from __future__ import annotations

import os
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.checks import check_logs
from ballbot.processes import worker_pool
from ballbot.robot import Robot
from campaigns.correct_logs import PRESETS, Draw, drawn, record
from campaigns.section import Section

KEPT = Path(__file__).parents[1] / "build" / "false_alarms"
LOGS = 300
#: stopped logs of `LOGS` that are still a pass
MOST_STOPPED = 3


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the checks make of one correct log."""

    seed: int
    preset: str
    reference: str
    duration: float  #: [s], of the log
    findings: tuple[Finding, ...]  #: notes left out

    @property
    def errors(self) -> tuple[str, ...]:
        """Codes of the findings that would stop a command."""
        return tuple(finding.code for finding in self.findings if finding.severity == "error")


def outcome(seed: int, *, kept: Path | None = None) -> Outcome:
    """Record the log of a seed, or read it if it is kept, and check it with its nominal preset, as a user would."""
    draw = drawn(seed)
    path = None if kept is None else kept / f"{seed:04d}.parquet"
    if path is not None and path.exists():
        log = Log.read(path)
    else:
        log = record(draw)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            log.write(path)
    return checked(draw, log)


def checked(draw: Draw, log: Log) -> Outcome:
    """Return what the checks make of a draw's log."""
    found = check_logs({"log": log}, robot=Robot.load(draw.preset))
    return Outcome(
        seed=draw.seed,
        preset=draw.preset,
        reference=draw.reference,
        duration=float(log.t[-1]),
        findings=tuple(finding for finding in found if finding.severity != "note"),
    )


def outcomes(seeds: Sequence[int], *, kept: Path | None = None, processes: int = 1) -> Iterator[Outcome]:
    """Yield the outcomes of seeds as they come."""
    if processes == 1:
        yield from (outcome(seed, kept=kept) for seed in seeds)
        return
    with worker_pool(processes) as pool:
        runs = [pool.submit(outcome, seed, kept=kept) for seed in seeds]
        yield from (run.result() for run in as_completed(runs))


def campaign() -> Section:
    """Check all logs and return the section of docs/generated/evidence.md."""
    return section(sorted(_followed(range(LOGS)), key=lambda one: one.seed))


def section(found: Sequence[Outcome]) -> Section:
    """Return the section of docs/generated/evidence.md that outcomes make."""
    stopped = [one for one in found if one.errors]
    named = "; ".join(
        f"seed {one.seed} ({one.preset}, {one.reference}): {', '.join(one.errors)}" for one in stopped
    )
    return Section(
        title="Correct logs that the checks stop",
        before=f"{len(found)} logs of the twin over all presets, {min(o.duration for o in found):.0f} to"
        f" {max(o.duration for o in found):.0f} s, with the references, noise, drift, play, delay, friction and"
        " imprecise robots that `campaigns/correct_logs.py` draws; `check_logs` with the nominal preset. An error"
        f" stops a command; at most {MOST_STOPPED} of {LOGS} may.",
        columns=["preset", "logs", "stopped by an error", "with a warning", "codes of warnings"],
        rows=[*(_row(one, [o for o in found if o.preset == one]) for one in PRESETS), _row("all", found)],
        after=f"Stopped: {named or 'none'}.",
    )


def _row(name: str, found: Sequence[Outcome]) -> list[str]:
    logs_of = defaultdict(set)
    for one in found:
        for finding in one.findings:
            if finding.severity == "warning":
                logs_of[finding.code].add(one.seed)
    warned = set[int]().union(*logs_of.values())
    codes = Counter({code: len(seeds) for code, seeds in logs_of.items()}).most_common()
    return [
        name,
        f"{len(found)}",
        f"{sum(bool(one.errors) for one in found)}",
        f"{len(warned)}",
        ", ".join(f"{code} {count}" for code, count in codes) or "none",
    ]


def _followed(seeds: Sequence[int]) -> Iterator[Outcome]:
    """Yield the outcomes of seeds; every tenth is told on standard error."""
    stopped = 0
    for done, one in enumerate(outcomes(seeds, kept=KEPT, processes=os.cpu_count() or 1), start=1):
        stopped += bool(one.errors)
        if done % 10 == 0 or one.errors:
            codes = f"; seed {one.seed} ({one.preset}): {', '.join(one.errors)}" if one.errors else ""
            print(
                f"{done} of {len(seeds)} logs checked, {stopped} stopped{codes}", file=sys.stderr, flush=True
            )
        yield one
