"""What callers pass to public functions is of its type, or refused in a sentence."""

import inspect

import numpy as np
import pytest

import ballbot
from ballbot import InputError, Log, Model, Robot
from ballbot.arguments import checked_arguments, names_listed
from ballbot.control.presets import nominal_controller

ROBOT = Robot.load("alten")
GAIN = np.zeros((3, 10))
LOG = Log({"t": np.array([0.0, 1.0]), "x": np.zeros(2), "y": np.zeros(2)})
WRONG = ["1", b"x", object(), 1j, [], {}, ["a"], {"a": 1}, True, 3, np.nan]
#: public functions, with arguments that they take
CALLS = {
    "simulate": (
        ballbot.simulate, {"plant": ROBOT, "controller": "nominal", "reference": "circle", "duration": 0.02}
    ),
    "simulate_batch": (
        ballbot.simulate_batch,
        {"model": ROBOT, "controller": "nominal", "reference": "circle", "duration": 0.02},
    ),
    "lqr": (ballbot.lqr, {"model": ROBOT, "Q": np.ones(10), "R": np.ones(3)}),
    "loop_margins": (ballbot.loop_margins, {"loop": "precise", "robot": None}),
    "Controller": (ballbot.Controller, {"robot": ROBOT, "gain": GAIN}),
    "Model": (Model, {"robot": ROBOT}),
    "Robot.load": (Robot.load, {"source": "alten"}),
    "Robot.replace": (ROBOT.replace, {}),
    "Robot.annotated": (ROBOT.annotated, {}),
    "Log.read": (Log.read, {"path": "nowhere.csv"}),
    "Log.between": (LOG.between, {"start": 0.0, "end": 2.0}),
    "Log.select": (LOG.select, {"rows": slice(0, 1)}),
    "log[...]": (LOG.__getitem__, {"name": "x"}),
    "validate": (ballbot.validate, {"robot": ROBOT, "logs": LOG}),
    "identify": (ballbot.identify, {"robot": ROBOT, "logs": LOG}),
    "study": (ballbot.study, {"robot": ROBOT, "logs": LOG}),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_an_argument_of_any_type_is_taken_or_refused_in_a_sentence(name):
    function, given = CALLS[name]
    for parameter in inspect.signature(function).parameters:
        refused = 0
        for wrong in WRONG:
            try:
                function(**{**given, parameter: wrong})
            except InputError:  # any other error fails
                refused += 1
        assert refused > 0, parameter


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: LOG.select(["x", "y"]), r"select takes rows, such as log.select\(slice\(0, 100\)\)"),
        (lambda: LOG[["x", "y"]], "indexed by the name of one column"),
        (lambda: LOG[0:10], r"not by a slice; log.select\(slice\(0, 10\)\)"),
        (lambda: ROBOT.replace(ball=3), "ball is 3; it must be a Ball."),
        (
            lambda: ballbot.simulate(ROBOT, 5, "square", duration=1.0),
            "A controller is given as an object of type int",
        ),
        (
            lambda: ballbot.simulate(ROBOT, "nominal", 5, duration=1.0),
            "A reference is given as an object of type int",
        ),
        (
            lambda: ballbot.simulate(ROBOT, "nominal", "square", duration="1"),
            "duration is '1'; it must be a number.",
        ),
        (
            lambda: ballbot.identify(ROBOT, LOG, free=5),
            "free is 5; it must be a list of texts or a text.",
        ),
        (lambda: ballbot.loop_margins("nominal"), "loop_margins\\('nominal', robot='alten'\\)"),
    ],
)
def test_refusal_says_what_to_give(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_margins_of_a_ready_made_controller_are_those_of_its_object():
    assert (
        ballbot.loop_margins("nominal", robot=ROBOT).rows()
        == ballbot.loop_margins(nominal_controller(ROBOT)).rows()
    )


def test_misspelt_name_of_the_package_has_the_nearest():
    with pytest.raises(AttributeError, match="Did you mean 'Robot'"):
        ballbot.Robt  # noqa: B018


def test_a_missing_argument_is_pythons_own_error():
    @checked_arguments
    def half(number: float) -> float:
        return 0.5 * number

    assert half(np.float32(3.0)) == 1.5
    with pytest.raises(TypeError, match="number"):
        half()  # pyright: ignore[reportCallIssue]


def test_names_in_one_text_are_separated_by_commas():
    assert names_listed(" psi, psi_dot,,") == ("psi", "psi_dot")
    assert names_listed("") == ()
