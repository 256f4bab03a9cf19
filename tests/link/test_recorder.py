"""A recording keeps every row that is older than 100 ms, whatever ends it."""

import errno
import os
from threading import Event

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.link.recorder import Recorder
from ballbot.log import Log
from tests.support.processes import PATIENCE, Child

COLUMNS = ("t", "u1", "theta")

#: records a row every 2 ms; prints its time once the recorder has it, and the slowest write so far
WRITER = """
import os, sys, time
from pathlib import Path
from ballbot.link.recorder import Recorder

slowest, sync = 0.0, os.fsync

def timed(descriptor):
    global slowest
    begin = time.monotonic()
    sync(descriptor)
    slowest = max(slowest, time.monotonic() - begin)

os.fsync = timed
recorder = Recorder(Path(sys.argv[1]), ("t", "u1", "theta"))
start = time.monotonic()
while True:
    t = time.monotonic() - start
    recorder.append([t, t / 3.0, float("nan")])
    print(repr(t), repr(slowest), flush=True)
    time.sleep(0.002)
"""


def record(path, rows):
    with Recorder(path, COLUMNS) as recorder:
        for row in rows:
            recorder.append(row)
    return recorder


@pytest.mark.slow
def test_killed_process_loses_at_most_100_ms(tmp_path):
    path = tmp_path / "log.recording.csv"
    with Child("-c", WRITER, str(path)) as writer:
        lines = [writer.line() for _ in range(150)]
        writer.kill()
        lines += writer.lines_left()
    t, slowest = np.array([[float(word) for word in line.split()] for line in lines]).T
    kept = Log.read(path)
    # the rows that are there are the first ones, whole and in order; the last one may not have been printed any more
    assert 0 <= len(kept) - 1 <= len(t)
    assert kept.t.tolist()[: len(t)] == t[: len(kept)].tolist()
    np.testing.assert_array_equal(kept["u1"], kept.t / 3.0)
    if np.diff(t).max() < 0.02 and slowest[-1] < 0.04:  # neither the computer nor its disk was late
        assert t[-1] - kept.t[-1] <= 0.1


@settings(max_examples=40)
@given(cut=st.integers(min_value=0), zeros=st.booleans())
def test_cut_recording_keeps_its_whole_rows(tmp_path_factory, cut, zeros):
    path = tmp_path_factory.mktemp("cut") / "new" / "log.recording.csv"
    rows = [[0.1 * k, 1.0 / (k + 1), float(k) if k % 2 else np.nan] for k in range(20)]
    record(path, rows)
    content = path.read_bytes()
    start = content.index(b"\n") + 1
    start = content.index(b"\n", start) + 1  # a log has a row
    cut = start + cut % (len(content) - start + 1)
    # a block that was never written reads as zeros
    path.write_bytes(content[:cut] + (bytes(40) if zeros else b""))
    # a row is whole where its last cell, the 1, begins
    whole = 1 + content[start:cut].count(b"\n") + (content[:cut].rpartition(b"\n")[2].count(b",") == 3)
    read = Log.read(path)
    assert len(read) in {whole, whole - zeros}  # zeros may spoil the last cell
    np.testing.assert_array_equal(np.column_stack([read[name] for name in COLUMNS]), rows[: len(read)])


def test_full_disk_is_reported_and_does_not_stop_the_loop(tmp_path, monkeypatch):
    written = os.write
    with Recorder(tmp_path / "log.recording.csv", COLUMNS) as recorder:

        def full(descriptor, data):
            if descriptor == recorder._descriptor:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return written(descriptor, data)

        monkeypatch.setattr(os, "write", full)
        for k in range(100):
            recorder.append([float(k), 0.123456789, 0.0])
    assert recorder.failure is not None
    assert "No space left" in recorder.failure


def test_slow_disk_is_never_waited_for(tmp_path, monkeypatch):
    begun, answers = Event(), Event()

    def sync(descriptor):  # noqa: ARG001
        begun.set()
        assert answers.wait(PATIENCE)

    with Recorder(tmp_path / "log.recording.csv", COLUMNS) as recorder:
        monkeypatch.setattr(os, "fsync", sync)
        recorder.append([0.0, 0.0, 0.0])
        assert begun.wait(PATIENCE)  # the row is being written
        for k in range(1, 100):
            recorder.append([float(k), 0.0, 0.0])  # or this would wait for ever
        answers.set()
    assert len(Log.read(recorder.path)) == 100
