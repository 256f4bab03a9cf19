"""Checks of logs before identification: do they excite the parameters, and do they show effects outside the model?

A log without motion or torque is refused as a whole. Otherwise the parameters that logs cannot determine are refused by
name: they take part in the fit, since a wheel that friction holds throughout has friction, but get no number.

Chatter. Wheels that swing to and fro within the gearbox's play are predicted wrongly by a model without play, and more
so with friction. A stiff gain makes motors cross the play, strike, and turn back before ball and body have followed.
Friction's sign then follows the motor and averages out over a swing, whereas a model that fixes motor to wheel holds
the ball by c + s. On such windows friction found elsewhere predicts the lean worse than none, and a fit to them alone
finds none.

Pivoting. Wheels that all turn alike turn the body against the ball, and show psi_dot less the ball's spin: all of
psi_dot where the ball does not pivot, and where floor and ball are smooth and the ball turns along, a share of it,

    share = sum (psi_dot - spin) psi_dot / sum psi_dot^2            over means of a tenth of a second

(0.2 and 0.5 on two logs of a course's robot, 0.99 on a physics engine's). The model without pivoting then explains the
heading by whatever else it has, first of all by rolling friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, texts, warning
from ballbot.identification.quantities import BY_NAME, Coordinates
from ballbot.identification.windows import Windows, ball_spin
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import wheel_speed_names
from ballbot.log.signals import turning_points
from ballbot.log.wheel_speeds import measured_wheel_speeds
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.summary import counted

#: a wheel turns in a window where its root mean square speed there is above this [rad/s]; encoder and gyro
#: noise of a robot at rest stay below
LEAST_SPEED = 0.1
#: the share of the windows in which a wheel must turn
LEAST_SHARE = 0.1
#: windows to fit, for each free parameter; fewer give no standard error clustered by window
WINDOWS_PER_PARAMETER = 2
#: b and c are one number where a wheel's speed varies by less than this share of it
LEAST_VARIATION = 0.1
#: least root mean square of a motor's torque, and of its changes from row to row [N m]
LEAST_TORQUE = 5e-3
#: what shows in a wheel's speed
_OF_WHEEL = ("viscous", "coulomb", "stribeck", "stribeck_asymmetry", "load", "torque_gain", "torque_offset")
#: least root mean square over the windows of states that a quantity shows in
_MOTIONS = (
    ("rolling", ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
    ("center_of_mass", ("theta", "phi"), 3e-3, "rad", "the robot hardly leans"),
    ("second_moment", ("theta_dot", "phi_dot"), 0.02, "rad/s", "the lean hardly changes"),
    ("pivoting", ("psi_dot",), 0.05, "rad/s", "the heading hardly turns"),
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
            f"The logs have {counted(len(windows), 'window')} of {length:g} s without gaps or "
            f"missing values, of which {fitted} are used to fit {parameters} parameters; "
            f"this needs at least {least}. Log the robot balancing for about {needed} s in all, or choose shorter "
            "windows."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Identifiability:
    """The parameters that logs can and cannot determine."""

    refused: NDArray[np.bool_]  #: (p,), free parameters that they cannot determine
    findings: tuple[Finding, ...]  #: one for each reason


def check_excitation(windows: Windows, robot: Robot, coordinates: Coordinates) -> Identifiability:
    """Refuse logs without motion, and the parameters that the other logs cannot determine.

    InputError if no wheel turns in enough windows, no torque is ever applied, or no free parameter can be determined.
    """
    if not np.any(windows.torques):
        raise InputError(
            "The torques u are zero in every window of the logs; friction shows only while motors work."
        )
    speeds = np.abs(Model(robot).wheel_speed(windows.measured[..., :5], windows.measured[..., 5:]))
    turning = np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED
    if np.all(turning.mean(axis=0) < LEAST_SHARE):
        raise InputError(
            f"The robot stands still: a wheel turns faster than {LEAST_SPEED:g} "
            f"rad/s in only {turning.any(axis=1).sum()} of {len(windows)} "
            "windows. Log it while it moves, such as around a square."
        )
    names, labels = np.array(coordinates.names), np.array(coordinates.labels)
    of_wheels = np.array([BY_NAME[name].each == "wheels" for name in coordinates.names])
    refused, findings = np.zeros(len(labels), dtype=bool), []
    for quantities, wheel, reason in _reasons(windows, speeds, turning):
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
    return Identifiability(refused=refused, findings=tuple(findings))


def _reasons(
    windows: Windows, speeds: NDArray[np.float64], turning: NDArray[np.bool_]
) -> Iterator[tuple[tuple[str, ...], int, str]]:
    """Yield quantities that windows do not determine, of which wheel from 1, 0 for all, and why."""
    torque = np.sqrt((windows.torques**2).mean(axis=(0, 1)))
    mean, spread = speeds.mean(axis=(0, 1)), speeds.std(axis=(0, 1))
    for i in np.flatnonzero(turning.mean(axis=0) < LEAST_SHARE).tolist():
        text = f"Wheel {i + 1} turns in only {turning[:, i].sum()} of {len(turning)} windows"
        yield _OF_WHEEL, i + 1, f"{text}; drive in another direction too"
    for i in np.flatnonzero(spread < LEAST_VARIATION * mean).tolist():
        text = f"Wheel {i + 1} turns at one speed, {mean[i]:.2g} rad/s; drive at other speeds too"
        yield ("viscous",), i + 1, text
    for i in np.flatnonzero(torque < LEAST_TORQUE).tolist():
        text = f"Motor {i + 1} gives only {torque[i]:.2g} N m; make it work harder"
        yield ("torque_gain", "load"), i + 1, text
    change = float(np.sqrt((np.diff(windows.torques, axis=1) ** 2).mean()))
    if change < LEAST_TORQUE:
        text = f"The torques change by only {change:.2g} N m per row; a step of the reference would help"
        yield ("delay",), 0, text
    for name, states, least, unit, words in _MOTIONS:
        columns = [STATE_NAMES.index(state) for state in states]
        motion = float(np.sqrt((windows.measured[..., columns] ** 2).mean()))
        if motion < least:
            yield (
                (name,),
                0,
                f"For {name}, {words} ({motion:.2g} {unit} root mean square; {least:g} are needed)",
            )


#: a swing is within the play where it is this many times as long: at its end a blow turns the wheel a little
WITHIN = (0.3, 2.0)
#: a turn back by less than this share of the play is the encoder's noise
LEAST_TURN = 0.1
#: a log whose wheels are within the play for more than this share of the time chatters
CHATTER = 0.3


def chatter_findings(log: Log, robot: Robot, name: str) -> list[Finding]:
    """Return a warning if a log's wheels swing within the robot's play: predictions with friction are then wrong."""
    play = robot.drive.backlash
    if not play > 0.0:
        return []
    speeds = np.nan_to_num(measured_wheel_speeds(log, robot))
    angles = np.cumsum(speeds[:-1] * np.diff(log.t)[:, None], axis=0)
    turns = [turning_points(angle, LEAST_TURN * play) for angle in angles.T]
    # how far an angle travels from one turning point to the next, and for how many rows
    lengths = np.concatenate([np.abs(np.diff(angle[at])) for angle, at in zip(angles.T, turns, strict=True)])
    rows = np.concatenate([np.diff(at) for at in turns])
    within = (lengths > WITHIN[0] * play) & (lengths < WITHIN[1] * play)
    share = float(rows[within].sum() / rows.sum())
    if not share > CHATTER:
        return []
    text = (
        f"In {name} the wheels oscillate by {math.degrees(np.median(lengths[within])):.1f} deg for {100 * share:.0f} % "
        f"of the time, within the gearbox's play of {math.degrees(play):.1f} deg: the motors "
        "strike the stops while ball and body hardly follow. The model has no play, so friction there makes "
        "its predictions worse, first those of the lean. Validate friction on logs of a softer gain."
    )
    return [warning("chatter", text)]


#: the share is estimated from means over so long [s], in which encoders' noise averages out
HEADING_MEAN = 0.1
#: a heading that turns less, root mean square, is noise [rad/s]
LEAST_TURNING = 0.03
#: a share below the first is reported; one below the second is from wheels that count backwards, which
#: `ballbot check-log` reports
LARGEST_SHARE, SMALLEST_SHARE = 0.8, -0.3
HEADING = ("psi", "psi_dot")


def share_shown(log: Log, robot: Robot) -> float | None:
    """Return the share of the heading's turning that the wheels show; None if the log does not determine it."""
    if not {*wheel_speed_names(robot.wheel_count), *STATE_NAMES} <= set(log.names) or len(log) < 2:
        return None
    rate, spin = log["psi_dot"], ball_spin(log, robot)
    known = np.isfinite(rate) & np.isfinite(spin)
    rows = max(1, round(HEADING_MEAN / log.sample_time))
    count = int(known.sum()) // rows
    rate, spin = (part[known][: count * rows].reshape(count, rows).mean(axis=1) for part in (rate, spin))
    if len(rate) < 2 or np.sqrt((rate**2).mean()) < LEAST_TURNING:
        return None
    return float((rate - spin) @ rate / (rate @ rate))


def heading_findings(
    shares: Sequence[float | None], *, excluded_states: Sequence[str], estimated: Sequence[str]
) -> list[Finding]:
    """Return a warning if the wheels do not show the heading of a log; it states the measure taken or the remedy.

    The shares are those of `share_shown`, one a log.
    """
    few = [share for share in shares if share is not None and SMALLEST_SHARE < share < LARGEST_SHARE]
    if not few:
        return []
    if "pivoting" in estimated:
        done = "; the friction against that, T_p, was among the estimated parameters."
    elif set(HEADING) <= set(excluded_states):
        done = "; the heading was excluded from the cost."
    else:
        done = (
            ", which this model does not, so other friction parameters compensate for it. "
            "Estimate the floor's friction against pivoting (--estimate friction,pivoting), "
            "or exclude the heading from the cost (--exclude-states psi,psi_dot)."
        )
    most = f" to {100 * max(few):.0f} %" if len(few) > 1 else ""
    shown = f"{100 * min(few):.0f} %{most} of the turning of the heading"
    return [warning("pivoting", f"The wheels show only {shown}: the ball pivots on the floor{done}")]
