"""What is read from the residuals (4.2), the gain of psi = 0 at other headings (5.2), and A r = 0 (5.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import held
from ballbot.mechanics.model import Model
from ballbot.simulation.run import simulate
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.item import Check, Mistake
from ballbot.thesis.reproduce.recordings import CHANGE
from ballbot.validation.statistics import Correlations

#: of velocity over ground and rate of lean that kinematics joins: residuals (6, 9) and (7, 8)
LEANING_PAIRS = (("x_dot", "phi_dot"), ("y_dot", "theta_dot"))
#: that the thesis names beside (6, 9): (7, 9)
NAMED_PAIRS = (("y_dot", "phi_dot"),)
#: a lean that is asked for, which no point of rest has [rad], and until when the loop has settled [s]
_ASKED_LEAN, _SETTLING = float(np.radians(2.0)), 60.0


def clear_correlation(found: Correlations) -> float:
    """Return from what size on a residual's correlation with another is clear: four of its standard errors."""
    place = found.labels.index("e_y_dot"), found.labels.index("e_phi_dot")
    return 4.0 / float(np.sqrt(found.counts[place]))


class FixedFrame:
    """u = K (r - x) with the gain of psi = 0 and no turn into the heading's frame, as the thesis has it."""

    def __init__(self, gain: NDArray[np.float64], sample_time: float) -> None:
        self.gain, self.sample_time = gain, sample_time

    def reset(self) -> None:
        """Forget the past; this controller has none."""

    def update(
        self,
        t: float,  # noqa: ARG002
        state: NDArray[np.float64],
        reference: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m]."""
        return self.gain @ (reference - state)


def residual_pairs(bench: Bench) -> Mistake:
    """Section 4.2 names the residual pairs (7, 9) and (6, 9)."""
    found = [one.correlations for one in bench.validations]
    clear = max(clear_correlation(one) for one in found)
    first, second, named = (
        [one.between(f"e_{a}", f"e_{b}")[0] for one in found] for a, b in LEANING_PAIRS + NAMED_PAIRS
    )
    return Mistake(
        number=13,
        where="section 4.2",
        thesis="Residual 7 goes with residual 9, and residual 6 with residual 9 negatively.",
        right="Leaning about y moves the ball along x, leaning about x along y the other way: the pairs are "
        "(6, 9) and (7, 8), with opposite signs.",
        shown_by=(
            Check.over(
                [abs(one) for one in named],
                claim="residual 7 does not go with 9",
                quantity="their correlation on the twin, its size",
                highest=clear,
            ),
            Check.over(
                first, claim="6 goes with 9, and not oppositely", quantity="their correlation", lowest=clear
            ),
            Check.over(
                second, claim="7 goes with 8, oppositely", quantity="their correlation", highest=-clear
            ),
        ),
    )


def gain_at_other_headings(bench: Bench) -> Mistake:
    """The gain is designed at psi = 0 and applied up to psi = pi."""
    limit = _last_stable_heading(bench)
    run = simulate(
        Model(bench.robot),
        FixedFrame(bench.design.gain, bench.robot.sensors.sample_time),
        CHANGE,
        duration=20.0,
    )
    fell = float(run.t[-1]) if run.ended else float("nan")
    turned = bench.frictionless("exact", CHANGE)
    return Mistake(
        number=14,
        where="sections 5.1 and 5.2",
        thesis="The reference goes to psi = pi under u = K (r - x) with one gain.",
        right="The wheels turn with the body, so that the error must be turned into the heading's frame "
        "first, u = K S(psi) (r - x); the thesis has no word on it. Without, the robot falls on the "
        "thesis's own reference.",
        shown_by=(
            Check(
                claim="one gain does not balance at every heading",
                quantity="largest heading at which it does",
                value=float(np.degrees(limit)),
                unit="deg",
                highest=179.0,
            ),
            Check(
                claim="the change to [1 -1 pi] ends in a fall",
                quantity="when the model falls, the change at t = 3 s",
                value=fell,
                unit="s",
                highest=20.0,
            ),
            Check(
                claim="with the error turned it does not",
                quantity="largest lean of the same run with S(psi)",
                value=float(np.degrees(np.abs(turned.states[:, 2:4]).max())),
                unit="deg",
                highest=10.0,
            ),
        ),
    )


def reference_and_stability(bench: Bench) -> Mistake:
    """Section 5.1 asks A r = 0 of a reference for the sake of stability."""
    robot, gain = bench.robot, bench.design.gain
    linear = Model(robot).linearize()
    reference = np.zeros(10)
    reference[3] = _ASKED_LEAN
    F, G = held(linear.A, linear.B, robot.sensors.sample_time)
    largest = float(np.abs(np.linalg.eigvals(F - G @ gain)).max())
    # where x_dot = A x + B K (r - x) is zero
    rest = np.linalg.solve(linear.A - linear.B @ gain, -linear.B @ gain @ reference)
    run = simulate(
        Model(robot),
        FixedFrame(gain, robot.sensors.sample_time),
        lambda _: reference,
        duration=_SETTLING,
    )
    last = run.states[-1] if not run.ended else np.full(10, np.nan)
    return Mistake(
        number=19,
        where="section 5.1, (5.3)",
        thesis="A r = 0 is needed for (5.3) to be stable.",
        right="A r is a constant input to (5.3): it moves the point of rest, e = (A - B K)^-1 A r, and nothing "
        "else. The eigenvalues of A - B K hold no r.",
        shown_by=(
            Check(
                claim="a reference with A r other than 0 is asked for",
                quantity=f"largest entry of A r, phi = {np.degrees(_ASKED_LEAN):g} degrees, its size",
                value=float(np.abs(linear.A @ reference).max()),
                lowest=0.1,
            ),
            Check(
                claim="the loop is stable whatever r is",
                quantity="largest eigenvalue of the sampled loop, its size",
                value=largest,
                highest=1.0,
            ),
            Check(
                claim="the nonlinear model comes to rest under it",
                quantity=f"largest rate after {_SETTLING:g} s, of all ten states' rates",
                value=float(np.abs(last[5:]).max()),
                highest=1e-4,
            ),
            Check(
                claim="away from where it is asked to be",
                quantity="x at rest",
                value=float(last[0]),
                unit="m",
                lowest=0.01,
            ),
            Check(
                claim="as (5.3) says",
                quantity="the same over that of (5.3)",
                value=float(last[0] / rest[0]),
                lowest=0.99,
                highest=1.01,
            ),
        ),
    )


def _last_stable_heading(bench: Bench) -> float:
    """Return the largest heading [rad] up to which the gain, not turned, keeps the sampled linear model stable."""
    linear = Model(bench.robot).linearize()
    F, G = held(linear.A, linear.B, bench.robot.sensors.sample_time)
    last = 0.0
    for psi in np.radians(np.arange(0.0, 180.5, 0.5)):
        # in the heading's frame the model is the same, and the error that the gain sees is turned by psi
        closed = F - G @ bench.design.gain @ _turn(psi)
        if np.abs(np.linalg.eigvals(closed)).max() >= 1.0 + 1e-9:
            break
        last = float(psi)
    return last


def _turn(psi: float) -> NDArray[np.float64]:
    """Return the matrix (10, 10) that takes an error from the heading's frame back to the world's."""
    c, s = np.cos(psi), np.sin(psi)
    pair = np.array([[c, -s], [s, c]])
    matrix = np.eye(10)
    for place in (0, 2, 5, 7):
        matrix[place : place + 2, place : place + 2] = pair
    return matrix
