"""An encoder that holds its angle while its wheel turns, as shown by the lean, the heading and the other wheels.

A wheel may rightly stand still while the others turn: dry friction holds it, or the ball rolls along its axle. Its
encoder is stuck if the rest of the motion does not allow that. A balancing robot obeys linear relations, whatever its
friction and its torques are,

    y = C x + r          y: accelerations of the lean, of the heading, and of every wheel beyond the third
                         x: lean, accelerations of three wheels, the held one among them, and one

which are fitted where no encoder holds. If wheel i turns though its encoder does not, r grows along the column of C of
that wheel; if somebody holds the robot, it grows along other directions. r is scaled by its covariance where the
relations were fitted, so that a relation that does not hold, as that of the heading of a ball that pivots, has no
weight. No units, radii or masses enter.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.findings import Finding
from ballbot.log.checks.kinematics import smoothed_motion
from ballbot.log.checks.table import judged
from ballbot.log.columns import wheel_angle_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL, Smooth

TINY = 1e-30
#: shortest hold that is tested [s]: dry friction holds a wheel for less while a robot balances at 1 to 3 Hz, and what
#: the filter leaves of a shorter one is too little
SHORTEST_HOLD = 2.0
#: standard deviation of the filter's weights [s]: the angles' noise is far above, and what a wheel misses grows
#: downwards. Rows nearer to a hold's ends than so many of them have filtered values of both sides
WIDTH, APART = 0.25, 3.0
#: windows over which the unexplained motion is compared, and the fewest that the relations are fitted by [s]
WINDOW, FEWEST_SECONDS = 0.5, 4.0
#: turning of the wheel explains this part of the motion that a hold leaves unexplained: 0.88 or more of 72 encoders
#: stopped at random, at most 0.6 of true holds (`ballbot.log.checks.table`)
ALONG = 0.85


def check_stuck_encoders(log: Log, *, wheel_count: int) -> Iterator[Finding]:
    """Return an error for each hold of an encoder during which the rest of the motion shows that its wheel turned.

    The upper quartile of the hold's windows is compared with the 95th percentile of the windows elsewhere.
    """
    names = wheel_angle_names(wheel_count)
    holds = [(i, *span) for i, name in enumerate(names) if name in log for span in _holds(log, name)]
    motion = smoothed_motion(log, wheel_count, width=WIDTH) if holds else None
    if motion is None:
        return
    (rows, usable, moved), apart = motion, APART * WIDTH
    near_holds = [(rows >= start - apart) & (rows <= end + apart) for _, start, end in holds]
    free = usable & ~np.any(near_holds, axis=0)
    if free.sum() * INTERVAL < FEWEST_SECONDS:
        return
    for wheel, start, end in holds:
        inside = usable & (rows > start + apart) & (rows < end - apart)
        if inside.sum() * INTERVAL < WINDOW:
            continue
        along, total = _unexplained_along(wheel, moved, free)
        usual = float(np.quantile(_windows(along, free), 0.95))
        times = float(np.sqrt(np.quantile(_windows(along, inside), 0.75) / max(usual, TINY)))
        part = float(along[inside].sum() / max(float(total[inside].sum()), TINY))
        if part > ALONG:
            numbers = {"name": names[wheel], "end": end, "times": times, "percent": 100 * part}
            yield from judged("stuck: encoder", [names[wheel]], times, start, start=start, **numbers)


def _holds(log: Log, name: str) -> list[tuple[float, float]]:
    """Return the intervals of at least `SHORTEST_HOLD` in which an encoder changes by no more than one step."""
    known = np.isfinite(log[name])
    t, angle = log.t[known], log[name][known]
    steps = np.abs(np.diff(angle))
    if not (steps > 0.0).any():
        return []
    step = 1.01 * float(np.quantile(steps[steps > 0.0], 0.01))
    firsts, listed = [0], angle.tolist()
    for row in (np.flatnonzero(steps) + 1).tolist():
        if abs(listed[row] - listed[firsts[-1]]) > step:
            firsts.append(row)
    spans = [(float(t[a]), float(t[b - 1])) for a, b in pairwise([*firsts, len(t)])]
    return [span for span in spans if span[1] - span[0] >= SHORTEST_HOLD]


def _unexplained_along(wheel: int, moved: Smooth, free: Bools) -> tuple[Floats, Floats]:
    """Return the squares (N,) of r along the column of C of a wheel, and of all of r, fitted on the free rows.

    `moved` has the lean (2), the heading and the wheels.
    """
    n = moved.value.shape[1] - 3
    # a wheel and its neighbours are independent in every arrangement around the ball
    own = [3 + i % n for i in (wheel, wheel + 1, wheel - 1)]
    rest = [k for k in range(3 + n) if k not in own]
    x = np.column_stack([moved.acceleration[:, own], moved.value[:, :2], np.ones(len(free))])
    y = moved.acceleration[:, rest]
    C = np.linalg.lstsq(x[free], y[free], rcond=None)[0]
    left = y - x @ C
    covariance = np.cov(left[free], rowvar=False)
    # a signal that is nearly constant must not make it singular
    covariance += 1e-9 * np.trace(covariance) * np.eye(len(covariance))
    whitening = np.linalg.inv(np.linalg.cholesky(covariance)).T
    left, column = left @ whitening, C[0] @ whitening
    along = np.square(left @ (column / max(float(np.linalg.norm(column)), TINY)))
    return along, np.square(left).sum(axis=1)


def _windows(values: Floats, kept: Bools) -> Floats:
    """Return the means of a signal over windows of the kept rows."""
    rows = round(WINDOW / INTERVAL)
    values = values[kept]
    whole = len(values) // rows * rows
    return values[:whole].reshape(-1, rows).mean(axis=1)
