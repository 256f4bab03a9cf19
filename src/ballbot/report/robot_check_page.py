"""The page of a checked robot: its drawing, what follows from its parameters, a swing, and a reference."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ballbot.control.presets import PRESETS
from ballbot.report.blocks import (
    Block,
    Bullets,
    Paragraph,
    Report,
    Section,
    Sheet,
    Subheading,
    Verbatim,
    section,
)
from ballbot.report.console import matrix_text
from ballbot.report.loop import loop_section, poles_figure
from ballbot.report.provenance import Provenance
from ballbot.report.robot_check import (
    pole_sentence,
    poles_text,
    sources_sentence,
    uncertainty_sentence,
)
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import drawn_picture
from ballbot.report.words import with_symbols
from ballbot.robot.figure import robot_figure
from ballbot.rounding import digits, unit_heading
from ballbot.summary import counted
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
    state_order,
)


def robot_check_report(checked: CheckedRobot, made: Provenance) -> Report:
    """Return the page."""
    robot = checked.robot
    return Report(
        title=f"{robot.name}: check of the robot file",
        lead=f"A robot with {robot.wheel_count} wheels. {sources_sentence(robot)}",
        verdict=_verdict(checked),
        sections=list(_sections(checked)),
        undecided=_undecided(checked),
        made=made,
        findings=checked.findings,
    )


def _capital(sentence: str) -> str:
    return f"{sentence[0].upper()}{sentence[1:]}"


def _verdict(checked: CheckedRobot) -> list[tuple[str, str]]:
    errors = sum(one.severity == "error" for one in checked.findings)
    warnings = sum(one.severity == "warning" for one in checked.findings)
    plausible = (
        "Its numbers fit together."
        if not errors + warnings
        else (
            f"{counted(errors, 'error')} and {counted(warnings, 'warning')}: see the checks of the inputs below."
        )
    )
    verdict = [("Plausible", plausible), ("Poles", _capital(pole_sentence(checked.poles)))]
    if checked.spread:
        verdict.append(("How sure", uncertainty_sentence(checked.spread)))
    if checked.swing:
        quantity, value, unit = checked.swing.rows()[0]
        verdict.append(("Swing", _capital(f"{quantity}: {value} {unit}.")))
    if checked.following:
        verdict.append(
            (f"Following {checked.following.name}", " ".join(reference_verdict(checked.following)))
        )
    return verdict


def _sections(checked: CheckedRobot) -> Iterator[Section]:
    drawing = (
        "To scale, from its right and from above. The body appears as two discs with its mass and inertia."
    )
    rows = [
        (one.meaning, digits(one.value, 4), "" if one.unit == "1" else one.unit) for one in checked.derived
    ]
    yield section(
        "The robot",
        drawn_picture("robot", partial(robot_figure, checked.robot), drawing),
        Sheet(
            headings=("quantity", "value", "unit"),
            rows=rows,
            caption="Quantities that follow from the parameters.",
        ),
    )
    yield section(
        "How it falls",
        Paragraph(text=f"Poles about upright, exact model [rad/s]: {poles_text(checked.poles)}."),
        drawn_picture(
            "poles",
            partial(poles_figure, open_loop=checked.poles),
            "The same in the complex plane. Shaded: a pole there makes the robot fall.",
        ),
    )
    yield _loop_section(checked.loop)
    if checked.swing:
        yield _swing_section(checked.swing)
    if checked.following:
        yield _reference_section(checked.following)
    yield section(
        "Linear model",
        Paragraph(
            text="x_dot = A x + B u about upright, exact model, with the viscous friction of the robot file:"
        ),
        Bullets(items=with_symbols(state_order(checked.robot.wheel_count)).splitlines()),
        Verbatim(text=matrix_text("A", checked.linear.A)),
        Verbatim(text=matrix_text("B", checked.linear.B)),
    )
    yield section("Transformation matrices", *_matrices(checked))


def _loop_section(loop: CheckedLoop) -> Section:
    of = f"the {loop.controller} controller" if loop.controller in PRESETS else loop.controller
    if loop.margins is None:
        return section(f"Stability margins with {of}", Paragraph(text=loop.refusal))
    return loop_section(loop.margins, of=of)


def _matrices(checked: CheckedRobot) -> Iterator[Block]:
    for name, meaning in MATRICES.items():
        yield Subheading(text=f"{meaning[0].upper()}{meaning[1:]}")
        if name in MATRIX_EQUATIONS:
            yield Paragraph(text=f"In the thesis: {MATRIX_EQUATIONS[name]}.", quiet=True)
        yield Verbatim(text=matrix_text(name, checked.matrices[name]))


def _swing_section(swing: CheckedSwing) -> Section:
    return section(
        "The swing",
        Sheet(
            headings=("quantity", "value, 95 %", "unit"),
            rows=swing.rows(),
            caption=f"From {swing.fit.swing.source}.",
        ),
        Bullets(items=[one.text for one in (*swing.findings, *swing.inertia_findings())]),
        swing_series(swing),
    )


def swing_series(swing: CheckedSwing) -> TimeSeries:
    """Return the recording with the pendulum fitted to it, and their difference."""
    fit = swing.fit
    unit = "deg" if fit.swing.kind == "angle" else "deg/s"
    measured, fitted = (np.degrees(one - fit.values[5]) for one in (fit.swing.values, fit.predicted))
    lines = (
        Line(name="measured", values=measured, look="measured"),
        Line(name="pendulum fitted", values=fitted, look="second"),
    )
    what = "angle" if fit.swing.kind == "angle" else "rate"
    return TimeSeries(
        t=fit.swing.t - fit.swing.t[0],
        panels=(
            Panel(label=unit_heading(what, unit), lines=lines),
            Panel(
                label=unit_heading("measured less fitted", unit),
                lines=(Line(name="difference", values=measured - fitted, look="first"),),
            ),
        ),
        caption="The swing as recorded, and the pendulum with friction that was fitted to it.",
    )


def _reference_section(following: ReferenceMargins) -> Section:
    return section(
        f"Following {following.name}",
        Bullets(items=reference_verdict(following)),
        Sheet(headings=MARGIN_HEADINGS, rows=margin_rows(following), caption="Largest use of each limit."),
    )


def _undecided(checked: CheckedRobot) -> list[str]:
    """Return what a robot's file cannot show."""
    sentences = [
        "Whether the numbers are those of the machine: they are checked against one another, and a wrong value that "
        "fits the others is not found. Logs show more: `ballbot check-log LOG --robot ROBOT`."
    ]
    if checked.spread is None:
        sentences.append("How uncertain the pole is: no value in the file has a standard_deviation.")
    if checked.following:
        sentences.append(
            "How noise, delay and play change the run along the reference: `ballbot record` has them."
        )
    if checked.swing:
        sentences.append("The inertia about the vertical axis: the body does not turn about it in a swing.")
    return sentences
