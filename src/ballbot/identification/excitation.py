"""Checks of logs before identification: whether they excite the parameters, and show effects outside the model.

Parameters that the logs do not determine get no value. They still take part in the fit, because a wheel that friction
holds throughout has friction.

Chatter. A stiff gain makes motors cross the gearbox's play, strike, and turn back before ball and body have followed.
The sign of the friction then follows the motor, whereas a model without play holds the ball by c + s: friction from
other logs predicts such windows worse than no friction, and a fit to them alone gives none.

Pivoting. Equal speeds of all wheels turn the body against the ball, and show psi_dot less the ball's spin:

    share = sum (psi_dot - spin) psi_dot / sum psi_dot^2            over means of a tenth of a second

is 1 if the ball does not pivot (0.2 and 0.5 on two logs of a robot on a smooth floor). A model without pivoting then
explains the heading by its other parameters, mainly by rolling friction.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, texts, warning
from ballbot.identification.prediction import ball_spin
from ballbot.identification.quantities import BY_NAME, Coordinates
from ballbot.identification.windows import Windows
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import wheel_speed_names
from ballbot.log.pose import measured_wheel_speeds
from ballbot.log.signals import turning_points
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.summary import counted

#: a wheel turns in a window if its root mean square speed is above this [rad/s], which is above the noise of encoders
#: and gyro
LEAST_SPEED = 0.1
#: least share of the windows in which a wheel must turn
LEAST_SHARE = 0.1
#: least windows for each free parameter, for standard errors clustered by window
WINDOWS_PER_PARAMETER = 2
#: least variation of a wheel's speed, as a share of the mean, that separates b from c
LEAST_VARIATION = 0.1
#: least root mean square of a motor's torque, and of its change from row to row [N m]
LEAST_TORQUE = 5e-3
#: quantities that need a wheel to turn
_OF_WHEEL = ("viscous", "coulomb", "stribeck", "stribeck_asymmetry", "load", "torque_gain", "torque_offset")
#: quantities, the states that they affect, the least root mean square of these over the windows, and what is lacking
_MOTIONS = (
    ("rolling", ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
    ("center_of_mass", ("theta", "phi"), 3e-3, "rad", "the robot hardly leans"),
    ("second_moment", ("theta_dot", "phi_dot"), 0.02, "rad/s", "the lean hardly changes"),
    ("imu_delay", ("theta_dot", "phi_dot"), 5e-3, "rad/s", "the lean hardly changes"),
    ("velocity_delay", ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
)


def check_count(windows: Windows, *, fitted: int, parameters: int) -> None:
    """Raise InputError if the windows to fit are fewer than `WINDOWS_PER_PARAMETER` times the parameters."""
    least = WINDOWS_PER_PARAMETER * parameters
    if fitted < least:
        length = windows.samples * windows.sample_time
        # the same share of the windows is held out
        needed = math.ceil(math.ceil(least * max(len(windows), 1) / max(fitted, 1)) * length)
        raise InputError(
            f"The logs have {counted(len(windows), 'window')} of {length:g} s without gaps or missing values, of which "
            f"{fitted} are used to fit {parameters} parameters; this needs at least {least}. Log the robot balancing "
            f"for about {needed} s in all, or choose shorter windows."
        )


def check_excitation(
    windows: Windows, robot: Robot, coordinates: Coordinates, *, logs: Sequence[Log] = ()
) -> tuple[Bools, tuple[Finding, ...]]:
    """Return which free parameters (p,) the logs cannot determine, and why; InputError if they determine none.

    Whether the ball pivots is seen in the whole `logs`.
    """
    if not np.any(windows.torques):
        raise InputError(
            "The torques u are zero in every window of the logs; friction shows only while motors work."
        )
    speeds = np.abs(Model(robot).wheel_speed(windows.measured[..., :5], windows.measured[..., 5:]))
    turning = np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED
    if np.all(turning.mean(axis=0) < LEAST_SHARE):
        raise InputError(
            f"The robot stands still: a wheel turns faster than {LEAST_SPEED:g} rad/s in only "
            f"{turning.any(axis=1).sum()} of {len(windows)} windows. Log it while it moves, such as around a square."
        )
    names, labels = np.array(coordinates.names), np.array(coordinates.labels)
    of_wheels = np.array([BY_NAME[name].each == "wheels" for name in coordinates.names])
    refused, findings = np.zeros(len(labels), dtype=bool), []
    for quantities, wheel, reason in _reasons(windows, speeds, turning, logs, robot):
        rows = np.isin(names, quantities) & coordinates.free & ~refused
        if wheel:
            rows &= of_wheels & np.char.endswith(labels, str(wheel))
        if rows.any():
            text = f"{reason}: {', '.join(labels[rows].tolist())} cannot be estimated."
            findings.append(warning("excitation", text))
            refused |= rows
    if np.all(refused[coordinates.free]):
        raise InputError(
            f"These logs do not determine the parameters to be estimated: {' '.join(texts(findings))}"
        )
    return refused, tuple(findings)


def _reasons(
    windows: Windows, speeds: Floats, turning: Bools, logs: Sequence[Log], robot: Robot
) -> Iterator[tuple[tuple[str, ...], int, str]]:
    """Yield quantities that the windows do not determine, the wheel from 1 (0 for all), and the reason."""
    torque = np.sqrt((windows.torques**2).mean(axis=(0, 1)))
    mean, spread = speeds.mean(axis=(0, 1)), speeds.std(axis=(0, 1))
    for i in np.flatnonzero(turning.mean(axis=0) < LEAST_SHARE).tolist():
        text = f"Wheel {i + 1} turns in only {turning[:, i].sum()} of {len(turning)} windows"
        yield _OF_WHEEL, i + 1, f"{text}; drive in another direction too"
    for i in np.flatnonzero(spread < LEAST_VARIATION * mean).tolist():
        text = f"Wheel {i + 1} always turns at {mean[i]:.2g} rad/s; drive at other speeds too"
        yield ("viscous",), i + 1, text
    for i in np.flatnonzero(torque < LEAST_TORQUE).tolist():
        text = f"Motor {i + 1} gives only {torque[i]:.2g} N m; make it work harder"
        yield ("torque_gain", "load"), i + 1, text
    change = float(np.sqrt((np.diff(windows.torques, axis=1) ** 2).mean()))
    if change < LEAST_TORQUE:
        text = f"The torques change by only {change:.2g} N m per row; add steps to the reference"
        yield ("delay",), 0, text
    parts = [means for log in logs if (means := _turning(log, robot, PIVOTING_MEAN)) is not None]
    turned, pivoted = (math.sqrt(sum(float(part[k] @ part[k]) for part in parts)) for k in (0, 1))
    if not pivoted > (1.0 - LARGEST_SHARE) * turned:
        share = 100.0 * pivoted / turned if turned else 0.0
        text = (
            f"The ball pivots by {share:.2g} % of the heading's turning, which play and rollers may show too"
        )
        yield ("pivoting",), 0, text
    for name, states, least, unit, words in _MOTIONS:
        columns = [STATE_NAMES.index(state) for state in states]
        motion = float(np.sqrt((windows.measured[..., columns] ** 2).mean()))
        if motion < least:
            text = f"For {name}, {words} ({motion:.2g} {unit} root mean square; {least:g} are needed)"
            yield (name,), 0, text


#: length of an oscillation within the play, over the play: an impact at its end turns the wheel a little
WITHIN = (0.3, 2.0)
#: a reversal by less than this share of the play is encoder noise
LEAST_TURN = 0.1
#: a log chatters if its wheels are within the play for more than this share of the time
CHATTER = 0.3


def chatter_findings(log: Log, robot: Robot, name: str) -> list[Finding]:
    """Return a warning if the wheels oscillate within the play, where predictions with friction are wrong."""
    play = robot.drive.backlash
    if not play > 0.0:
        return []
    speeds = np.nan_to_num(measured_wheel_speeds(log, robot))
    angles = np.cumsum(speeds[:-1] * np.diff(log.t)[:, None], axis=0)
    turns = [turning_points(angle, LEAST_TURN * play) for angle in angles.T]
    # travel and rows from one turning point to the next
    lengths = np.concatenate([np.abs(np.diff(angle[at])) for angle, at in zip(angles.T, turns, strict=True)])
    rows = np.concatenate([np.diff(at) for at in turns])
    within = (lengths > WITHIN[0] * play) & (lengths < WITHIN[1] * play)
    share = float(rows[within].sum() / rows.sum())
    if not share > CHATTER:
        return []
    oscillation, of_gears = math.degrees(np.median(lengths[within])), math.degrees(play)
    text = (
        f"In {name} the wheels oscillate by {oscillation:.1f} deg for {100 * share:.0f} % of the time, within the "
        f"gearbox's play of {of_gears:.1f} deg: the motors hit the stops while ball and body hardly follow. The model "
        "has no play, so friction makes its predictions of such logs worse, mainly those of the lean. Validate "
        "friction on logs of a softer gain."
    )
    return [warning("chatter", text)]


#: the share is estimated from means over so many seconds, which average out encoder noise
HEADING_MEAN = 0.1
#: over so many seconds play and rollers, whose angles are bounded, average out
PIVOTING_MEAN = 1.0
#: least root mean square turning rate of the heading [rad/s]; less is noise
LEAST_TURNING = 0.03
#: a share between these is reported; a smaller one is from wheels that count backwards, which `ballbot check-log`
#: reports
LARGEST_SHARE, SMALLEST_SHARE = 0.8, -0.3
HEADING = ("psi", "psi_dot")


def _turning(log: Log, robot: Robot, seconds: float) -> tuple[Floats, Floats] | None:
    """Return means of the heading's rate and the ball's spin (k,) [rad/s] over so long; None if it is not shown."""
    if not {*wheel_speed_names(robot.wheel_count), *STATE_NAMES} <= set(log.names) or len(log) < 2:
        return None
    rate, spin = log["psi_dot"], ball_spin(log, robot)
    known = np.isfinite(rate) & np.isfinite(spin)
    rows = max(1, round(seconds / log.sample_time))
    count = int(known.sum()) // rows
    rate, spin = (part[known][: count * rows].reshape(count, rows).mean(axis=1) for part in (rate, spin))
    return None if len(rate) < 2 or np.sqrt((rate**2).mean()) < LEAST_TURNING else (rate, spin)


def share_shown(log: Log, robot: Robot) -> float | None:
    """Return the share of the heading's turning that shows in the wheels; None if the log does not determine it."""
    turning = _turning(log, robot, HEADING_MEAN)
    return None if turning is None else 1.0 - float(turning[1] @ turning[0] / (turning[0] @ turning[0]))


def heading_findings(
    shares: Sequence[float | None], *, excluded_states: Sequence[str], estimated: Sequence[str]
) -> list[Finding]:
    """Return a warning if the ball pivots in some log by `share_shown`, with what was or can be done about it."""
    few = [share for share in shares if share is not None and SMALLEST_SHARE < share < LARGEST_SHARE]
    if not few:
        return []
    if "pivoting" in estimated:
        done = "; its pivoting friction T_p was estimated."
    elif set(HEADING) <= set(excluded_states):
        done = "; the heading was excluded from the cost."
    else:
        done = (
            ", which this model lacks, so other friction parameters compensate for it. "
            "Estimate the pivoting friction of the floor (--estimate friction,pivoting), "
            "or exclude the heading from the cost (--exclude-states psi,psi_dot)."
        )
    most = f" to {100 * max(few):.0f} %" if len(few) > 1 else ""
    shown = f"{100 * min(few):.0f} %{most} of the turning of the heading"
    return [warning("pivoting", f"The wheels show only {shown}: the ball pivots on the floor{done}")]
