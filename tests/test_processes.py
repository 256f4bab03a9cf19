"""Processes that work for another end when that one is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

#: starts two workers, shows their process numbers, and waits for work that takes a minute
WORK = """
import os, sys, time
from ballbot.fitting.run import uninterrupted, worker_pool
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
    parent = subprocess.Popen([sys.executable, "-c", WORK], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    workers = [int(pid) for pid in parent.stdout.readline().split()]
    assert len(workers) == 2
    assert all(map(alive, workers))
    os.kill(parent.pid, how)
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 10.0
    while any(map(alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(alive, workers))
