"""The ball's angular velocity by video, beside the wheels' (the thesis's Figure V.2); and results.json.

results.json holds SI units, radians, pixels, and quaternions in the order wxyz.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ballbot.findings import Finding, by_severity
from ballbot.report.blocks import Bullets, Picture, Result, Sheet, section
from ballbot.report.page import picture_data
from ballbot.report.series import Line, Panel, TimeSeries, true_spans
from ballbot.results import to_results
from ballbot.rounding import plus_minus, signed
from ballbot.vision.spin import Spin, WheelComparison, spin_findings

_AXES = ("x", "y", "z")
_HEADINGS = ("quantity", "value", "unit")


def spin_report(
    spin: Spin,
    comparison: WheelComparison,
    *,
    video: str,
    picture: bytes,
    log_findings: Sequence[Finding],
) -> Result:
    """Return the page; `picture` is the overlay as PNG."""
    verdict, *others = (finding.text for finding in spin_findings(spin, comparison))
    overlay = "Frames of the video with their times, the ball's outline (green) and the seam that was found (magenta)."
    tracked = f"{100.0 * float(np.mean(spin.track.tracked)):.1f}"
    seen = [
        *((words, f"{value:.4g}", unit) for words, _, unit, value in _view(spin)),
        ("frames with the seam tracked", tracked, "%"),
    ]
    return Result(
        title=f"{video}: the ball's angular velocity",
        lead=f"{len(spin.t)} frames in {spin.t[-1] - spin.t[0]:.1f} s. Shape of the seam: {spin.seam.name}.",
        verdict=[("", verdict)],
        sections=[
            section(
                "What was seen",
                Bullets(others),
                Picture(partial(picture_data, picture), overlay),
                Sheet(_HEADINGS, seen, "The camera's view."),
            ),
            section("Angular velocity", _velocity_series(spin, comparison)),
            section("Video and wheels", _comparison_sheet(comparison)),
        ],
        undecided=[
            "Motions faster than the camera: between two frames the ball is taken to turn evenly.",
            "" if spin.known.all() else "The velocity where the seam was lost, which is shaded.",
        ],
        findings=log_findings,
        data=_data(spin, comparison, log_findings),
    )


def _view(spin: Spin) -> list[tuple[str, str, str, float]]:
    """Return words, key in results.json, unit and value of the camera's view of the ball."""
    view = spin.view
    return [
        ("ball's centre, across", "x", "pixels", view.x),
        ("ball's centre, down", "y", "pixels", view.y),
        ("ball's radius", "radius", "pixels", view.radius),
        ("distance of the lens", "distance", "ball radii", view.distance),
    ]


def _comparison_sheet(comparison: WheelComparison) -> Sheet:
    clock = signed(plus_minus(comparison.motion.clock.offset, comparison.motion.offset_half_width))
    rows = [
        ("clock of the video after the log's", clock, "s"),
        *(
            (f"gain about {axis}, video over wheels", plus_minus(float(gain), float(half)), "")
            for axis, gain, half in zip(_AXES, comparison.gain, comparison.gain_half_width, strict=True)
        ),
        ("RMS difference, of the peak", f"{100.0 * comparison.rms_difference_of_peak:.2g}", "%"),
    ]
    return Sheet(_HEADINGS, rows, "±: half widths of 95 %.")


def _velocity_series(spin: Spin, comparison: WheelComparison) -> TimeSeries:
    """Return the ball's velocity by the video and by the wheels, and the difference beside the video's error."""
    panels, differences = [], []
    for axis, name in enumerate(_AXES):
        lines = (
            Line("video", spin.omega[:, axis], "measured"),
            Line("wheel speeds by T_obw", comparison.wheels[:, axis], "second"),
        )
        panels.append(Panel(f"Ω about {name} [rad/s]", lines))
        error = 2.0 * spin.errors[:, axis]
        less = (
            Line("video less wheels", comparison.difference[:, axis], "first"),
            Line("± 2 standard errors of the video", error, "third"),
            Line("± 2 standard errors of the video", -error, "third"),
        )
        differences.append(Panel(f"difference about {name} [rad/s]", less))
    return TimeSeries(
        spin.t,
        [*panels, *differences],
        "The ball's angular velocity by the video and by the wheels, and their difference beside twice the video's "
        "standard error.",
        across="time of the video [s]",
        shaded=true_spans(spin.t, ~spin.known),
        shade="lost",
    )


def _data(spin: Spin, comparison: WheelComparison, log_findings: Sequence[Finding]) -> dict[str, object]:
    """Return what results.json holds."""
    known = spin.known
    return {
        "findings": by_severity([*log_findings, *spin_findings(spin, comparison)]),
        "frames": len(spin.t),
        "duration": float(spin.t[-1] - spin.t[0]),
        "tracked_share": float(np.mean(spin.track.tracked)),
        "stretches": int(spin.track.stretch.max()) + 1,
        "seam": spin.seam.name,
        "seam_separation": spin.colour.separation,
        "view": {
            **{key: value for _, key, _, value in _view(spin)},
            "focal_length": spin.view.focal,
        },
        "ball_omega": {
            "peak": spin.peak,
            "rms": np.sqrt(np.mean(spin.omega[known] ** 2, axis=0)),
            "median_standard_error": np.median(spin.errors[known], axis=0),
        },
        "robot_camera_wxyz": spin.robot_camera,
        "wheels": to_results(comparison)
        | {
            "clock": to_results(comparison.motion.clock)
            | {"offset_half_width": comparison.motion.offset_half_width},
            "rotation_half_width": comparison.motion.rotation_half_width,
        },
    }
