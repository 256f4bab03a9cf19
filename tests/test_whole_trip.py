"""The example of the whole trip, made short: from a log over the firmware to a study again."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot import Log
from ballbot.firmware.build import compilers

pytest.importorskip("mujoco", reason="MuJoCo, of the extra `twin`, is not installed")

ROOT = Path(__file__).parents[1]
#: 16 s of a robot that hardly moves determine the dry friction alone
BOUNDS = """viscous = [0.015, 0.015]
stribeck = [0.0, 0.0]
stribeck_speed = [0.6, 0.6]
stribeck_exponent = [1.0, 1.0]
rolling = [0.007, 0.007]
"""


@pytest.mark.sample
@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
def test_whole_trip(tmp_path):
    script = [sys.executable, ROOT / "examples" / "06_whole_trip.py", "--out", tmp_path / "trip"]
    (tmp_path / "bounds.toml").write_text(BOUNDS)
    study = f"--no-confirm --bounds {tmp_path}/bounds.toml"  # with few robots to try controllers on
    options = ["--duration", "16", "--draws", "6", "--study-options", study]
    done = subprocess.run([*script, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "The run of 16 s is over." in done.stdout
    stages = re.findall(r"^\$ ballbot (\w+)", done.stdout, flags=re.MULTILINE)
    assert stages == ["record", "study", "export", "run", "study"]
    log = Log.read(tmp_path / "trip" / "after" / "log.csv")
    assert len(log) == 3200
    # the robot follows the square: the chosen controller is within a few centimetres after it has settled
    assert abs(log["x"] - log["ref_x"])[-200:].max() < 0.1
    for name in ("study", "study_again"):
        results = json.loads((tmp_path / "trip" / name / "results.json").read_text())
        assert results["provenance"]["files"], name
    assert (tmp_path / "trip" / "study_again" / "controller.toml").is_file()
