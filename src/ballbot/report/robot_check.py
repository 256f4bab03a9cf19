"""A checked robot as text: derived quantities, matrices, poles, their uncertainty, a swing, a reference, a drawing."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.text import Text

from ballbot.control.margins import MEANING
from ballbot.control.presets import PRESETS
from ballbot.report.blocks import table
from ballbot.report.console import finding_line, matrix_text
from ballbot.report.loop import margins_table
from ballbot.robot import Robot
from ballbot.robot.derived import Derived
from ballbot.robot.drawing import robot_drawing
from ballbot.workflows.reference_check import (
    MARGIN_HEADINGS,
    ReferenceMargins,
    margin_rows,
    reference_verdict,
)
from ballbot.workflows.robot_check import (
    MATRICES,
    MATRIX_EQUATIONS,
    CheckedLoop,
    CheckedRobot,
    CheckedSwing,
    PoleSpread,
    state_order,
)


def robot_check_parts(checked: CheckedRobot) -> list[RenderableType]:
    """Return what `ballbot check` prints of a robot, top to bottom."""
    robot = checked.robot
    rows = [[one.meaning, f"{one.value:.5g}", _unit(one)] for one in checked.derived]
    parts: list[RenderableType] = [
        Text(f"{robot.name}: a robot with {robot.wheel_count} wheels. {sources_sentence(robot)}"),
        *(finding_line(one, accepted=one.severity == "error") for one in checked.findings),
        Text(""),
        table("Derived quantities", ("quantity", "value", "unit"), rows),
        Text("\nTransformation matrices", style="bold"),
    ]
    for name, meaning in MATRICES.items():
        heading = f"\n{meaning} {MATRIX_EQUATIONS.get(name, '')}".rstrip()
        parts += [Text(heading), Text(matrix_text(name, checked.matrices[name]))]
    parts += [
        *_linear_lines(checked),
        *_pole_lines(checked.poles),
        Text(uncertainty_sentence(checked.spread)),
    ]
    parts += _loop_parts(checked.loop)
    if checked.swing:
        parts += _swing_parts(checked.swing)
    if checked.following:
        parts += _reference_parts(checked.following)
    return [*parts, Text("\nDrawing", style="bold"), Text(robot_drawing(robot))]


def _unit(one: Derived) -> str:
    return "" if one.unit == "1" else one.unit


def _linear_lines(checked: CheckedRobot) -> list[Text]:
    return [
        Text("\nLinear model x_dot = A x + B u about upright, exact model", style="bold"),
        Text(state_order(checked.robot.wheel_count)),
        Text(matrix_text("A", checked.linear.A)),
        Text(matrix_text("B", checked.linear.B)),
    ]


def sources_sentence(robot: Robot) -> str:
    """Return how many of a robot's parameters are measured, estimated and so on."""
    kinds = Counter(source.partition(":")[0] for source in robot.sources.values())
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    return f"Sources of its parameters: {counts}."


def _loop_parts(loop: CheckedLoop) -> list[RenderableType]:
    preset = loop.controller in PRESETS
    title = (
        f"\nLoop with the {loop.controller} controller"
        if preset
        else f"\nLoop with the controller {loop.controller}"
    )
    if loop.margins is None:
        return [Text(title, style="bold"), Text(loop.refusal)]
    return [Text(title, style="bold"), margins_table(loop.margins), Text(MEANING)]


def _pole_lines(poles: NDArray[np.complex128]) -> list[Text]:
    return [
        Text("\nPoles about upright, exact model [rad/s]", style="bold"),
        Text(poles_text(poles)),
        Text(pole_sentence(poles)),
    ]


def poles_text(poles: NDArray[np.complex128]) -> str:
    """Return poles with three decimals, separated by commas."""
    # adding zero keeps a minus sign off what prints as nothing
    rounded = np.round(poles, 3) + 0.0
    return ", ".join(f"{pole.real:g}{f'{pole.imag:+g}j' if pole.imag else ''}" for pole in rounded)


def pole_sentence(poles: NDArray[np.complex128]) -> str:
    """Return the fastest growth, and how soon a lean doubles by it."""
    fastest = float(poles[0].real)
    time = f"; a lean doubles in {np.log(2.0) / fastest:.3f} s" if fastest > 0.0 else ""
    return f"unstable pole: {fastest:.3f} rad/s{time}."


def uncertainty_sentence(spread: PoleSpread | None) -> str:
    """Return how the standard deviations in the file spread the pole."""
    if spread is None:
        return (
            "No value in the file has a standard_deviation; with some, "
            "the standard deviation of the pole would be shown here."
        )
    largest = list(spread.variance_shares.items())[:3]
    causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in largest)
    low, high = spread.interval_95
    return (
        "From the standard deviations in the file, its standard deviation is "
        f"{spread.standard_deviation:.2g} rad/s, and it lies between {low:.3g} "
        f"and {high:.3g} in 95 % of {spread.draws} draws ({causes})."
    )


def _swing_parts(swing: CheckedSwing) -> list[RenderableType]:
    headings = ("quantity", "value, 95 %", "unit")
    title = f"Swing from {swing.fit.swing.source}"
    return [
        Text(""),
        table(title, headings, swing.rows()),
        *(finding_line(one, accepted=one.severity == "error") for one in swing.findings),
        *(Text(one.text) for one in swing.inertia_findings()),
    ]


def _reference_parts(margins: ReferenceMargins) -> list[RenderableType]:
    found = table("Largest use of each limit", MARGIN_HEADINGS, margin_rows(margins))
    sentences = [Text(line) for line in reference_verdict(margins)]
    return [Text(f"\nFollowing {margins.name}", style="bold"), *sentences, found]
