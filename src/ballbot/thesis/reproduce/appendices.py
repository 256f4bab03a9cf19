"""Appendix I, hardware: Figure I.1. III, parameters: Figure III.1. IV, sensors: IV.1 to IV.4.

Figure III.1 is made on simulated swings, those of Appendix IV on three-minute runs of the twin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.identification.inertia import Pivot, inertia_of_swing
from ballbot.report.alignment import smoothed
from ballbot.report.bench import swing_figure
from ballbot.report.palette import MUTED
from ballbot.report.style import MEASURED, STATE_SYMBOLS, WITHOUT_FRICTION, LineStyle
from ballbot.robot import Robot
from ballbot.robot.derived import shell_wall, wheel_speed_limit
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.drawing import Arrow, Curve, blocks_figure, panels_figure
from ballbot.thesis.reproduce.item import Check, Item, over_runs
from ballbot.thesis.reproduce.mistakes import RUBBER
from ballbot.validation.alignment import Alignment, SensorErrors
from ballbot.workflows.metrics import rms


def figure_i_1(bench: Bench) -> Item:
    """The robot's architecture, a drawing; the appendix's numbers are held against its formulas."""
    ball, drive = bench.robot.ball, bench.robot.drive
    wall = 100.0 * shell_wall(mass=ball.mass, radius=ball.radius, density=RUBBER)
    limit = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )
    return Item(
        name="Figure I.1",
        title="The robot's architecture",
        thesis="The thesis draws controller, motor drivers, motors, wheels, encoders and IMU; it computes a "
        "wall of 2.5 cm for the ball and 27.59 rad/s for the wheels.",
        ours=f"Ours is the same drawing with the numbers of the preset {bench.robot.name}; its formulas give "
        f"{wall:.2f} cm and {limit:.2f} rad/s.",
        checks=(
            Check("the wall is 2.5 cm", "by mass, radius and density", wall, "cm", lowest=2.45, highest=2.55),
            Check(
                "the wheels' speed limit is 27.59 rad/s",
                "by supply, motor and gear",
                limit,
                "rad/s",
                lowest=27.585,
                highest=27.595,
            ),
        ),
        figure=lambda: _architecture(bench.robot),
    )


#: what the swing gave, by Appendix III [kg m^2]
THESIS_INERTIA = 4.37


def figure_iii_1(bench: Bench) -> Item:
    """The body hung up at the ball's centre and let swing, in simulation."""
    fit, hung = bench.swings[0], Pivot.of(bench.robot)
    found = [inertia_of_swing(one, bench.robot, hung) for one in bench.swings]
    pivots = [one.about_pivot.value for one in found]
    half, own = found[0].about_pivot.half_width, found[0].about_center_of_mass
    return Item(
        name="Figure III.1",
        title="The body's inertia from a simulated swing",
        thesis="The thesis shows a frame of the video of the hanging body, and gives 4.37 kg m^2 by I = m g "
        "r / omega_n^2; neither the frequency nor an uncertainty is printed.",
        ours=f"A body of that inertia swings at {fit.frequency:.4f} rad/s, with a period of "
        f"{2.0 * math.pi / fit.frequency:.4f} s. Nothing was filmed: the angles are simulated by a pendulum of that "
        f"inertia, {fit.swing.swings:.0f} swings at 30 samples a second with an error of 3 mrad each. From each of "
        f"{len(found)} such records `ballbot check --swing` finds {over_runs(pivots)} kg m^2 about the pivot, the "
        f"first to ± {half:.1g}, and {own.value:.3f} about the centre of mass. That tests the method, not the "
        "thesis's number.",
        checks=(
            Check.over(
                "the method finds the inertia that was simulated, 4.37 kg m^2",
                "found from the swing, its difference from that",
                [100.0 * abs(one / THESIS_INERTIA - 1.0) for one in pivots],
                "%",
                highest=0.1,
            ),
        ),
        figure=lambda: swing_figure(fit, label="simulated, with the tracking's error"),
    )


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
            Check.over("theta and phi stay close", "the larger RMS difference", near, "deg", highest=1.0),
            Check.over(
                "psi drifts apart",
                "its drift over the run, over the RMS about it",
                [a / w for a, w in zip(apart, wander, strict=True)],
                lowest=10.0,
            ),
        ),
        figure=lambda: _both(bench.alignments[0], ("theta", "phi", "psi")),
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
                "theta's and phi's errors peak just over 1 degree",
                "the largest",
                largest,
                "deg",
                lowest=0.5,
                highest=2.0,
            ),
            Check.over(
                "the heading drifts by about 16 degrees in 3 minutes",
                "drift",
                drift,
                "deg",
                lowest=0.9 * THESIS_DRIFT,
                highest=1.1 * THESIS_DRIFT,
            ),
        ),
        figure=lambda: _errors(bench.alignments[0], ("theta", "phi", "psi")),
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
                "they match in the beginning",
                f"largest distance in the first {_PART:g} s",
                first,
                "mm",
                highest=100.0,
            ),
            Check.over(
                "they drift apart",
                "the last part's largest over the first's",
                [b / a for a, b in zip(first, last, strict=True)],
                lowest=2.0,
            ),
        ),
        figure=lambda: _both(bench.alignments[0], ("x", "y")),
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
                "each error goes with the other coordinate's movement",
                "the smaller correlation",
                follows,
                lowest=0.5,
            ),
            Check.over(
                "the heading's drift makes them",
                "share of the error's square that it explains",
                shares,
                lowest=0.5,
            ),
        ),
        figure=lambda: _errors(bench.alignments[0], ("x", "y")),
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


