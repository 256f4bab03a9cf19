"""A recording keeps every row that is older than 100 ms, whatever ends it."""

import errno
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.link.recorder import Recorder, read_recording

COLUMNS = ("t", "u1", "theta")

#: records a row every 2 ms and prints its time once the recorder has it
WRITER = """
import sys, time
from pathlib import Path
from ballbot.link.recorder import Recorder

recorder = Recorder(Path(sys.argv[1]), ("t", "u1", "theta"), about={"robot": "alten"})
print("ready", flush=True)
start = time.monotonic()
while True:
    t = time.monotonic() - start
    recorder.append([t, t / 3.0, float("nan")])
    sys.stdout.write(f"{t!r}\\n")
    sys.stdout.flush()
    time.sleep(0.002)
"""


def record(path, rows):
    with Recorder(path, COLUMNS, about={"robot": "alten", "wheels": 3}) as recorder:
        for row in rows:
            recorder.append(row)
    return recorder


def test_every_row_reads_back_to_the_same_bits(tmp_path):
    rows = [[0.005 * k, np.sqrt(k), np.nan if k % 3 else -1e-300] for k in range(1000)]
    recorder = record(tmp_path / "new" / "log.recording", rows)
    read = read_recording(recorder.path)
    found = np.column_stack([read.log[name] for name in COLUMNS])
    np.testing.assert_array_equal(found, np.array(rows))
    assert read.about == {"robot": "alten", "wheels": 3}
    assert read.damaged_bytes == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_killed_process_loses_at_most_100_ms(tmp_path, seed):
    path = tmp_path / "log.recording"
    child = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True, bufsize=1
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "ready\n"
    time.sleep(np.random.default_rng(seed).uniform(0.15, 0.6))
    os.kill(child.pid, signal.SIGKILL)
    given_rows = [float(line) for line in child.stdout.read().split("\n")[:-1]]
    child.wait()
    kept = read_recording(path).log
    # the rows that are there are the first ones, whole and in order
    assert kept.t.tolist() == given_rows[: len(kept)]
    np.testing.assert_array_equal(kept["u1"], kept.t / 3.0)
    assert given_rows[-1] - kept.t[-1] <= 0.1


@given(cut=st.integers(min_value=0), zeros=st.booleans())
def test_cut_recording_keeps_its_whole_rows(tmp_path_factory, cut, zeros):
    path = tmp_path_factory.mktemp("cut") / "log.recording"
    rows = [[0.1 * k, 1.0 / (k + 1), float(k)] for k in range(20)]
    record(path, rows)
    content = path.read_bytes()
    start = content.index(b"\n") + 1
    cut = start + cut % (len(content) - start + 1)
    # a block that was never written reads as zeros, and the rows after it do not count
    path.write_bytes(content[:cut] + (bytes(40) + content[cut:] if zeros else b""))
    whole = content[start:cut].count(b"\n")
    if not whole:
        with pytest.raises(InputError, match="without a whole row"):
            read_recording(path)
        return
    read = read_recording(path)
    np.testing.assert_array_equal(np.column_stack([read.log[name] for name in COLUMNS]), rows[:whole])
    assert (read.damaged_bytes > 0) == (zeros or content[cut - 1 : cut] != b"\n")


def test_recording_that_was_cut_off_is_never_overwritten(tmp_path):
    path = tmp_path / "log.recording"
    record(path, [[0.0, 1.0, 2.0]])
    before = path.read_bytes()
    with pytest.raises(InputError, match="ballbot run recover"):
        Recorder(path, COLUMNS, about={})
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"t,u1\n0,1\n", b'{"format": "other"}\n', b"[" * 100_000])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "log.recording"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a recording"):
        read_recording(path)


def test_full_disk_is_reported_and_does_not_stop_the_loop(tmp_path, monkeypatch):
    written = os.write

    def full(descriptor, data):
        if len(data) > 200:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return written(descriptor, data)

    with Recorder(tmp_path / "log.recording", COLUMNS, about={}, interval=0.01) as recorder:
        monkeypatch.setattr(os, "write", full)
        for k in range(100):
            recorder.append([float(k), 0.123456789, 0.0])
    assert recorder.failure is not None
    assert "No space left" in recorder.failure


def test_slow_disk_is_measured_and_never_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda _: time.sleep(0.1))
    with Recorder(tmp_path / "log.recording", COLUMNS, about={}, interval=0.01) as recorder:
        took = []
        for k in range(100):
            begin = time.monotonic()
            recorder.append([float(k), 0.0, 0.0])
            took.append(time.monotonic() - begin)
            time.sleep(0.002)
    assert recorder.longest_unsaved >= 0.1
    assert np.quantile(took, 0.9) < 0.001  # not all of them: the machine may be busy with something else
