"""Marks of the figure of a robot's geometry."""

from __future__ import annotations

import numpy as np
import pytest

from ballbot.identification.geometry import Geometry, GeometryQuantity
from ballbot.report.bench import geometry_figure


def test_geometry_beyond_errors_and_slip_is_marked():
    def one(name: str, value: float, error: float) -> GeometryQuantity:
        return GeometryQuantity(
            name=name, value=value, standard_error=error, in_file=0.11, unit="m", kind="both"
        )

    # 0.1 % off with an error of 0.01 %: clear, but slip may cause 0.6 %
    slipping, off = one("wheels.radius", 0.1101, 1e-5), one("ball.radius", 0.112, 1e-4)
    geometry = Geometry(measured=(slipping, off))
    (axes,) = geometry_figure(geometry).axes
    marks = {line.get_marker(): line for line in axes.get_lines() if line.get_marker() in ("o", "D")}
    assert np.ravel(marks["o"].get_xdata())[0] == pytest.approx(slipping.deviation)
    assert np.ravel(marks["D"].get_xdata())[0] == pytest.approx(off.deviation)
