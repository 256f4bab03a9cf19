"""A loop on a page: its poles, its margins, its frequency response and its steps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.control.margins import Loop, LoopMargins
from ballbot.report.blocks import Block, Sheet
from ballbot.report.palette import BLUE, GREEN, MUTED, ORANGE, SHADE
from ballbot.report.series import Line, Panel, TimeSeries, wheel_lines
from ballbot.report.style import LineStyle, drawn_picture
from ballbot.report.words import digits

_NONE = np.zeros(0, np.complex128)


def poles_figure(
    *, open_loop: NDArray[np.complex128] = _NONE, closed_loop: NDArray[np.complex128] = _NONE
) -> Figure:
    """Return a robot's poles without control, those of the closed loop, or both; the unstable half is shaded.

    To the left is fast; on the real line nothing oscillates.
    """
    figure = Figure(figsize=(4.6, 2.6), layout="constrained")
    axes = figure.subplots()
    if open_loop.size:
        axes.plot(open_loop.real, open_loop.imag, "x", color=ORANGE, markersize=7, label="without control")
    if closed_loop.size:
        real, imaginary = closed_loop.real, closed_loop.imag
        axes.plot(real, imaginary, "o", color=BLUE, markersize=4.5, mfc="none", label="closed loop")
    axes.axvspan(0.0, 1e3, color=SHADE)
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    poles = np.concatenate([open_loop, closed_loop])
    height = max(1.0, 1.25 * float(np.abs(poles.imag).max()))
    left, right = min(-1.0, 1.12 * float(poles.real.min())), max(1.0, 1.5 * float(poles.real.max()))
    axes.set(xlim=(left, right), ylim=(-height, height))
    axes.set_xlabel("real part [rad/s]")
    axes.set_ylabel("imaginary part [rad/s]")
    axes.legend(loc="upper left")
    return figure


def margins_sentence(margins: LoopMargins) -> str:
    """Return how far the torques may be off; the linear model knows neither the motors' limits nor the wheels' grip."""
    greatest, delay = margins.greatest_gain, margins.delay
    most = "any number of" if np.isinf(greatest) else f"{greatest:.3g}"
    late = "beyond 100 samples" if np.isinf(delay) else f"{1e3 * delay:.0f} ms"
    return (
        f"The linear loop stays stable while the torques of all wheels are {margins.least_gain:.2g} to {most} times "
        f"those commanded, and while they come less than {late} late."
    )


#: [Hz], of the open loop's response, and how many
_LOWEST_FREQUENCY, _FREQUENCIES = 0.02, 300
_LOOPS: tuple[tuple[str, LineStyle], ...] = (
    ("lean", {"color": BLUE, "linestyle": "-", "linewidth": 1.6}),
    ("lean, across", {"color": GREEN, "linestyle": "--", "linewidth": 1.3}),
    ("heading", {"color": ORANGE, "linestyle": "-.", "linewidth": 1.3}),
)


def bode_figure(loop: Loop) -> Figure:
    """Return magnitude and phase of the loop cut at the wheels, up to half the sampling frequency."""
    frequencies = np.geomspace(_LOWEST_FREQUENCY, 0.5 / loop.sample_time, _FREQUENCIES)
    responses = loop.responses(frequencies)
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    size, phase = figure.subplots(2, 1, sharex=True)
    for (label, style), one in zip(_LOOPS, responses.T, strict=True):
        size.plot(frequencies, 20.0 * np.log10(np.abs(one)), label=label, **style)
        phase.plot(frequencies, np.degrees(np.unwrap(np.angle(one))), **style)
    size.axhline(0.0, color=MUTED, linewidth=0.8)
    size.set_ylabel("magnitude [dB]")
    phase.axhline(-180.0, color=MUTED, linewidth=0.8)
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    phase.set_xscale("log")
    figure.legend(*size.get_legend_handles_labels(), loc="outside upper center", ncols=len(_LOOPS))
    return figure


#: a step of the position [m] and of the heading [rad], and for how many time constants of the slowest pole
_STEPS, _TIME_CONSTANTS = (0.1, math.radians(10.0)), 6.0


def loop_blocks(loop: Loop, margins: LoopMargins) -> Iterator[Block]:
    """Yield the margins, the open loop's response, and steps of the position and of the heading."""
    rows = [
        ("least factor on all torques", f"{margins.least_gain:.3g}", "1"),
        ("greatest factor on all torques", digits(margins.greatest_gain), "1"),
        ("greatest delay of all torques", digits(1e3 * margins.delay), "ms"),
    ]
    caption = (
        "At which change of all wheels' torques the first eigenvalue of the sampled loop reaches the unit circle. "
        "Parts besides the gain, friction and limits do not count; a dash: none was found."
    )
    yield Sheet(headings=("margin", "value", "unit"), rows=rows, caption=caption)
    yield drawn_picture(
        "bode",
        partial(bode_figure, loop),
        "Open loop, cut at the wheels, to half the sampling frequency: the eigenvalues of its gain.",
    )
    slowest = loop.slowest
    duration = min(20.0, _TIME_CONSTANTS / slowest)
    for place, size, what in ((0, _STEPS[0], "0.1 m ahead"), (4, _STEPS[1], "10° of heading")):
        yield _step_series(
            loop, place, size, f"Step of {what} by the gain alone, on the linear model.", duration
        )


def _step_series(loop: Loop, place: int, size: float, caption: str, duration: float) -> TimeSeries:
    states, torques = loop.step(place, size, duration)
    pose = (
        Panel(
            label="x [mm]",
            lines=[Line(name="x", values=1e3 * states[:, 0], look="first")],
            levels=(1e3 * size,),
        )
        if place == 0
        else Panel(
            label="heading [deg]",
            lines=[Line(name="heading", values=np.degrees(states[:, 4]), look="first")],
            levels=(math.degrees(size),),
        )
    )
    lean = Panel(
        label="lean φ [deg]", lines=[Line(name="lean", values=np.degrees(states[:, 3]), look="first")]
    )
    return TimeSeries(
        t=np.arange(len(states), dtype=np.float64) * loop.sample_time,
        panels=(
            pose,
            *((lean,) if place == 0 else ()),
            Panel(label="torques [N m]", lines=wheel_lines(list(torques.T))),
        ),
        caption=caption,
        level="reference",
    )
