"""The ball's velocity from video against T_obw times the wheels' speeds, as in the thesis's Figure V.2; the findings.

Video and log are on clocks of their own, and the camera stands anyhow to the robot; both are found as for motion
capture (`ballbot.validation.alignment`), from how the ball turned over half a second by the one and by the other.
The findings say how well the ball was followed, how it was seen, and whether the wheels agree with the video.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.log import Log
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot
from ballbot.validation.alignment import Clock, MotionFit
from ballbot.validation.alignment.clock import Turning, candidate_clocks
from ballbot.validation.alignment.motion import fit_linear, fit_motion, wahba
from ballbot.vision.spin import Spin

#: share of the turning that video and log must have in common, or they are not of the same run
_LEAST_SHARE = 0.8
#: and the least time [s]
_LEAST_TIME = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelComparison:
    """Video against wheels, on the video's rows."""

    clock: Clock  #: t_video = offset + (1 + rate) t_log
    offset_half_width: float  #: 95 % [s]
    robot_camera: Rotation  #: camera frame to robot frame, by the turning itself
    rotation_half_width: NDArray[np.float64]  #: (3,) 95 % [rad]
    wheels: NDArray[np.float64]  #: (n, 3) T_obw times wheel speeds [rad/s], robot frame; NaN outside the log
    difference: NDArray[np.float64]  #: (n, 3) video less wheels [rad/s]
    rms: NDArray[np.float64]  #: (3,) of that
    peak: float  #: largest length of `wheels` [rad/s]
    gain: NDArray[np.float64]  #: (3,) video over wheels about each axis
    gain_half_width: NDArray[np.float64]  #: (3,) 95 %, by blocks of time

    @property
    def forward(self) -> float:
        """The angle of the robot's x in the picture, from its right, clockwise [rad]."""
        R = self.robot_camera.as_matrix()
        return float(np.arctan2(R[0, 1] - R[1, 0], R[0, 0] + R[1, 1]))

    @property
    def tilt(self) -> float:
        """How far the camera's axis is from the robot's z [rad]."""
        return float(np.arccos(np.clip(self.robot_camera.as_matrix()[2, 2], -1.0, 1.0)))


def compare_with_wheels(
    spin: Spin, log: Log, robot: Robot, *, known: Rotation | None = None
) -> WheelComparison:
    """Return how the ball's velocity by video and by the wheels agree.

    Parameters
    ----------
    spin : Spin
        Camera frame.
    log : Log
        Of the clamped robot in the same run: wheel1_dot, wheel2_dot and so on.
    robot : Robot
        Its geometry makes T_obw.
    known : Rotation, optional
        Camera frame to robot frame; without it, the one found is used.

    Raises
    ------
    InputError
        Where log and video overlap too little, or do not turn alike.
    """
    speeds = log.wheel_speeds
    if speeds.shape[1] != robot.wheel_count:
        raise InputError(
            f"The log has the speeds of {speeds.shape[1]} wheels; {robot.name} has {robot.wheel_count} wheels."
        )
    by_wheels = speeds @ transforms(robot).T_obw.T
    logged, seen = _turning(log.t, by_wheels), _turning(spin.t, spin.velocity.omega)
    motion = _best(logged, seen)
    used = known or motion.body_marker
    at = motion.clock.to_log(spin.t)
    inside = (at >= log.t[0]) & (at <= log.t[-1])
    wheels = np.where(inside[:, None], logged.rate_at(at), np.nan)
    by_video = spin.velocity.omega @ used.as_matrix().T
    difference = by_video - wheels
    both = np.isfinite(difference).all(axis=1)
    gains = [
        fit_linear(wheels[both, axis, None, None], by_video[both, axis, None], spin.t[both])
        for axis in range(3)
    ]
    return WheelComparison(
        clock=motion.clock,
        offset_half_width=motion.offset_half_width,
        robot_camera=motion.body_marker,
        rotation_half_width=motion.rotation_half_width,
        wheels=wheels,
        difference=difference,
        rms=np.sqrt(np.mean(difference[both] ** 2, axis=0)),
        peak=float(np.linalg.norm(wheels[both], axis=1).max()),
        gain=np.array([gain[0] for gain, _ in gains]),
        gain_half_width=np.array([half[0] for _, half in gains]),
    )


def log_with_spin(log: Log, spin: Spin, clock: Clock) -> Log:
    """Return a log with ball_omega_x .. z on its own rows, robot frame; NaN where the video does not tell."""
    t = clock.to_cameras(log.t)
    known = spin.known
    after = np.clip(np.searchsorted(spin.t, t), 1, len(spin.t) - 1)
    near = known[after] & known[after - 1] & (t >= spin.t[0]) & (t <= spin.t[-1])
    omega = np.where(known[:, None], spin.omega, 0.0)
    columns = {
        f"ball_omega_{name}": np.where(near, np.interp(t, spin.t, omega[:, axis]), np.nan)
        for axis, name in enumerate("xyz")
    }
    return log.with_columns(columns)


def _turning(t: NDArray[np.float64], omega: NDArray[np.float64]) -> Turning:
    """Return the running totals of an angular velocity (n, 3); what is NaN is counted as missing."""
    known = np.asarray(np.isfinite(omega).all(axis=1))
    rate = np.where(known[:, None], omega, 0.0)
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)[:, None]
    missing = np.concatenate([[0.0], np.cumsum(~(known[1:] & known[:-1]))])
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return Turning(t=t, total=total, rate=rate, missing=missing)


