"""Kinds of controllers: each is one file, found by its name wherever a controller is named."""

import pytest

from ballbot.cli.main import main
from ballbot.control.file import read_controller
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import KINDS
from ballbot.control.source import NAMED_CONTROLLERS, named_controller
from ballbot.workflows.controller_design import GainOptions, design_controller
from tests.support.control_examples import FRICTION, alten


@pytest.mark.parametrize("name", KINDS)
def test_kind_is_made_designed_and_compared_by_its_name(name):
    made = named_controller(name, alten(FRICTION))
    designed = design_controller(alten(FRICTION), gain=GainOptions(kind=name)).controller
    assert made.packed.tolist() == designed.packed.tolist()
    assert made.compensation == KINDS[name].compensation
    assert name == "nominal" or name in NAMED_CONTROLLERS


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_design_writes_the_requested_parts(tmp_path):
    alten(FRICTION).write(tmp_path / "robot.toml")
    options = ["--kind", "precise", "--delay", "0.016", "--notch", "27", "--out", str(tmp_path)]
    assert main(["design", str(tmp_path / "robot.toml"), *options]) == 0
    parts = read_controller(tmp_path / "controller.toml", alten(FRICTION)).parts
    assert parts.prediction == DelayPrediction(delay=0.016)
    assert parts.notch == Notch(frequency=27.0)
