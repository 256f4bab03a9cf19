"""The figures of the reproduction, drawn; those of chapter 4 show the first of the runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle

from ballbot.log import Log
from ballbot.report.bench import movement_figure, swing_figure
from ballbot.report.comparison import RUN_LINES
from ballbot.report.driveline import measured_figure, torque_speed_figure
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE, SHADE
from ballbot.report.spin import velocity_figure
from ballbot.report.style import (
    MEASURED,
    STATE_SYMBOLS,
    STATE_UNITS,
    WITH_FRICTION,
    WITHOUT_FRICTION,
    LineStyle,
    thinned,
)
from ballbot.report.validation_figures import correlation_figure, symbols
from ballbot.robot.figure import robot_figure
from ballbot.rounding import unit_heading
from ballbot.thesis.reproduce.alignment_figures import (
    orientation_error_figure,
    orientation_figure,
    position_error_figure,
    position_figure,
)
from ballbot.thesis.reproduce.bench import BallVideo, Bench
from ballbot.thesis.reproduce.chapter5 import FAST, MOVING
from ballbot.thesis.reproduce.diagrams import (
    COMPENSATION,
    COMPENSATION_NARROW,
    architecture,
    architecture_narrow,
)
from ballbot.thesis.reproduce.drawing import (
    BASIC_LABELS,
    THESIS_EQUATIONS,
    Shown,
    blocks_figure,
    draw_state,
    paths_figure,
    states_figure,
)
from ballbot.thesis.reproduce.recordings import ARRIVED, CHANGE_RUN
from ballbot.thesis.reproduce.runs import above, largest_lean
from ballbot.workflows.metrics import position_error

_ARROW = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
#: an axis's length, and the radius at which turns are drawn, in ball radii
_AXIS, _TURN = 2.4, 1.9


def figure_2_1(bench: Bench) -> Figure:
    """Return the robot to scale from its right and from above, with x, y, z and theta, phi, psi."""
    figure = robot_figure(bench.robot)
    side, top = figure.axes[:2]
    r = bench.robot.ball.radius
    _axes(side, r, right="$x$", up="$z$", into="$y$, away", length=_AXIS)
    _axes(top, r, right="$x$", up="$y$", into="$z$, up", length=0.8 * _AXIS)
    # seen along +y, a turn about y goes from z to x
    _turn(side, r, r"$\varphi$", start=48.0, end=88.0, towards_start=True)
    _turn(top, r, r"$\psi$", start=18.0, end=60.0, towards_start=False)
    _roll(top, r)
    return figure


def _axes(axes: Axes, r: float, *, right: str, up: str, into: str, length: float) -> None:
    """Draw two axes from the ball's centre, `length` ball radii long, and name the one that is seen end on."""
    for place, label, offset in (((length * r, 0.0), right, (-3, -11)), ((0.0, length * r), up, (-9, 0))):
        axes.annotate("", xy=place, xytext=(0.0, 0.0), arrowprops=_ARROW, zorder=20, annotation_clip=False)
        axes.annotate(
            label, place, offset, textcoords="offset points", ha="center", va="center", fontsize=11, zorder=20
        )
    axes.plot(0.0, 0.0, "o", markersize=6, markerfacecolor="white", color=INK, zorder=21)
    axes.annotate(into, (0.0, 0.0), (-7, -13), textcoords="offset points", ha="right", fontsize=9, zorder=21)


def _turn(axes: Axes, r: float, label: str, *, start: float, end: float, towards_start: bool) -> None:
    """Draw an arc with an arrow at one end, angles in degrees from the panel's right."""
    radius = _TURN * r
    axes.add_patch(
        Arc((0.0, 0.0), 2 * radius, 2 * radius, theta1=start, theta2=end, color=INK, linewidth=1.4, zorder=20)
    )
    tip, before = np.radians([start, start + 6.0] if towards_start else [end, end - 6.0])
    points = [(radius * np.cos(a), radius * np.sin(a)) for a in (tip, before)]
    axes.annotate(
        "",
        xy=points[0],
        xytext=points[1],
        zorder=20,
        arrowprops=_ARROW,
    )
    middle = np.radians(0.5 * (start + end))
    axes.annotate(
        label,
        (1.12 * radius * np.cos(middle), 1.12 * radius * np.sin(middle)),
        ha="center",
        va="center",
        fontsize=12,
        zorder=20,
    )


