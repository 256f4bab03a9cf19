"""Whether the heading follows the wheels, as it does where the ball does not pivot on the floor.

Wheels that all turn alike turn the body against the ball, and show psi_dot less the ball's spin: all of psi_dot where
the ball does not pivot, and where floor and ball are smooth and the ball turns along, a share of it,

    share = sum (psi_dot - spin) psi_dot / sum psi_dot^2            over means of a tenth of a second

(0.2 and 0.5 on two logs of a course's robot, 0.99 on a physics engine's). The model without pivoting then explains the
heading by whatever else it has, first of all by rolling friction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.wheel_speeds import ball_spin
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import wheel_speed_names
from ballbot.robot import Robot

#: the share is told from means over so long [s], in which encoders' noise averages out
MEAN = 0.1
#: a heading that turns less, root mean square, is noise [rad/s]
LEAST_TURNING = 0.03
#: less than this share is said; less than the other is wheels that count backwards, which `ballbot check-log` tells
LARGEST_SHARE, SMALLEST_SHARE = 0.8, -0.3
HEADING = ("psi", "psi_dot")


def share_shown(log: Log, robot: Robot) -> float | None:
    """Return the share of the heading's turning that the wheels show; None where the log does not tell."""
    if not {*wheel_speed_names(robot.wheel_count), *STATE_NAMES} <= set(log.names) or len(log) < 2:
        return None
    rate, spin = log["psi_dot"], ball_spin(log, robot)
    known = np.isfinite(rate) & np.isfinite(spin)
    rows = max(1, round(MEAN / log.sample_time))
    rate, spin = _means(rate[known], rows), _means(spin[known], rows)
    if len(rate) < 2 or np.sqrt((rate**2).mean()) < LEAST_TURNING:
        return None
    return float((rate - spin) @ rate / (rate @ rate))


def heading_remarks(
    shares: Sequence[float | None], *, left_out: Sequence[str], sought: Sequence[str]
) -> list[str]:
    """Return a sentence where wheels do not show the heading of logs, with what was done or what to do about it.

    Parameters
    ----------
    shares : sequence of float or None
        Of `share_shown`, one a log.
    left_out : sequence of str
        States left out of the cost.
    sought : sequence of str
        Quantities that vary.
    """
    few = [one for one in shares if one is not None and SMALLEST_SHARE < one < LARGEST_SHARE]
    if not few:
        return []
    if "pivoting" in sought:
        done = "; the friction against that, T_p, was among the estimated parameters."
    elif set(HEADING) <= set(left_out):
        done = "; the heading was excluded from the cost."
    else:
        done = (
            ", which this model does not, so other friction parameters compensate for it. "
            "Estimate the floor's friction against pivoting (--free friction,pivoting), "
            "or exclude the heading from the cost (--leave-out psi,psi_dot)."
        )
    least = f"{100 * min(few):.0f} %"
    most = f" to {100 * max(few):.0f} %" if len(few) > 1 else ""
    return [
        f"The wheels show only {least}{most} of the turning "
        f"of the heading: the ball pivots on the floor{done}"
    ]


def _means(values: NDArray[np.float64], rows: int) -> NDArray[np.float64]:
    count = len(values) // rows
    return values[: count * rows].reshape(count, rows).mean(axis=1)
