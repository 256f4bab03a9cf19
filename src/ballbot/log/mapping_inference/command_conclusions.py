"""Conclusions on the commands of a foreign log: what they drive, their kind, unit and delay, resistance, dead band."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ballbot.log.mapping_inference.command_units import Unit
from ballbot.log.mapping_inference.commands import Assignment
from ballbot.log.mapping_inference.drive import RATIO_ERROR, DriveEvidence, gain_bias
from ballbot.log.mapping_inference.evidence import CONFIDENT, MOST, Conclusion, in_percent
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.mapping_inference.roles import PLAIN
from ballbot.log.mapping_inference.stall import resistance_confidence
from ballbot.log.mapping_inference.tolerances import (
    command_delay_harmless,
    delay_evidence,
    delay_words,
)

#: logarithm of the ratio of two scales that no log separates, such as 1000 and 1023
ALIKE = 0.05
#: logarithm of the ratio of the torques of two kinds that are one answer: half of what torques may be off. At 0.15, a
#: current was taken for a torque unasked, and all friction was wrong by 15 %
ALIKE_TORQUES = 0.1


def possible_commands(proposal: Proposal) -> tuple[str, ...]:
    """Return the unused columns that may be the commands of a log without: as many of one name as wheels, that move."""
    roles, columns = proposal.roles, proposal.table.columns
    series: dict[str, list[str]] = {}
    for one in roles.unused(columns):
        open_to = one.kind == "command" or (one.kind == "other" and one.weight < PLAIN)
        values = columns[one.name]
        if one.name not in roles.speeds and one.index is not None and open_to:
            moves = len(np.unique(values[np.isfinite(values)])) > 1
            series.setdefault(one.stem, []).extend([one.name] * moves)
    return tuple(name for group in series.values() if len(group) == len(roles.angles) for name in group)


def command_conclusions(proposal: Proposal) -> list[Conclusion]:
    """Return the conclusions on the commands."""
    if not proposal.roles.commands:
        return _no_commands(proposal)
    drive = proposal.drive
    assigned = drive.assigned if drive else None
    zero = _zero(proposal)
    if drive is None or assigned is None:
        return [
            *zero,
            Conclusion(
                name="order and signs of the commands",
                value="as the wheels",
                confidence=0.5,
                evidence="the log does not show how the wheels respond to the commands",
                alternatives=("another order", "negated"),
                key="[input] from",
            ),
            *_kind(proposal),
        ]
    if assigned.strange is not None and assigned.confidence < CONFIDENT:
        return [*zero, _strange_command(proposal, assigned, assigned.strange)]
    own = [wheel + 1 for wheel in assigned.wheels]
    found = [
        *zero,
        Conclusion(
            name="order and signs of the commands",
            value=f"for wheels {own}, signs {list(assigned.signs)}",
            confidence=assigned.confidence,
            evidence=f"the motion explains {100 * assigned.explained:.0f} % of the commands, {assigned.advantage:.1f} "
            "standard errors better than with any other order or signs"
            + ("; a mixture of all wheels' torques for each explains far more" if assigned.mixed else ""),
            alternatives=(
                ("torques about the body's axes, where a mapping needs each motor's",)
                if assigned.mixed
                else ()
                if assigned.confidence > 0.98
                else (assigned.next_best,)
            ),
            key="[input] sign",
        ),
        *_kind(proposal),
    ]
    late = proposal.command_delay
    bearable = command_delay_harmless(late, drive.braked)
    delay = Conclusion(
        name="delay of the commands",
        value=delay_words(late),
        confidence=late.confidence,
        harmless=bearable,
        evidence=delay_evidence(late, bearable),
        error=1e3 * late.error,
        unit="ms",
        key="[input] delay",
    )
    return [*found, delay, *_dead_band(proposal)]


def _zero(proposal: Proposal) -> list[Conclusion]:
    """Return which number stands for zero in the commands, if it is not zero."""
    found = proposal.roles.zero
    if found is None:
        return []
    return [
        Conclusion(
            name="zero of the commands",
            value=f"{found.value:g}",
            confidence=found.confidence,
            evidence=found.evidence,
            alternatives=tuple(f"{one:g}" for one in found.alternatives),
            key="[input] zero",
        )
    ]


def _no_commands(proposal: Proposal) -> list[Conclusion]:
    """Return whether a log has no commands, if columns may be some; nothing without such columns."""
    names = possible_commands(proposal)
    if not names or proposal.roles.body_commands:
        return []
    return [
        Conclusion(
            name="columns of the commands",
            value="none",
            confidence=0.5,
            evidence=f"{', '.join(names)} are as many as the wheels, and their names do not say what they are",
            alternatives=(", ".join(names),),
            key="--columns",
        )
    ]


def _strange_command(proposal: Proposal, assigned: Assignment, strange: int) -> Conclusion:
    """Return which column was taken for a command but is not one; other doubts about commands follow from it."""
    name, shares = proposal.roles.commands[strange], assigned.shares
    least = min(share for place, share in enumerate(shares) if place != strange)
    return Conclusion(
        name="columns of the commands",
        value=f"{name} as a motor's command",
        confidence=min(assigned.confidence, 0.5),
        evidence=f"one wheel's torque and friction explain at most {100 * shares[strange]:.0f} % of {name}, and at "
        f"least {100 * least:.0f} % of each other command",
        alternatives=(f"{name} as a set point or another quantity, so that this motor's column is missing",),
        key="[input] from",
    )


def _kind(proposal: Proposal) -> list[Conclusion]:
    drive = proposal.drive
    if drive is None:
        return []
    best, found = drive.unit, drive.response
    same: dict[Unit, float] = {unit: 0.0 for unit in drive.units if unit.kind == best.kind}
    kinds: dict[str, float] = {}
    for unit, p in drive.units.items():
        own = unit if unit in same else _equal_unit(unit, same, drive.standstill)
        kind = unit.kind if own is None else own.kind
        kinds[kind] = kinds.get(kind, 0.0) + p
        if own is not None:
            same[own] += p
    total = max(sum(same.values()), 1e-12)
    shown = "names, sizes and whole numbers only"
    if found is not None and math.isfinite(found.gain + found.gain_error + found.damping_error):
        shown = (
            f"{found.gain * math.exp(-gain_bias(best)):.3g} units of the command act as 1 N m (standard error "
            f"{100 * math.hypot(RATIO_ERROR, found.gain_error):.0f} %), and {found.damping:.3f} N m s/rad of damping "
            f"(standard error {found.damping_error:.3f})"
        )
    by_duty = best.kind in ("duty", "voltage")
    contradiction = (
        ()
        if drive.contradicting_factor is None
        else (
            f"another scale, {'another resistance, ' if by_duty else ''}or a robot unlike its file: these are "
            f"{drive.contradicting_factor:.2g} times what the motion needs",
        )
    )
    kind_found = Conclusion(
        name="kind of the command",
        value=best.kind,
        confidence=min(kinds[best.kind], MOST),
        evidence=shown + _alike_kinds(drive, best),
        alternatives=tuple(one for one, p in kinds.items() if one != best.kind and p > 0.02),
        key="[input] kind",
    )
    if not kind_found.determined:
        return [kind_found]  # a unit belongs to a kind
    return [
        kind_found,
        Conclusion(
            name="full scale of the duty" if best.kind == "duty" else "unit of the command",
            value=_scale_words(best),
            confidence=min(sum(p for unit, p in same.items() if _alike(unit, best)) / total, MOST)
            * (1.0 if drive.contradicting_factor is None else 0.5),
            evidence=shown,
            alternatives=(
                *(
                    _scale_words(unit)
                    for unit, p in same.items()
                    if not _alike(unit, best) and p > 0.02 * total
                ),
                *contradiction,
            ),
            key="[input] scale",
        ),
        *([] if contradiction else _resistance(drive)),
    ]


def _resistance(drive: DriveEvidence) -> list[Conclusion]:
    """Return whether the resistance that the torque limit gives is the motors', if they are driven by duties."""
    ratio = drive.torque_ratio
    if drive.unit.kind not in ("duty", "voltage") or ratio is None:
        return []
    times, error = ratio
    confidence = min(resistance_confidence(times, error), MOST)
    shown = (
        f"the motion and the robot file's masses give {times * drive.resistance:.3g} ohm, standard error "
        f"{100 * error:.0f} %"
    )
    return [
        Conclusion(
            name="resistance of the motors",
            value=f"{drive.resistance:.3g} ohm, with which full duty gives the torque limit",
            confidence=confidence,
            evidence=shown,
            alternatives=()
            if confidence >= CONFIDENT
            else (f"{times * drive.resistance:.3g} ohm, by the motion",),
            key="[input] resistance",
        )
    ]


