"""Checks of logs before identification: do they excite the parameters, and do they show effects outside the model?

Excitation is checked before anything is estimated. A log without motion or torque is refused as a whole. Otherwise
the parameters that a log cannot determine are refused by name: they take part in the fit, since a wheel that friction
holds throughout has friction, but get no number.

Chatter. Wheels that swing to and fro within the gearbox's play are predicted wrongly by a model without play, and more
so with friction. A stiff gain makes motors chatter: they cross the play, strike, and are turned back before ball and
body have followed. The encoder, on the motor's side, sees swings about as long as the play. Friction's sign then
follows the motor and averages out over a swing (as dither does), whereas a model that fixes motor to wheel holds the
ball by c + s. On such windows friction found elsewhere predicts the lean worse than none, and a fit to them alone finds
none.

Pivoting. The heading follows the wheels if the ball does not pivot on the floor. Wheels that all turn alike turn the
body against the ball, and show psi_dot less the ball's spin: all of psi_dot where the ball does not pivot, and where
floor and ball are smooth and the ball turns along, a share of it,

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
from ballbot.log.checks.kinematics import measured_wheel_speeds
from ballbot.log.columns import wheel_speed_names
from ballbot.log.signals import turning_points
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
#: least motion that excites a group of rigid-body parameters: root mean square over the windows of these states
_MOTIONS = (
    (("rolling",), ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
    (("center_of_mass",), ("theta", "phi"), 3e-3, "rad", "the robot hardly leans"),
    (("second_moment",), ("theta_dot", "phi_dot"), 0.02, "rad/s", "the lean hardly changes"),
    (("pivoting",), ("psi_dot",), 0.05, "rad/s", "the heading hardly turns"),
    (("imu_delay",), ("theta_dot", "phi_dot"), 5e-3, "rad/s", "the lean hardly changes"),
    (("velocity_delay",), ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Identifiability:
    """The parameters that logs can and cannot determine."""

    refused: NDArray[np.bool_]  #: (p,), free parameters that they cannot determine
    findings: tuple[Finding, ...]  #: one for each reason


def check_count(windows: Windows, *, fitted: int, parameters: int) -> None:
    """Refuse too few windows.

    InputError if the windows to fit are fewer than `WINDOWS_PER_PARAMETER` times the parameters.
    """
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


def check_excitation(windows: Windows, robot: Robot, coordinates: Coordinates) -> Identifiability:
    """Refuse logs without motion, and the parameters that the other logs cannot determine.

    InputError if no wheel turns in enough windows, no torque is ever applied, or no free parameter can be determined.
    """
    if not np.any(windows.torques):
        raise InputError(
            "The torques u are zero in every window of the logs; friction shows only while motors work."
        )
    speeds = Model(robot).wheel_speed(windows.measured[..., :5], windows.measured[..., 5:])
    turning = np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED
    if np.all(turning.mean(axis=0) < LEAST_SHARE):
        raise InputError(
            f"The robot stands still: a wheel turns faster than {LEAST_SPEED:g} "
            f"rad/s in only {turning.any(axis=1).sum()} of {len(windows)} "
            "windows. Log it while it moves, such as around a square."
        )
    refused, findings = np.zeros(len(coordinates.labels), dtype=bool), []
    for names, wheel, reason in _reasons(windows, speeds, turning):
        rows = _rows(coordinates, names, wheel) & coordinates.free & ~refused
        if rows.any():
            labels = [label for label, row in zip(coordinates.labels, rows, strict=True) if row]
            findings.append(warning("excitation", f"{reason}: {', '.join(labels)} cannot be estimated."))
            refused |= rows
    if np.all(refused[coordinates.free]):
        raise InputError(
            f"These logs do not determine the parameters to be estimated: {' '.join(texts(findings))}"
        )
    return Identifiability(refused=refused, findings=tuple(findings))


#: what shows in a wheel's speed
_OF_WHEEL = ("viscous", "coulomb", "stribeck", "stribeck_asymmetry", "load", "torque_gain", "torque_offset")


def _reasons(
    windows: Windows, speeds: NDArray[np.float64], turning: NDArray[np.bool_]
) -> Iterator[tuple[tuple[str, ...], int | None, str]]:
    """Yield quantities that windows do not determine, of which wheel, and why."""
    for i in np.flatnonzero(turning.mean(axis=0) < LEAST_SHARE).tolist():
        text = f"Wheel {i + 1} turns in only {turning[:, i].sum()} of {len(turning)} windows"
        yield _OF_WHEEL, i, f"{text}; drive in another direction too"
    size = np.abs(speeds).reshape(-1, speeds.shape[-1])
    for i in np.flatnonzero(size.std(axis=0) < LEAST_VARIATION * size.mean(axis=0)).tolist():
        text = f"Wheel {i + 1} turns at one speed, {size[:, i].mean():.2g} rad/s"
        yield ("viscous",), i, f"{text}; drive at other speeds too"
    torque = np.sqrt((windows.torques**2).mean(axis=(0, 1)))
    for i in np.flatnonzero(torque < LEAST_TORQUE).tolist():
        yield ("torque_gain", "load"), i, f"Motor {i + 1} gives only {torque[i]:.2g} N m; make it work harder"
    change = float(np.sqrt((np.diff(windows.torques, axis=1) ** 2).mean()))
    if change < LEAST_TORQUE:
        text = f"The torques change by only {change:.2g} N m per row; a step of the reference would help"
        yield ("delay",), None, text
    for names, states, least, unit, words in _MOTIONS:
        motion = float(
            np.sqrt((windows.measured[..., [STATE_NAMES.index(one) for one in states]] ** 2).mean())
        )
        if motion < least:
            amount = f"{motion:.2g} {unit} root mean square; {least:g} are needed"
            yield names, None, f"For {' and '.join(names)}, {words} ({amount})"


def _rows(coordinates: Coordinates, names: tuple[str, ...], wheel: int | None) -> NDArray[np.bool_]:
    """Return which parameters (p,) are of these quantities, and of that wheel where one is given."""
    mine = np.array([name in names for name in coordinates.names])
    if wheel is None:
        return mine
    ends = np.array([label.endswith(str(wheel + 1)) for label in coordinates.labels])
    return mine & ends & np.array([BY_NAME[name].each == "wheels" for name in coordinates.names])


#: a swing is within the play where it is this many times as long: at its end a blow turns the wheel a little
WITHIN = (0.3, 2.0)
#: a turn back by less than this share of the play is the encoder's noise
LEAST_TURN = 0.1
#: a log whose wheels are within the play for more than this share of the time chatters
CHATTER = 0.3


@dataclass(frozen=True, kw_only=True)
class Chatter:
    """How much a log's wheels swing within the play."""

    share: float  #: of the time, the wheels' mean
    swing: float  #: median length of the swings within the play [rad]; NaN without swings

    @property
    def matters(self) -> bool:
        """Whether predictions with friction are not to be trusted there."""
        return self.share > CHATTER


