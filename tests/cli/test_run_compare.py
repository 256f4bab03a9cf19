"""`ballbot run compare`: a study's controller against the one before it, in turn on an emulated robot."""

import json

import pytest

from ballbot.cli.main import main
from ballbot.firmware.build import compilers
from ballbot.log import Log
from tests.support.prediction_examples import COURSE, write_predicting_study

pytestmark = [
    pytest.mark.sample,
    pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)"),
]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Return a folder as a study leaves it, whose prediction is about a simulated run of its controller."""
    return write_predicting_study(tmp_path_factory.mktemp("study") / "found")


def test_better_controller_is_kept_and_its_gain_has_an_interval(study, tmp_path, capsys):
    out = tmp_path / "compared"
    prediction = str(study / "results.json")
    assert main(["run", "compare", "--emulated", "--prediction", prediction, "--out", str(out)]) == 0
    found = json.loads((out / "results.json").read_text())
    assert found["recommendation"] == "keep"
    assert [one["recommendation"] for one in found["verdicts"]] == ["keep", "keep"]
    gain = found["gains"]["peak_error"]
    low, high = gain["low"], gain["high"]
    assert low < gain["factor"] < high
    # the nominal gain leaves friction uncompensated and wanders by tenths of a metre, the precise one by millimetres
    assert gain["factor"] < 0.2
    names = ["1_before.csv", "2_after.csv", "3_before.csv", "4_after.csv", "report.html", "results.json"]
    assert sorted(path.name for path in out.iterdir() if not path.name.startswith(".")) == names
    shown = capsys.readouterr().out
    assert "Next: go on with" in shown
    # a log of the comparison is one that the prediction's own command takes
    assert main(["validate", "--prediction", prediction, str(out / "2_after.csv")]) == 0
    assert "\nConfirmed: " in capsys.readouterr().out
    assert len(Log.read(out / "4_after.csv")) == COURSE.duration / 0.005


def test_controller_that_was_not_predicted_is_refused(study, tmp_path, capsys):
    other = tmp_path / "study"
    other.mkdir()
    for name in ("results.json", "robot.toml", "previous_controller.toml"):
        (other / name).write_bytes((study / name).read_bytes())
    (other / "controller.toml").write_bytes((study / "previous_controller.toml").read_bytes())
    words = ["run", "compare", "--emulated", "--prediction", str(other / "results.json")]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert "is not the one whose performance is predicted" in capsys.readouterr().err
