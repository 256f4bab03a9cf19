"""The documents say what the code does: their examples run."""

import re
import subprocess
import sys
import tomllib

import pytest

from ballbot.cli.main import COMMANDS, main
from ballbot.log.mapping_file import read_mapping
from ballbot.robot import Robot
from tests.support.paths import ROOT


def fenced(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_mapping_in_the_documents_is_one(tmp_path):
    (example,) = fenced("docs/logs.md", "toml")
    path = tmp_path / "mapping.toml"
    path.write_text(example, encoding="utf-8")
    told, mapping = tomllib.loads(example), read_mapping(path)
    assert mapping.columns["t"].column == told["columns"]["t"]["from"]
    assert mapping.columns["t"].factor == 1e-3  # "ms"
    assert {"wheel1", "wheel2", "wheel3"} <= set(mapping.columns)


def test_the_readme_lists_every_command_and_preset():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for name in (command.name for command in COMMANDS):
        assert f"`ballbot {name}" in text
    for preset in Robot.presets():
        assert f"`{preset}`" in text


@pytest.mark.slow
def test_the_readmes_python_runs(tmp_path):
    pytest.importorskip("mujoco")
    (example,) = fenced("README.md", "python")
    for name, reference, seed in (("square", "square", "1"), ("figure_eight", "figure_eight", "2")):
        # 8 s each hold twice the windows that the example's twelve parameters take
        run = ["record", "nominal", "--reference", reference, "--seed", seed, "--duration", "8"]
        assert main([*run, "--out", str(tmp_path / "demo" / name)]) == 0
    subprocess.run([sys.executable, "-c", example], cwd=tmp_path, check=True, capture_output=True)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["01_model.py", "02_closed_loop.py"])
def test_examples_run(example):
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / example], check=True, capture_output=True, text=True
    )
    assert done.stdout.count("\n") >= 3
