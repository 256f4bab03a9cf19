"""Kill an identification with kill -9, resume it, and compare its files with those of one that was not killed.

.venv/bin/python -m campaigns.evidence resume
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

import numpy as np

from benchmarks.workloads import measured_square, nominal_robot
from campaigns.section import Section

KILLS = 20
OUTPUTS = ("report.html", "results.json", "robot.toml")
CHECKPOINT = "checkpoint.jsonl"


@dataclass(frozen=True, kw_only=True)
class Identification:
    """One run of `ballbot identify` on the log in a folder, as a process of its own."""

    folder: Path
    resume: bool
    options: tuple[str, ...] = ()

    def start(self) -> subprocess.Popen[bytes]:
        """Start it; all runs have the same command line but for --resume."""
        words = ["-m", "ballbot.cli.main", "identify", "alten", "log.csv", "--out", "out", *self.options]
        words += ["--resume"] if self.resume else []
        return subprocess.Popen(
            [sys.executable, *words],
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def finish(self) -> dict[str, bytes]:
        """Run it to its end and return what it has written."""
        process = self.start()
        _, errors = process.communicate()
        if process.returncode:
            raise RuntimeError(errors.decode())
        return {name: (self.folder / "out" / name).read_bytes() for name in OUTPUTS}

    def kill_after(self, seconds: float) -> int | None:
        """Start it, kill it after so long, and return how many answers it left on file; None if it had ended."""
        process = self.start()
        sleep(seconds)
        ended = process.poll() is not None
        process.kill()
        process.communicate()
        return None if ended else answers_on_file(self.folder)


def answers_on_file(folder: Path) -> int:
    """Return how many answers the checkpoint has."""
    path = folder / "out" / CHECKPOINT
    return max(0, path.read_bytes().count(b"\n") - 1) if path.exists() else 0


def write_log(folder: Path, *, duration: float = 16.0) -> None:
    """Write a balancing robot's log with noise into the folder."""
    measured_square(nominal_robot(), duration=duration, period=16.0).write(folder / "log.csv")


def campaign() -> Section:
    """Kill runs at random moments and return the section of docs/generated/evidence.md."""
    random = np.random.default_rng(5)
    with tempfile.TemporaryDirectory() as name:
        # every run in a folder `robot` of its own: a page names a log.csv by its folder
        undisturbed, lasted = _undisturbed(Path(name) / "undisturbed" / "robot")
        each = [
            _killed(Path(name) / f"once{number}" / "robot", [seconds], undisturbed)
            for number, seconds in enumerate(random.uniform(0.0, lasted, KILLS))
        ]
        # long enough for some of them to get further than the one before
        many = _killed(Path(name) / "many" / "robot", random.uniform(0.3, 0.5, KILLS) * lasted, undisturbed)
    left = [count for one in each for count in one.left if count is not None]
    whole = sum(count is None for one in each for count in one.left)
    return Section(
        title="Killed and resumed",
        before="`ballbot identify` on a simulated log of 16 s, killed with SIGKILL at moments drawn uniformly from"
        f" the {lasted:.0f} s that it takes, and resumed with `--resume`; its results.json and robot.toml against"
        " those of a run that was not killed.",
        columns=["", "kills", "same bytes in the end", "answers on file when killed"],
        rows=[
            [
                f"{KILLS} runs killed once each",
                f"{len(left)}" + (f" ({whole} had ended)" if whole else ""),
                f"{sum(one.same for one in each)} of {len(each)}",
                f"{min(left)} to {max(left)}",
            ],
            [
                "one run killed again and again",
                f"{sum(count is not None for count in many.left)}",
                "yes" if many.same else "no",
                ", ".join(str(count) for count in many.left if count is not None),
            ],
        ],
    )


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a run that was killed."""

    left: tuple[int | None, ...]  #: answers on file after each kill; None where it had ended before
    same: bool  #: whether its results are those of the undisturbed run


def _undisturbed(folder: Path) -> tuple[dict[str, bytes], float]:
    folder.mkdir(parents=True)
    write_log(folder)
    Identification(folder=folder, resume=False).finish()  # compiles
    started = monotonic()
    return Identification(folder=folder, resume=False).finish(), monotonic() - started


def _killed(folder: Path, moments: np.ndarray | list[float], undisturbed: dict[str, bytes]) -> Outcome:
    folder.mkdir(parents=True)
    write_log(folder)
    left = tuple(
        Identification(folder=folder, resume=number > 0).kill_after(float(seconds))
        for number, seconds in enumerate(moments)
    )
    return Outcome(left=left, same=Identification(folder=folder, resume=True).finish() == undisturbed)


if __name__ == "__main__":
    print(campaign().markdown())
