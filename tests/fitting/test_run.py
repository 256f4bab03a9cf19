"""The time left, by the pace of a stage and a clock that the test moves; and processes that end with their parent."""

import signal
import sys
import time
from pathlib import Path

import pytest

from ballbot.progress import Pace, Progress, as_clock
from tests.support.processes import PATIENCE, Child


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_time_left_is_that_of_the_rest_of_the_stage_at_its_pace():
    clock = Clock()
    pace = Pace(clock)
    left = []
    for done, now in ((1, 190.0), (2, 195.0), (4, 205.0)):  # the first step, 90 s, compiles
        clock.now = now
        pace.note(Progress(stage="descent", done=done, total=10))
        left.append(pace.left())
    assert left == ["", "about 0:40 left", "about 0:30 left"]
    clock.now = 220.0  # no step for as long as the last three took
    assert pace.left() == "about 1:00 left"
    pace.note(Progress(stage="descent", done=10, total=10))
    assert pace.left() == ""


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0:00"), (59.6, "1:00"), (61.0, "1:01"), (3600.0, "1:00:00"), (36061, "10:01:01")],
)
def test_clock(seconds, text):
    assert as_clock(seconds) == text


#: starts two workers, shows their process numbers, and waits for work that takes a minute
WORK = """
import os, sys, time
from ballbot.processes import (uninterrupted, worker_pool)
pool = worker_pool(2)
with uninterrupted():
    pids = [pool.submit(os.getpid).result()]
    waiting = [pool.submit(time.sleep, 60.0) for _ in range(2)]
while len(pids) < 2:
    pids = list(pool._processes)
print(*pids, flush=True)
waiting[0].result()
"""


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"  # ended, and nobody has asked how


@pytest.mark.skipif(sys.platform != "linux", reason="looks processes up in /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_when_their_parent_is_killed(how):
    with Child("-c", WORK) as parent:
        workers = [int(pid) for pid in parent.line().split()]
        assert len(workers) == 2
        assert all(map(alive, workers))
        parent.send(how)
        parent.end()
    deadline = time.monotonic() + PATIENCE
    while any(map(alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(alive, workers))
