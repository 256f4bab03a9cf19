"""How large the torques are, wheel by wheel, by the acceleration that gravity causes.

Regression of a torque on the torque that the motion needs gives too small a factor, because the need comes from
differentiated signals and has their noise. Gravity's part of the need comes from the lean alone:

    z = A^-T r_b E^T M_vv (-Lambda g)          (`ballbot.mechanics.model`)

Its noise is another sensor's, so that k = (z . u) / (z . n), both without what follows the wheel's friction, has no
such bias (an instrumental variable). It is 0.95 to 1.1 on logs that show it well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.physics.evidence import block_sums, without
from ballbot.log.physics.motion import Motion, as_complex, as_plane
from ballbot.log.physics.torque import (
    TURNED_POWER,
    UNCLEAR_FACTOR,
    UNCLEAR_SHARE,
    Driving,
    TorqueEvidence,
    enough_turning,
)
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model, contact_momentum
from ballbot.robot import Robot

SURE = 3.0
#: standard error from which nothing is concluded, relative to the factor; of one torque, to that or the
#: others' median, if that is larger
KNOWN = 0.08
#: seconds of motion from which one torque is judged by itself: of 42 stretches of 12 s of correct logs of the twin one
#: still gets the error, of 14 and 16 s none
LEAST_SECONDS = 14
#: factor of all torques that is an error; dry friction that sticks follows the need, and adds up to a half to it
TOO_LARGE = 1.55
#: one torque's factor over the others' median that is an error
ONE_TOO_LARGE, ONE_TOO_SMALL = 1.55, 0.62


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Factors of the torques over the motion's need."""

    all: float
    all_error: float  #: standard error
    each: NDArray[np.float64]  #: (n,)
    each_error: NDArray[np.float64]  #: (n,) standard errors
    #: (n, 2) smallest and largest factor with any one second left out: one reversal can weigh more than all else, and
    #: then the standard error is too small
    each_without_one: NDArray[np.float64]
    seconds: int  #: of motion

    @property
    def known(self) -> bool:
        """Whether the log shows them."""
        return bool(np.isfinite(self.each).all()) and self.all_error < KNOWN * self.all


def torque_gains(driving: Driving, motion: Motion, robot: Robot) -> Gains | None:
    """Return the factors of a log's torques; None if its wheels turn too little."""
    if not enough_turning(driving):
        return None
    pulled = _pulled(motion, robot)
    of_need, of_torque = [], []
    for i in range(driving.torque.shape[1]):
        weight = driving.turning[:, i] ** TURNED_POWER
        columns = np.column_stack([driving.friction[:, i], np.ones(len(weight))]) * weight[:, None]
        z, n, u = (
            without(columns, signal[:, i] * weight) for signal in (pulled, driving.needed, driving.torque)
        )
        of_need.append(block_sums(z * n, driving.block))
        of_torque.append(block_sums(z * u, driving.block))
    pairs = list(zip(of_need, of_torque, strict=True))
    factors = [_factor(zn, zu) for zn, zu in pairs]
    together, error = _factor(np.sum(of_need, axis=0), np.sum(of_torque, axis=0))
    return Gains(
        all=together,
        all_error=error,
        each=np.array([factor for factor, _ in factors]),
        each_error=np.array([one for _, one in factors]),
        each_without_one=np.array([_without_one(zn, zu) for zn, zu in pairs]),
        seconds=len(of_need[0]),
    )


def gain_findings(found: Gains, torque: TorqueEvidence, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of one torque that is scaled unlike the others, or of all that are too large."""
    if not found.known:
        return []
    # four wheels share what the motion needs in more ways than one
    if len(names) == 3 and found.seconds >= LEAST_SECONDS:
        for j in range(len(names)):
            if findings := _one_unlike_the_others(found, j, names[j]):
                return findings
    too_large = TOO_LARGE * (UNCLEAR_FACTOR if torque.explained < UNCLEAR_SHARE else 1.0)
    if found.all - SURE * found.all_error > too_large:
        sentence = (
            f"The torques are {found.all:.2g} times what the motion of this robot needs: "
            f"{names[0]}, {names[1]} .. are scaled (torque constant, gear ratio, current or "
            "per-unit values in place of N m), or the robot is heavier than its file says."
        )
        return [Finding(code="torque-scale", severity="error", text=sentence, where=Place(columns=names))]
    return []


def _one_unlike_the_others(found: Gains, j: int, name: str) -> list[Finding]:
    factor, error, rest = found.each[j], found.each_error[j], np.delete(found.each, j)
    others = float(np.median(rest))
    if rest.min() <= 0.0 or not error < KNOWN * max(factor, others):
        return []
    least, most = found.each_without_one[j]
    too_large = min(factor - SURE * error, least) > ONE_TOO_LARGE * others
    too_small = max(factor + SURE * error, most) < ONE_TOO_SMALL * others
    if not (too_large or too_small):
        return []
    sentence = (
        f"{name} is {factor / others:.2g} times as large as the other torques, relative to what "
        "the motion of its wheel needs: its torque constant, gear ratio or unit differs, or "
        "its motor gives less than the command. Correct the scale of the column in a mapping."
    )
    return [Finding(code="torque-scale", severity="error", text=sentence, where=Place(columns=(name,)))]


def _factor(zn: NDArray[np.float64], zu: NDArray[np.float64]) -> tuple[float, float]:
    """Return (z . u) / (z . n) and its standard error, by blocks; infinite if nothing is known."""
    total = float(np.sum(zn))
    if total == 0.0:
        return float("inf"), float("inf")
    k = float(np.sum(zu)) / total
    return k, float(np.sqrt(np.sum((zu - k * zn) ** 2)) / abs(total))


def _without_one(zn: NDArray[np.float64], zu: NDArray[np.float64]) -> tuple[float, float]:
    """Return the smallest and the largest (z . u) / (z . n) with one block left out."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = (zu.sum() - zu) / (zn.sum() - zn)
    return float(factors.min()), float(factors.max())


def _pulled(motion: Motion, robot: Robot) -> NDArray[np.float64]:
    """Return gravity's part (N, n) [N m] of the torque that the motion needs of each wheel."""
    law, r_b = contact_momentum(robot), robot.ball.radius
    M_vv = Model(robot).mass_matrix(np.zeros(5))[:2, :2]
    g = -motion.lean[1] + 1j * motion.lean[0]
    force = as_complex(-as_plane(g) @ law.pull.T @ M_vv.T)
    tau = np.column_stack([-r_b * force.imag, r_b * force.real, np.zeros(len(force))])
    return tau @ np.linalg.pinv(transforms(robot).T_owb)
