"""A designed excitation: its run over time, its limits and the expected errors."""

import numpy as np

from ballbot.identification.quantities import BY_NAME
from ballbot.report.blocks import Result, Sheet, details, section
from ballbot.report.series import Line, Panel, TimeSeries, wheel_lines
from ballbot.robot.parameters import DIMENSIONLESS
from ballbot.rounding import digits
from ballbot.workflows.excite import Excitation
from ballbot.workflows.metrics import leans


def excitation_report(result: Excitation) -> Result:
    """Return the page."""
    task, limits = result.task, result.task.limits
    runs = {**result.peaks, **{f"{name}, loop": trial.peaks for name, trial in result.on_loop.items()}}
    peaks = [
        (name, *(factor * getattr(values, key) for values in (limits, *runs.values())))
        for key, name, factor in (
            ("lean", "lean [deg]", 180.0 / np.pi),
            ("floor", "floor [m]", 1.0),
            ("torque", "torque [N m]", 1.0),
        )
    ]
    units = {
        label: quantity.unit.removeprefix(DIMENSIONLESS)
        for quantity in BY_NAME.values()
        for label in quantity.labels(task.robot.wheel_count)
    }
    columns = [task.in_units(errors).tolist() for errors in result.errors.values()]
    errors = [
        (label, units[label], assumed, *(digits(error, 2) for error in expected))
        for label, assumed, *expected in zip(task.labels, task.assumed.tolist(), *columns, strict=True)
    ]
    caption = (
        "Standard errors expected of a square and of the design: the least that are possible with the noise assumed, "
        "to compare runs by."
    )
    return Result(
        title=f"{task.robot.name}: an informative excitation",
        lead=(
            f"{task.duration:.0f} s within {np.degrees(limits.lean):.2g}° of lean, {limits.floor:g} m of floor "
            f"and {limits.torque:.3g} N m of torque."
        ),
        verdict=[("", _verdict(result))],
        sections=[
            section(
                "The run",
                Sheet(("quantity", "limit", *runs), peaks, "Limits, and the largest values of each run"),
                _followed_series(result),
            ),
            details(
                "Expected errors", Sheet(("parameter", "unit", "assumed", *result.errors), errors, caption)
            ),
        ],
        undecided=[
            "How much the real robot's friction differs from the file's, with which the errors are computed.",
            "Whether the real robot stays within the limits: the simulation is not the robot. Have a hand near it.",
        ],
        data=result.to_dict(),
    )


def _verdict(result: Excitation) -> str:
    gain = gain_sentence(float(result.errors["square"].max() / result.errors["designed"].max()))
    trial, on_loop = result.on_loop["designed"], "The loop with sensors stayed within all limits."
    if trial.ended:
        on_loop = f"On the loop with sensors a run ended early: {trial.ended}. Lower the limits."
    elif exceeded := " and ".join(trial.peaks.exceeding(result.task.limits)):
        on_loop = f"The loop with sensors exceeded the limit on {exceeded}; lower that limit."
    return f"{gain} {on_loop}"


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


def _followed_series(result: Excitation) -> TimeSeries:
    """Return reference, lean and torques over time on the loop, with the limits."""
    limits, log = result.task.limits, result.on_loop["designed"].log
    x, y, psi = result.sines.poses()[: len(log), :3].T
    reference = [Line("x [m]", x, "fifth"), Line("y [m]", y, "sixth"), Line("ψ [rad]", psi, "quiet")]
    lean, most = Line("lean", np.degrees(leans(log)), "measured"), float(np.degrees(limits.lean))
    torques, torque = wheel_lines(list(log.torques.T)), limits.torque
    return TimeSeries(
        log.t,
        (
            Panel("reference [m, rad]", reference),
            Panel("lean [deg]", (lean,), levels=(most,), from_zero=True),
            Panel("torques [N m]", torques, levels=(-torque, torque)),
        ),
        "Reference, lean and torques on the loop.",
        level="limit",
    )