def _roll(axes: Axes, r: float) -> None:
    """Draw theta's turn about x: a flat ellipse around the axis, its arrow as a right hand turns."""
    place = 1.55 * r
    axes.add_patch(
        Arc((place, 0.0), 0.3 * r, 1.1 * r, theta1=-70.0, theta2=120.0, color=INK, linewidth=1.4, zorder=20)
    )
    tip, before = (np.radians(angle) for angle in (120.0, 108.0))
    points = [(place + 0.15 * r * np.cos(a), 0.55 * r * np.sin(a)) for a in (tip, before)]
    axes.annotate(
        "",
        xy=points[0],
        xytext=points[1],
        zorder=20,
        arrowprops=_ARROW,
    )
    axes.annotate(r"$\theta$", (place, -0.75 * r), ha="center", va="center", fontsize=12, zorder=20)


def figure_3_1(bench: Bench) -> Figure:
    """Return torque over speed of the three free wheels."""
    return measured_figure(bench.sweeps)


def figure_3_2(bench: Bench) -> Figure:
    """Return torque over speed of wheel 1, measured and of both models."""
    return torque_speed_figure(bench.sweeps[0], bench.driveline_fit)


def figure_3_4(bench: Bench) -> Figure:
    """Return the ball's rotation about each axis with friction and without."""
    return movement_figure(bench.ball_movement)


def figure_3_5(bench: Bench) -> Figure:
    """Return the paths of the models about the origin, from the first of their starts."""
    runs = [
        Shown(label="with friction", log=bench.standing["friction"][0], line=WITH_FRICTION),
        Shown(label=BASIC_LABELS["thesis"], log=bench.standing["thesis"][0], line=THESIS_EQUATIONS),
        Shown(label=BASIC_LABELS["exact"], log=bench.standing["exact"][0], line=WITHOUT_FRICTION),
    ]
    return paths_figure(runs, ball_radius=bench.robot.ball.radius, goal=False)


_STATES = ("x", "y", "theta", "phi", "psi", "psi_dot")


def figure_4_1(bench: Bench) -> Figure:
    """Return measured and simulated states in closed loop, over the whole run."""
    one = bench.validations[0]
    return states_figure(
        _shown({"measured": one.log.without_truth()} | one.runs), _STATES, start=0.0, end=float(one.log.t[-1])
    )


def figure_4_2(bench: Bench) -> Figure:
    """Return them in open loop, each model until its own lean is past recovery."""
    example = bench.validations[0].example
    t = example["measured"].t
    return states_figure(_shown(example), _STATES, start=float(t[0]), end=float(t[-1]))


def figure_4_3(bench: Bench) -> Figure:
    """Return the correlation matrix of residuals and torques, its significant cells framed."""
    found = bench.validations[0].correlations
    return correlation_figure(symbols(found.labels), found.matrix, marked=found.significant)


def _shown(logs: Mapping[str, Log]) -> list[Shown]:
    return [
        Shown(label="measured", log=logs["measured"], line=MEASURED),
        Shown(label="model with friction", log=logs["friction"], line=WITH_FRICTION),
        Shown(label=BASIC_LABELS["exact"], log=logs["exact"], line=WITHOUT_FRICTION),
        Shown(label=BASIC_LABELS["thesis"], log=logs["thesis"], line=THESIS_EQUATIONS),
    ]


def figure_i_1(bench: Bench) -> Figure:
    """Return the architecture with the preset's numbers."""
    return blocks_figure(architecture(bench.robot))


