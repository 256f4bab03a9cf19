"""What the checks of a log say: by the key of a statistic, its limits and the sentence, with its numbers in braces.

A statistic is a number that a function of this package takes from a log. It is a finding of the first severity whose
limit it exceeds, under the code before the key's colon.
"""

import math
from collections.abc import Mapping, Sequence

from ballbot.findings import Finding, Severity, finding

_IN_UNIT = (
    "{name} varies {size:.3g} times as much as {rates} would make it: {column} looks like {unit}, not {right}. If so, "
    'write unit = "{unit}" for it into a mapping.'
)
_ROLLING = "The ball does not move as the wheels turn: {fault}. Correct the columns or the mapping."
_ORDER = (
    "The torques do not fit the motion as logged: {fault}. With this correction they explain {after:.0f} % of the "
    "torque that the motion needs, as logged {before:.0f} %. Correct the columns or the mapping."
)
_WITHIN = (
    "{fault}: this explains {percent:.0f} % of the difference between the logged torques and those that the motion "
    "then needs. Check the columns, the motor, its driver and its cables, and use only the other rows."
)
#: evidence of a fault within a log: at most 1.5 of the 449 sound logs that it was chosen on (campaigns/motor_faults.py)
_FAULT: Mapping[Severity, float] = {"error": 4.0}
CHECKS: Mapping[str, tuple[Mapping[Severity, float], str]] = {
    # single rows: {rows} over the limit, the first with its {place} and {value}, and the {largest} statistic
    "gap": ({"warning": 0},
        "Rows are missing in {rows}, first for {first:.4g} s after {place}, at most for {largest:.4g} s, while rows "
        "come every {period:.4g} s; windows must not span them."),
    "spike": ({"warning": 0},
        "{name} jumps away and back in {rows}, to {value:.6g} at {place}: a corrupted message, a failed reading, or a "
        "marker of missing values, which a mapping file can name."),
    "wrap": ({"warning": 0},
        "{name} jumps by a full turn in {rows}, first at {place}: it is wrapped. Unwrap it (numpy.unwrap) before use."),
    "jump": ({"error": 1},  # change over the least jump
        "{name} jumps in {rows}, first to {value:.3g} {unit} at {place}, which its rate does not explain: joined logs, "
        "a restart, or a sensor that was reset. Split the log there."),
    "saturation": ({"warning": 2},  # rows
        "{name} stays at its largest value, {value:.4g} N m, in {rows}, first at {place}: it is saturated there, or "
        "the recording clips it, and it does not follow the control law."),
    "torque-limit": ({"warning": 1.01},  # over the robot's limit, with the rounding of files
        "{name} is above the robot's limit of {torque:.4g} N m in {rows}, first at {place}: the input may not be a "
        "torque, or the limit in the robot file is too low."),
    "speed-limit": ({"warning": 1},  # over the robot's limit
        "{name} is above {speed:.4g} rad/s, the limit of the robot's supply and motors, in {rows}, first at {place}: "
        "the commanded torque is not the torque that acted."),
    # columns by themselves
    "rows": ({"error": 0}, "The log has one row, which shows no motion; every use needs many rows."),
    "use": ({"note": 0}, "Not enough for {use}: the log lacks the {columns}."),
    "unknown": ({"note": 0}, "Columns that Ballbot does not know and does not use: {listed}."),
    "jitter": ({"warning": 0.05},  # standard deviation of the intervals over their median
        "The intervals between rows vary by {percent:.0f} % about {period:.4g} s (from {least:.4g} to {most:.4g} s); "
        "rates from differences will be noisy."),
    "missing": ({"warning": 0},  # cells
        "{names}: {count} of {rows} values missing or not finite, the first at {place}; uses that "
        "need the column leave these rows out."),
    "copied": ({"error": 0},
        "{one} and {other} have the same values: one of the two was recorded twice, in place of the other."),
    "constant: all": ({"warning": 0},
        "No measurement and no torque changes in {duration:.3g} s: the robot is at rest throughout, or was not "
        "recorded. Record it while it moves."),
    "dead-motor": ({"error": 0},
        "{values} throughout though the robot balances and moves: a motor that is dead or off, or a torque that was "
        "not recorded. Identification and validation would use it as the torque that acted."),
    "constant: reference": ({"note": 0}, "{name} is {value:g} throughout: the reference is constant."),
    "constant": ({"error": 1, "warning": 0},  # 2 if its rate, or its angle, changes
        "{name} is {value:g} throughout{though}, as if its sensor or cable were dead."),
    "degrees: lean": ({"error": 0},
        "The lean exceeds {limit:g} {times} times and reaches {peak:.3g}, which no balancing robot does in radians: "
        "theta and phi are in degrees, or the log continues after a fall (t = {t:.6g} s)."),
    "fall": ({"warning": 0},
        "The robot falls or is caught: its lean exceeds {limit:g} rad at t = {t:.6g} s (row {row}); only the rows "
        "before show balancing."),
    "lean-offset": ({"error": 0.04, "warning": 0.025},  # mean lean [rad]
        "theta and phi are ({theta:.2g}, {phi:.2g}) degrees on average, and a balancing robot's are near zero: the IMU "
        "is mounted at an angle or has a bias, the centre of mass lies off the axis, or the floor slopes. Subtract the "
        "mean, or correct the cause."),
    # [s], of columns of a robot that moves meanwhile: from 0.4 on, less the rounding of times
    "stuck": ({"error": 0.399, "warning": -1},
        "{names}: one value repeats for {lasting:.3g} s from {place}, and nearly all other rows "
        "differ: {cause}."),
    # delay by repeated values [s]: from 0.04 on, less the rounding of times; duplicated rows: infinite
    "held": ({"error": 0.0399, "warning": 0},
        "{names}: a new value comes only every {rows} rows, every {delay:.3g} s, and repeats in between: {cause}. "
        "Values are late by up to that time; keep one row of {rows}, interpolate, or log at their rate."),
    # columns against their rates
    "time-scale: reverse": ({"error": 0},
        "All positions and angles change in the opposite direction to their rates: the rows are in reverse order of "
        "time. Sort them, or negate all rates."),
    "time-scale": ({"error": 1.3},  # factor, or its inverse
        "Positions and angles all change {factor:.3g} times as much as the integrals of their rates over t: {cause}. "
        "By the rates, rows come every {by_rates:.3g} s, by t every {by_t:.4g}."),
    "sign": ({"error": 0},
        "{name} and {rates} have opposite signs (correlation {correlation:.2f}); negate one of them."),
    "degrees": ({"error": 0}, _IN_UNIT),
    "scale: unit": ({"error": 0}, _IN_UNIT),
    "scale: changes": ({"error": 0},
        "{name} does not follow {name}_dot, but its running sum does: it is the change from row to row. Log its sum."),
    "scale": ({"error": 4, "warning": 1.5},  # factor, or its inverse: smaller ones may be noise
        "{name} varies {size:.3g} times as much as {rates} give: one of the two has a wrong scale, a delay or much "
        "noise."),
    "swapped": ({"error": 0},
        "{first} and {second} are swapped, or their rates are: each changes by the rate of the other."),
    # wheels against the states and the robot file
    "robot-sensors: period": ({"warning": 0.02},  # difference of the logarithms: four deviations of a clock
        "Rows come every {period:.4g} ms, but sample_time of the robot file is {written:.4g} ms. Correct the robot "
        "file, or know that the log has another rate than the controller."),
    "robot-sensors: counts": ({"warning": 0.02},  # difference of the logarithms
        "The wheels' angles come in steps of {step:.4g} rad: {seen:.4g} counts a motor turn with the gear ratio "
        "{ratio:g}, but encoder_counts of the robot file is {counts}. Correct encoder_counts or gear_ratio."),
    "wheels: others": ({"error": 0},
        "The log has values of {names}, but the robot has {count} wheels. Name the log's own robot."),
    "ball-axes": ({"error": 0}, _ROLLING),
    "heading-sign": ({"error": 0}, _ROLLING),
    "wheels: unseen": ({"note": 0},
        "The order and signs of the wheels cannot be checked: that needs the ten states, the speed of every wheel, and "
        "motion."),
    "encoders": ({"error": 0},
        "{wheels} in the opposite direction: with the other sign the wheels agree with the lean and the heading. "
        "Correct the columns, or [wheels] in the mapping: sign = {signs} times what it is."),
    "wheels: weak": ({"warning": 0},
        "The wheel speeds hardly follow the states (correlations {correlations}): another robot, much slip, or a "
        "delay."),
    "wheels: order": ({"error": 0},
        "The wheel columns do not fit this robot; a mapping with [wheels] order = {order} and sign = {signs} would fit "
        "(correlations {correlations})."),
    "wheels: gain": ({"error": 1, "warning": 0},  # factor, or its inverse, over the largest that slip and play explain
        "The wheels turn {gains} times as fast as the states imply for this robot: {cause}."),
    # Of 72 encoders stopped at random for 2.5 to 10 s all leave 2 to 39 times as much; true holds in the 12
    # recordings of the test half of campaigns/mapping_recordings.py leave at most 0.6 times as much
    "stuck: encoder": ({"error": 2},
        "{name} holds its value from {start:.6g} to {end:.6g} s though its wheel turns: the lean, the heading and the "
        "other wheels leave {times:.2g} times as much of the motion unexplained as elsewhere, and {percent:.0f} % of "
        "that is what turning of this wheel would do. The encoder or its cable failed, or messages were lost."),
    "disturbance": ({"warning": 1},  # torque over gravity's, averaged over a quarter of a second
        "Something other than wheels and gravity moves the lean, {times:.1f} times as strongly as gravity: the log is "
        "good for predictions of a fraction of a second, but not for closed-loop or long open-loop validation."),
    # lean and torques against the robot's equations
    "lean-axes": ({"error": 0},
        "The lean does not fit the ball's acceleration: {causes}. With this correction the ball accelerates towards "
        "the lean, as under every balancing robot (the same mistake in x_dot, y_dot and the wheels would look the "
        "same). Correct the columns or the mapping."),
    "lean-scale": ({"error": 0},
        "The ball accelerates {size:.3g} times as much as the lean implies: x, y, x_dot and y_dot are scaled (wheel "
        "radius, ball radius, gear ratio or encoder counts per turn), the height of the centre of mass differs from "
        "the robot file, theta and phi are scaled by {inverse:.3g}, or t is stretched."),
    "lean-scale: unit": ({"error": 0},
        "The ball accelerates {size:.3g} times as much as the lean implies: x, y, x_dot and y_dot look like {unit}, "
        'not m. If so, write unit = "{unit}" for them into a mapping.'),
    "lean-axes: turn": ({"error": math.radians(12)},  # three standard errors below the angle [rad]
        "The ball accelerates {degrees:.0f} degrees to the {side} of the lean: the IMU is mounted turned about the "
        "vertical, or psi has another zero than x and y. Rotate the lean ([attitude] turn in a mapping)."),
    "physics": ({"warning": 0},
        "The signs and scales of lean and torques cannot be checked: the acceleration of the ball does not follow the "
        "lean clearly enough (too little motion, slipping wheels, or a robot that is held)."),
    # [s]: the computing time of a controller and the group delay of a filter are below
    "torque-delay": ({"error": 0.03},
        "The torques are {ms:.0f} ms too {late} in the log: they respond to the states {ms:.0f} ms {before}. The times "
        "of the torques or of the sensors are wrong; shift one of them ([input] delay or [attitude] delay in a "
        "mapping)."),
    "torque-order": ({"error": 0.9}, _ORDER),  # confidence in another order or other signs
    "torque-sign": ({"error": 0.9}, _ORDER),
    "dead-motor: within": (_FAULT, _WITHIN),
    "torque-scale: within": (_FAULT, _WITHIN),
    "torque-sign: within": (_FAULT, _WITHIN),
    "torque-order: within": (_FAULT, _WITHIN),
    "torque-unrelated": ({"error": 0},
        "{names}: the motion explains at most {percent:.0f} %, and no other order or signs fit. The torque is of "
        "another log, shifted in time, random, or not that of the motor."),
    "torque-scale: one": ({"error": 0},
        "{name} is {factor:.2g} times as large as the other torques, relative to the torque that the motion of its "
        "wheel needs: its torque constant, gear ratio or unit differs, or its motor gives another torque than the "
        "command. Correct the scale of the column in a mapping."),
    # five standard errors below the factor's logarithm
    "torque-scale": ({"error": math.log(1.25), "warning": math.log(1.15)},
        "The torques are {factor:.2g} times as large as the motion of this robot needs: all are scaled (torque "
        "constant, gear ratio, current or per-unit values in place of N m), the recording clips them, or the robot is "
        "{heavier} than in the robot file."),
    "robots": ({"error": 0},
        "{odd} and {other} are of different robots: the torque that the motion needs is {factor:.2f} times as large in "
        "{odd} (relative to the robot file it is {of_odd} in {odd} and {of_other} in {other}). One is heavier, or has "
        "another gear ratio or torque constant. Use logs of one robot in one condition."),
}  # fmt: skip


def judged(
    key: str, columns: Sequence[str], size: float = math.inf, time: float | None = None, /, **numbers: object
) -> list[Finding]:
    """Return the finding on a statistic of columns, at a time, with the sentence's numbers; none within the limits."""
    limits, text = CHECKS[key]
    over: list[Severity] = [severity for severity, limit in limits.items() if size > limit]
    code = key.partition(":")[0]
    return [finding(code, over[0], text.format_map(numbers), *columns, time=time)] if over else []
