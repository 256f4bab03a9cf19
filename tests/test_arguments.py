"""What callers pass to public functions is one of several things, or refused in a sentence."""

import numpy as np
import pytest

import ballbot
from ballbot import InputError, Log, Robot

ROBOT = Robot.load("alten")
GAIN = np.zeros((3, 10))
LOG = Log({"t": np.array([0.0, 1.0]), "x": np.zeros(2), "y": np.zeros(2)})


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: LOG.select(["x", "y"]), r"select takes rows, such as log.select\(slice\(0, 100\)\)"),
        (lambda: LOG[["x", "y"]], "indexed by the name of one column"),
        (lambda: LOG[0:10], r"not by a slice; log.select\(slice\(0, 10\)\)"),
        (lambda: ballbot.simulate(ROBOT, 5, "square", duration=1.0), "controller is given as .* of type int"),
        (lambda: ballbot.simulate(ROBOT, "nominal", 5, duration=1.0), "reference is given as .* of type int"),
        (lambda: ballbot.loop_margins("nominal"), "loop_margins\\('nominal', robot='alten'\\)"),
    ],
)
def test_refusal_says_what_to_give(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_misspelt_name_of_the_package_has_the_nearest():
    with pytest.raises(AttributeError, match="Did you mean 'Robot'"):
        ballbot.Robt  # noqa: B018
