"""References: the desired pose of the robot as a function of time, or from a file.

A reference is a function f(t) -> (10,) in the order of `ballbot.log.columns.STATE_NAMES`. Only x, y and psi
ever differ from zero: A r = 0 then holds for the linearised robot, and r is an equilibrium of the controller
u = K S(psi) (r - x). A moving reference therefore sets a position and never a speed, unless it is a plan
(`ballbot.plan`): the states of a motion that the robot can do, which controllers with feed-forward follow.

A file is a table of poses, for any run that takes a reference by name:

    t,ref_x,ref_y,ref_psi        [s, m, m, rad]

A log has the same columns, so that its reference can be followed again. A row holds until the next one, the last row
to the end. A plan's file has the other seven columns too, ref_theta to ref_psi_dot [rad, m/s, rad/s], and is linear
between its rows.
"""

from bisect import bisect_right
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import positive_number
from ballbot.errors import InputError, check_known
from ballbot.log import Log
from ballbot.log.formats import is_log_file
from ballbot.state import STATE_NAMES

#: the desired state (10,) at a time [s]; its arrays are read-only
Reference = Callable[[float], NDArray[np.float64]]

#: a reference, the name of one (`REFERENCES`), or the path of a reference file
ReferenceLike = Reference | str | Path

#: a corner that rounding moves by less than this [s] past its sample belongs to that sample
_ROUNDING = 1e-9


def hold(*, x: float = 0.0, y: float = 0.0, psi: float = 0.0) -> Reference:
    """Hold a pose.

    Parameters
    ----------
    x, y : float
        [m].
    psi : float
        [rad].

    Returns
    -------
    Reference
        A function of time [s].

    Examples
    --------
    >>> hold(x=0.5, psi=1.0)(0.0)
    array([0.5, 0. , 0. , 0. , 1. , 0. , 0. , 0. , 0. , 0. ])
    """
    pose = _pose(x, y, psi)
    return lambda _t: pose


