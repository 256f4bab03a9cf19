"""The page of an identification from balancing logs: parameters, friction, laws, and errors on held-out windows.

A wheel's friction is drawn over its speed, with the band that follows from the standard errors.

    tau(w) = b w + (c + s E) sgn(w),      E = exp(-r),      r = |w/v_s|^delta

The band is from the delta method: variance g' C g, with g the gradient of tau by (b, c, s, v_s, delta) and C their
covariance. A parameter without a standard error takes that of a uniform distribution over its interval.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from ballbot.arrays import Floats
from ballbot.findings import texts
from ballbot.fitting.model_selection import Gain
from ballbot.identification import HoldoutResult, Identification
from ballbot.identification.coulomb import coulomb_sentence
from ballbot.identification.holdout import FrictionAtHorizon
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import LawCandidate, LawSelection
from ballbot.log import Log
from ballbot.log.pose import measured_wheel_speeds
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.blocks import Block, Bullets, Column, Result, Sheet, details, section, sheet_of
from ballbot.report.palette import BLUE, MUTED
from ballbot.report.style import STATE_UNITS, drawn_picture
from ballbot.report.validation import correlation_figure
from ballbot.report.words import driveline_symbols, logs_words, state_mark
from ballbot.robot import Friction
from ballbot.rounding import digits, interval, unit_heading, value_and_error


def identification_report(
    fit: Identification,
    logs: Mapping[str, Log] = MappingProxyType({}),
    holdouts: Sequence[HoldoutResult] = (),
) -> Result:
    """Return the page, with the friction over the speeds of the logs and the errors on others."""
    one_log = "How much the estimate differs from log to log: there is one log."
    return Result(
        title=f"{fit.robot.name}: friction from balancing logs",
        lead=f"Identified from {logs_words(logs)}, with predictions over windows of {fit.window:g} s.",
        verdict=[("Verdict", fit.verdict.sentence), ("Friction", friction_sentence(fit))],
        sections=[
            section("Parameters", *parameter_blocks(fit, logs.values())),
            section("Friction laws", _selection_sheet(fit.selection) if fit.selection else None),
            details(
                "Errors on held-out windows",
                _error_sheet(fit, holdouts),
                *(_horizon_sheet(holdout) for holdout in holdouts if holdout.horizons),
            ),
        ],
        undecided=[
            *texts((*fit.findings, *(finding for holdout in holdouts for finding in holdout.findings))),
            one_log if fit.variation.logs == 1 else "",
            "The friction at speeds, loads and temperatures that the logs do not have.",
        ],
        findings=fit.log_findings,
        data={
            **fit.to_dict(),
            **({"ladder": fit.selection} if fit.selection else {}),
            **({"judged_on": {holdout.name: holdout for holdout in holdouts}} if holdouts else {}),
        },
    )


def parameter_blocks(fit: Identification, logs: Iterable[Log]) -> Iterator[Block]:
    """Yield the parameters, what they stand for, each wheel's friction, and the correlation of their errors."""
    yield _parameter_sheet(fit)
    if sentence := coulomb_sentence(fit.coulomb, fit.names):
        yield Bullets([sentence])
    caption = (
        "Friction of each wheel against its speed, with the 95 % band from the standard errors; below, the share of "
        "the logs at each speed."
    )
    yield drawn_picture("friction", caption, friction_figure, fit, tuple(logs))
    if np.isfinite(fit.correlation).any():
        caption = (
            "Correlation of the parameters' errors. A strong colour marks two parameters of which the data determine "
            "a combination better than either alone."
        )
        special = {"v_s": "$v_s$", "delta": r"$\delta$", "C_rr": "$C_{rr}$"}
        labels = [special.get(label, f"${label[0]}_{{{label[1:]}}}$") for label in fit.labels]
        yield drawn_picture("parameters", caption, correlation_figure, labels, fit.correlation)


