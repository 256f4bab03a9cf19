"""Compare the twin without its imperfections with the exact model in open loop, as contacts become stiffer.

.venv/bin/python -m campaigns.evidence twin_convergence
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot import Model, Robot
from ballbot.report.palette import BLUE, GREEN, INK, ORANGE
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Softness
from campaigns.section import Section, write_picture

SAMPLE_TIME = 0.005  # [s]
SAMPLES = 60  # 0.3 s: the fall multiplies an error by cosh(5.2 t) = 2.5

#: leaning, rolling and turning
START = np.array([0, 0, 0.03, -0.02, 0.3, 0.1, -0.05, 0.05, 0.02, 0.4])

COLORS = (BLUE, ORANGE, GREEN, INK)


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """How stiff the contacts are, and how fine the steps."""

    step: float  #: [s]
    stiffness: float  #: wheels on the ball [N/m]

    def scenario(self, robot: Robot) -> Scenario:
        """Return no friction, no pivoting, one point under each wheel, and a floor as hard as the step allows."""
        return replace(
            Scenario.ideal(robot),
            wheel_contact="point",
            pivoting=10.0,
            floor_grip=2.0,
            roller_grip=2.0,
            timestep=self.step,
            contact_time=2 * self.step,
            softness=Softness(stiffness=self.stiffness, damping=0.15 / self.step),
        )


#: the stiffness that a step can bear grows with its inverse square
TOGETHER = tuple(Contacts(step=5e-4 / 2**k, stiffness=1e5 * 4**k) for k in range(5))
#: the stiffness alone, at a step fine enough for all
STIFFNESS = tuple(Contacts(step=3.125e-5, stiffness=1e4 * 10**k) for k in range(4))


def torques(sample: int) -> NDArray[np.float64]:
    """Return the torques (3,) [N m] of a sample: swings of half a newton metre."""
    t = SAMPLE_TIME * sample
    return 0.5 * np.array([np.sin(9 * t), np.sin(7 * t + 1), np.cos(8 * t)])


def exact_motion(robot: Robot) -> NDArray[np.float64]:
    """Return the exact model's states (samples, 10)."""
    model, state, states = Model(robot, step=1e-4), START, []
    for k in range(SAMPLES):
        state = model.advance(state, torques(k), SAMPLE_TIME)
        states.append(state)
    return np.array(states)


def twin_motion(robot: Robot, contacts: Contacts) -> NDArray[np.float64]:
    """Return the twin's true states (samples, 10)."""
    twin = Twin(robot, contacts.scenario(robot))
    twin.reset(START, seed=1)
    return np.array([twin.step(torques(k), SAMPLE_TIME).truth for k in range(SAMPLES)])


def errors(robot: Robot, exact: NDArray[np.float64], contacts: Contacts) -> NDArray[np.float64]:
    """Return the largest errors (4,): x y [m], theta phi psi [rad], and their rates."""
    off = np.abs(twin_motion(robot, contacts) - exact).max(axis=0)
    return np.array([part.max() for part in np.split(off, (2, 5, 7))])


def campaign() -> Section:
    """Return the errors of both series, and draw them."""
    robot = Robot.load("alten")
    exact = exact_motion(robot)
    rows, series = [], {}
    for name, contacts in (("both", TOGETHER), ("stiffness", STIFFNESS)):
        found = np.array([errors(robot, exact, one) for one in contacts])
        series[name] = found
        rows += [
            [f"{1e3 * one.step:.4g} ms", f"{one.stiffness:.1e} N/m", *(f"{e:.1e}" for e in row)]
            for one, row in zip(contacts, found, strict=True)
        ]
    order = np.polyfit(np.log([one.step for one in TOGETHER]), np.log(series["both"]), 1)[0]
    rows.insert(len(TOGETHER), ["**order in the step**", "", *(f"**{one:.1f}**" for one in order)])
    picture = write_picture("twin_convergence", lambda: _figure(series["both"]))
    moved = np.ptp(exact, axis=0)
    return Section(
        title="Convergence of the twin to the exact model",
        before="MuJoCo's robot without driveline and rolling friction, pivoting prevented, single-point wheels, "
        "against the exact model (RK4): 0.3 s open loop from a moving start under torques of 0.5 N m; largest error "
        f"of any sample. The motion: {moved[0]:.3f} m, {moved[2]:.3f} rad, {moved[4]:.3f} rad of heading. First with "
        "step and stiffness together, then with the stiffness alone.",
        columns=["step", "contact stiffness", "x y [m]", "angles [rad]", "velocities [m/s]", "rates [rad/s]"],
        rows=rows,
        after=f"![errors against the step]({picture})",
    )


def _figure(found: NDArray[np.float64]) -> Figure:
    figure = Figure(figsize=(5.4, 3.4), layout="constrained")
    axes = figure.subplots()
    steps = [1e3 * one.step for one in TOGETHER]
    marks = zip(("x y [m]", "angles [rad]", "velocities [m/s]", "rates [rad/s]"), "os^D", COLORS, strict=True)
    for (label, mark, color), values in zip(marks, found.T, strict=True):
        axes.loglog(steps, values, marker=mark, color=color, markersize=4, linewidth=1.2, label=label)
    axes.set(
        xlabel="step [ms]; the contacts' stiffness grows with its inverse square", ylabel="largest error"
    )
    axes.set_xticks(steps, [f"{step:.3g}" for step in steps])
    axes.minorticks_off()
    axes.set_title("The twin's distance from the exact model")
    axes.legend(loc="lower right")
    return figure
