"""Intervals for the estimate from another log, on a real robot: all pairs of three public logs.

.venv/bin/python -m campaigns.evidence course_robot      with BALLBOT_DATA=DIR

The logs are of the robots of the University of Michigan's course ROB 311 (https://github.com/michiganrobotics/rob311).
They carry no licence and are not part of Ballbot: put them into the folder rob311 of DIR. `ballbot check-log` proposes
a mapping for each, with the commands stated as duties, as the course's firmware sends them. Dead bands are filled in,
and for the third log the delay at which the lean fits the wheels best.
"""

import tempfile
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np

from ballbot.cli.context import read_balancing_log
from ballbot.cli.main import main as ballbot
from ballbot.files import write_text
from ballbot.fitting.run import Run, Threads
from ballbot.identification.identify import IdentificationOptions, identify
from ballbot.identification.result import Identification
from ballbot.identification.windows import back_emf_of
from ballbot.log import Log
from ballbot.robot import Robot
from campaigns.between_logs import COLUMNS, Judged, coverage_row
from campaigns.section import Section, public_file

SOURCE = "https://github.com/michiganrobotics/rob311"


@dataclass(frozen=True, kw_only=True)
class Source:
    """A public log."""

    sha256: str
    dead_band: float  #: duty that the firmware adds; see docs/real_robots.md
    #: [s]; left at zero, it puts the third log's viscous friction at the bound of the search
    lean_delay: float = 0.0


SOURCES = {
    "main_control_1": Source(
        sha256="b2f8fb77e120815d8ccf7c37d1b597c63741283973f5709244c3ec4423e90bec", dead_band=0.06
    ),
    "main_control_autotune_1": Source(
        sha256="f5d8abfac9a14df43f3b0e562f1d0b725eab47dab0bd87d70f8b77a37b3800f2", dead_band=0.06
    ),
    # the course's firmware adds 1024 of 32639
    "lab10_data_trial_408": Source(
        sha256="3d971b3a835faf3808785890b803e0a7a3baef621c8eb96d7d8d1012c7b74d03",
        dead_band=0.0314,
        lean_delay=0.0166,
    ),
}
_GROUPS = ("b", "c", "C_rr")


def log_file(name: str) -> Path:
    """Return the file of a log; DataMissingError if it is not there."""
    return public_file(f"rob311/{name}.txt", sha256=SOURCES[name].sha256, see="docs/real_robots.md")


def filled_in(mapping: str, source: Source) -> str:
    """Return a proposed mapping with what its firmware adds to a duty, and how late its lean is.

    Where the axes of the IMU are asked for, they are as proposed: one log of the course shows them by itself.
    """
    stated = mapping.replace("# dead_band = 0.0 ", f"dead_band = {source.dead_band:g} ")
    stated = "".join(line for line in stated.splitlines(keepends=True) if not line.startswith("complete = "))
    return stated.replace("[attitude]\n", f"[attitude]\ndelay = {source.lean_delay:g}\n")


def mapped(name: str, folder: Path) -> tuple[Log, float]:
    """Return a log by the mapping that `check-log` proposes, as docs/real_robots.md does, and its motors' back-EMF."""
    path, robot = log_file(name), Robot.load("rob311")
    out = folder / name
    ballbot(["check-log", str(path), "--robot", "rob311", "--command", "duty", "--out", str(out)])
    mapping = out / "mapping.toml"
    write_text(mapping, filled_in(mapping.read_text(encoding="utf-8"), SOURCES[name]))
    return read_balancing_log(path, mapping, robot), back_emf_of([mapping], robot)


def identified_in(name: str, folder: Path) -> Identification:
    """Map a log and identify it by itself."""
    log, back_emf = mapped(name, folder)
    return identify(
        Robot.load("rob311"),
        log,
        law="coulomb",
        seed=0,
        options=IdentificationOptions(excluded_states=("psi", "psi_dot"), back_emf=back_emf),
        run=Run(seed=0, executor=Threads(count=1)),
    )


def campaign() -> Section:
    """Compare all pairs of the logs and return the section of docs/generated/evidence.md."""
    for name in SOURCES:
        log_file(name)
    with tempfile.TemporaryDirectory() as folder:
        by_source = {name: identified_in(name, Path(folder)) for name in SOURCES}
    judged = {both: judge_pair(*(by_source[name] for name in both)) for both in permutations(by_source, 2)}
    hashes = ", ".join(f"{name} ({source.sha256[:12]})" for name, source in SOURCES.items())
    return Section(
        title="Intervals for the estimate from another log, on a real robot",
        before=f"Three logs of robots of a course ({SOURCE}; in brackets the first digits of the files' SHA-256: "
        f"{hashes}), each identified by itself (law coulomb, heading excluded). Two 95 % intervals from one log are "
        "compared with the estimate from another: the one that identification states, and that for another log. Of "
        "the robot and the floor nothing is known but the logs; the third log may be of "
        "another robot of the course. Where `check-log` asks, the "
        "commands are duties, full duty gives the torque limit, and the lean's delay is the one at which the wheels "
        "explain the lean best. Width: median, over the spread of the estimates from repeated logs.",
        columns=list(COLUMNS),
        rows=[
            *(coverage_row(f"{source} for {other}", judged[source, other]) for source, other in judged),
            coverage_row("all", [case for pair in judged.values() for case in pair]),
        ],
    )


def judge_pair(fit: Identification, other: Identification) -> list[Judged]:
    """Return how the intervals from one log compare with the estimates from another."""
    judged = []
    numbers = zip(fit.labels, fit.values.tolist(), other.values.tolist(), fit.bounds, strict=True)
    for label, value, others, bounds in numbers:
        kinds = (fit.intervals, fit.variation.predictions)
        if label.rstrip("123") in _GROUPS and label in fit.intervals:
            ends = np.clip([(kind[label].lower, kind[label].upper) for kind in kinds], *bounds)
            judged.append(Judged(label=label, first=value, second=others, ends=ends))
    return judged
