"""Kill a sweep of 200 recordings with kill -9, start it again, and compare its files with those of one left alone.

.venv/bin/python -m campaigns.evidence killed_sweep
"""

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

import numpy as np

from campaigns.section import Section

KILLS, RUNS = 20, 200
#: until the first run is made, about [s]: imports, and processes that begin
START = 3.0


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """`ballbot record --seeds` in a folder, as a process of its own."""

    folder: Path

    def __post_init__(self) -> None:
        """Make the folder."""
        self.folder.mkdir()

    def start(self) -> subprocess.Popen[bytes]:
        """Start it; all sweeps have the same command line."""
        words = ["-m", "ballbot.cli.main", "record", "nominal", "--duration", "0.2", "--seeds", f"1-{RUNS}"]
        return subprocess.Popen(
            [sys.executable, *words, "--out", "runs"],
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def kill_after(self, seconds: float) -> int:
        """Start it, kill it after so long, and return how many finished runs there are."""
        process = self.start()
        sleep(seconds)
        process.kill()
        process.communicate()
        return len(list(self.folder.glob("runs/seed_*/.ballbot.json")))

    def finish(self) -> dict[str, bytes]:
        """Run it to its end and return the files of every run, by their paths."""
        process = self.start()
        _, errors = process.communicate()
        if process.returncode:
            raise RuntimeError(errors.decode())
        files = self.folder.glob("runs/seed_*/[!.]*")
        return {path.relative_to(self.folder).as_posix(): path.read_bytes() for path in files}


def campaign() -> Section:
    """Kill sweeps at random moments and return the section of docs/generated/evidence.md."""
    random = np.random.default_rng(5)
    with tempfile.TemporaryDirectory() as name:
        alone = Sweep(folder=Path(name) / "alone")
        begun = monotonic()
        undisturbed = alone.finish()
        lasted = monotonic() - begun
        # on average as long as the start and a twentieth of the work take
        longest = START + 2.0 * lasted / KILLS
        moments = random.uniform(0.0, longest, KILLS)
        killed = Sweep(folder=Path(name) / "killed")
        left = [killed.kill_after(float(seconds)) for seconds in moments]
        same = killed.finish() == undisturbed
    return Section(
        title="Sweeps killed and started again",
        before=f"`ballbot record --seeds 1-{RUNS}` of 0.2 s on the nominal twin, killed with SIGKILL {KILLS} times, "
        f"each time after a delay drawn uniformly from 0 to {longest:.0f} s, and started again with the same "
        f"words; its runs' files ({len(undisturbed)}) against those of a sweep left alone, which takes {lasted:.0f} s.",
        columns=["finished runs after each kill", "same bytes in the end"],
        rows=[[", ".join(map(str, left)), "yes" if same else "no"]],
    )
