"""The page of a controller design."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from ballbot.arrays import Floats
from ballbot.control.controller import torque_limit_words
from ballbot.control.lqr import frictionless_model, matrix_rows
from ballbot.control.margins import HEADINGS, MEANING, Margins
from ballbot.control.overcompensation import has_friction
from ballbot.findings import Finding
from ballbot.log import STATE_NAMES
from ballbot.log.columns import torque_names
from ballbot.mechanics.model import LinearModel
from ballbot.report.blocks import (
    Block,
    Bullets,
    Paragraph,
    Result,
    Section,
    Sheet,
    Verbatim,
    details,
    matrix_text,
    section,
)
from ballbot.report.palette import MUTED
from ballbot.report.series import IN_TURN, Look
from ballbot.report.style import LOOKS, STATE_UNITS, drawn_picture
from ballbot.report.words import NO_FRICTION, capital, state_mark
from ballbot.rounding import percent
from ballbot.summary import pole_words
from ballbot.workflows.controller_design import ControllerDesign
from ballbot.workflows.robot_check import linearization_results


def _nothing_compensated(design: ControllerDesign) -> str:
    """Return why a compensating controller has no friction to compensate; empty if it has some."""
    if has_friction(design.certain):
        return ""
    if has_friction(design.stated):
        return "No part of the friction in the robot file is certain, so none is compensated."
    return NO_FRICTION


def controller_design_report(design: ControllerDesign, findings: Sequence[Finding] | None = None) -> Result:
    """Return the page of a design."""
    controller, nothing = design.controller, _nothing_compensated(design)
    robot, kind = controller.robot, controller.compensation
    slowest = float(-np.max(design.gain.poles.real))
    parts = ", ".join(part.label for _, part in controller.parts.present()) or "none"
    settling = (
        f"The slowest pole is at −{slowest:.3g} rad/s: the robot settles in about {4.0 / slowest:.2g} s."
    )
    margin = f"{capital(design.margin.sentence)}."
    if design.margin.overcompensates:
        margin = f"WARNING: {design.margin.sentence}; this injects energy and can destabilise the robot."
    return Result(
        title=f"{robot.name}: a controller",
        lead=(
            f"Sampled LQR at {1e3 * controller.sample_time:g} ms; {'no' if kind == 'none' else kind} friction "
            f"compensation; parts: {parts}."
        ),
        verdict=[
            ("Closed loop", settling),
            ("Margins", f"{capital(design.loop_margins.sentence())}."),
            ("Torque limit of each wheel", f"{torque_limit_words(controller)}."),
            ("Compensation", "" if kind == "none" else nothing or margin),
        ],
        sections=[
            section(
                "Gain",
                gain_sheet(design.gain.gain),
                Paragraph(f"Closed-loop poles: {pole_words(design.gain.poles)} rad/s."),
            ),
            loop_section(design.loop_margins),
            details("Friction compensation", *_compensation_blocks(design)),
            linear_section(frictionless_model(robot).linearize(), caption="exact model without friction"),
        ],
        undecided=[
            "How the loop behaves with the robot's friction, play, noise and limits: the poles are those of the linear "
            "model without friction. `ballbot simulate`, `ballbot limits` and `ballbot compare` show it.",
        ],
        findings=findings,
        data={
            "robot": robot.name,
            "sample_time": controller.sample_time,
            "compensation": kind,
            "gain": controller.gain,
            "poles": design.gain.poles,
            "linearization": linearization_results(frictionless_model(robot)),
            "loop_margins": design.loop_margins,
            "compensation_margin": design.margin,
        },
    )


def _compensation_blocks(design: ControllerDesign) -> Iterator[Block]:
    none = design.controller.compensation == "none"
    if nothing := "No friction is compensated." if none else _nothing_compensated(design):
        yield Bullets([nothing])
        return
    margin, stated, certain = design.margin, design.stated, design.certain
    of_wheels = zip(margin.wheel_fractions, margin.at_speeds, strict=True)
    rows = [
        (f"wheel {k}", percent(share), f"{speed:.2g} rad/s") for k, (share, speed) in enumerate(of_wheels, 1)
    ]
    rows.append(("rolling", percent(margin.rolling_fraction), ""))
    caption = "Largest compensated fraction of the friction that is certain; beyond 100 % it injects energy."
    yield Sheet(("friction", "compensated", "at"), rows, caption)
    if certain is not stated:
        dry, viscous = (
            ", ".join(percent(part / all_) if all_ else "none" for part, all_ in zip(*each, strict=True))
            for each in ((certain.coulomb, stated.coulomb), (certain.viscous, stated.viscous))
        )
        text = f"each wheel's dry friction: {dry}; of its viscous friction: {viscous}."
        yield Bullets([f"Only the friction that is certain is compensated, as a fraction of {text}"])


def gain_sheet(
    gain: Floats, caption: str = "Gain K of u = K S(ψ) (r − x), in N m per unit of each state."
) -> Sheet:
    """Return a gain (n, k) with a row for each state, so that it fits a narrow page."""
    # integral action adds states
    names = [f"{state_mark(name)} [{STATE_UNITS[name]}]" for name in STATE_NAMES]
    names += [f"∫ {k}" for k in range(1, gain.shape[1] - len(names) + 1)]
    rows = [(name.strip(), *cells) for name, cells in matrix_rows(gain.T, names)]
    wheels = (f"wheel {k}" for k in range(1, len(gain) + 1))
    return Sheet(("state", *wheels), rows, caption)


def linear_section(linear: LinearModel, *, caption: str) -> Section:
    """Return the section on a linear model about upright."""
    states = ", ".join(f"{name} [{STATE_UNITS[name]}]" for name in STATE_NAMES)
    order = f"x = {states}\nu = {', '.join(torque_names(linear.B.shape[1]))} [N m]"
    text = "\n".join((order, matrix_text("A", linear.A), matrix_text("B", linear.B)))
    return details("Linear model", Verbatim(text, f"x_dot = A x + B u about upright, {caption}."))


def loop_section(margins: Margins, *, of: str = "") -> Section:
    """Return the section on a loop; `of` names its controller if the page is not about it."""
    bode = (
        "Bode diagram of the loop broken at the wheels' torques: at one wheel with the others closed, and at all "
        "wheels together, as the eigenvalues for the two leans and the heading."
    )
    return section(
        f"Stability margins{f' with {of}' if of else ''}",
        Sheet(HEADINGS, margins.rows(), MEANING),
        drawn_picture("bode", bode, bode_figure, margins),
    )


def bode_figure(margins: Margins) -> Figure:
    """Return the Bode diagram of the loop broken at each wheel."""
    figure = Figure(figsize=(7.4, 3.8), layout="constrained")
    gain, phase = figure.subplots(2, 1, sharex=True)
    loop = margins.loop
    omega = np.geomspace(0.1, 0.999 * math.pi / loop.sample_time, 400)
    alike = len(margins.rows()) == 2  # one row for any single wheel, one for all together
    wheels, names = loop.wheel_responses(omega), ("one wheel",) if alike else loop.wheels
    # responses of all wheels together differ in look from those of single wheels
    of_modes: tuple[Look, ...] = ("quiet", "fifth", "sixth")
    modes = zip(("lean 1", "lean 2", "heading"), loop.mode_responses(omega).T, of_modes, strict=True)
    for name, response, look in (*zip(names, wheels.T, IN_TURN, strict=False), *modes):
        gain.plot(omega, 20.0 * np.log10(np.abs(response)), label=name, **LOOKS[look])
        degrees = np.degrees(np.unwrap(np.angle(response)))
        # a stable loop crosses 0 dB near -180 degrees; whole turns come from unwrapping only
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
