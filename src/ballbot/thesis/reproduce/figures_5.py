"""Figures 5.1 to 5.8, drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ballbot.log import Log
from ballbot.report.comparison import RUN_LINES
from ballbot.report.style import (
    BLUE,
    INK,
    MUTED,
    ORANGE,
    SHADE,
    STATE_SYMBOLS,
    STATE_UNITS,
    WITH_FRICTION,
    WITHOUT_FRICTION,
    Line,
    thinned,
)
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.chapter5 import FAST, MOVING
from ballbot.thesis.reproduce.drawing import (
    BASIC_LABELS,
    THESIS_EQUATIONS,
    Arrow,
    Block,
    Diagram,
    Shown,
    blocks_figure,
    draw_state,
    paths_figure,
    states_figure,
)
from ballbot.thesis.reproduce.recordings import ARRIVED, CHANGE_RUN
from ballbot.thesis.reproduce.runs import above, largest_lean
from ballbot.workflows.metrics import position_error

_LINEAR: Line = {"color": INK, "linestyle": "-", "linewidth": 1.8}
_NONE, _FULL, _PARTIAL = (RUN_LINES[kind] for kind in ("none", "full", "partial"))
#: as the way and the lean grow
_GROWING: tuple[Line, ...] = (
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
            ylabel=f"{STATE_SYMBOLS[name]}: nonlinear\nless linear [{unit}]",
        )
        axes.set_yscale("symlog", linthresh=1.0)
    panels[3, 1].legend(loc="upper right", ncols=2, fontsize=7)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def figure_5_2(bench: Bench) -> Figure:  # noqa: ARG001
    """Return the block diagram of model-based compensation."""
    return blocks_figure(
        Diagram(
            size=(7.4, 2.5),
            blocks=(
                Block(text="$r - x$", at=(0.10, 0.70), size=(0.10, 0.20)),
                Block(text="$S(\\psi)$\nheading frame", at=(0.28, 0.70), size=(0.16, 0.24)),
                Block(text="LQR\n$K$", at=(0.45, 0.70), size=(0.10, 0.24)),
                Block(text="$+$", at=(0.58, 0.70), size=(0.06, 0.20)),
                Block(text="torque\nlimit", at=(0.70, 0.70), size=(0.10, 0.24)),
                Block(text="robot", at=(0.87, 0.70), size=(0.13, 0.24)),
                Block(text="wheel speeds\n(3.9)", at=(0.80, 0.22), size=(0.17, 0.24)),
                Block(text="friction model\n(3.7), (3.8)", at=(0.58, 0.22), size=(0.17, 0.24)),
            ),
            arrows=(
                Arrow(path=((0.0, 0.70), (0.05, 0.70)), label="$r$"),
                Arrow(path=((0.15, 0.70), (0.20, 0.70))),
                Arrow(path=((0.36, 0.70), (0.40, 0.70))),
                Arrow(path=((0.50, 0.70), (0.55, 0.70))),
                Arrow(path=((0.61, 0.70), (0.65, 0.70)), label="$u$"),
                Arrow(path=((0.75, 0.70), (0.805, 0.70))),
                Arrow(path=((0.935, 0.70), (0.98, 0.70), (0.98, 0.22), (0.885, 0.22)), label="$x$"),
                Arrow(path=((0.715, 0.22), (0.665, 0.22))),
                Arrow(path=((0.58, 0.34), (0.58, 0.60))),
                Arrow(path=((0.98, 0.22), (0.98, 0.05), (0.10, 0.05), (0.10, 0.60))),
            ),
        )
    )


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
            axes.set_ylabel(f"{STATE_SYMBOLS[name]} [m], {law}")
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