def figure_iii_1(bench: Bench) -> Figure:
    """Return the first simulated swing, the fitted pendulum and their difference."""
    return swing_figure(bench.swings[0], label="simulated, with the tracking's error")


def figure_iv_1(bench: Bench) -> Figure:
    """Return the angles on board and by the cameras."""
    return orientation_figure(bench.alignments[0])


def figure_iv_2(bench: Bench) -> Figure:
    """Return the angles' errors."""
    return orientation_error_figure(bench.alignments[0])


def figure_iv_3(bench: Bench) -> Figure:
    """Return the position on board and by the cameras."""
    return position_figure(bench.alignments[0])


def figure_iv_4(bench: Bench) -> Figure:
    """Return the position's errors."""
    return position_error_figure(bench.alignments[0])


#: of what was seen, about so many points are drawn
_POINTS = 600


def figure_v_1(bench: Bench) -> Figure:
    """Return a frame of the video, and beside it the sphere with the seam that is seen and the curve fitted."""
    video = bench.ball_video
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    picture, sphere = figure.subplots(1, 2)
    view = video.spin.view
    picture.imshow(video.frame[:, :, ::-1])
    picture.plot(*view.outline().T, color="white", linewidth=0.8, linestyle="--")
    reach = 1.2 * view.radius
    picture.set(xlim=(view.x - reach, view.x + reach), ylim=(view.y + reach, view.y - reach))
    picture.set(title=f"Frame {video.row} and the ball's outline found", xlabel="pixels", ylabel="pixels")
    picture.grid(visible=False)
    _draw_sphere(sphere, video)
    figure.legend(loc="outside lower right", ncols=3, markerscale=2.0)
    return figure


def figure_v_2(bench: Bench) -> Figure:
    """Return the velocity about each axis by video and by the wheels."""
    return velocity_figure(bench.ball_video.spin, bench.ball_video.comparison)


