"""The loop of a robot and its controller: its poles, margins, Bode diagram and step responses."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from ballbot.control.linear import RobotLoop, step_response
from ballbot.control.margins import HEADINGS, MEANING, Margins
from ballbot.mechanics.model import LinearModel
from ballbot.report.blocks import Section, Sheet, Verbatim, details, section
from ballbot.report.console import matrix_text
from ballbot.report.palette import BLUE, MUTED, SHADE
from ballbot.report.series import IN_TURN, Line, Look, Panel, TimeSeries, wheel_lines
from ballbot.report.style import LOOKS, drawn_picture
from ballbot.workflows.robot_check import state_order

#: of what acts on all wheels alike, beside the wheels' looks
_MODES: tuple[Look, ...] = ("quiet", "fifth", "sixth")
#: frequencies of a Bode diagram, and the lowest [rad/s]
_POINTS, _LOWEST = 400, 0.1
#: steps of the reference [m, rad]
STEPS = {"x": 0.1, "psi": math.radians(10.0)}


def poles_figure(poles: NDArray[np.complex128]) -> Figure:
    """Return the poles of a closed loop; the unstable half is shaded.

    To the left is fast; on the real line nothing oscillates.
    """
    figure = Figure(figsize=(4.6, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(poles.real, poles.imag, "o", color=BLUE, markersize=4.5, mfc="none")
    axes.axvspan(0.0, 1e3, color=SHADE)
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    height = max(1.0, 1.25 * float(np.abs(poles.imag).max()))
    left, right = min(-1.0, 1.12 * float(poles.real.min())), max(1.0, 1.5 * float(poles.real.max()))
    axes.set(xlim=(left, right), ylim=(-height, height))
    axes.set_xlabel("real part [rad/s]")
    axes.set_ylabel("imaginary part [rad/s]")
    return figure


def linear_section(linear: LinearModel, *, caption: str) -> Section:
    """Return the section on a linear model about upright."""
    order = state_order(linear.B.shape[1])
    text = "\n".join((order, matrix_text("A", linear.A), matrix_text("B", linear.B)))
    return details(
        "Linear model", Verbatim(text=text, caption=f"x_dot = A x + B u about upright, {caption}.")
    )


def loop_section(margins: Margins, *, of: str = "") -> Section:
    """Return the section on a loop; `of` names its controller, if that is not the page's own."""
    loop = margins.loop
    bode = (
        "Bode diagram of the loop broken at the wheels' torques: at one wheel with the others closed, and at all "
        "wheels together, as the eigenvalues for the two leans and the heading."
    )
    return section(
        f"Stability margins{f' with {of}' if of else ''}",
        Sheet(headings=HEADINGS, rows=margins.rows(), caption=MEANING),
        drawn_picture("bode", partial(bode_figure, margins), bode),
        *(step_series(loop, name) for name in STEPS),
    )


def step_series(loop: RobotLoop, name: str) -> TimeSeries:
    """Return the response to a step of the reference in x or psi as time series of a page."""
    size = STEPS[name]
    step = step_response(loop, name=name, size=size)
    late = f" Torques act {1e3 * loop.delay:g} ms late, as predicted." if loop.delay else ""
    if name == "psi":
        what, degrees = f"{math.degrees(size):g}° of the heading", np.degrees(step.states[:, 4])
        line = Line("heading", degrees, "measured")
        panels = [Panel(label="heading [deg]", lines=(line,), levels=(math.degrees(size),))]
    else:
        what, degrees = f"{1e3 * size:g} mm in x", np.degrees(step.states[:, 3])
        line = Line("x", 1e3 * step.states[:, 0], "measured")
        panels = [
            Panel(label="x [mm]", lines=(line,), levels=(1e3 * size,)),
            Panel(label="lean φ [deg]", lines=(Line("lean", degrees, "measured"),)),
        ]
    return TimeSeries(
        t=step.t,
        panels=[*panels, Panel(label="torques [N m]", lines=wheel_lines(list(step.torques.T)))],
        caption=(
            f"Response of the linear loop to a step of the reference by {what}, without reference shaping, "
            f"feed-forward, limits and friction.{late}"
        ),
        level="reference",
    )


def bode_figure(margins: Margins) -> Figure:
    """Return the Bode diagram of the loop broken at each wheel."""
    figure = Figure(figsize=(7.4, 3.8), layout="constrained")
    gain, phase = figure.subplots(2, 1, sharex=True)
    loop = margins.loop
    omega = np.geomspace(_LOWEST, 0.999 * math.pi / loop.sample_time, _POINTS)
    alike = len(margins.rows()) == 2  # one row of each wheel, one of all
    wheels, names = loop.wheel_responses(omega), ("one wheel",) if alike else loop.wheels
    modes = zip(("lean 1", "lean 2", "heading"), loop.mode_responses(omega).T, _MODES, strict=True)
    for name, response, look in (*zip(names, wheels.T, IN_TURN, strict=False), *modes):
        gain.plot(omega, 20.0 * np.log10(np.abs(response)), label=name, **LOOKS[look])
        degrees = np.degrees(np.unwrap(np.angle(response)))
        # a stable loop crosses 0 dB about -180 degrees; whole turns are only the unwrapping's
        crossing = np.argmin(np.abs(np.log(np.abs(response))))
        phase.plot(omega, degrees - 360.0 * np.round((degrees[crossing] + 180.0) / 360.0), **LOOKS[look])
    for axes, level in ((gain, 0.0), (phase, -180.0)):
        axes.axhline(level, color=MUTED, linewidth=0.9)
        axes.set_xscale("log")
        axes.margins(x=0.0)
    gain.set_ylabel("gain [dB]")
    # outside: within the axes it would cover the crossing of 0 dB of some loops
    figure.legend(*gain.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    phase.set_ylabel("phase [deg]")
    phase.yaxis.set_major_locator(MultipleLocator(90.0))
    phase.set_xlabel("frequency [rad/s]")
    return figure
