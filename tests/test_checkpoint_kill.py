"""`ballbot identify` killed with SIGKILL on its way and resumed: the same bytes as undisturbed."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.workloads import measured_square, nominal_robot
from campaigns.resume import OUTPUTS, Identification, answers_on_file

#: fewer parameters are found sooner
OPTIONS = ("--bounds", "bounds.toml")
BOUNDS = """\
stribeck = [0.0, 0.0]
stribeck_speed = [0.6, 0.6]
stribeck_exponent = [1.0, 1.0]
rolling = [0.007, 0.007]
"""


def folder_with_log(folder: Path) -> Path:
    folder.mkdir()
    # once around in 5 s, so that the shortest log that gives six parameters turns every wheel
    measured_square(nominal_robot(), duration=5.0, period=5.0).write(folder / "log.csv")
    (folder / "bounds.toml").write_text(BOUNDS)
    return folder


def run(folder: Path, *, resume: bool) -> Identification:
    return Identification(folder=folder, resume=resume, options=OPTIONS)


@pytest.mark.slow
def test_killed_at_three_moments_it_ends_in_the_same_bytes(tmp_path):
    undisturbed = run(folder_with_log(tmp_path / "undisturbed"), resume=False).finish()
    killed = folder_with_log(tmp_path / "killed")
    random = np.random.default_rng()  # the moment within a step is left to chance
    generations = len(json.loads(undisturbed["results.json"])["cost"]["evolution"])
    # answers on file, the inputs' first: early in the evolution, late in it, and in the polish
    for number, moment in enumerate((3, generations // 2, generations + 4)):
        process = run(killed, resume=number > 0).start()
        while answers_on_file(killed) < moment and process.poll() is None:
            time.sleep(1e-3)
        time.sleep(random.uniform(0.0, 0.03))
        process.kill()
        process.communicate()
        assert answers_on_file(killed) >= moment
    assert run(killed, resume=True).finish() == undisturbed
    assert {path.name for path in (killed / "out").glob("[!.]*")} == set(OUTPUTS)