def _equal_unit(unit: Unit, others: Iterable[Unit], standstill: dict[Unit, float]) -> Unit | None:
    """Return the one of other units that makes nearly the same log: a current, if one ampere gives about one N m."""
    if unit.kind not in ("torque", "current"):
        return None
    torque = standstill[unit]
    return next(
        (
            one
            for one in others
            if one.kind in ("torque", "current") and abs(math.log(standstill[one] / torque)) < ALIKE_TORQUES
        ),
        None,
    )


def _alike_kinds(drive: DriveEvidence, best: Unit) -> str:
    """Return, as a clause, how another kind that counts as the same answer changes the torques, or nothing."""
    for unit, p in drive.units.items():
        if unit.kind != best.kind and p > 0.02 and _equal_unit(unit, [best], drive.standstill) is not None:
            times = drive.standstill[unit] / drive.standstill[best]
            return f"; a {unit.kind} in {unit.unit} is not excluded, and gives {times:.2f} times the torques"
    return ""


def _alike(one: Unit, other: Unit) -> bool:
    """Return whether two scales differ by less than a motor's data does."""
    return abs(math.log(one.scale / other.scale)) < ALIKE


def _scale_words(unit: Unit) -> str:
    if unit.kind == "duty":
        return f"{1.0 / unit.scale:g}"
    return unit.unit


def _dead_band(proposal: Proposal) -> list[Conclusion]:
    drive = proposal.drive
    if drive is None or drive.unit.kind != "duty":
        return []
    if proposal.dead_band is not None:
        return [
            Conclusion(
                name="dead band",
                value=f"{proposal.dead_band:.4f}",
                confidence=MOST,
                evidence="as given",
                key="[input] dead_band",
            )
        ]
    undone, estimate = drive.undone_dead_band, drive.dead_band
    if undone is None:
        return []
    other, shown = "the duty that the firmware adds", ""
    if estimate is not None and estimate.informative:
        shown = (
            f"; by the motion, the firmware adds one with a probability of {in_percent(undone.probability)} %"
        )
    value = "counted as less dry friction"
    if proposal.added_duty is not None:
        value = f"{proposal.added_duty:.4f}, the expected one"
    return [
        Conclusion(
            name="dead band",
            value=value,
            confidence=undone.confidence,
            alternatives=() if undone.confidence >= CONFIDENT else (other,),
            evidence="a dead band acts as less dry friction, but for what it adds while a wheel turns against its "
            f"duty, or coasts: {100.0 * drive.turning_against:.0f} % of its size, beside the torque of the wheel that "
            f"this changes most{shown}",
            key="[input] dead_band",
        )
    ]
