"""Results on one screen: their `repr`, what a notebook shows of them, and their figures."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.control.controller import Controller
from ballbot.control.lqr import LqrDesign
from ballbot.control.margins import loop_margins
from ballbot.control.presets import nominal_controller
from ballbot.fitting.sweep import digest
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.registry import FIGURES, PAGES
from ballbot.report import plots  # noqa: F401 (registers them)
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.batch_result import ClosedLoopBatch
from ballbot.summary import HEIGHT, WIDTH, Plotted, Reported, Summary
from ballbot.workflows.controller_design import design_controller
from ballbot.workflows.limits import POINTS, LimitBounds, Plane, RobotLimits
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled, leaning
from tests.support.log_examples import smooth_log, with_wheels
from tests.support.screen import assert_fits_a_screen

GAIN = np.linspace(-123.456, 1.0, 30).reshape(3, 10)
LQR = LqrDesign(
    gain=GAIN,
    poles=np.array([-1.0 + 0.5j, -1.0 - 0.5j, *np.linspace(-2, -9, 8)]),
    cost=np.eye(10),
    sample_time=5e-3,
)


def limits() -> RobotLimits:
    edge = np.linspace(-1.0, 1.0, POINTS)
    kept = edge[:, None] ** 2 + edge**2 < 0.5
    return RobotLimits(
        directions=np.arange(3.0),
        heights=np.arange(9.0),
        lean=LimitBounds(lower=np.full(3, 0.2), upper=np.full(3, 0.3)),
        impulse=LimitBounds(lower=np.ones((9, 3)), upper=np.full((9, 3), 2.0)),
        plane=Plane(
            **dict.fromkeys(("direction", "lower_area", "upper_area"), 0.0),
            **dict.fromkeys(("lean", "rate"), 1.0),
            **dict.fromkeys(("leans", "rates"), edge),
            **dict.fromkeys(("lower", "upper"), kept),
        ),
    )


def batch() -> ClosedLoopBatch:
    """Return three robots of which one falls."""
    starts = np.array([leaning(lean) for lean in (0.0, 0.01, 0.9)])
    return simulate_batch(alten(FRICTION), "nominal", "hold", duration=0.5, initial_states=starts)


RESULTS = {
    "linear model": lambda: Model("alten").linearize(),
    "batch": batch,
    "robot": lambda: alten(FRICTION),
    "robot of four wheels": lambda: four_wheeled(friction=True),
    "log": lambda: with_wheels(smooth_log(rows=40), alten()),
    "log of one row": lambda: Log({"t": [0.0], "other": [np.nan]}, ended="fallen: a lean of 0.9 rad"),
    "controller": lambda: nominal_controller("alten"),
    "controller of an unstable loop": lambda: Controller(alten(), GAIN),
    "controller with every part": lambda: everything(alten(FRICTION)),
    "gain": lambda: LQR,
    "gain with integral": lambda: replace(LQR, integral_gain=GAIN[:, :3]),
    "controller design": lambda: design_controller(alten(FRICTION)),
    "limits": limits,
    "margins": lambda: loop_margins(nominal_controller("alten")),
}


@pytest.mark.parametrize("name", RESULTS)
def test_result_fits_a_screen(name):
    # which have nothing to draw
    assert_fits_a_screen(
        RESULTS[name](), drawn=name not in ("log of one row", "controller of an unstable loop")
    )


def test_every_class_of_results_has_its_figure_and_page():
    assert descendants(Plotted) - {Reported} == set(FIGURES)
    assert descendants(Reported) == set(PAGES)


def descendants(kind: type) -> set[type]:
    return {one for own in kind.__subclasses__() for one in (own, *descendants(own))}


def test_robots_of_one_summary_have_different_digests():
    """Finished runs are of one robot; robots that differ beyond the digits of a summary are not the same."""
    robot = alten(FRICTION)
    other = robot.replace(gravity=float(np.nextafter(robot.gravity, 10.0))).annotated(sources=robot.sources)
    assert repr(robot) == repr(other)
    assert digest(robot) != digest(other)
    assert digest([(robot,)]) != digest([(other,)])
    assert digest({"of": robot}) != digest({"of": other})


TEXT = st.text(max_size=100)


@given(
    title=TEXT,
    rows=st.lists(st.tuples(TEXT, TEXT | st.lists(TEXT, max_size=3).map(tuple)), max_size=5),
    sentences=st.lists(TEXT, max_size=5),
    times=st.integers(1, 9),
)
@settings(max_examples=20)
def test_any_texts_fit_a_screen_and_are_not_obeyed(title, rows, sentences, times):
    summary = Summary(title=title, rows=tuple(rows * times), sentences=tuple(sentences * times))
    lines = repr(summary).split("\n")
    assert len(lines) <= HEIGHT
    assert max(map(len, lines)) <= WIDTH
    assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e\u2028]", repr(summary))
    assert set(re.findall(r"</?(\w+)", summary._repr_html_())) <= {"b", "table", "tr", "th", "td", "ul", "li"}


def test_what_does_not_fit_is_counted():
    summary = Summary(title="title", sentences=tuple(f"sentence {number}" for number in range(40)))
    assert repr(summary).endswith(f"... {1 + 40 - (HEIGHT - 1)} more lines: print(_.summary())")
    assert len(str(summary).splitlines()) == 41
