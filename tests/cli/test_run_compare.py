"""`ballbot run compare`: a study's controller against the one before it, in turn on an emulated robot."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from ballbot import Robot
from ballbot.cli.main import main
from ballbot.control.file import write_controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.files import write_text
from ballbot.firmware.build import compilers
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.results import as_json
from ballbot.robot.file import write_robot
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario
from ballbot.twin.imperfections import imperfections_of
from ballbot.workflows.controller_choice import NamedCourse
from ballbot.workflows.controller_prediction import Prediction, checksum_of, performance_intervals
from ballbot.workflows.metrics import Performance, performance_of

pytestmark = [
    pytest.mark.sample,
    pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)"),
]

ALTEN = Robot.load("alten")
SCENARIO = Scenario.nominal(ALTEN)
KNOWN = ALTEN.replace(friction=SCENARIO.friction)
COURSE = NamedCourse(name="square", duration=24.0)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Return a folder as a study leaves it, whose prediction is about a simulated run of its controller."""
    folder = tmp_path_factory.mktemp("study")
    controller = precise_controller(KNOWN)
    plant = SensedPlant(Model(KNOWN), imperfections_of(SCENARIO, known=KNOWN), estimator=controller.estimator)
    reference = COURSE.reference_spec.reference()
    log = simulate(plant, controller, reference, duration=COURSE.duration, seed=1).without_truth()
    seen = performance_of(log, controller)
    random = np.random.default_rng(0)
    similar = [
        Performance.from_array(seen.to_array() * np.exp(0.1 * random.standard_normal(5))) for _ in range(20)
    ]
    without = [
        replace(one, peak_error=40.0 * one.peak_error, rms_error=40.0 * one.rms_error) for one in similar
    ]
    factor = dict.fromkeys(asdict(seen), (0.5, 2.0))
    prediction = Prediction(
        course=COURSE,
        controller="precise",
        checksum=checksum_of(controller),
        torque_limit=controller.torque_limit,
        scenario="nominal",
        draws=20,
        chosen=performance_intervals(similar, discrepancy=factor),
        none=performance_intervals(without, discrepancy=factor),
    )
    write_text(folder / "results.json", as_json({"prediction": prediction}))
    write_robot(KNOWN, folder / "robot.toml")
    write_controller(controller, folder / "controller.toml")
    write_controller(nominal_controller(KNOWN, compensation="none"), folder / "previous_controller.toml")
    return folder


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
