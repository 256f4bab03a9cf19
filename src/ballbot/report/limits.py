"""A robot's limits: figures of the recovery region and of tilts and impulses over all directions, and tables."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ballbot.control.overcompensation import has_friction
from ballbot.report.blocks import Column, Result, section, sheet_of
from ballbot.report.comparison import TRACK_LOOKS
from ballbot.report.palette import INK, LOWER, MUTED, UPPER
from ballbot.report.style import LOOKS, MARKS, drawn_picture, label_of
from ballbot.report.words import NO_FRICTION
from ballbot.results import to_results
from ballbot.robot import Robot
from ballbot.summary import counted
from ballbot.workflows.limits import RobotLimits, TwinLimit

#: width of the first, second, ... controller's lines: those beneath still show
_WIDTHS = (3.6, 2.8, 2.1, 1.5, 1.0, 0.6)
#: look of each: colour, marker of the twin's limits, and width
_LOOKS = [
    (LOOKS[look]["color"], mark, width) for look, mark, width in zip(TRACK_LOOKS, MARKS, _WIDTHS, strict=True)
]
#: that have looks of their own
MOST_CONTROLLERS = len(_LOOKS)
_DEGREES = 180.0 / np.pi


def planes_figure(limits: Mapping[str, RobotLimits]) -> Figure:
    """Draw the leans and lean rates that each controller recovers from, in its worst direction."""
    columns = min(3, len(limits))
    rows = -(-len(limits) // columns)
    figure = Figure(figsize=(7.4, 0.8 + 2.5 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in panels.flat[len(limits) :]:
        axes.set_visible(False)
    for axes, (name, result) in zip(panels.flat, limits.items(), strict=False):
        lean, rate = np.degrees(result.plane.leans), np.degrees(result.plane.rates)
        for recovers, color, style in ((result.plane.upper, UPPER, "--"), (result.plane.lower, LOWER, "-")):
            kept = recovers.T.astype(np.float64)
            axes.contourf(lean, rate, kept, levels=[0.5, 1.5], colors=[color])
            axes.contour(lean, rate, kept, levels=[0.5], colors=[INK], linewidths=0.8, linestyles=style)
        axes.axhline(0.0, color=MUTED, linewidth=0.6)
        axes.axvline(0.0, color=MUTED, linewidth=0.6)
        axes.set_title(f"{label_of(name)}, towards {np.degrees(result.plane.direction):.0f}°")
        axes.set_xlabel("tilt [deg]")
        axes.grid(visible=False)
    for axes in panels[:, 0]:
        axes.set_ylabel("tilt rate [deg/s]")
    figure.legend(
        handles=[
            Patch(facecolor=LOWER, edgecolor=INK, label="recovers, and no wheel slips"),
            Patch(facecolor=UPPER, edgecolor=INK, linestyle="--", label="recovers if wheels never slip"),
        ],
        loc="outside lower left",
        ncols=1,
    )
    return figure


def directions_figure(
    limits: Mapping[str, RobotLimits], on_twin: Mapping[str, Sequence[TwinLimit]]
) -> Figure:
    """Draw the largest tilt at rest and the largest impulse at the centre of mass over all directions."""
    figure = Figure(figsize=(7.4, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    for axes, kind, unit, title in (
        (left, "lean", _DEGREES, "tilt at rest [deg]"),
        (right, "impulse", 1.0, "impulse [N s]"),
    ):
        for (name, result), (color, mark, width) in zip(limits.items(), _LOOKS, strict=False):
            bounds = result.lean if kind == "lean" else result.central_impulse
            around = np.append(result.directions, result.directions[0] + 2.0 * np.pi)
            for sizes, dash, broad in ((bounds.lower, "-", width), (bounds.upper, "--", min(width, 1.6))):
                closed = unit * np.append(sizes, sizes[0])
                axes.plot(around, closed, color=color, linewidth=broad, linestyle=dash)
            for edge in on_twin.get(name, ()):
                if edge.kind == kind:
                    at = ([edge.direction], [unit * edge.twin])
                    axes.plot(*at, color=color, marker=mark, markersize=5, mec=INK, mew=0.6)
        axes.set_ylim(bottom=0.0)
        axes.set_title(title, loc="center", pad=14)
    handles = [
        Line2D([], [], color=color, marker=mark if on_twin else "", label=label_of(name), linewidth=width)
        for name, (color, mark, width) in zip(limits, _LOOKS, strict=False)
    ]
    handles.append(Line2D([], [], color=INK, linewidth=1.6, label="no wheel slips"))
    handles.append(Line2D([], [], color=INK, linewidth=1.2, linestyle="--", label="wheels never slip"))
    figure.legend(handles=handles, loc="outside lower left", ncols=2)
    return figure


def _on_twin(limit: TwinLimit, size: float) -> str:
    return f"{(_DEGREES if limit.kind == 'lean' else 1.0) * size:.1f}"


_TWIN: tuple[Column[tuple[str, TwinLimit]], ...] = (
    Column("controller", lambda row: row[0]),
    Column("limit", lambda row: "tilt [deg]" if row[1].kind == "lean" else "impulse [N s]"),
    Column("towards", lambda row: f"{np.degrees(row[1].direction):.0f}°"),
    Column("no wheel slips", lambda row: _on_twin(row[1], row[1].lower)),
    Column("on the twin", lambda row: _on_twin(row[1], row[1].twin)),
    Column("wheels never slip", lambda row: _on_twin(row[1], row[1].upper)),
)


def limits_report(
    robot: Robot,
    limits: Mapping[str, RobotLimits],
    on_twin: Mapping[str, Sequence[TwinLimit]],
    *,
    grip: float,
    scenario: str,
) -> Result:
    """Return the page."""
    twins = [(name, limit) for name, edges in on_twin.items() for limit in edges]
    meaning = ": up to the first number no wheel slips, up to the second if wheels never slip"
    verdict = [
        (name, f"Recovers in every direction from {result.words}{'' if k else meaning}.")
        for k, (name, result) in enumerate(limits.items())
    ]
    idle = len(limits) > 1 and not has_friction(robot.friction)
    play = "What play and sliding wheels take from the limits: `--twin` runs such a robot."
    directions = (
        "The largest tilt at rest, and the largest impulse at the centre of mass, by direction on the floor. Solid: no "
        f"wheel slips; dashed: wheels never slip.{' Marks: found on the twin.' if on_twin else ''}"
    )
    planes = (
        "The tilts and tilt rates that each controller recovers from, in its worst direction. Strong: no wheel slips; "
        "faint: only if wheels never slip. Without an outline, an area continues beyond what was tried."
    )
    return Result(
        title=f"{robot.name}: the largest tilts and impulses that it recovers from",
        lead=(
            f"{counted(len(limits), 'controller')}, friction coefficient of the wheels on the ball {grip:g}, sensors, "
            f"delay and noise of the scenario {scenario}."
        ),
        verdict=[*verdict, ("", NO_FRICTION if idle else "")],
        sections=[
            section("On the twin", sheet_of(twins, _TWIN) if twins else None),
            section(
                "Over all directions",
                drawn_picture("directions", directions, directions_figure, limits, on_twin),
            ),
            section("Tilt and tilt rate", drawn_picture("planes", planes, planes_figure, limits)),
        ],
        undecided=[
            "The limit between the two bounds: above the lower one a wheel slips somewhere, and what follows depends "
            "on its friction while it slips.",
            "The grip of the real wheels on the real ball: it is an assumption (`--grip`).",
            "" if on_twin else play,
        ],
        data={
            "robot": robot.name,
            "grip": grip,
            "scenario": scenario,
            "controllers": {
                name: to_results(result) | {"twin": on_twin.get(name, ())} for name, result in limits.items()
            },
        },
    )
