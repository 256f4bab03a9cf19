"""What the results.json of `ballbot spin` holds: SI units, radians, pixels, wxyz."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbot.findings import Finding, finding_results
from ballbot.vision.comparison import WheelComparison
from ballbot.vision.spin import Spin
from ballbot.vision.words import spin_findings


def spin_results(
    spin: Spin, comparison: WheelComparison | None, *, log_findings: Sequence[Finding] = ()
) -> dict[str, object]:
    """Return what results.json holds of a video's ball."""
    found = [
        Finding(code="spin", severity="note", text=sentence) for sentence in spin_findings(spin, comparison)
    ]
    view, errors, colour = spin.view, spin.calibration.errors, spin.colour
    known = spin.known
    omega = spin.omega[known]
    return {
        "findings": finding_results([*log_findings, *found]),
        "frames": len(spin.t),
        "duration": float(spin.t[-1] - spin.t[0]),
        "tracked_share": float(np.mean(spin.track.tracked)),
        "stretches": int(spin.track.stretch.max()) + 1,
        "seam": spin.seam.name,
        "colours": {"seam": colour.seam, "ball": colour.ball, "separation": colour.separation},
        "view": {
            "x": view.x,
            "y": view.y,
            "radius": view.radius,
            "distance": view.distance,
            "focal_length": view.focal,
            "by_seam": spin.calibrated,
            "standard_errors": {
                "x": errors[0],
                "y": errors[1],
                "radius": errors[2] * view.radius,
                "distance": errors[3] * view.distance**2,
            },
        },
        "ball_omega": {
            "peak": float(np.linalg.norm(omega, axis=1).max()),
            "rms": np.sqrt(np.mean(omega**2, axis=0)),
            "median_standard_error": np.median(spin.errors[known], axis=0),
        },
        "robot_camera_wxyz": spin.robot_camera.as_quat(canonical=True)[[3, 0, 1, 2]],
        "wheels": None if comparison is None else _wheels(comparison),
    }


def _wheels(comparison: WheelComparison) -> dict[str, object]:
    return {
        "clock": {
            "offset": comparison.clock.offset,
            "offset_half_width": comparison.offset_half_width,
            "rate": comparison.clock.rate,
        },
        "forward": comparison.forward,
        "camera_tilt": comparison.tilt,
        "rotation_half_width": comparison.rotation_half_width,
        "rms_difference": comparison.rms,
        "rms_difference_of_peak": float(np.linalg.norm(comparison.rms)) / comparison.peak,
        "peak": comparison.peak,
        "gain": comparison.gain,
        "gain_half_width": comparison.gain_half_width,
    }
