"""The documents say what the code does: their examples run."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot.cli.main import COMMANDS
from ballbot.log.mapping_file import read_mapping
from ballbot.robot import Robot

ROOT = Path(__file__).parents[1]


def fenced(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_mapping_in_the_documents_is_one(tmp_path):
    (example,) = fenced("docs/logs.md", "toml")
    path = tmp_path / "mapping.toml"
    path.write_text(example, encoding="utf-8")
    read_mapping(path)


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
        run = ["record", "nominal", "--reference", reference, "--seed", seed, "--duration", "15"]
        command = [sys.executable, "-m", "ballbot.cli.main", *run, "--out", f"demo/{name}"]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    subprocess.run([sys.executable, "-c", example], cwd=tmp_path, check=True, capture_output=True)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["01_model.py", "02_closed_loop.py"])
def test_examples_run(example):
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / example], check=True, capture_output=True, text=True
    )
    assert done.stdout.count("\n") >= 3
