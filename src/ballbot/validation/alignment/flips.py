"""Jumps of a marker body's frame by 90 or 180 degrees, that symmetric markers give: found by the log, and undone.

    R_seen = R F,   F one of the 24 rotations of a cube, constant from break to break

Across a break the log says how the body turned, M in the marker frame, so that F after it follows from F before:
F_b = the cube's rotation nearest to M^T F_a R_a^T R_b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.log.poses import Poses
from ballbot.validation.alignment.clock import Clock
from ballbot.validation.alignment.turning import Turning, broken

#: further than this from every rotation of the cube, it is something else [rad]
_LARGEST_REMAINDER = np.radians(30.0)
_LONGEST_BREAK = 20.0  #: over which a gyro is believed [s]


@dataclass(frozen=True, kw_only=True)
class Flip:
    """A change of the marker body's frame."""

    t: float  #: of the cameras' clock [s]
    angle: float  #: [rad], of a rotation of a cube
    axis: tuple[float, float, float]  #: in the marker frame, a unit vector


@cache
def cube_rotations() -> Rotation:
    """Return the 24 rotations that leave a cube in place."""
    return Rotation.create_group("O")


def nearest_cube_rotation(rotation: Rotation) -> tuple[Rotation, float]:
    """Return the cube's rotation nearest to one, and the angle between the two [rad]."""
    group = cube_rotations()
    angles = (group.inv() * rotation).magnitude()
    best = int(np.argmin(angles))
    return group[best], float(angles[best])


def stretches(poses: Poses) -> list[tuple[int, int]]:
    """Return the first and last row of every stretch of poses without a break, in their order."""
    unbroken = ~broken(poses)
    edges = np.diff(np.concatenate([[False], unbroken, [False]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def undo_flips(
    poses: Poses,
    found: list[tuple[int, int]],
    anchor: int,
    *,
    log: Turning,
    clock: Clock,
    body_marker: Rotation,
) -> tuple[Poses, tuple[Flip, ...]]:
    """Return the poses in the frame that the marker body has in one stretch, and where it changed.

    Parameters
    ----------
    poses : Poses
    found : list of tuple of int
        Their `stretches`.
    anchor : int
        The number of the stretch whose frame all get.
    log : Turning
        Of the same body.
    clock : Clock
    body_marker : Rotation
        Marker frame to body frame, in the anchor.
    """
    undo = [Rotation.identity()] * len(found)
    for right in range(anchor + 1, len(found)):
        M, seen = _across(poses, found[right - 1], found[right], log, clock, body_marker)
        undo[right] = (
            undo[right - 1] if M is None else _nearest(M.inv() * undo[right - 1] * seen, undo[right - 1])
        )
    for left in range(anchor - 1, -1, -1):
        M, seen = _across(poses, found[left], found[left + 1], log, clock, body_marker)
        undo[left] = (
            undo[left + 1] if M is None else _nearest(M * undo[left + 1] * seen.inv(), undo[left + 1])
        )
    flips: list[Flip] = []
    for right in range(1, len(found)):
        change = (undo[right - 1].inv() * undo[right]).as_rotvec()
        if np.linalg.norm(change) > 0.1:
            flips.append(_flip(float(poses.t[found[right][0]]), change))
    return (_without(poses, found, undo), tuple(flips)) if flips else (poses, ())


def _across(
    poses: Poses, left: tuple[int, int], right: tuple[int, int], log: Turning, clock: Clock, body_marker: Rotation
) -> tuple[Rotation | None, Rotation]:  # fmt: skip
    """Return how the body turned between two stretches, in the marker frame, by the log (None: untold) and as seen."""
    a, b = left[1], right[0]
    M = _turned(log, clock, poses.t[a], poses.t[b])
    seen = poses.rotations[a].inv() * poses.rotations[b]
    return (None if M is None else body_marker.inv() * M * body_marker), seen


def _nearest(rotation: Rotation, otherwise: Rotation) -> Rotation:
    """Return the cube's rotation that is near, or the other one where none is."""
    nearest, remainder = nearest_cube_rotation(rotation)
    return nearest if remainder < _LARGEST_REMAINDER else otherwise


def _without(poses: Poses, found: list[tuple[int, int]], undo: list[Rotation]) -> Poses:
    """Return the poses with every stretch's flip undone; between stretches, that of the one before."""
    quaternions = poses.rotations.as_quat()
    ends = [*(start for start, _ in found[1:]), len(quaternions)]
    begin = 0
    for end, flip in zip(ends, undo, strict=True):
        quaternions[begin:end] = (poses.rotations[begin:end] * flip.inv()).as_quat()
        begin = end
    return replace(poses, rotations=Rotation.from_quat(quaternions))


def _turned(log: Turning, clock: Clock, start: float, end: float) -> Rotation | None:
    """Return how the body turned between two times of the cameras, in its frame at the first; None where unknown."""
    t = clock.to_log(np.array([start, end]))
    if t[1] - t[0] > _LONGEST_BREAK or not log.covers(t[:1], t[1:])[0]:
        return None
    inside = log.t[(log.t > t[0]) & (log.t < t[1])]
    steps = Rotation.from_rotvec(np.diff(log.at(np.concatenate([t[:1], inside, t[1:]])), axis=0))
    while len(steps) > 1:  # neighbours multiplied, until one is left
        odd = steps[-1:] if len(steps) % 2 else None
        steps = steps[0 : len(steps) // 2 * 2 : 2] * steps[1::2]
        steps = Rotation.concatenate([steps, odd]) if odd is not None else steps
    return steps[0]


def _flip(t: float, change: NDArray[np.float64]) -> Flip:
    angle = float(np.linalg.norm(change))
    x, y, z = (change / angle).tolist()
    return Flip(t=t, angle=angle, axis=(x, y, z))
