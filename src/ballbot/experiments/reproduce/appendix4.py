"""Appendix IV, sensors against motion capture: Figures IV.1 to IV.4, on three-minute runs of the twin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.experiments.metrics import rms
from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Check, Item, over_runs
from ballbot.validation.alignment import Alignment, SensorErrors

#: the thesis's drift of the heading: 16 degrees in 3 minutes [deg]
THESIS_DRIFT, MINUTES = 16.0, 3.0
#: first and last part of the run that are held beside each other [s]
_PART = 30.0


def figure_iv_1(bench: Bench) -> Item:
    """The angles on board and by the cameras."""
    sensors = _sensors(bench)
    near = [max(float(np.degrees(one.of[name].rms)) for name in ("theta", "phi")) for one in sensors]
    apart = [float(np.degrees(abs(one.of["psi"].drift) * one.duration)) for one in sensors]
    wander = [float(np.degrees(one.of["psi"].wander)) for one in sensors]
    return Item(
        name="Figure IV.1",
        title="The angles on board and by motion capture",
        thesis="Theta and phi stay close to the cameras'; psi slowly drifts apart.",
        ours=f"Theta and phi differ by {over_runs(near)} degrees (RMS, the larger); psi drifts by {over_runs(apart)} "
        f"degrees in {sensors[0].duration:.0f} s, as the twin's gyro was made to.",
        checks=(
            Check.over(
                near,
                claim="theta and phi stay close",
                quantity="the larger RMS difference",
                unit="deg",
                highest=1.0,
            ),
            Check.over(
                [a / w for a, w in zip(apart, wander, strict=True)],
                claim="psi drifts apart",
                quantity="its drift over the run, over the RMS about it",
                lowest=10.0,
            ),
        ),
    )


def figure_iv_2(bench: Bench) -> Item:
    """The angles' errors."""
    sensors = _sensors(bench)
    largest = [max(float(np.degrees(one.of[name].largest)) for name in ("theta", "phi")) for one in sensors]
    drift = [float(np.degrees(abs(one.of["psi"].drift))) * 60.0 * MINUTES for one in sensors]
    return Item(
        name="Figure IV.2",
        title="The angles' errors",
        thesis="Theta's and phi's errors peak just over 1 degree at the worst; the heading drifts by about "
        "16 degrees in 3 minutes.",
        ours=f"The largest error of theta and phi is {over_runs(largest)} degrees; the heading drifts by "
        f"{over_runs(drift)} degrees in 3 minutes.",
        checks=(
            Check.over(
                largest,
                claim="theta's and phi's errors peak just over 1 degree",
                quantity="the largest",
                unit="deg",
                lowest=0.5,
                highest=2.0,
            ),
            Check.over(
                drift,
                claim="the heading drifts by about 16 degrees in 3 minutes",
                quantity="drift",
                unit="deg",
                lowest=0.9 * THESIS_DRIFT,
                highest=1.1 * THESIS_DRIFT,
            ),
        ),
    )


def figure_iv_3(bench: Bench) -> Item:
    """The position on board and by the cameras."""
    first, last = (list(part) for part in zip(*map(_away, bench.alignments), strict=True))
    return Item(
        name="Figure IV.3",
        title="The position on board and by motion capture",
        thesis="The positions match well in the beginning and slowly drift apart.",
        ours=f"They differ by at most {over_runs(first)} mm in the first {_PART:g} s and {over_runs(last)} mm "
        "in the last.",
        checks=(
            Check.over(
                first,
                claim="they match in the beginning",
                quantity=f"largest distance in the first {_PART:g} s",
                unit="mm",
                highest=100.0,
            ),
            Check.over(
                [b / a for a, b in zip(first, last, strict=True)],
                claim="they drift apart",
                quantity="the last part's largest over the first's",
                lowest=2.0,
            ),
        ),
    )


def figure_iv_4(bench: Bench) -> Item:
    """The position's errors, and what of them the heading's error makes."""
    shares = [
        one.position.by_heading if one.position is not None else float("nan") for one in _sensors(bench)
    ]
    follows = [_crossed(one) for one in bench.alignments]
    return Item(
        name="Figure IV.4",
        title="The position's errors",
        thesis="The errors drift and oscillate; that of x goes with the movement in y and that of y with x, "
        "which shows that the heading's drift makes them.",
        ours="In the last minute the smaller of the errors' correlations with the other coordinate is "
        f"{over_runs(follows)}; the heading's error explains {over_runs([100.0 * one for one in shares])} % of the "
        "position error's square.",
        checks=(
            Check.over(
                follows,
                claim="each error goes with the other coordinate's movement",
                quantity="the smaller correlation",
                lowest=0.5,
            ),
            Check.over(
                shares,
                claim="the heading's drift makes them",
                quantity="share of the error's square that it explains",
                lowest=0.5,
            ),
        ),
    )


def _sensors(bench: Bench) -> list[SensorErrors]:
    # the twin's log has angles and the cameras see them
    return [one.sensors for one in bench.alignments if one.sensors is not None]


def _away(found: Alignment) -> tuple[float, float]:
    """Return the largest distance between the two positions in the first and in the last part [mm]."""
    assert found.sensors is not None  # as in `_sensors`
    away, t = np.hypot(found.sensors.errors["x"], found.sensors.errors["y"]), found.log.t
    first, last = np.nanmax(away[t <= t[0] + _PART]), np.nanmax(away[t >= t[-1] - _PART])
    return 1e3 * float(first), 1e3 * float(last)


def _crossed(found: Alignment) -> float:
    """Return the smaller correlation of an error with the other coordinate, late, when the heading is far off."""
    assert found.sensors is not None  # as in `_sensors`
    log, errors = found.log, found.sensors.errors
    late = log.t >= log.t[-1] - 2.0 * _PART
    return min(
        abs(_correlation(errors["x"][late], log["mocap_y"][late])),
        abs(_correlation(errors["y"][late], log["mocap_x"][late])),
    )


def _correlation(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    known = np.isfinite(first) & np.isfinite(second)
    a, b = first[known] - first[known].mean(), second[known] - second[known].mean()
    return float(np.mean(a * b)) / max(rms(a) * rms(b), 1e-12)
