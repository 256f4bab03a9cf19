"""A designed excitation: its run over time, its limits and the expected errors."""

from __future__ import annotations

import numpy as np

from ballbot.identification.quantities import BY_NAME
from ballbot.report.blocks import Result, Sheet, details, section
from ballbot.report.series import Line, Panel, TimeSeries, wheel_lines
from ballbot.robot.parameters import DIMENSIONLESS
from ballbot.rounding import digits, unit_heading
from ballbot.workflows.excite import Excitation
from ballbot.workflows.metrics import leans

#: how a limit is shown: its unit, and by what its SI number is multiplied
_SHOWN = {"lean": ("deg", 180.0 / np.pi), "floor": ("m", 1.0), "torque": ("N m", 1.0)}


def _limits_table(result: Excitation) -> Sheet:
    """Return each limit with the peaks of the square and of the design, on the model and on the loop."""
    runs = {**result.peaks, **{f"{name}, loop": one.peaks for name, one in result.on_loop.items()}}
    shown = (result.task.limits, *runs.values())
    rows = [
        (unit_heading(name, unit), *(digits(factor * getattr(one, name)) for one in shown))
        for name, (unit, factor) in _SHOWN.items()
    ]
    caption = "Limits, and the largest values of each run"
    return Sheet(headings=("quantity", "limit", *runs), rows=rows, caption=caption)


def _errors_table(result: Excitation) -> Sheet:
    """Return the standard errors expected."""
    task = result.task
    quantities = {label: one for one in BY_NAME.values() for label in one.labels(task.robot.wheel_count)}
    columns = [task.in_units(errors).tolist() for errors in result.errors.values()]
    rows = [
        (
            *(label, quantities[label].unit.removeprefix(DIMENSIONLESS), digits(believed)),
            *(digits(one, 2) for one in errors),
        )
        for label, believed, *errors in zip(task.labels, task.believed.tolist(), *columns, strict=True)
    ]
    headings = ("parameter", "unit", "assumed", *result.errors)
    caption = (
        "Standard errors expected of a square and of the design: the least that are possible with the noise assumed, "
        "to compare runs by."
    )
    return Sheet(headings=headings, rows=rows, caption=caption)


def _verdict(result: Excitation) -> str:
    gain = gain_sentence(float(result.errors["square"].max() / result.errors["designed"].max()))
    trial = result.on_loop["designed"]
    exceeded = trial.peaks.exceeding(result.task.limits)
    if trial.ended:
        return f"{gain} On the loop with sensors a run ended early: {trial.ended}. Lower the limits."
    if exceeded:
        limits = " and ".join(exceeded)
        return f"{gain} The loop with sensors exceeded the limit on {limits}; lower that limit."
    return f"{gain} The loop with sensors stayed within all limits."


def gain_sentence(gain: float) -> str:
    """Return the sentence on the ratio of a square's worst standard error to the design's."""
    if not np.isfinite(gain):
        return (
            "With a square of the same length some parameters cannot be identified; with the design all can."
        )
    if gain < 1.0:
        return (
            f"The worst expected standard error is {1.0 / gain:.1f} times a square's, so the "
            "square is more informative. Drive that."
        )
    return f"The worst expected standard error is {gain:.1f} times smaller than a square's."


def excitation_report(result: Excitation) -> Result:
    """Return the page."""
    limits = result.task.limits
    return Result(
        title=f"{result.task.robot.name}: an informative excitation",
        lead=(
            f"{result.task.duration:.0f} s within {np.degrees(limits.lean):.2g}° of lean, {limits.floor:g} m of floor "
            f"and {limits.torque:.3g} N m of torque."
        ),
        verdict=[("", _verdict(result))],
        sections=[
            section("The run", _limits_table(result), _followed_series(result)),
            details("Expected errors", _errors_table(result)),
        ],
        undecided=[
            "How much the real robot's friction differs from the file's, with which the errors are computed.",
            "Whether the real robot stays within the limits: the simulation is not the robot. Have a hand near it.",
        ],
        data=result.to_dict(),
    )


def _followed_series(result: Excitation) -> TimeSeries:
    """Return reference, lean and torques over time on the loop, with the limits."""
    limits, log = result.task.limits, result.on_loop["designed"].log
    poses = result.design.sines.poses()
    asked = [
        Line("x [m]", poses[: len(log), 0], "fifth"),
        Line("y [m]", poses[: len(log), 1], "sixth"),
        Line("ψ [rad]", poses[: len(log), 2], "quiet"),
    ]
    lean, most = Line("lean", np.degrees(leans(log)), "measured"), float(np.degrees(limits.lean))
    torques = wheel_lines(list(log.torques.T))
    return TimeSeries(
        t=log.t,
        panels=(
            Panel(label="reference [m, rad]", lines=asked),
            Panel(label="lean [deg]", lines=(lean,), levels=(most,), from_zero=True),
            Panel(label="torques [N m]", lines=torques, levels=(-limits.torque, limits.torque)),
        ),
        caption="Reference, lean and torques on the loop.",
        level="limit",
    )
