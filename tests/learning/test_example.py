"""The example that learns with PyTorch, for a few updates."""

import importlib.util
import subprocess
import sys

import pytest

from ballbot.control.file import read_controller
from ballbot.learning.contract import Contract
from tests.support.paths import ROOT


@pytest.mark.slow
def test_example_with_pytorch_writes_a_controller(tmp_path):
    if importlib.util.find_spec("torch") is None:
        pytest.skip("PyTorch is not installed, and no extra of Ballbot's has it: pip install torch")
    short = [
        "--task",
        "Drive",
        "--updates",
        "2",
        "--num-envs",
        "20",
        "--num-steps",
        "80",
        "--minibatches",
        "2",
        "--out",
    ]
    script = [sys.executable, ROOT / "examples" / "08_ppo.py", *short, "--out", tmp_path / "learned"]
    lines = subprocess.check_output(script, text=True).splitlines()
    assert [line.startswith("update ") for line in lines] == [True, True, False]
    controller = read_controller(lines[-1], tmp_path / "learned" / "robot.toml")
    policy = controller.parts.policy
    assert policy is not None
    assert (policy.period, policy.first.shape) == (0.01, (64, 20))
    assert Contract.read(tmp_path / "learned" / "contract.json").robot == "alten"
