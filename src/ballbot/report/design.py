"""A controller design as text, and the figure of a robust design: the search, and its gain on robots not used in it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import RenderableType
from rich.text import Text

from ballbot.control.overcompensation import CompensationMargin
from ballbot.report.console import matrix_text, table
from ballbot.report.palette import BLUE, GREEN, ORANGE, SHADE
from ballbot.report.style import LineStyle
from ballbot.robot import Friction
from ballbot.workflows.controller_design import ControllerDesign, frictionless_model
from ballbot.workflows.perturbed_robots import TAIL, PerturbationRanges
from ballbot.workflows.robot_check import state_order
from ballbot.workflows.robust_design import RobustDesign

_LINES: dict[str, LineStyle] = {
    "robust": {"color": BLUE, "linestyle": "-", "linewidth": 2.0},
    "nominal": {"color": ORANGE, "linestyle": "--", "linewidth": 1.4},
    "plain": {"color": GREEN, "linestyle": "-.", "linewidth": 1.4},
}
_LABELS = {"robust": "weights found", "nominal": "nominal weights", "plain": "plain LQR, Q = I and R = I"}


def robust_figure(found: RobustDesign) -> Figure:
    """Draw the best worst tenth over the generations, and each design's costs on the fresh robots in order of size."""
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    generations = np.arange(1, len(found.history) + 1)
    left.step(generations, found.history, where="post", **_LINES["robust"])
    left.set_ylim(0.0, 1.1 * found.history[0])
    left.set_xlabel("generation")
    left.set_ylabel("best worst tenth of J")
    left.set_title("the search")
    _draw_costs(right, found)
    return figure


def _draw_costs(axes: Axes, found: RobustDesign) -> None:
    axes.axvspan(100.0 * (1.0 - TAIL), 100.0, color=SHADE, label="worst tenth")
    for name, design in found.compared.items():
        share = 100.0 * (np.arange(len(design.costs)) + 0.5) / len(design.costs)
        axes.plot(share, np.sort(design.costs), label=_LABELS[name], **_LINES[name])
    axes.set_yscale("log")
    axes.set_yticks([1, 2, 5, 10, 20], labels=["1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(0.9, 1.3 * max(float(design.costs.max()) for design in found.compared.values()))
    axes.set_xlabel("share of the robots that cost less [%]")
    axes.set_ylabel("J")
    axes.set_title(f"{found.fresh} robots that the search had not seen")
    axes.legend(loc="upper left", fontsize=7.5)


def search_comment(found: RobustDesign, command: str) -> str:
    """Return the comment of a controller file on how its gain was found."""
    designs = {name: f"{one.worst_tenth:.3g}" for name, one in found.compared.items()}
    return (
        f"# Found by: {command}\n"
        f"# {_weights(found)}\n"
        f"# worst tenth of J on {found.fresh} fresh robots: {designs['robust']}; nominal gain {designs['nominal']}, "
        f"plain LQR {designs['plain']}\n\n"
    )


def robust_design_parts(found: RobustDesign, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the gain of a robust design, its comparison with other weights, and its own weights."""
    yield Text(matrix_text("K", found.controller.gain))
    headings = ("design", "worst tenth of J", "mean J", "worst error (mm)", "worst roughness (N m)", "falls")
    rows = [
        [
            name,
            f"{one.worst_tenth:.2f}",
            f"{one.mean:.2f}",
            f"{1e3 * one.worst_error:.1f}",
            f"{one.worst_roughness:.3f}",
            f"{one.falls}",
        ]
        for name, one in found.compared.items()
    ]
    title = f"On {found.fresh} perturbed robots that the search did not use"
    yield table(title, headings, rows, framed=framed)
    yield Text(_weights(found))
    yield Text(_perturbed_by(found.spread))


def _perturbed_by(spread: PerturbationRanges) -> str:
    """Return the sentence on the ranges or standard deviations of the perturbed mass, height and friction."""
    ranges = {"mass": spread.mass, "height": spread.height, "friction": spread.friction}
    known = [name for name, share in ranges.items() if share is None]
    ranged = [f"{name} within {100.0 * share:g} %" for name, share in ranges.items() if share is not None]
    drawn = [f"{' and '.join(known)} by the standard deviations in the robot's file"] if known else []
    return f"Perturbed robots: {'; '.join([*drawn, *ranged])}; --perturb changes a range."


def _weights(found: RobustDesign) -> str:
    weights = ", ".join(f"{weight:.4g}" for weight in found.state_weights)
    return f"Q = diag({weights}), R = {found.torque_weight:g} I"


def controller_design_parts(found: ControllerDesign, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the linear model, the gain with its standard deviation, the poles, and the compensation's margin."""
    robot, spread = found.controller.robot, found.uncertainty
    linear = frictionless_model(robot).linearize()
    yield Text("x_dot = A x + B u about upright, exact model without friction", style="bold")
    yield Text(state_order(robot.wheel_count))
    yield Text(matrix_text("A", linear.A))
    yield Text(matrix_text("B", linear.B))
    yield Text("\nGain", style="bold")
    yield Text(matrix_text("K", found.gain.gain))
    if spread.parts:
        causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in spread.largest())
        yield Text(f"\nStandard deviation of the gain, from those in the robot file ({causes}):\n")
        yield Text(matrix_text("+-", spread.deviation))
    rows = [[f"{pole.real:.4f}", f"{pole.imag:.4f}"] for pole in found.gain.poles]
    yield table("Closed-loop poles (rad/s)", ["real", "imaginary"], rows, framed=framed)
    if found.certain is not found.stated:
        yield Text(_certain_fractions(found.stated, found.certain))
    if found.controller.compensation != "none":
        yield Text(_margin(found.margin))


def _certain_fractions(stated: Friction, certain: Friction) -> str:
    fractions = [
        f"{100.0 * less / whole:.0f} %" if whole else "none"
        for less, whole in zip(certain.coulomb, stated.coulomb, strict=True)
    ]
    return (
        "\nOnly the friction that is certain is compensated, "
        f"as a fraction of each wheel's: {', '.join(fractions)}"
    )


def _margin(margin: CompensationMargin) -> str:
    """Return the compensated fraction of the certain friction, and a warning if it exceeds that friction."""
    fractions = ", ".join(
        f"{100.0 * share:.0f} %" for share in (*margin.wheel_fractions, margin.rolling_fraction)
    )
    amplitudes = ", ".join(f"{one.amplitude:g}" for one in margin.swings)
    returned = ", ".join(f"{100.0 * one.fraction:.0f} %" for one in margin.swings)
    text = (
        f"Largest compensated fraction of each wheel's friction and of the rolling friction: {fractions}\n"
        "Largest fraction of the energy dissipated by friction that compensation returns to a wheel oscillating "
        f"by {amplitudes} rad/s: {returned}"
    )
    return (
        f"{text}\nWARNING: {margin.sentence}; this injects energy and can destabilise the robot"
        if margin.overcompensates
        else text
    )