def square(*, side: float = 0.5, period: float = 32.0) -> Reference:
    """Step around the corners of a square: (0, 0), (side, 0), (side, side), (0, side).

    Parameters
    ----------
    side : float
        [m].
    period : float
        Of one turn [s]; each corner is held for a quarter of it, the origin first.

    Returns
    -------
    Reference
        A function of time [s].

    Raises
    ------
    InputError
        If the period is not positive.

    Examples
    --------
    >>> square(side=0.5, period=32.0)(9.0)[:2]
    array([0.5, 0. ])
    """
    positive_number(period, "The reference's period")
    points = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side))
    corners = [_pose(x, y, 0.0) for x, y in points]
    return lambda t: corners[int((t + _ROUNDING) // (period / 4.0)) % 4]


def change_pose(
    *, x: float = 1.0, y: float = -1.0, psi: float = np.pi, at: float = 3.0, ramp: float = 4.0
) -> Reference:
    """Move from the origin to a pose: the thesis's change to [1 -1 pi].

    Parameters
    ----------
    x, y : float
        [m].
    psi : float
        [rad].
    at : float
        Begin [s].
    ramp : float
        Duration [s]; zero is a step.

    Returns
    -------
    Reference
        A function of time [s].

    Raises
    ------
    InputError
        If the ramp is negative.

    Examples
    --------
    >>> change_pose(at=3.0, ramp=4.0)(5.0)[[0, 1, 4]].round(3)
    array([ 0.5  , -0.5  ,  1.571])
    """
    if not ramp >= 0.0:
        raise InputError(f"The reference's ramp is {ramp:g} s; it must be zero (a step) or positive.")

    def reference(t: float) -> NDArray[np.float64]:
        share = float(np.clip((t - at) / ramp, 0.0, 1.0)) if ramp else float(t >= at)
        return _pose(share * x, share * y, share * psi)

    return reference


def circle(*, radius: float = 0.5, period: float = 30.0) -> Reference:
    """Move counter-clockwise around the circle about (0, radius) through the origin, at constant heading.

    Parameters
    ----------
    radius : float
        [m].
    period : float
        Of one turn [s].

    Returns
    -------
    Reference
        A function of time [s].

    Raises
    ------
    InputError
        If the period is not positive.

    Examples
    --------
    >>> circle(radius=0.5, period=30.0)(7.5)[:2].round(3)
    array([0.5, 0.5])
    """
    positive_number(period, "The reference's period")

    def reference(t: float) -> NDArray[np.float64]:
        angle = 2.0 * np.pi * t / period
        return _pose(radius * np.sin(angle), radius * (1.0 - np.cos(angle)), 0.0)

    return reference


def figure_eight(*, length: float = 1.0, width: float = 0.5, period: float = 40.0) -> Reference:
    """Move along a figure of eight that crosses itself at the origin (lemniscate of Gerono), at constant heading.

    Parameters
    ----------
    length, width : float
        Along x and along y, from end to end [m].
    period : float
        Of one eight [s].

    Returns
    -------
    Reference
        A function of time [s].

    Raises
    ------
    InputError
        If the period is not positive.

    Examples
    --------
    >>> figure_eight(length=1.0, width=0.5, period=40.0)(10.0)[:2].round(3)
    array([0.5, 0. ])
    """
    positive_number(period, "The reference's period")

    def reference(t: float) -> NDArray[np.float64]:
        angle = 2.0 * np.pi * t / period
        return _pose(0.5 * length * np.sin(angle), 0.5 * width * np.sin(2.0 * angle), 0.0)

    return reference


def drive(*, speed: float = 0.5, begin: float = 2.0, ramp: float = 0.0, end: float = np.inf) -> Reference:
    """Go along x at a speed and stop at once.

    Parameters
    ----------
    speed : float
        [m/s].
    begin : float
        [s].
    ramp : float
        The time in which the speed is reached evenly [s].
    end : float
        [s].

    Returns
    -------
    Reference
        A function of time [s].

    Raises
    ------
    InputError
        If the ramp is negative.

    Examples
    --------
    >>> [drive(speed=1.0, begin=2.0, ramp=2.0, end=5.0)(t)[0].item() for t in (2.0, 3.0, 4.0, 5.0, 6.0)]
    [0.0, 0.25, 1.0, 2.0, 2.0]
    """
    if not ramp >= 0.0:
        raise InputError(f"The reference's ramp is {ramp:g} s; it must be zero or positive.")

    def reference(t: float) -> NDArray[np.float64]:
        since = max(min(t, end) - begin, 0.0)
        rising = min(since, ramp)
        share = 0.5 * rising / ramp if ramp else 0.0
        return _pose(speed * (share * rising + since - rising), 0.0, 0.0)

    return reference


def velocity_steps(*, speed: float = 0.5, period: float = 16.0) -> Reference:
    """Stand, go along x at a speed, stand, and go back at it, each for a quarter of the period.

    Parameters
    ----------
    speed : float
        [m/s].
    period : float
        [s].

    Returns
    -------
    Reference
        A function of time [s].

    Raises
    ------
    InputError
        If the period is not positive.

    Examples
    --------
    >>> [velocity_steps(speed=0.5, period=8.0)(t)[0].item() for t in (2.0, 3.0, 4.0, 6.0, 7.0, 8.0)]
    [0.0, 0.5, 1.0, 1.0, 0.5, 0.0]
    """
    positive_number(period, "The reference's period")
    quarter = period / 4.0

    def reference(t: float) -> NDArray[np.float64]:
        into = t % period
        forth, back = (min(max(into - k * quarter, 0.0), quarter) for k in (1, 3))
        return _pose(speed * (forth - back), 0.0, 0.0)

    return reference


#: the references that the command line takes by name, with their defaults
REFERENCES = MappingProxyType(
    {
        "hold": hold,
        "square": square,
        "change_pose": change_pose,
        "circle": circle,
        "figure_eight": figure_eight,
        "drive": drive,
        "velocity_steps": velocity_steps,
    }
)


def named_reference(name: str) -> Reference:
    """Return the reference of that name with its defaults, dashes as underscores; InputError if there is none."""
    known = name.replace("-", "_")
    check_known(known, REFERENCES, f"There is no reference {name!r}", otherwise="the names are")
    return REFERENCES[known]()


def _pose(x: float, y: float, psi: float) -> NDArray[np.float64]:
    pose = np.zeros(10)
    pose[_POSE_INDICES] = x, y, psi
    pose.setflags(write=False)  # some references return the same array at every call
    return pose


#: the columns of a plan; those that every file has, and the indices of their values in the state
_STATE_COLUMNS = tuple(f"ref_{name}" for name in STATE_NAMES)
_FILE_COLUMNS, _POSE_INDICES = ("ref_x", "ref_y", "ref_psi"), [0, 1, 4]
#: a time that rounding moves before its row by less than this fraction of the first interval belongs to that row
_FILE_ROUNDING = 1e-6


def sampled_reference(times: NDArray[np.float64], poses: NDArray[np.float64]) -> Reference:
    """Return the reference that holds each pose x, y [m], psi [rad] (N, 3) until the next; times (N,) [s] rise.

    Of a plan's states (N, 10), return the one that is linear between them.

    >>> reference = sampled_reference(np.array([0.0, 2.0]), np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))
    >>> reference(3.0)[:2]
    array([0.5, 0. ])
    """
    if poses.shape[1] == len(STATE_NAMES):
        return lambda t: np.array([np.interp(t, times, column) for column in poses.T])
    rounding = _FILE_ROUNDING * float(times[1] - times[0]) if len(times) > 1 else 0.0
    wanted = np.zeros((len(times), 10))
    wanted[:, _POSE_INDICES] = poses
    wanted.setflags(write=False)
    begins = times.tolist()
    return lambda t: wanted[max(bisect_right(begins, t + rounding) - 1, 0)]


def write_reference(times: NDArray[np.float64], poses: NDArray[np.float64], path: str | Path) -> None:
    """Write a reference, times (N,) and poses (N, 3) or a plan's states (N, 10), as a log file of its suffix."""
    Log({"t": times} | dict(zip(_columns(poses), poses.T, strict=True))).write(path)


def read_reference(path: str | Path) -> Reference:
    """Return the reference of a file that has t, ref_x, ref_y and ref_psi, or a plan's columns; a log is one.

    InputError if the file cannot be read, lacks a column or misses a value.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     write_reference(np.array([0.0, 2.0]), np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), f"{folder}/step.csv")
    ...     read_reference(f"{folder}/step.csv")(3.0)[:2]
    array([0.5, 0. ])
    """
    return sampled_reference(*read_poses(path))


def reference_text(path: str | Path) -> str:
    """Return a reference file's times and poses, or states, as the text of a CSV file, every value to the bit."""
    times, poses = read_poses(path)
    rows = np.column_stack([times, poses]).tolist()
    return "\n".join(["t," + ",".join(_columns(poses)), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def as_reference(source: ReferenceLike) -> Reference:
    """Return a reference from a function, a name or a file; InputError if the source is none of these."""
    if callable(source):
        return source
    if not isinstance(source, str | Path):
        raise InputError(
            f"A reference is given as an object of type {type(source).__name__}; give a function f(t) of ten numbers, "
            "a name such as 'square', or the path of a reference file."
        )
    return read_reference(source) if is_reference_file(source) else named_reference(str(source))


def is_reference_file(source: str | Path) -> bool:
    """Return whether a reference names a file, by the suffix of a table."""
    return is_log_file(source)


def _columns(rows: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the columns of poses or states."""
    return _FILE_COLUMNS if rows.shape[1] == len(_FILE_COLUMNS) else _STATE_COLUMNS


def read_poses(path: str | Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (N,) and poses (N, 3), or a plan's states (N, 10)."""
    log = Log.read(path)
    planned = any(name in log for name in _STATE_COLUMNS if name not in _FILE_COLUMNS)
    columns = _STATE_COLUMNS if planned else _FILE_COLUMNS
    missing = [name for name in columns if name not in log]
    if missing:
        kind = "plan's" if planned else "reference"
        raise InputError(f"{path} has no column {missing[0]}; a {kind} file has t, {', '.join(columns)}.")
    poses = np.column_stack([log[name] for name in columns])
    if not np.isfinite(poses).all():
        row = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise InputError(
            f"{path} has no value at t = {log.t[row]:g} s; a reference needs a value in every cell."
        )
    return log.t, poses
