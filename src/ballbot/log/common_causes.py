"""Findings of different checks that have one cause, joined to one that names it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ballbot.findings import Finding, Place
from ballbot.log.kinematic_check import ALIKE

if TYPE_CHECKING:
    from ballbot.log.physics import Examined

_VELOCITY = ("x", "y", "x_dot", "y_dot")
_LEAN = ("theta", "phi")


def join_common_causes(findings: Sequence[Finding], examined: Examined) -> list[Finding]:
    """Return the findings, those of one cause as one.

    - The wheels turn too slowly for the states by the factor by which the ball accelerates too much for the lean (or
      the other way round): the ball's velocity, which both checks use, is scaled.
    - A lean angle contradicts its rate and the ball's acceleration: the angle has the opposite sign, not the rate.

    Parameters
    ----------
    findings : sequence of Finding
        Of all checks of one log.
    examined : Examined
        What the equations of motion show of the same log.
    """
    return _negated_angles(_scaled_velocity(findings, examined), examined)


def _scaled_velocity(findings: Sequence[Finding], examined: Examined) -> list[Finding]:
    lean, wheels = examined.lean, examined.wheel_gain
    if lean is None or wheels is None or not {"wheels", "lean-scale"} <= {one.code for one in findings}:
        return list(findings)
    scale = abs(lean.gravity_gain)
    if not 1.0 / ALIKE < scale * wheels < ALIKE:
        return list(findings)
    sentence = (
        f"The ball accelerates {scale:.3g} times as much as the lean implies, and the wheels turn {wheels:.3g} times "
        f"as fast as the ball's velocity implies: x, y, x_dot and y_dot are scaled by {scale:.3g} (unit, wheel radius, "
        "ball radius, gear ratio or encoder counts per turn). Correct the scale of these columns."
    )
    joined = Finding(code="lean-scale", severity="error", text=sentence, where=Place(columns=_VELOCITY))
    return [joined, *(one for one in findings if one.code not in ("wheels", "lean-scale"))]


def _negated_angles(findings: Sequence[Finding], examined: Examined) -> list[Finding]:
    lean = examined.lean
    if lean is None or not lean.misread or lean.angles[0].swapped or lean.rates[0].swapped:
        return list(findings)
    angles = {name for name, sign in zip(_LEAN, lean.angles[0].signs, strict=True) if sign < 0}
    against_rate = {one.where.columns[0] for one in findings if one.code == "sign" and one.where.columns}
    if not angles or min(lean.rates[0].signs) < 0 or not angles <= against_rate:
        return list(findings)
    joined = [
        _negated(one) if one.code == "sign" and one.where.columns[0] in angles else one for one in findings
    ]
    return [one for one in joined if one.code != "lean-axes"]


def _negated(contradiction: Finding) -> Finding:
    angle, rate = contradiction.where.columns
    sentence = (
        f"{angle} and {rate} have opposite signs, and the ball accelerates against {angle}: {angle} has the opposite "
        f"sign. Negate {angle}."
    )
    return Finding(code="sign", severity="error", text=sentence, where=contradiction.where)
