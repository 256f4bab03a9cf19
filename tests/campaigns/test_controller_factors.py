"""The factorial of controllers: its cells, and its effects from peaks that are known."""

from __future__ import annotations

import numpy as np
import pytest

from ballbot.control.file import controller_text
from ballbot.control.presets import nominal_controller, precise_controller
from tests.support.control_examples import FRICTION, alten

pytest.importorskip("mujoco")

from campaigns.controller_factors import (
    CELLS,
    Cell,
    controller_of,
    effect,
)

#: of three seeds
SPREAD = np.array([0.9, 1.0, 1.1])


def known_peaks(cell: Cell) -> np.ndarray:
    """Return peaks that the gain divides by 20 and compensation by 4, but beside the observer by nothing."""
    peak = 0.4 * (0.05 if cell.stiff else 1.0)
    peak *= 0.25 if cell.compensation and not cell.observer else 1.0
    if cell.stiff and not cell.filter:
        return np.array([0.666, np.nan, 0.7])
    return peak * SPREAD


PEAKS = {cell: known_peaks(cell) for cell in CELLS}


def test_cells_lead_from_the_nominal_to_the_precise_controller():
    robot = alten(FRICTION)
    nothing, everything = CELLS[0], CELLS[-1]
    assert len(set(CELLS)) == 32
    assert controller_text(controller_of(robot, nothing)) == controller_text(nominal_controller(robot))
    assert controller_text(controller_of(robot, everything)) == controller_text(precise_controller(robot))
    texts = {controller_text(controller_of(robot, cell)) for cell in CELLS}
    assert len(texts) == 32


def test_effects_are_ratios_over_the_cells_in_which_nothing_falls():
    found = effect(PEAKS, "compensation", given={"observer": False})
    assert found.ratio.mean == pytest.approx(4.0)
    assert (found.ratio.low, found.ratio.high) == pytest.approx((4.0, 4.0))  # the same of every seed
    assert found.cells == 6  # of 8: those with the stiff gain and without the filter fall
    assert found.falls == (2, 2)
    assert effect(PEAKS, "compensation", given={"observer": True}).ratio.mean == pytest.approx(1.0)
    stiff = effect(PEAKS, "stiff", given={})
    assert (stiff.ratio.mean, stiff.cells, stiff.falls) == (pytest.approx(20.0), 8, (0, 8))
