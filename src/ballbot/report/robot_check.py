"""A checked robot: its derived quantities, poles and margins, a swing, its linear model and matrices."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from ballbot.control.presets import KINDS
from ballbot.findings import by_severity, texts
from ballbot.mechanics.model import Model
from ballbot.report.bench import swing_series
from ballbot.report.blocks import (
    Bullets,
    Paragraph,
    Result,
    Section,
    Sheet,
    Verbatim,
    details,
    matrix_text,
    section,
)
from ballbot.report.design import linear_section, loop_section
from ballbot.report.style import drawn_picture
from ballbot.report.words import capital
from ballbot.robot.components import PARAMETERS
from ballbot.robot.derived import derived_quantities
from ballbot.robot.figure import robot_figure
from ballbot.robot.parameters import value_of
from ballbot.robot.variations import Propagated
from ballbot.summary import counted, pole_words
from ballbot.workflows.robot_check import MATRICES, CheckedRobot, linearization_results


def robot_check_report(checked: CheckedRobot) -> Result:
    """Return the page."""
    robot, swing = checked.robot, checked.swing
    margins = {"refusal": checked.margins} if isinstance(checked.margins, str) else checked.margins.to_dict()
    kinds = Counter(source.partition(":")[0] for source in robot.sources.values())
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    severities = [finding.severity for finding in (*checked.findings, *(swing.findings if swing else ()))]
    errors, warnings = map(severities.count, ("error", "warning"))
    doubtful = f"{counted(errors, 'error')} and {counted(warnings, 'warning')} of the checks."
    fastest = float(checked.poles[0].real)
    time = f"; a lean doubles in {np.log(2.0) / fastest:.3f} s" if fastest > 0.0 else ""
    vertical = "The inertia about the vertical axis: the body does not turn about it in a swing."
    return Result(
        title=f"{robot.name}: check of the robot file",
        lead=f"A robot with {robot.wheel_count} wheels. Sources of its parameters: {counts}.",
        verdict=[
            ("Doubtful", doubtful) if errors + warnings else ("Plausible", "Its numbers fit together."),
            ("Unstable pole", f"{fastest:.3f} rad/s{time}. {_uncertainty(fastest, checked.spread)}"),
            ("Swing", " ".join(texts(swing.findings)) or f"{swing.notes()[0].text}" if swing else ""),
        ],
        sections=list(_sections(checked)),
        undecided=[
            "Whether the numbers are those of the machine: they are checked against one another, and a wrong value "
            "that fits the others is not found. Logs show more: `ballbot check-log LOG --robot ROBOT`.",
            vertical if swing else "",
        ],
        findings=checked.findings,
        data={
            "robot": robot.name,
            "parameters": {
                parameter.name: value
                for parameter in PARAMETERS
                if (value := value_of(robot, parameter)) != ()
            },
            "derived": {quantity.name: quantity.value for quantity in derived_quantities(robot)},
            "matrices": checked.matrices,
            "linearization": linearization_results(Model(robot)),
            "poles": checked.poles,
            "unstable_pole": fastest,
            "standard_deviations": robot.standard_deviations,
            "unstable_pole_uncertainty": checked.spread
            and {
                "standard_deviation": checked.spread.deviation,
                "interval_95": _interval(fastest, checked.spread),
                "variance_shares": dict(checked.spread.largest(len(checked.spread.parts))),
            },
            "loop_margins": {"controller": checked.controller, **margins},
            "findings": by_severity(checked.findings),
            "swing": swing,
        },
    )


def _interval(pole: float, spread: Propagated) -> tuple[float, float]:
    """Return the interval of 95 % about a pole."""
    half = 1.96 * spread.deviation
    return pole - half, pole + half


def _uncertainty(pole: float, spread: Propagated | None) -> str:
    """Return how the standard deviations in the file spread the pole."""
    if spread is None:
        return "Its uncertainty is unknown: no value in the file has a standard_deviation."
    causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in spread.largest())
    low, high = _interval(pole, spread)
    return (
        "From the standard deviations in the file, its standard deviation is "
        f"{spread.deviation:.2g} rad/s ({causes}), and its 95 % interval {low:.3g} to {high:.3g}."
    )


def _sections(checked: CheckedRobot) -> Iterator[Section]:
    robot = checked.robot
    to_scale = (
        "To scale, from its right and from above. The body appears as two discs with its mass and inertia."
    )
    derived = [
        (quantity.meaning, f"{quantity.value:.5g}", quantity.unit.removeprefix("1"))
        for quantity in derived_quantities(robot)
    ]
    yield section(
        "Derived quantities",
        drawn_picture("robot", to_scale, robot_figure, robot),
        Sheet(("quantity", "value", "unit"), derived),
        Verbatim(f"Poles about upright, exact model [rad/s]: {pole_words(checked.poles)}"),
    )
    of = f"the {checked.controller} controller" if checked.controller in KINDS else checked.controller
    if isinstance(checked.margins, str):
        yield section(f"Stability margins with {of}", Paragraph(checked.margins))
    else:
        yield loop_section(checked.margins, of=of)
    if swing := checked.swing:
        yield section(
            "The swing",
            Sheet(("quantity", "value, 95 %", "unit"), swing.rows(), f"From {swing.fit.swing.source}."),
            Bullets([finding.text for finding in (*swing.findings, *swing.notes())]),
            swing_series(swing.fit),
        )
    caption = "exact model, with the viscous friction of the robot file"
    yield linear_section(Model(robot).linearize(), caption=caption)
    matrices = (
        Verbatim(matrix_text(name, checked.matrices[name]), f"{capital(words)}.")
        for name, words in MATRICES.items()
    )
    yield details("Transformation matrices", *matrices)
