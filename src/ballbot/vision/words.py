"""What a video told, in words: how well the ball was followed, how it was seen, and whether the wheels say the same."""

from __future__ import annotations

import numpy as np

from ballbot.vision.comparison import WheelComparison
from ballbot.vision.spin import Spin

#: tilts below this are the usual [rad]
_TILTED = np.radians(5.0)
#: a seam of the right kind fits better than this in the median frame
_POOR = 0.85
#: most spans of lost frames that are named
_NAMED = 3


def spin_findings(spin: Spin, comparison: WheelComparison | None) -> tuple[str, ...]:
    """Return the findings as plain sentences."""
    words = [_velocity(spin), _tracking(spin), *_doubts(spin), _view(spin)]
    if comparison is not None:
        words += [_agreement(comparison), _clocks(comparison)]
    return tuple(words)


def _velocity(spin: Spin) -> str:
    omega = spin.omega[spin.known]
    errors = spin.errors[spin.known]
    typical = " ".join(f"{value:.2g}" for value in np.median(errors, axis=0))
    return (
        f"The ball turned at up to {np.linalg.norm(omega, axis=1).max():.3g} rad/s; the standard error of its "
        f"velocity about x, y, z is {typical} rad/s (median)."
    )


def _tracking(spin: Spin) -> str:
    lost = ~spin.track.tracked
    whole = f"{spin.t[-1] - spin.t[0]:.1f} s ({len(spin.t)} frames)"
    if not lost.any():
        return f"The seam was tracked throughout, {whole}."
    edges = np.diff(np.concatenate([[0], lost.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    spans = [f"{spin.t[a]:.2f} to {spin.t[b]:.2f} s" for a, b in zip(starts, ends, strict=True)]
    named = ", ".join(spans[:_NAMED]) + (f" and {len(spans) - _NAMED} more" if len(spans) > _NAMED else "")
    return f"Of {whole} the seam was lost in {lost.sum()} frames: {named}."


def _doubts(spin: Spin) -> list[str]:
    quality = float(np.median(spin.track.quality[spin.track.tracked]))
    if quality > _POOR:
        return []
    return [
        f"The seam fits the curve {spin.seam.name!r} poorly, by {100 * quality:.0f} % in the "
        "median frame: it may be of another kind (--seam), and the velocity may be wrong."
    ]


def _view(spin: Spin) -> str:
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


def _agreement(comparison: WheelComparison) -> str:
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


def _clocks(comparison: WheelComparison) -> str:
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