def chatter(log: Log, robot: Robot) -> Chatter:
    """Return how much the wheels swing within the robot's play."""
    play = robot.drive.backlash
    if not play > 0.0:
        return Chatter(share=0.0, swing=math.nan)
    speeds = np.nan_to_num(measured_wheel_speeds(log, robot))
    angles = np.cumsum(speeds[:-1] * np.diff(log.t)[:, None], axis=0)
    turns = [turning_points(angle, LEAST_TURN * play) for angle in angles.T]
    # how far an angle travels from one turning point to the next, and for how many rows
    lengths = np.concatenate(
        [np.abs(np.diff(angle[one])) for angle, one in zip(angles.T, turns, strict=True)]
    )
    rows = np.concatenate([np.diff(one) for one in turns])
    within = (lengths > WITHIN[0] * play) & (lengths < WITHIN[1] * play)
    swing = float(np.median(lengths[within])) if within.any() else math.nan
    return Chatter(share=float(rows[within].sum() / rows.sum()), swing=swing)


def chatter_finding(found: Chatter, robot: Robot, name: str) -> Finding:
    """Return the warning of a log that chatters."""
    text = (
        f"In {name} the wheels oscillate by {math.degrees(found.swing):.1f} deg for {100 * found.share:.0f} % "
        f"of the time, within the gearbox's play of {math.degrees(robot.drive.backlash):.1f} deg: the motors "
        "strike the stops while ball and body hardly follow. The model has no play, so friction there makes "
        "its predictions worse, first those of the lean. Validate friction on logs of a softer gain."
    )
    return warning("chatter", text)


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
    rate, spin = (one[known][: count * rows].reshape(count, rows).mean(axis=1) for one in (rate, spin))
    if len(rate) < 2 or np.sqrt((rate**2).mean()) < LEAST_TURNING:
        return None
    return float((rate - spin) @ rate / (rate @ rate))


def heading_findings(
    shares: Sequence[float | None], *, excluded_states: Sequence[str], estimated: Sequence[str]
) -> list[Finding]:
    """Return a warning if the wheels do not show the heading of a log; it states the measure taken or the remedy.

    The shares are those of `share_shown`, one a log.
    """
    few = [one for one in shares if one is not None and SMALLEST_SHARE < one < LARGEST_SHARE]
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
    least = f"{100 * min(few):.0f} %"
    most = f" to {100 * max(few):.0f} %" if len(few) > 1 else ""
    text = f"The wheels show only {least}{most} of the turning of the heading: the ball pivots on the floor{done}"
    return [warning("pivoting", text)]
