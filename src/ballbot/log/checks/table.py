"""What the checks of a log say: by the key of a statistic, its limits and the sentence.

A statistic is a number that a function of this package takes from a log. It is a finding of the first severity whose
limit it exceeds, under the code before the key's colon. Faults of single rows stand in `ballbot.log.checks.values`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ballbot.findings import Finding, Severity, finding


class Check(NamedTuple):
    """The sentence on a statistic, with its numbers in braces, and the limits above which it is a finding."""

    text: str
    error: float = math.inf
    warning: float = math.inf
    note: float = math.inf


_IN_UNIT = "{name} varies {size:.3g} times as much as {rates} give: {column} is in {unit}, not in {right}."
CHECKS: Mapping[str, Check] = {
    # columns by themselves
    "rows": Check("The log has one row, which shows no motion; every use needs many rows.", error=0),
    "use": Check("Not enough for {use}: the log lacks the {columns}.", note=0),
    "unknown": Check("Columns that Ballbot does not know and does not use: {listed}.", note=0),
    "jitter": Check(  # standard deviation of the intervals over their median
        "The intervals between rows vary by {percent:.0f} % about {period:.4g} s (from {least:.4g} to {most:.4g} s); "
        "rates from differences will be noisy.", warning=0.05,
    ),
    "missing": Check(  # cells
        "{names}: {count} of {rows} values missing or not finite, the first at row {row} (t = {t:.6g} s); uses that "
        "need the column leave these rows out.", warning=0,
    ),
    "constant: all": Check(
        "No measurement and no torque changes in {duration:.3g} s: the robot is at rest throughout, or was not "
        "recorded. Record it while it moves.", warning=0,
    ),
    "dead-motor": Check(
        "{values} throughout though the robot balances and moves: a motor that is dead or off, or a torque that was "
        "not recorded. Identification and validation would use it as the torque that acted.", error=0,
    ),
    "constant: reference": Check("{name} is {value:g} throughout: the reference is constant.", note=0),
    "constant": Check(  # 2 if its rate, or its angle, changes
        "{name} is {value:g} throughout{though}, as if its sensor or cable were dead.", error=1, warning=0,
    ),
    "degrees: lean": Check(
        "The lean exceeds {limit:g} {times} times and reaches {peak:.3g}, which no balancing robot does in radians: "
        "theta and phi are in degrees, or the log continues after a fall (t = {t:.6g} s).", error=0,
    ),
    "fall": Check(
        "The robot falls or is caught: its lean exceeds {limit:g} rad at t = {t:.6g} s (row {row}); only the rows "
        "before show balancing.", warning=0,
    ),
    "lean-offset": Check(  # mean lean [rad]
        "theta and phi are ({theta:.2g}, {phi:.2g}) degrees on average, and a balancing robot's are near zero: the IMU "
        "is mounted at an angle or has a bias, the centre of mass lies off the axis, or the floor slopes. Subtract the "
        "mean, or correct the cause.", error=0.04, warning=0.025,
    ),
    "stuck": Check(  # [s], of columns of a robot that moves meanwhile: from 0.4 on, less the rounding of times
        "{names}: one value repeats for {lasting:.3g} s from row {row} (t = {t:.6g} s), and nearly all other rows "
        "differ: {cause}.", error=0.399, warning=-1,
    ),
    "held": Check(  # delay by repeated values [s]: from 0.04 on, less the rounding of times; duplicated rows: infinite
        "{names}: a new value comes only every {rows} rows, every {delay:.3g} s, and repeats in between: {cause}. "
        "Values are late by up to that time; keep one row of {rows}, interpolate, or log at their rate.",
        error=0.0399, warning=0,
    ),
    # columns against their rates
    "time-scale: reverse": Check(
        "All positions and angles change in the opposite direction to their rates: the rows are in reverse order of "
        "time. Sort them, or negate all rates.", error=0,
    ),
    "time-scale": Check(  # factor, or its inverse
        "Positions and angles all change {factor:.3g} times as much as the integrals of their rates over t: {cause}. "
        "By the rates, rows come every {by_rates:.3g} s, by t every {by_t:.4g}.", error=1.3,
    ),
    "time-scale: slow": Check(
        "Rows come every {by_t:.4g} s and no value continues from row to row: t is in ms or another unit, not in "
        "seconds, or the log was thinned out. No robot balances at such a rate.", error=0,
    ),
    "sign": Check(
        "{name} and {rates} have opposite signs (correlation {correlation:.2f}); negate one of them.", error=0,
    ),
    "degrees": Check(_IN_UNIT, error=0),
    "scale: unit": Check(_IN_UNIT, error=0),
    "scale": Check(  # factor, or its inverse: smaller ones may be noise
        "{name} varies {size:.3g} times as much as {rates} give: one of the two has a wrong scale, a delay or much "
        "noise.", error=4, warning=1.5,
    ),
    "swapped": Check(
        "{first} and {second} are swapped, or their rates are: each changes by the rate of the other.", error=0,
    ),
    # wheels against the states and the robot file
    "robot-sensors: period": Check(  # difference of the logarithms
        "Rows come every {period:.4g} ms, but sample_time of the robot file is {written:.4g} ms. Correct the robot "
        "file, or know that the log has another rate than the controller.", warning=0.05,
    ),
    "robot-sensors: counts": Check(  # difference of the logarithms
        "The wheels' angles come in steps of {step:.4g} rad: {seen:.4g} counts a motor turn with the gear ratio "
        "{ratio:g}, but encoder_counts of the robot file is {counts}. Correct encoder_counts or gear_ratio.",
        warning=0.02,
    ),
    "wheels: others": Check(
        "The log has values of {names}, but the robot has {count} wheels. Name the log's own robot.", error=0,
    ),
    "ball-axes": Check(
        _ROLLING := "The ball does not move as the wheels turn: {fault}. Correct the columns or the mapping.", error=0,
    ),
    "heading-sign": Check(_ROLLING, error=0),
    "wheels: unseen": Check(
        "The order and signs of the wheels cannot be checked: that needs the ten states, the speed of every wheel, and "
        "motion.", note=0,
    ),
    "encoders": Check(
        "{wheels} in the opposite direction: with the other sign the wheels agree with the lean and the heading. "
        "Correct the columns, or [wheels] in the mapping: sign = {signs} times what it is.", error=0,
    ),
    "wheels: weak": Check(
        "The wheel speeds hardly follow the states (correlations {correlations}): another robot, much slip, or a "
        "delay.", warning=0,
    ),
    "wheels: order": Check(
        "The wheel columns do not fit this robot; a mapping with [wheels] order = {order} and sign = {signs} would fit "
        "(correlations {correlations}).", error=0,
    ),
    "wheels: gain": Check(  # factor, or its inverse, over the largest that slip and play explain
        "The wheels turn {gains} times as fast as the states imply for this robot: {cause}.", error=1, warning=0,
    ),
    "stuck: encoder": Check(
        "{name} holds its value from {start:.6g} to {end:.6g} s though its wheel turns: the lean, the heading and the "
        "other wheels leave {times:.2g} times as much of the motion unexplained as elsewhere, and {percent:.0f} % of "
        "that is what turning of this wheel would do. The encoder or its cable failed, or messages were lost.",
        # Of 72 encoders stopped at random for 2.5 to 10 s all leave 2 to 39 times as much; true holds in the 12
        # recordings of the test half of campaigns/mapping_recordings.py leave at most 0.6 times as much
        error=2,
    ),
    "disturbance": Check(  # torque over gravity's, averaged over a quarter of a second
        "Something other than wheels and gravity moves the lean, {times:.1f} times as strongly as gravity: the log is "
        "good for predictions of a fraction of a second, but not for closed-loop or long open-loop validation.",
        warning=1,
    ),
    # lean and torques against the robot's equations
    "lean-axes": Check(
        "The lean does not fit the ball's acceleration: {causes}. With this correction the ball accelerates towards "
        "the lean, as under every balancing robot (the same mistake in x_dot, y_dot and the wheels would look the "
        "same). Correct the columns or the mapping.", error=0,
    ),
    "lean-scale": Check(
        "The ball accelerates {size:.3g} times as much as the lean implies: x, y, x_dot and y_dot are scaled (wheel "
        "radius, ball radius, gear ratio or encoder counts per turn), the height of the centre of mass differs from "
        "the robot file, theta and phi are scaled by {inverse:.3g}, or t is stretched.", error=0,
    ),
    "lean-axes: turn": Check(  # three standard errors below the angle [rad]
        "The ball accelerates {degrees:.0f} degrees to the {side} of the lean: the IMU is mounted turned about the "
        "vertical, or psi has another zero than x and y. Rotate the lean ([attitude] turn in a mapping).",
        error=math.radians(12),
    ),
    "physics": Check(
        "The signs and scales of lean and torques cannot be checked: the acceleration of the ball does not follow the "
        "lean clearly enough (too little motion, slipping wheels, or a robot that is held).", warning=0,
    ),
    "torque-delay": Check(  # [s]: the computing time of a controller and the group delay of a filter are below
        "The torques are {ms:.0f} ms too {late} in the log: they respond to the states {ms:.0f} ms {before}. The times "
        "of the torques or of the sensors are wrong; shift one of them ([input] delay or [attitude] delay in a "
        "mapping).", error=0.03,
    ),
    "torque-order": Check(
        _ORDER := "The torques do not fit the motion as logged: {fault}. With this correction they explain {after:.0f} "
        "% of the torque that the motion needs, as logged {before:.0f} %. Correct the columns or the mapping.",
        error=0.9,  # confidence in another order or other signs
    ),
    "torque-sign": Check(_ORDER, error=0.9),
    "torque-unrelated": Check(
        "{names}: the motion explains at most {percent:.0f} %, and no other order or signs fit. The torque is of "
        "another log, shifted in time, random, or not that of the motor.", error=0,
    ),
    "torque-scale: one": Check(
        "{name} is {factor:.2g} times as large as the other torques, relative to the torque that the motion of its "
        "wheel needs: its torque constant, gear ratio or unit differs, or its motor gives another torque than the "
        "command. Correct the scale of the column in a mapping.", error=0,
    ),
    "torque-scale": Check(  # five standard errors below the factor's logarithm
        "The torques are {factor:.2g} times as large as the motion of this robot needs: all are scaled (torque "
        "constant, gear ratio, current or per-unit values in place of N m), the recording clips them, or the robot is "
        "{heavier} than in the robot file.", error=math.log(1.25), warning=math.log(1.15),
    ),
    "torque-bound": Check(
        "The logs bound the scale of the torques only so far, relative to the others and the robot file: {bounds} (95 "
        "%). A wrong torque constant within that would not show, and would change the motor's friction as much. Runs "
        "that accelerate more bound it better.", warning=0,
    ),
    "robots": Check(
        "{odd} and {other} are of different robots: {quantity} is {factor:.2f} times as large in {odd} (relative to "
        "the robot file it is {of_odd} in {odd} and {of_other} in {other}). {cause} Use logs of one robot in one "
        "condition.", error=0,
    ),
}  # fmt: skip


def judged(
    key: str, size: float, columns: Sequence[str], numbers: Mapping[str, object], *, time: float | None = None
) -> list[Finding]:
    """Return the finding on a statistic of these columns; none if it is within the limits."""
    check = CHECKS[key]
    limits: dict[Severity, float] = {"error": check.error, "warning": check.warning, "note": check.note}
    over: list[Severity] = [severity for severity, limit in limits.items() if size > limit]
    code, text = key.partition(":")[0], check.text
    return [finding(code, over[0], text.format_map(numbers), *columns, time=time)] if over else []
