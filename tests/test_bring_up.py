"""The documents that bring up a robot against the emulated one.

The commands of bring_up.md run here, those of the tutorial when the site is built.
"""

import pytest

from ballbot.cli.main import main
from ballbot.file_formats import read_results
from ballbot.firmware.build import compilers
from ballbot.log import Log
from ballbot.robot import Robot
from tests.support.paths import ROOT
from tests.test_documents import commands_of

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

#: options that make the long commands and the runs for them shorter; the page's own options stay
_SHORTER = {
    ("run", "sweep"): ["--duration", "62.83"],
    ("run", "upside-down"): ["--duration", "30"],
    ("identify-upside-down", "alten"): ["--window", "0.5"],
    ("study", "alten"): ["--no-confirm", "--draws", "6"],
}


@pytest.mark.sample
def test_every_command_of_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for words in commands_of(ROOT / "docs" / "bring_up.md"):
        assert main([*words, *_SHORTER.get(tuple(words[:2]), [])]) == 0, (words, capsys.readouterr().err)
    # the emulated robot has the friction of the twin's nominal scenario
    found = Robot.load("driveline/robot.toml").friction
    assert found.coulomb == pytest.approx((0.11, 0.09, 0.12), rel=0.05)
    assert found.viscous == pytest.approx((0.014, 0.016, 0.013), rel=0.05)
    assert len(Log.read("square/log.csv")) == 40 / 0.005
    compared = read_results("compared/results.json")
    assert [one["recommendation"] for one in (compared, *compared["verdicts"])] == 3 * ["keep"]
    # without compensation the robot wanders by tenths of a metre, with the precise gain by millimetres
    # of both, and of three runs each the mean error is known well, the peak to a factor of ten
    gain = compared["gains"]["rms_error"]
    assert gain["low"] < gain["factor"] < gain["high"] < 0.05
    assert compared["gains"]["peak_error"]["verdict"] == "smaller"
    assert "After over before, the drift removed" in capsys.readouterr().out
