"""A line looks the same wherever a page draws it: in a figure, in a time series and in a replay."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from ballbot.identification.geometry import Geometry, GeometryQuantity
from ballbot.report import comparison, palette
from ballbot.report.bench import geometry_figure
from ballbot.viewer.page import RUN_COLORS, web_file

#: colors of the replay that have another name in figures
_IN_FIGURES = {"teal": "green"}
_DASHES = {"-": 0, "--": 2, "-.": 4, ":": 2}  # numbers of a canvas's dash


def _looks(script: str, pattern: str) -> dict[str, list[float]]:
    return {name: json.loads(dash) for name, dash in re.findall(pattern, script)}


def replay_dashes() -> dict[str, list[float]]:
    return _looks(web_file("plots.js"), r"(\w+): \{ width: [\d.]+, dash: (\[.*?\]) \}")


def chart_looks() -> dict[str, tuple[str, list[float]]]:
    found = re.findall(
        r'(\w+): \{ color: "--(\w+)", width: [\d.]+, dash: (\[.*?\]),',
        web_file("charts.js", "ballbot.report"),
    )
    return {look: (color, json.loads(dash)) for look, color, dash in found}


def test_a_color_has_one_dash_in_replays_and_time_series():
    replay, charts = replay_dashes(), chart_looks()
    assert set(replay) == {*RUN_COLORS, "ink"}
    looks = ("measured", "first", "second", "third", "fourth")
    by_color = dict(charts[look] for look in looks)
    for color, dash in replay.items():
        assert len(by_color[_IN_FIGURES.get(color, color)]) == len(dash), color
    # as blue and black are both solid, black is the heavier
    widths = dict(re.findall(r"(ink|blue): \{ width: ([\d.]+)", web_file("plots.js")))
    assert float(widths["ink"]) > 1.3 * float(widths["blue"])


@pytest.mark.parametrize("place", range(4))
def test_a_compared_controller_has_one_look(place: int):
    line = comparison.line_of(place)
    color, dash = chart_looks()[comparison._TRACK_LOOKS[place]]
    assert line["color"] == getattr(palette, color.upper())
    assert len(dash) == _DASHES[line["linestyle"]]


def test_geometry_beyond_errors_and_slip_is_marked():
    def one(name: str, value: float, error: float) -> GeometryQuantity:
        return GeometryQuantity(
            name=name, value=value, standard_error=error, in_file=0.11, unit="m", kind="both"
        )

    # 0.1 % off with an error of 0.01 %: clear, but slip may cause 0.6 %
    slipping, off = one("wheels.radius", 0.1101, 1e-5), one("ball.radius", 0.112, 1e-4)
    geometry = Geometry(measured=(slipping, off), wheel_ratios=(), camera_delay=None, leaning_seen=None)
    (axes,) = geometry_figure(geometry).axes
    marks = {line.get_marker(): line for line in axes.get_lines() if line.get_marker() in ("o", "D")}
    assert np.ravel(marks["o"].get_xdata())[0] == pytest.approx(slipping.deviation)
    assert np.ravel(marks["D"].get_xdata())[0] == pytest.approx(off.deviation)
