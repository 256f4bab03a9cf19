"""A sweep that is stopped, at any moment and however, goes on where it was, and ends in the same bytes."""

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError
from ballbot.files import write_bytes
from ballbot.fitting.run import Processes
from ballbot.fitting.sweep import HEADER, RunFolder
from tests.support.processes import Child

RUNS = {f"{number:02d}": number for number in range(8)}


def run_folder(path: Path, *, made_from: str = "a") -> RunFolder[bytes, bytes]:
    """Return a folder whose runs are bytes."""
    return RunFolder(
        path=path,
        made_from={"input": made_from, "seed": "0"},
        write=write_bytes,
        read=lambda file: file.read_bytes() if file.exists() else None,
    )


def drawn(number: int) -> bytes:
    """Return bytes that only the number decides, after a moment."""
    time.sleep(0.02)
    return np.random.default_rng(number).bytes(100_000)


def count(made: list[int], number: int) -> bytes:
    made.append(number)
    return bytes([number])


def fail(failing: type[BaseException], at: int, number: int) -> bytes:
    if number == at:
        raise failing("no good")
    return bytes([number])


def complete(folder: RunFolder[bytes, bytes], make: Callable[[int], bytes]) -> None:
    """Make the runs in this process, and check that all are there."""
    assert list(folder.complete(make, RUNS, workers=Processes(count=1), stage="running")) == list(RUNS)


def test_finished_runs_are_not_made_again(tmp_path):
    folder, made = run_folder(tmp_path / "runs"), list[int]()
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        complete(folder, partial(fail, KeyboardInterrupt, 5))
    complete(folder, partial(count, made))
    assert made == list(range(5, 8))


def test_runs_made_from_something_else_are_refused(tmp_path):
    complete(run_folder(tmp_path), bytes)
    with pytest.raises(InputError, match="holds finished runs that differ from these in: input;"):
        complete(run_folder(tmp_path, made_from="b"), bytes)
    (tmp_path / HEADER).write_text("{}")
    with pytest.raises(InputError, match="is damaged"):
        complete(run_folder(tmp_path), bytes)
    (tmp_path / HEADER).unlink()
    with pytest.raises(InputError, match="00 was not written by this command"):
        complete(run_folder(tmp_path), bytes)


def test_a_refused_run_leaves_the_finished_ones(tmp_path):
    folder = run_folder(tmp_path / "runs")
    with pytest.raises(InputError, match="no good"):
        complete(folder, partial(fail, InputError, 3))
    assert (tmp_path / "runs" / "02").exists()
    # where none was finished, nothing hinders other runs
    with pytest.raises(InputError, match="no good"):
        complete(run_folder(tmp_path / "none"), partial(fail, InputError, 0))
    complete(run_folder(tmp_path / "none", made_from="b"), bytes)


SWEEP = """
import sys
from pathlib import Path
from ballbot.fitting.run import Processes
from tests.fitting.test_sweep import RUNS, drawn, run_folder
folder = run_folder(Path(sys.argv[1]))
if __name__ == "__main__":
    folder.complete(drawn, RUNS, workers=Processes(count=2), stage="", progress=lambda one: print(one.done, flush=True))
"""


@pytest.mark.slow
def test_sweep_killed_again_and_again_ends_in_the_same_bytes(tmp_path):
    script, random = tmp_path / "sweep.py", np.random.default_rng()  # the instant is left to chance
    script.write_text(SWEEP)
    there = 0.0
    while there < len(RUNS):
        with Child(str(script), str(tmp_path / "runs")) as child:
            for _ in range(4):  # what is there, and the next runs
                there = float(child.line())
                if there == len(RUNS):
                    break
            time.sleep(random.uniform(0.0, 0.03))
            child.kill()
        names = {path.name for path in (tmp_path / "runs").glob("[!.]*")}
        for name in names:
            assert (tmp_path / "runs" / name).read_bytes() == drawn(RUNS[name])
    assert names == set(RUNS)
    assert json.loads((tmp_path / "runs" / HEADER).read_text())["made_from"]["input"] == "a"
