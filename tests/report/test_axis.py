"""The page of an axis: no column or mark is lost."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot.findings import note
from ballbot.identification.axis import AxisIdentification, AxisRecord, identify_axis
from ballbot.identification.axis.model import Axis
from ballbot.report.axis import axis_friction_figure, axis_report, expected_sentence, parameter_rows
from ballbot.report.page import page_of
from tests.support.report_pages import shown_text
from tests.support.screen import assert_fits_a_screen

VALUES = {"mass": 1.0, "viscous": 2.0, "coulomb": 1.5, "offset": 0.2}


def moved(name: str, phase: float) -> AxisRecord:
    """Return a record of 6 s at 100 Hz without noise, its force a sum of two sines."""
    t = np.arange(600, dtype=np.float64) * 0.01
    force = 8.0 * np.sin(2.0 * np.pi * 0.7 * t + phase) + 4.0 * np.sin(2.0 * np.pi * 1.9 * t + 2.0 * phase)
    states = Axis(values=VALUES).windows(force, 0.01, np.array([0]), np.array([599]), np.zeros((1, 2)))
    return AxisRecord(name=name, sample_time=0.01, force=force, position=np.append(0.0, states[:, 0]))


@pytest.fixture(scope="module")
def found() -> AxisIdentification:
    return identify_axis(records())


@cache
def records() -> tuple[AxisRecord, AxisRecord]:
    return moved("a.csv", 0.3), moved("b.csv", 1.1)


@pytest.mark.slow
def test_identification_fits_a_screen_and_is_drawn(found: AxisIdentification) -> None:
    assert_fits_a_screen(found)


@pytest.mark.slow
def test_the_friction_found_is_drawn(found: AxisIdentification) -> None:
    # without noise to the error of one step a sample
    assert found.best.values["viscous"] == pytest.approx(2.0, rel=0.02)
    lines = axis_friction_figure(found, records()[0]).axes[0].get_lines()
    curves = {str(line.get_label()): line for line in lines}
    speed, friction = (np.asarray(one)[201:] for one in curves["coulomb"].get_data())
    np.testing.assert_allclose(friction, 1.5 + 2.0 * speed, rtol=0.02)
    assert [row[0] for row in parameter_rows(found)] == ["M", "b", "c", "offset"]
    assert set(curves) == {"record", "coulomb"}


@pytest.mark.slow
def test_no_finding_is_said_twice(found: AxisIdentification) -> None:
    notes = tuple(note(f"code-{k}", f"Sentence {k}.") for k in range(3))
    page = shown_text(page_of(axis_report(replace(found, findings=notes), records()[0])))
    assert [page.count(text) for text in (expected_sentence(found), *(one.text for one in notes))] == [1] * 4
