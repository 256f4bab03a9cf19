"""Check clock, unit and frame of motion capture against the log of the same run.

With the clock and the markers' rotation matched (`turning`), the cameras' displacement over a few seconds, turned into
the log's world by the orientations of both, is that of the log's x and y. Their ratio is one in metres, and 1,000 in
millimetres. In a left-handed frame the displacement is the log's mirrored; if the orientations are of that frame, too,
it is the opposite of the log's, because a mirrored rotation is the rotation turned by half a turn.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ballbot.arrays import Bools, Floats
from ballbot.findings import Finding, error
from ballbot.identification.turning import ANGLE_NAMES, MotionFit, log_rotations, longest_bridge
from ballbot.log import Log
from ballbot.log.evidence import RELATED, TINY
from ballbot.log.pose import Poses
from ballbot.log.units import unit_of_ratio

POSITIONS = ("x", "y")
#: displacements are over so long that a robot's rocking averages out [s], from one row in so many on; and the fewest
STRETCH, EVERY, LEAST_STRETCHES = 5.0, 5, 60
#: beyond this lean a robot falls or is held by hand [rad]
LARGEST_LEAN = 0.35
#: no robot on a ball moves so fast for that long [m/s]: it is a sprinter's speed
FASTEST_BODY = 10.0
#: a camera's displacement turned by more than this against the log's is opposite [rad]
_OPPOSITE = math.radians(135.0)

#: share of the displacement that a linear map of the log's explains and a rotation does not: a mirror's, unless the
#: path is nearly straight; wheels whose radii or angles are off by a tenth make it a hundredth
_NO_ROTATION = 0.1
#: of fewer displacements a linear map explains much by chance
_INDEPENDENT = 3.0

#: poses of the cameras on k rows of the log: the rows, the orientations, and where the tracked point was (k, 3) [m] in
#: the cameras' frame, NaN if not seen
SeenRows = tuple[NDArray[np.intp], Rotation, Floats]


def poses_on_rows(log: Log, poses: Poses, motion: MotionFit) -> SeenRows:
    """Return the poses, interpolated on the log's rows that lie between two close poses."""
    t, longest = motion.clock.to_cameras(log.t), longest_bridge(poses.t)
    rows = np.flatnonzero(_bracketed(t, poses.t, longest))
    t, known = t[rows], np.isfinite(poses.places).all(axis=1)
    points = np.full((len(t), 3), np.nan)
    if known.sum() > 1:
        near = _bracketed(t, poses.t[known], longest)
        columns = [np.interp(t, poses.t[known], column) for column in poses.places[known].T]
        points = np.where(near[:, None], np.column_stack(columns), np.nan)
    return rows, Slerp(poses.t, poses.rotations)(t), points


def _bracketed(t: Floats, seen: Floats, longest: float) -> Bools:
    """Return which times (N,) lie between two times of poses that are at most `longest` apart."""
    after = np.clip(np.searchsorted(seen, t), 1, len(seen) - 1)
    return (t >= seen[0]) & (t <= seen[-1]) & (seen[after] - seen[after - 1] <= longest)


def stretches(t: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first and the last rows of the stretches of `STRETCH` within times (k,) [s], without a long gap."""
    last = np.searchsorted(t, t + STRETCH)
    first = np.flatnonzero(last < len(t))[::EVERY]
    last = last[first]
    kept = t[last] - t[first] < 1.2 * STRETCH
    return first[kept], last[kept]


def frame_findings(log: Log, seen: SeenRows, motion: MotionFit) -> list[Finding]:
    """Return the errors of motion capture whose positions are in another unit, or in a mirrored frame."""
    rows, camera_marker, points = seen
    first, last = stretches(log.t[rows])
    moved = points[last] - points[first]
    rows, kept = rows[first], np.isfinite(moved).all(axis=1)
    speed = math.sqrt(float(np.mean(moved[kept] ** 2)) * 3.0) / STRETCH if kept.any() else 0.0
    findings = []
    if all(name in log for name in (*ANGLE_NAMES, *POSITIONS)):
        path = np.column_stack([log[name] for name in POSITIONS])
        own = path[seen[0][last]] - path[rows]
        rotations, known = log_rotations(log)
        fallen = np.cumsum(~known | (np.hypot(log["theta"], log["phi"]) > LARGEST_LEAN))
        kept &= (fallen[rows] == fallen[seen[0][last]]) & np.isfinite(own).all(axis=1)
        if kept.sum() >= LEAST_STRETCHES:
            first = first[kept]
            world = Rotation.from_quat(rotations.as_quat()[rows[kept]]) * motion.body_marker
            turned = (world * Rotation.from_quat(camera_marker.as_quat()[first]).inv()).apply(moved[kept])
            findings = _compared(own[kept], turned, np.ptp(log.t[rows[kept]]) / STRETCH)
    if not findings and speed > FASTEST_BODY:
        text = (
            f"The motion capture moves at {speed:.3g} m/s, as no robot on a ball does: x, y and z are not in m. Write "
            "their unit into a mapping, and give it with --mocap-mapping."
        )
        findings = [error("unit", text, *POSITIONS, "z")]
    return findings


def _compared(path: Floats, seen: Floats, count: float) -> list[Finding]:
    """Return the errors that the cameras' displacements (k, 3), in the log's world, show against the log's (k, 2).

    They overlap, and `count` of them do not.
    """
    own, cameras = path @ [1.0, 1.0j], seen[:, :2] @ [1.0, 1.0j]
    linear = path @ np.linalg.lstsq(path, seen, rcond=None)[0]
    along = complex(np.vdot(own, cameras))
    sizes = (float(np.sum(values**2)) for values in (path, seen, linear))
    of_log, of_cameras, explained = (max(size, TINY) for size in sizes)
    alike = abs(along) ** 2 / (of_log * of_cameras)
    if explained < RELATED**2 * of_cameras:
        return []
    mirrored, findings = count > _INDEPENDENT and explained / of_cameras - alike > _NO_ROTATION, []
    ratio = math.sqrt(explained / of_log)
    # the units of length are factors of 10 apart or more
    for name, size in (("the motion capture", ratio), ("the log", 1.0 / ratio)):
        if unit := unit_of_ratio(size, "m", within=math.sqrt(10.0)):
            columns = (*POSITIONS, "z") if size == ratio else POSITIONS
            other = "the log's x and y" if size == ratio else "the motion capture"
            option = "--mocap-mapping" if size == ratio else "--mapping"
            text = (
                f"The positions of {name} look like {unit}, not m: they are {size:,.4g} times the path of {other}. If "
                f'so, export them in m, or write unit = "{unit}" for {", ".join(columns)} into a mapping, and give it '
                f"with {option}."
            )
            findings.append(error("unit", text, *columns))
    if mirrored or abs(np.angle(along)) > _OPPOSITE:
        how = "the log's mirrored" if mirrored else "opposite to the log's"
        also = "" if mirrored else ", and of the quaternion's components of the two other axes"
        text = (
            f"The path of the motion capture is {how}: its frame is left-handed, or an axis of the log is negated. "
            f"Change the sign of one of x, y and z{also}, by sign = -1 in a mapping, and give it with --mocap-mapping."
        )
        findings.append(error("mirrored", text, *POSITIONS, "z"))
    return findings