def _parameter_sheet(fit: Identification) -> Sheet:
    """Return each parameter of the law with its standard error, both 95 % intervals, and the robot file's value."""
    layout, other = fit.layout, fit.other
    names = [name for name in layout.names for _ in BY_NAME[name].labels(layout.wheel_count)]
    values, errors = np.where(fit.unknown, np.nan, fit.values), fit.errors
    in_file = layout.nominal(fit.predictor.robot)
    rows = [
        (
            *(label, BY_NAME[name].unit, digits(float(in_file[i])), *value_and_error(values[i], errors[i])),
            *(
                interval(of[label].lower, of[label].upper) if label in of else ""
                for of in (fit.intervals, fit.variation.predictions)
            ),
            f"{100.0 * fit.file_share[i]:.0f} %" if np.isfinite(fit.file_share[i]) else "",
            fit.stands_for(name) or "",
            *([] if other is None else [digits(float(other.values[i]))]),
            f"{lower} to {upper}" if upper != lower else f"held at {lower}",
        )
        for i, (label, name) in enumerate(zip(fit.labels, names, strict=True))
        if name in fit.names
        for lower, upper in [map(digits, fit.bounds[i])]
    ]
    rolling = " C_rr: the ball's rolling friction over its load." * ("rolling" in fit.names)
    caption = (
        f"{driveline_symbols(fit.names)}{rolling} Standard errors contain the variation between logs. A dash: held "
        f"at a bound, or the logs do not show it. Open: the logs set no limit within the values allowed. From the "
        "file: share of the variance due to errors of the robot file's other values; the rest is the logs'."
    )
    headings = (
        *("parameter", "unit", "in the robot file", "found", "standard error", "95 %", "95 %, another log"),
        *("from the file", "stands also for"),
        *(["other optimum"] if other else []),
        "allowed",
    )
    return Sheet(headings, rows, caption, brief=(0, 3, 4, 5, 7, 1))


def _error_sheet(fit: Identification, holdouts: Sequence[HoldoutResult]) -> Sheet:
    """Return the open-loop errors of each state (RMSE), and those with over those without friction on other logs."""
    ours = fit.held_out
    rows = [
        (
            unit_heading(state_mark(state), STATE_UNITS[state]),
            *(digits(with_friction), digits(without), f"{ratio:.2f}"),
            *(f"{holdout.errors.with_over_without[state]:.2f}" for holdout in holdouts),
        )
        for (state, ratio), with_friction, without in zip(
            ours.with_over_without.items(), ours.rmse_with, ours.rmse_without, strict=True
        )
    ]
    others = "; with / without friction on other logs" if holdouts else ""
    return Sheet(
        ("state", "with friction", "without", "with / without", *(holdout.name for holdout in holdouts)),
        rows,
        f"Open-loop RMSE on {len(ours.spans)} held-out windows{others}",
    )


def _horizon_sheet(holdout: HoldoutResult) -> Sheet:
    """Return the errors of the wheels' speeds and of the lean by horizon, on another log."""
    columns: list[Column[FrictionAtHorizon]] = [
        Column("after, s", lambda row: f"{row.horizon:.3g}"),
        Column("wheel speed, rad/s", lambda row: row.wheel_speed.with_friction),
        Column("viscous part", lambda row: row.wheel_speed.viscous_part),
        Column("without friction", lambda row: row.wheel_speed.without_friction),
        Column("missing friction", lambda row: digits(row.wheel_speed.share, 2)),
        Column("lean, deg", lambda row: math.degrees(row.lean.with_friction)),
        Column("without friction", lambda row: math.degrees(row.lean.without_friction)),
        Column("missing friction", lambda row: digits(row.lean.share, 2)),
    ]
    caption = f"{holdout.name}, RMSE of {holdout.horizons[0].starts} predictions from its rows"
    return sheet_of(holdout.horizons, columns, caption=caption)


def _selection_sheet(selection: LawSelection) -> Sheet:
    """Return the laws with their errors and gains on windows held out."""
    decisions = {"accepted": "taken", "rejected": "no useful gain", "undecided": "the data cannot decide"}

    def shown(gain: Gain | None) -> str:
        return f"{100 * gain.share:.1f} % ({100 * gain.lower:.1f} to {100 * gain.upper:.1f})" if gain else ""

    columns: list[Column[LawCandidate]] = [
        Column("law", lambda candidate: candidate.law.name),
        Column("friction", lambda candidate: candidate.law.formula),
        Column("error", lambda candidate: f"{candidate.error:.3f}"),
        Column("compared with", lambda candidate: candidate.law.within or "no friction"),
        Column("gain, 95 % interval", lambda candidate: candidate.gain, shown),
        Column(
            "", lambda candidate: "best" if candidate is selection.best else decisions[candidate.decision]
        ),
    ]
    caption = "Friction laws on held-out windows: error relative to no friction."
    return sheet_of(selection.candidates, columns, caption=caption)


def friction_curve(fit: Identification, wheel: int, speed: Floats) -> tuple[Floats, Floats]:
    """Return the friction of a wheel (from 0) at speeds (k,) [rad/s] other than zero, and its standard error [N m]."""
    at = np.repeat(speed[:, None], fit.robot.wheel_count, axis=1)
    directed = bool(fit.robot.friction.coulomb_asymmetry)

    def torque(values: Floats) -> Floats:
        robot = fit.layout.robot_of(fit.robot, values, asymmetric=directed)
        return wheel_friction(at, robot.friction)[:, wheel]

    curve, step = torque(fit.values), 1e-5
    # differences; where a parameter is zero, to one side
    steps = step * np.where(fit.values == 0.0, 1.0, fit.values)
    moved = [torque(fit.values + change) for change in np.diag(steps)]
    gradient = (np.array(moved) - curve).T / steps
    variance = np.einsum("ki,ij,kj->k", gradient, fit.assumed_covariance, gradient)
    return curve, np.sqrt(np.maximum(variance, 0.0))