def _draw_sphere(axes: Axes, video: BallVideo) -> None:
    """Draw the unit sphere as the camera sees it from far away: x to the right, y down."""
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor=INK, linewidth=1.0))
    seen = video.seen[:: max(1, len(video.seen) // _POINTS)]
    axes.plot(seen[:, 0], seen[:, 1], ".", color=ORANGE, markersize=2.5, label="seam seen")
    # the camera looks along +z, so that the near half has z below zero
    for near, style, width in ((False, ":", 0.9), (True, "-", 1.4)):
        hidden = (video.curve[:, 2] < 0.0) != near
        places = np.where(hidden[:, None], np.nan, video.curve)
        color, label = (BLUE, "curve fitted") if near else (MUTED, "on the far side")
        axes.plot(places[:, 0], places[:, 1], linestyle=style, linewidth=width, color=color, label=label)
    axes.set(xlim=(-1.2, 1.2), ylim=(1.2, -1.2), aspect="equal", title="Seam and curve on the ball")
    axes.set(xlabel="$x$ [ball radii]", ylabel="$y$ [ball radii]")


_LINEAR: LineStyle = {"color": INK, "linestyle": "-", "linewidth": 1.8}
_NONE, _FULL, _PARTIAL = (RUN_LINES[kind] for kind in ("none", "full", "partial"))
#: as the way and the lean grow
_GROWING: tuple[LineStyle, ...] = (
    {"color": MUTED, "linestyle": ":", "linewidth": 1.4},
    {"color": BLUE, "linestyle": "-.", "linewidth": 1.1},
    {"color": ORANGE, "linestyle": "--", "linewidth": 1.1},
    {"color": INK, "linestyle": "-", "linewidth": 1.1},
)
#: what is shown of the wheels' speeds [s]
_FIRST, _LAST = 2.5, 8.0


def figure_5_1(bench: Bench) -> Figure:
    """Return states of the linear model and of the nonlinear ones, and how far the two part as the lean grows."""
    linear, basic = bench.linear["exact"], bench.basic
    shown = [
        Shown(label="linear", log=linear, line=_LINEAR),
        Shown(label=f"nonlinear, {BASIC_LABELS['exact']}", log=basic["exact"], line=WITHOUT_FRICTION),
        Shown(label=f"nonlinear, {BASIC_LABELS['thesis']}", log=basic["thesis"], line=THESIS_EQUATIONS),
        Shown(label="nonlinear, friction", log=bench.changes["none"][0], line=WITH_FRICTION),
    ]
    names = ("x", "y", "theta", "phi", "psi", "psi_dot")
    figure = Figure(figsize=(7.4, 6.6), layout="constrained")
    panels = figure.subplots(4, 2)
    for axes, name in zip(panels.flat, names, strict=False):
        draw_state(axes, shown, name, start=0.0, end=20.0)
        axes.set_ylabel(f"{STATE_SYMBOLS[name]} [{STATE_UNITS[name]}]")
    for axes, name, unit in zip(panels[3], ("theta", "x"), ("mrad", "mm"), strict=True):
        for (straight, bent), line in zip(bench.parting["exact"], _GROWING, strict=True):
            rows = bent.t <= 20.0
            lean = np.degrees(largest_lean(bent))
            difference = 1e3 * (bent[name] - straight[name])[rows]
            axes.plot(*thinned(bent.t[rows], difference), label=f"lean up to {lean:.1f}°", **line)
        axes.set(
            xlabel="time [s]",
            xlim=(0.0, 20.0),
            ylabel=unit_heading(f"{STATE_SYMBOLS[name]}: nonlinear\nless linear", unit),
        )
        axes.set_yscale("symlog", linthresh=1.0)
    panels[3, 1].legend(loc="upper right", ncols=2, fontsize=7)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def figure_5_2(bench: Bench) -> Figure:  # noqa: ARG001
    """Return the block diagram of model-based compensation."""
    return blocks_figure(COMPENSATION)


def figure_5_3(bench: Bench) -> Figure:
    """Return the position of the linear model and of the nonlinear one with and without compensation."""
    runs = bench.changes
    shown = [
        Shown(label="linear", log=bench.linear["exact"], line=_LINEAR),
        Shown(label="friction, no compensation", log=runs["none"][0], line=_NONE),
        Shown(label="friction, compensation", log=runs["full"][0], line=_FULL),
    ]
    return states_figure(shown, ("x", "y"), start=0.0, end=CHANGE_RUN)


def figure_5_4(bench: Bench) -> Figure:
    """Return the position of the linear model and with full and partial compensation: a bare sign, and a ramp."""
    runs = bench.changes
    figure = Figure(figsize=(7.4, 3.9), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True)
    for row, (suffix, law) in zip(panels, (("_sign", "bare sign"), ("", "ramp")), strict=True):
        shown = [
            Shown(label="linear", log=bench.linear["exact"], line=_LINEAR),
            Shown(label="full compensation", log=runs[f"full{suffix}"][0], line=_FULL),
            Shown(label="partial compensation", log=runs[f"partial{suffix}"][0], line=_PARTIAL),
        ]
        for axes, name in zip(row, ("x", "y"), strict=True):
            draw_state(axes, shown, name, start=0.0, end=CHANGE_RUN)
            axes.set_ylabel(unit_heading(f"{STATE_SYMBOLS[name]}, {law}", "m"))
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def figure_5_5(bench: Bench) -> Figure:
    """Return the wheels' speeds with full and partial compensation, and what of them is fast."""
    count, h = bench.robot.wheel_count, bench.robot.sensors.sample_time
    figure = Figure(figsize=(7.4, 4.4), layout="constrained")
    panels = figure.subplots(count, 2, sharex=True, squeeze=False)
    kinds = (("full", "full compensation", _FULL), ("partial", "partial compensation", _PARTIAL))
    for kind, label, line in kinds:
        log = bench.changes[kind][0]
        rows = (log.t >= _FIRST) & (log.t <= _LAST)
        t, fast = log.t[rows], 1e3 * above(log.wheel_speeds, h, FAST)[rows]
        for wheel, (whole, part) in enumerate(panels):
            whole.plot(*thinned(t, log.wheel_speeds[rows, wheel]), label=label, **line)
            part.plot(*thinned(t, fast[:, wheel]), label=label, **line)
            whole.set_ylabel(f"wheel {wheel + 1} [rad/s]")
            part.set_ylabel(f"above {FAST:g} Hz\n[mrad/s]")
    reach = 1.2e3 * max(_largest_fast(bench, kind) for kind, _, _ in kinds)
    for part in panels[:, 1]:
        part.set_ylim(-reach, reach)  # the step's jump goes beyond
    for axes in panels[-1]:
        axes.set(xlabel="time [s]", xlim=(_FIRST, _LAST))
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def figure_5_6(bench: Bench) -> Figure:
    """Return the models' paths with and without compensation, from every start."""
    return paths_figure(_compared(bench.changes), ball_radius=bench.robot.ball.radius, goal=True)


def figure_5_7(bench: Bench) -> Figure:
    """Return the twin's paths with and without compensation, of every run."""
    return paths_figure(_compared(bench.twin_changes), ball_radius=bench.robot.ball.radius, goal=True)


def figure_5_8(bench: Bench) -> Figure:
    """Return the twin's distance from the reference over time, of every run, and the reference."""
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    longest = bench.twin_changes["none"][0]
    upper.axvspan(ARRIVED, float(longest.t[-1]), color=SHADE, label="arrived: the peak is taken here")
    for run in _compared(bench.twin_changes):
        upper.plot(*thinned(run.log.t, position_error(run.log)), label=run.label, **run.line)
    upper.set_ylabel("distance from the\nreference [m]")
    upper.set_ylim(bottom=0.0)
    figure.legend(loc="outside upper center", ncols=3)
    for name, symbol, dash in (("x", "$x$ [m]", "-"), ("y", "$y$ [m]", "--"), ("psi", r"$\psi$ [rad]", "-.")):
        lower.plot(
            *thinned(longest.t, longest[f"ref_{name}"]),
            color=INK,
            linestyle=dash,
            linewidth=1.2,
            label=symbol,
        )
    lower.set(xlabel="time [s]", ylabel="reference")
    lower.set_ylim(-1.8, 6.5)
    lower.legend(loc="upper right", ncols=3)
    upper.margins(x=0.01)
    return figure


def _largest_fast(bench: Bench, kind: str) -> float:
    """Return the largest size [rad/s] of what is fast in a wheel's speed while it is shown, past the step's jump."""
    log = bench.changes[kind][0]
    fast = above(log.wheel_speeds, bench.robot.sensors.sample_time, FAST)
    return float(np.abs(fast[(log.t >= MOVING[0]) & (log.t <= _LAST)]).max())


def _compared(runs: Mapping[str, Sequence[Log]]) -> list[Shown]:
    """Return runs without and with compensation: the first of each bold and named, the others thin."""
    return [
        Shown(
            label=label if number == 0 else "_" + label,
            log=log,
            line=line if number == 0 else {**line, "linewidth": 0.35},
        )
        for kind, label, line in (("none", "no compensation", _NONE), ("full", "compensation", _FULL))
        for number, log in enumerate(runs[kind])
    ]


#: drawings for a phone, by the name of the wide one, where panels one below another are no way to make one
NARROW_DRAWINGS: Mapping[str, Callable[[Bench], Figure]] = MappingProxyType(
    {
        "figure_i_1": lambda bench: blocks_figure(architecture_narrow(bench.robot)),
        "figure_5_2": lambda _: blocks_figure(COMPENSATION_NARROW),
    }
)
