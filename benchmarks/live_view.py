"""The frames of live views, and what they take of a core: writes docs/generated/live_view.md.

    python -m benchmarks.live_view

`ballbot view` runs as a person runs it; a web socket of this process stands for the page and counts frames. What a
browser takes to draw them is not counted. Linux only: the process's time is that of /proc.
"""

import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from ballbot.files import write_text
from ballbot.viewer.live import WORLD_NAMES, robot_names
from benchmarks.run import processor

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "live_view.md"
#: time that is measured [s]
SECONDS = 20.0
CASES = {
    "exact model": (1, ("alten",)),
    "exact model, four controllers": (
        4,
        (
            "alten",
            "--controller",
            "none",
            "--controller",
            "full",
            "--controller",
            "partial",
            "--controller",
            "precise",
        ),
    ),
    "twin": (1, ("alten", "--plant", "twin")),
    "twin, two controllers": (
        2,
        ("alten", "--plant", "twin", "--controller", "none", "--controller", "precise"),
    ),
}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was found in `SECONDS`."""

    frames: float  #: that reached the page [1/s]
    pace: float  #: simulated over real time
    taken: float  #: share of a core


def processor_time(process: int) -> float:
    """Return the time [s] that a process has taken of a core."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def counted(page: ClientConnection, server: int, robots: int) -> Measured:
    """Return what is found at a page whose simulation runs."""
    size = len(WORLD_NAMES) + robots * len(robot_names(3))
    before, begun, rows = processor_time(server), time.monotonic(), []
    while time.monotonic() < begun + SECONDS:
        data = page.recv()
        if isinstance(data, bytes):
            rows.append(np.frombuffer(data, dtype="<f4").reshape(-1, size))
    taken, seconds, table = processor_time(server) - before, time.monotonic() - begun, np.concatenate(rows)
    pace = float(table[-1, 0] - table[0, 0]) / seconds
    return Measured(frames=len(table) / seconds, pace=pace, taken=taken / seconds)


def measured(robots: int, words: tuple[str, ...]) -> Measured:
    """Return what a view of these words takes once it runs."""
    command = [sys.executable, "-m", "ballbot", "view", *words, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            match = re.search(r"(http://\S+?)/\?(\S+)", process.stdout.readline() if process.stdout else "")
            if match is None:
                raise RuntimeError("ballbot view gave no address")
            address = f"{match[1].replace('http', 'ws')}/live?{match[2]}"
            with connect(address, origin=Origin(match[1])) as page:
                return counted(page, process.pid, robots)
        finally:
            process.terminate()


def main() -> None:
    """Measure and write the page."""
    rows = []
    for name, (robots, words) in CASES.items():
        case = measured(robots, words)
        shown = (f"{case.frames:.1f}", f"{case.pace:.3f}", f"{case.taken:.1%}")
        rows.append(f"| {name} | {' | '.join(shown)} |")
        print(rows[-1], flush=True)
    table = "\n".join(rows)
    text = f"""# Live views

`python -m benchmarks.live_view` writes this page: {SECONDS:.0f} s of each view after its start, with a web socket in
place of the browser. {processor()}, {os.cpu_count()} cores, load average {os.getloadavg()[1]:.0f}.
The target is 50 frames a second.

| live view of | frames a second | simulated over real time | of a core |
|---|---:|---:|---:|
{table}
"""
    write_text(PAGE, text)


if __name__ == "__main__":
    main()
