"""Static analysis of the whole firmware; skipped without the tools. Under sanitizers: test_fuzz and test_tuning."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from ballbot.firmware.build import weights_folder
from ballbot.firmware.export import PROJECT
from ballbot.firmware.header import SOURCES
from ballbot.link.emulated import HARDWARE
from tests.support.compiled_firmware import weights_of
from tests.support.control_examples import everything, four_wheeled, with_policy

pytestmark = pytest.mark.board

PAGE = (PROJECT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> list[Path]:
    """Return the folder of the weights of a policy, to be included first."""
    learned = with_policy(everything(four_wheeled(friction=True)), feedback=0.6)
    return weights_folder(tmp_path_factory.mktemp("weights"), weights_of(learned))


def analysed(weights: list[Path], *options: str, more: tuple[Path, ...] = ()) -> str:
    """Return what cppcheck prints about the library, with a policy's weights, and about more sources."""
    if not shutil.which("cppcheck"):
        pytest.skip("cppcheck is missing")
    folders = [f"-I{folder}" for folder in (*weights, SOURCES, PROJECT, HARDWARE)]
    command = ["cppcheck", "--std=c99", "--quiet", *folders, *options, *map(str, (SOURCES, *more))]
    return subprocess.run(command, capture_output=True, text=True, check=True).stderr


def test_cppcheck_finds_nothing(weights):
    more = (PROJECT / "robot.c", HARDWARE)
    found = analysed(weights, "--enable=warning,performance,portability", more=more)
    assert re.findall(r"^\S+:\d+:\d+: (?:error|warning|performance|portability).*", found, flags=re.M) == []


def test_rules_of_misra_that_are_not_kept_are_those_of_the_document(weights):
    found = set(re.findall(r"misra-c2012-([\d.]+)", analysed(weights, "--addon=misra")))
    if not found:
        pytest.skip("cppcheck has no MISRA addon")
    listed = set(re.findall(r"^\| (\d+\.\d+) \|", PAGE, flags=re.M))
    assert found <= listed  # versions of cppcheck differ in what they see