def _best(logged: Turning, seen: Turning) -> MotionFit:
    if min(seen.t[-1] - seen.t[0], logged.t[-1] - logged.t[0]) < _LEAST_TIME:
        raise InputError(
            f"Video and log must both be at least {_LEAST_TIME:g} s long for their clocks to be aligned."
        )
    try:
        clocks = candidate_clocks(logged, seen)
    except InputError:
        clocks = []
    found = [fit for clock in clocks if (fit := _fit(logged, seen, clock)) is not None]
    best = max(found, key=lambda one: one.increments * np.log(one.motion / one.error), default=None)
    share = 0.0 if best is None else 1.0 - (best.error / best.motion) ** 2
    if best is None or share < _LEAST_SHARE:
        raise InputError(
            f"Video and log do not turn alike: with the best clock only {100 * share:.0f} % of "
            f"the turning is common to both; for the same run it is over {100 * _LEAST_SHARE:.0f} "
            "%. Check that both are of one run, and the order and signs of the wheels."
        )
    return best


def _fit(logged: Turning, seen: Turning, clock: Clock) -> MotionFit | None:
    """Return the fit that starts from a clock; None where they share too little under it, or it runs away."""
    try:
        fit = fit_motion(logged, seen, clock, wahba(logged, seen, clock))
    except InputError:
        return None
    return fit if math.isfinite(fit.error) else None


#: tilts below this are the usual [rad]
_TILTED = np.radians(5.0)
#: a seam of the right kind fits better than this in the median frame
_POOR = 0.85
#: most spans of lost frames that are named
_NAMED = 3


def spin_findings(spin: Spin, comparison: WheelComparison | None) -> tuple[Finding, ...]:
    """Return what a video shows of the ball's turning."""
    words = [_velocity_finding(spin), _tracking_finding(spin), *_poor_fit_finding(spin), _view_finding(spin)]
    if comparison is not None:
        words += [_agreement_finding(comparison), _clock_finding(comparison)]
    return tuple(note("spin", sentence) for sentence in words)


def _velocity_finding(spin: Spin) -> str:
    omega = spin.omega[spin.known]
    errors = spin.errors[spin.known]
    typical = " ".join(f"{value:.2g}" for value in np.median(errors, axis=0))
    return (
        f"The ball turned at up to {np.linalg.norm(omega, axis=1).max():.3g} rad/s; the standard error of its "
        f"velocity about x, y, z is {typical} rad/s (median)."
    )


def _tracking_finding(spin: Spin) -> str:
    lost = ~spin.track.tracked
    whole = f"{spin.t[-1] - spin.t[0]:.1f} s ({len(spin.t)} frames)"
    if not lost.any():
        return f"The seam was tracked throughout, {whole}."
    edges = np.diff(np.concatenate([[0], lost.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    spans = [f"{spin.t[a]:.2f} to {spin.t[b]:.2f} s" for a, b in zip(starts, ends, strict=True)]
    named = ", ".join(spans[:_NAMED]) + (f" and {len(spans) - _NAMED} more" if len(spans) > _NAMED else "")
    return f"Of {whole} the seam was lost in {lost.sum()} frames: {named}."


def _poor_fit_finding(spin: Spin) -> list[str]:
    quality = float(np.median(spin.track.quality[spin.track.tracked]))
    if quality > _POOR:
        return []
    return [
        f"The seam fits the curve {spin.seam.name!r} poorly, by {100 * quality:.0f} % in the "
        "median frame: it may be of another kind (--seam), and the velocity may be wrong."
    ]


def _view_finding(spin: Spin) -> str:
    view, errors = spin.view, spin.calibration.errors
    circle = f"The ball is at ({view.x:.1f}, {view.y:.1f}) with a radius of {view.radius:.1f} pixels"
    if not spin.calibrated:
        return (
            f"{circle}, by its outline. Too little was tracked to estimate the "
            f"camera's distance, which is assumed to be {view.distance:.1f} ball radii."
        )
    spread = errors[3] * view.distance**2
    return (
        f"{circle}; the camera is {view.distance:.2f} ball radii from its centre, by the seam's perspective (standard "
        f"error {spread:.2f})."
    )


def _agreement_finding(comparison: WheelComparison) -> str:
    off = np.abs(comparison.gain - 1.0) > 2.0 * comparison.gain_half_width
    off &= np.abs(comparison.gain - 1.0) > 0.02
    gains = ", ".join(
        f"{gain:.3f} ± {half:.3f}"
        for gain, half in zip(comparison.gain, comparison.gain_half_width, strict=True)
    )
    rms = 100.0 * np.linalg.norm(comparison.rms) / comparison.peak
    verdict = "do not match" if off.any() else "match"
    return (
        f"Video and T_obw times wheel speeds {verdict}: they differ by {rms:.2g} % "
        f"of the peak (RMS), and video is {gains} times the wheels about x, y, z."
    )


def _clock_finding(comparison: WheelComparison) -> str:
    clock = comparison.clock
    where = (
        f"The robot's x axis points {np.degrees(comparison.forward):.1f} "
        "degrees clockwise from the right in the picture"
    )
    tilt = np.degrees(comparison.tilt)
    tilted = f", and the camera is tilted by {tilt:.1f} degrees" + (
        "; check that it was mounted so" if comparison.tilt > _TILTED else ""
    )
    return (
        f"{where}{tilted}; the log's zero is at {clock.offset:.4f} ± {comparison.offset_half_width:.4f} s of the "
        f"video, whose clock runs {1e6 * clock.rate:+.0f} ppm fast."
    )