def friction_figure(fit: Identification, logs: Sequence[Log] = ()) -> Figure:
    """Return each wheel's friction over its speed with a 95 % band; below, how often the logs have such a speed."""
    n = fit.robot.wheel_count
    figure = Figure(figsize=(7.4, 3.1 if logs else 2.6), layout="constrained")
    heights = (3, 1) if logs else (1,)
    panels = figure.subplots(len(heights), n, sharex=True, sharey="row", height_ratios=heights, squeeze=False)
    fastest = 8.0 * fit.robot.friction.stribeck_speed
    if logs:
        speeds = np.concatenate([measured_wheel_speeds(log, fit.robot) for log in logs])
        speeds = speeds[np.isfinite(speeds).all(axis=1)]
        fastest = float(np.quantile(np.abs(speeds), 0.995))
        for axes, speed in zip(panels[1], speeds.T, strict=True):
            shares, edges = np.histogram(speed, bins=61, range=(-fastest, fastest))
            axes.stairs(100.0 * shares / len(speed), edges, fill=True, color=MUTED, alpha=0.55)
        panels[1, 0].set_ylabel("share of\nthe logs [%]")
    for wheel, axes in enumerate(panels[0]):
        for side in (-1.0, 1.0):
            speed = side * np.geomspace(1e-3, 1.0, 160) * fastest
            torque, error = friction_curve(fit, wheel, speed)
            low, high = torque - 1.96 * error, torque + 1.96 * error
            axes.fill_between(speed, low, high, color=BLUE, alpha=0.2, linewidth=0)
            axes.plot(speed, torque, color=BLUE, linewidth=1.4)
        axes.axhline(0.0, color=MUTED, linewidth=0.6)
        axes.axvline(0.0, color=MUTED, linewidth=0.6)
        axes.set_title(f"wheel {wheel + 1}")
    for axes in panels[-1]:
        axes.set_xlabel("wheel speed [rad/s]")
    panels[0, 0].set_ylabel("friction torque [N m]")
    return figure


def friction_sentence(fit: Identification) -> str:
    """Return the friction in words: of a wheel at rest and in motion, by direction and load, and of rolling."""
    friction = fit.robot.friction
    unlimited = [
        label for label, ends in fit.intervals.items() if np.isinf(ends.upper) and not ends.lower > 0.0
    ]
    rolling = f"the ball's rolling friction is {digits(fit.robot.rolling_force, 2)} N"
    words = [f"{_wheel_words(friction, float(fit.coulomb.speeds.max()))}; {rolling}."]
    for name, values in (("Coulomb", friction.coulomb_asymmetry), ("Stribeck", friction.stribeck_asymmetry)):
        if any(values):
            differs = f"differs by {_range(np.array(values))} N m from this mean of both directions"
            words.append(f"Forward, the {name} torque {differs}.")
    if any(friction.load):
        words.append(f"Each N m of motor torque adds {_range(np.array(friction.load))} N m of dry friction.")
    if unlimited:
        words.append(f"The logs do not limit {', '.join(unlimited)}: any value fits.")
    return " ".join(words)


def _wheel_words(friction: Friction, fastest: float) -> str:
    """Return a wheel's friction, in the mean of both directions, at rest and at the fastest speed of the logs."""
    coulomb, viscous = np.array(friction.coulomb), np.array(friction.viscous)
    if not any(friction.stribeck):
        if not coulomb.any():
            return f"The friction of a wheel is viscous only: {_range(viscous)} N m per rad/s"
        return f"The friction of a wheel is {_range(coulomb)} N m at any speed plus {_range(viscous)} N m per rad/s"
    shown = digits(fastest, 2)
    forward, backward = (
        wheel_friction(np.full(len(coulomb), side * float(shown)), friction) for side in (1.0, -1.0)
    )
    return (
        f"A wheel breaks away at {_range(coulomb + np.array(friction.stribeck))} N m and needs "
        f"{_range(0.5 * (forward - backward))} N m at {shown} rad/s"
    )


def _range(values: np.ndarray) -> str:
    upper = digits(float(values.max()), 2)
    lower = digits(float(values.min()), 2, beside=float(values.max()))
    return lower if lower == upper else f"{lower} to {upper}"