def _architecture(robot: Robot) -> Figure:
    """Return the architecture with the robot's numbers."""
    drive, sensors, n = robot.drive, robot.sensors, robot.wheel_count
    left, right = 0.26, 0.78
    wheels, ball = f"{2e3 * robot.wheels.radius:g} mm", robot.ball
    return blocks_figure(
        (
            ("IMU MTi-3 AHRS\nlean, heading, rates", (left, 0.92), (0.42, 0.14)),
            (f"batteries\n{drive.supply_voltage:g} V", (right, 0.92), (0.36, 0.14)),
            (f"controller STM32F303\n{1.0 / sensors.sample_time:g} Hz", (left, 0.65), (0.42, 0.16)),
            (f"{n} drivers\nESCON 36/3 EC", (right, 0.65), (0.36, 0.16)),
            (f"{n} encoders HEDL 5540\n{sensors.encoder_counts} counts a turn", (left, 0.36), (0.46, 0.16)),
            (f"{n} motors EC-i 40\ngears {drive.gear_ratio:g} : 1", (right, 0.36), (0.36, 0.16)),
            (f"ball\n{ball.mass:g} kg, {200.0 * ball.radius:g} cm", (left, 0.08), (0.42, 0.14)),
            (f"{n} omni-wheels\n{wheels}", (right, 0.08), (0.36, 0.14)),
        ),
        (
            Arrow(path=((left, 0.85), (left, 0.73))),
            Arrow(path=((right, 0.85), (right, 0.73))),
            Arrow(path=((0.47, 0.65), (0.60, 0.65)), label="torque"),
            Arrow(path=((right, 0.57), (right, 0.44)), label="current"),
            Arrow(path=((0.60, 0.36), (0.49, 0.36))),
            Arrow(path=((left, 0.44), (left, 0.57))),
            Arrow(path=((right, 0.28), (right, 0.15))),
            Arrow(path=((0.60, 0.08), (0.47, 0.08)), both_ways=True),
        ),
        height=4.0,
    )


_THIN: LineStyle = {"color": MUTED, "linestyle": "-", "linewidth": 0.6}


def _both(found: Alignment, names: Sequence[str]) -> Figure:
    """Return states on board and by the cameras, angles in degrees."""
    log, panels = found.log, []
    for name in names:
        scale, unit = (1.0, "m") if name in ("x", "y") else (float(np.degrees(1.0)), "deg")
        curves: list[Curve] = [
            ("cameras", log.t, scale * log[f"mocap_{name}"], MEASURED),
            ("on board", log.t, scale * log[name], WITHOUT_FRICTION),
        ]
        panels.append((f"{STATE_SYMBOLS[name]} [{unit}]", curves))
    return panels_figure(panels)


def _errors(found: Alignment, names: Sequence[str]) -> Figure:
    """Return errors, and beside those of angles their drift, those of places what the heading's error makes of them."""
    assert found.sensors is not None  # as in `_sensors`
    t, place, panels = found.log.t, found.sensors.position, []
    for name in names:
        scale, unit = (1e3, "mm") if name in ("x", "y") else (float(np.degrees(1.0)), "deg")
        error = scale * found.sensors.errors[name]
        if name in ("x", "y"):
            label = "made by the heading's error"
            other = np.full(len(t), np.nan) if place is None else scale * place.predicted[:, "xy".index(name)]
        else:
            known, label = np.isfinite(error), "drift"
            other = error[known].mean() + scale * found.sensors.of[name].drift * (t - t[known].mean())
        mean = smoothed(error, max(1, round(1.0 / found.log.sample_time)))
        curves: list[Curve] = [
            ("each sample", t, error, _THIN),
            ("mean over 1 s", t, mean, MEASURED),
            (label, t, other, WITHOUT_FRICTION),
        ]
        panels.append((f"error of {STATE_SYMBOLS[name]} [{unit}]", curves))
    return panels_figure(panels)
