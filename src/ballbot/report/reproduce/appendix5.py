"""Figures V.1 and V.2."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.film import FilmedBall
from ballbot.report.spin import velocity_figure
from ballbot.report.style import BLUE, INK, MUTED, ORANGE

#: of what was seen, about so many points are drawn
_POINTS = 600


def figure_v_1(bench: Bench) -> Figure:
    """Return a frame of the film, and beside it the sphere with the seam that is seen and the curve fitted."""
    film = bench.film
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    picture, sphere = figure.subplots(1, 2)
    view = film.spin.view
    picture.imshow(film.frame[:, :, ::-1])
    picture.plot(*view.outline().T, color="white", linewidth=0.8, linestyle="--")
    reach = 1.2 * view.radius
    picture.set(xlim=(view.x - reach, view.x + reach), ylim=(view.y + reach, view.y - reach))
    picture.set(title=f"Frame {film.row} and the ball's outline found", xlabel="pixels", ylabel="pixels")
    picture.grid(visible=False)
    _draw_sphere(sphere, film)
    figure.legend(loc="outside lower right", ncols=3, markerscale=2.0)
    return figure


def figure_v_2(bench: Bench) -> Figure:
    """Return the velocity about each axis by video and by the wheels."""
    return velocity_figure(bench.film.spin, bench.film.comparison)


def _draw_sphere(axes: Axes, film: FilmedBall) -> None:
    """Draw the unit sphere as the camera sees it from far away: x to the right, y down."""
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor=INK, linewidth=1.0))
    seen = film.seen[:: max(1, len(film.seen) // _POINTS)]
    axes.plot(seen[:, 0], seen[:, 1], ".", color=ORANGE, markersize=2.5, label="seam seen")
    # the camera looks along +z, so that the near half has z below zero
    for near, style, width in ((False, ":", 0.9), (True, "-", 1.4)):
        hidden = (film.curve[:, 2] < 0.0) != near
        places = np.where(hidden[:, None], np.nan, film.curve)
        color, label = (BLUE, "curve fitted") if near else (MUTED, "on the far side")
        axes.plot(places[:, 0], places[:, 1], linestyle=style, linewidth=width, color=color, label=label)
    axes.set(xlim=(-1.2, 1.2), ylim=(1.2, -1.2), aspect="equal", title="Seam and curve on the ball")
    axes.set(xlabel="$x$ [ball radii]", ylabel="$y$ [ball radii]")
