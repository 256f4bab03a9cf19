"""Figures for a narrow page: as wide as it, with panels that were side by side one below another."""

from __future__ import annotations

import re

import pytest
from matplotlib.figure import Figure

from ballbot.report.narrow import NARROW, make_narrow
from ballbot.report.page import _FigureMarkup
from ballbot.report.style import drawn_picture


def panels_of(rows: int, columns: int, **options) -> Figure:
    """Return a figure of panels named by row and column, with labels at its left and its bottom."""
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    for row, line in enumerate(panels):
        for column, axes in enumerate(line):
            axes.plot([0.0, 1.0], [0.0, 1.0])
            axes.set_title(f"{row}{column}")
    for row, axes in enumerate(panels[:, 0]):
        axes.set_ylabel(f"along {row}")
    for axes in panels[-1]:
        axes.set_xlabel("across")
    return figure


def grid_of(figure: Figure) -> list[list[str]]:
    """Return the titles of a figure's panels from the top, as they are drawn."""
    figure.draw_without_rendering()
    lines: dict[float, list[tuple[float, str]]] = {}
    for axes in figure.axes:
        box = axes.get_position()
        lines.setdefault(round(box.y0, 2), []).append(
            (box.x0, axes.get_title(loc="left") or axes.get_title())
        )
    return [[title for _, title in sorted(lines[y])] for y in sorted(lines, reverse=True)]


@pytest.mark.parametrize(
    ("rows", "columns", "options", "expected"),
    [
        (2, 1, {"sharex": True}, [["00"], ["10"]]),
        (1, 2, {"sharey": True}, [["00"], ["01"]]),
        (1, 3, {"sharex": True, "sharey": True}, [["00", "01"], ["02"]]),
        (2, 3, {}, [["00", "10"], ["01", "11"], ["02", "12"]]),
        # a panel stays above the one that belongs to it
        (2, 3, {"sharex": True, "height_ratios": (3, 1)}, [["00", "01"], ["10", "11"], ["02"], ["12"]]),
    ],
)
def test_panels_stand_one_below_another_and_keep_their_height(rows, columns, options, expected):
    figure = panels_of(rows, columns, **options)
    before = 3.0 / rows
    make_narrow(figure)
    assert grid_of(figure) == expected
    assert figure.get_figwidth() == NARROW
    if "height_ratios" not in options:
        assert 0.8 * before <= figure.get_figheight() / len(expected) <= before


def test_panels_that_come_to_the_left_and_the_bottom_are_labelled():
    figure = panels_of(1, 3, sharex=True, sharey=True)
    make_narrow(figure)
    first, second, third = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["along 0", "", "along 0"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "across", "across"]
    figure.draw_without_rendering()
    shown = [
        any(tick.label1.get_visible() for tick in axes.yaxis.get_major_ticks())
        for axes in (first, second, third)
    ]
    assert shown == [True, False, True]


def test_no_text_leaves_a_narrow_figure():
    figure = panels_of(2, 5, sharex=True)
    make_narrow(figure)
    figure.draw_without_rendering()
    box = figure.get_tightbbox()
    assert box.x0 >= -0.02
    assert box.x1 <= NARROW + 0.02


def test_a_legend_has_as_many_columns_as_fit():
    figure = panels_of(1, 2)
    for number in range(4):
        figure.axes[0].plot([0.0, 1.0], [1.0, 0.0], label=f"friction {number}")
    figure.legend(loc="outside upper center", ncols=4)
    make_narrow(figure)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    lines = {round(text.get_window_extent().y0) for text in legend.get_texts()}
    assert 1 < len(lines) < 4
    assert legend.get_window_extent().x0 >= 0.0
    assert legend.get_window_extent().width <= figure.bbox.width


def test_a_page_has_both_forms_of_a_wide_figure_with_names_of_their_own():
    made = drawn_picture("one", lambda: panels_of(1, 2), "a figure")
    forms = [set(re.findall(r'\bid="([^"]+)"', svg)) for svg in (made.markup, made.narrow)]
    assert all(forms)
    assert not forms[0] & forms[1]
    assert "--natural:552pt" in made.markup
    assert not drawn_picture("two", lambda: Figure(figsize=(NARROW, 2.0)), "a figure").narrow


def test_figures_of_a_page_share_the_outlines_of_letters():
    made = [drawn_picture(name, lambda: panels_of(1, 2), "a figure") for name in ("one", "two")]
    mark = _FigureMarkup()
    alone = [made[0].markup, made[0].narrow, made[1].markup, made[1].narrow]
    shared = [str(mark(svg)) for svg in alone]
    outlines = [set(re.findall(r' d="[^"]+" transform="scale\(0\.015625\)"', svg)) for svg in shared]
    assert outlines[0]
    assert not any(outlines[0] & others for others in outlines[1:])
    names = re.findall(r'\bid="([^"]+)"', "".join(shared))
    assert len(names) == len(set(names))
    assert set(re.findall(r'href="#([^"]+)"', "".join(shared))) <= set(names)
