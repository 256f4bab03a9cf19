"""All conclusions on a foreign log, in the order in which they rest on one another."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from ballbot.log.mapping_inference.commands import FULL_DUTIES, Assignment, Unit
from ballbot.log.mapping_inference.drive import DriveEvidence, resistance_confidence
from ballbot.log.mapping_inference.evidence import (
    CONFIDENT,
    MOST,
    Conclusion,
    advantage_confidence,
    in_percent,
)
from ballbot.log.mapping_inference.file_signals import GyroTest
from ballbot.log.mapping_inference.frame import Frame, HeadingTest
from ballbot.log.mapping_inference.names import read_name
from ballbot.log.mapping_inference.placement import LEAST_TIME, LeanTest
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.mapping_inference.tolerances import (
    TURN,
    Delay,
    command_delay_confidence,
    dead_band_confidence,
    turn_confidence,
)
from ballbot.log.mapping_inference.units import GAIN_DEVIATION, Scale, time_conclusion

#: prior probability that columns are about the world's axes, chosen and not measured: theta and phi, as papers on ball
#: balancing call them; angles of one letter, theta_x and theta_y, as an IMU's three are often called; roll and pitch
WORLD_THETA_PHI, WORLD_ONE_LETTER, WORLD_ROLL_PITCH = 0.5, 0.15, 0.01
#: a heading that turns by less than this [rad] around its mean leaves no question of the lean's axes: the other
#: reading turns the lean by no more
STEADY_HEADING = math.radians(4.0)
#: logarithm of the ratio of two scales that no log separates, such as 1000 and 1023
ALIKE = 0.05
#: logarithm of the ratio of the torques of two kinds that are one answer: half of what torques may be off
ALIKE_TORQUES = 0.1


def conclusions_of(proposal: Proposal) -> tuple[Conclusion, ...]:
    """Return the conclusions of a proposal."""
    found = [
        _columns(proposal),
        _time(proposal),
        _unit_of_wheels(proposal),
    ]
    if proposal.lean is not None:
        found.append(_scale("unit of the lean", proposal.lean, "[attitude] unit"))
        heading = proposal.heading_unit
        if heading is not None and (heading.unit != proposal.lean.unit or heading.confidence < CONFIDENT):
            found.append(_scale("unit of the heading", heading, "[attitude] unit"))
        found += _frame(proposal)
    if proposal.roles.commands:
        found += _commands(proposal)
    return tuple(found)


def _columns(proposal: Proposal) -> Conclusion:
    roles = proposal.roles
    named = "by their names" if not proposal.by_data else "by their values"
    by_values = [one for one in (roles.angles, roles.speeds, roles.commands) if one in roles.open_series]
    if by_values and not proposal.by_data:
        named += f", {' and '.join(', '.join(one) for one in by_values)} by their values"
    value = f"{roles.time}, {', '.join((*roles.attitude, *roles.angles, *roles.commands))}"
    if proposal.by_data and not (roles.alternatives or roles.quaternion or roles.time_parts):
        value = f"--columns {_columns_option(proposal)}"
    return Conclusion(
        name="columns",
        value=value,
        confidence=min(roles.confidence, MOST),
        evidence=f"time, lean, wheel angles and commands are recognised {named}",
        alternatives=roles.alternatives,
        key="--columns",
    )


def _columns_option(proposal: Proposal) -> str:
    """Return the names that --columns takes, in the file's order: what each column is; _ for one without a role."""
    roles = proposal.roles
    named = {roles.time: "t", **dict(zip(roles.attitude, ("roll", "pitch", "yaw"), strict=False))}
    named |= {name: f"wheel{place}_angle" for place, name in enumerate(roles.angles, start=1)}
    named |= {name: f"command{place}" for place, name in enumerate(roles.commands, start=1)}
    return ",".join(named.get(name, "_") for name in proposal.table.columns)


def _time(proposal: Proposal) -> Conclusion:
    tested, gyro, named = proposal.lean_test, proposal.gyro, proposal.roles.reading(proposal.roles.gyro)
    return time_conclusion(
        proposal.time,
        # counts of a gyro fit in several scales, and show no unit of the time
        by_gyro=gyro.gain if gyro and gyro.scale == 1.0 else None,
        gyro_named=bool(named and named.unit),
        by_gravity=(tested.time_ratio, tested.time_error) if tested else (math.nan, math.nan),
        gain=tested.placements[0].gain if tested else 1.0,
    )


def _scale(name: str, scale: Scale, key: str) -> Conclusion:
    return Conclusion(
        name=name,
        value=scale.description,
        confidence=scale.confidence,
        evidence=scale.reason,
        alternatives=scale.alternatives,
        key=key,
    )


#: by how many standard deviations [log] the lean's response to the wheels must be off to contradict units and robot
#: file; noise of the wheels makes it too small, so that such a one counts as less
GAIN_CONTRADICTED, TOO_SMALL = 2.5, 1.3


def _unit_of_wheels(proposal: Proposal) -> Conclusion:
    """Return the unit of the wheel angles, in doubt if the lean responds to the wheels unlike the robot's."""
    found, tested = _scale("unit of the wheel angles", proposal.wheel, "[wheels] angle"), proposal.lean_test
    if tested is None or not math.isfinite(tested.gain_error):
        return found
    gain = tested.placements[0].gain
    off, deviation = math.log(max(gain, 1e-12)), math.hypot(GAIN_DEVIATION, tested.gain_error)
    if abs(off) < GAIN_CONTRADICTED * deviation * (TOO_SMALL if off < 0.0 else 1.0):
        return found
    unlike = (
        f"a robot unlike its file: the lean responds to the wheels {gain:.2g} times as strongly as it should"
    )
    return replace(found, confidence=min(found.confidence, 0.5), alternatives=(*found.alternatives, unlike))


def _frame(proposal: Proposal) -> list[Conclusion]:
    tested, frame, heading = proposal.lean_test, proposal.frame, proposal.heading
    if tested is None:
        sentence = (
            f"the log has less than {LEAST_TIME:.0f} s of balancing, too few to test where the wheels are"
        )
        return [
            Conclusion(
                name="order and signs of the wheels",
                value="as the robot's",
                confidence=0.5,
                evidence=sentence,
                alternatives=("mirrored", "a wheel reversed"),
                key="[wheels] order",
            )
        ]
    best, other = tested.placements[:2]
    found = [
        Conclusion(
            name="order and signs of the wheels",
            value=best.description,
            confidence=tested.confidence,
            evidence=f"the next best placement, {other.description}, fits {tested.margin:.1f} times worse",
            alternatives=() if tested.confidence > 0.98 else (other.description,),
            key="[wheels] order",
        )
    ]
    yaw = heading is not None
    found.append(
        Conclusion(
            name="direction in which all wheels count",
            value=f"signs {list(frame.signs)}",
            # it rests on the signs of the wheels among themselves
            confidence=tested.confidence * frame.direction,
            evidence=_direction_evidence(tested, frame, heading),
            alternatives=(f"signs {[-sign for sign in frame.signs]} with the IMU turned by 180 deg",)
            if yaw
            else (),
            key="[wheels] sign",
        )
    )
    if frame.handedness < 0.999 and yaw:
        found.append(_handedness(proposal))
    if yaw and tested.headings > STEADY_HEADING:
        found.append(_axes_of_lean(proposal, tested))
    return [*found, *_turn_and_delay(proposal)]


def _direction_evidence(tested: LeanTest, frame: Frame, heading: HeadingTest | None) -> str:
    if heading is not None:
        return f"the sum of the wheels' speeds and the heading's rate correlate by {heading.correlation:.2f}"
    if frame.signs_by_heading:
        return (
            "with the heading that the wheels give, the lean's acceleration fits "
            f"{abs(tested.forwards):.1f} standard errors better than with the opposite one"
        )
    return "without a heading, wheels that count backwards and an IMU turned by half a turn are one"


def _handedness(proposal: Proposal) -> Conclusion:
    frame, tested = proposal.frame, proposal.lean_test
    z = tested.same_handedness if tested else 0.0
    reversed_axes = [
        name for name, sign in zip(("roll", "pitch", "yaw"), frame.axis_signs, strict=True) if sign < 0
    ]
    value = f"{' and '.join(reversed_axes)} reversed" if reversed_axes else "right-handed"
    gyro, shown = proposal.gyro, ""
    if gyro is not None and math.isfinite(gyro.handedness):
        shown = f"; by the gyro the handedness is {gyro.handedness:.1f} (1 or -1), error {gyro.handedness_error:.1f}"
    return Conclusion(
        name="axes of the IMU",
        value=value,
        confidence=frame.handedness,
        evidence=f"lean and yaw of the same handedness fit the turning of the heading {abs(z):.1f} standard errors "
        f"{'better' if z >= 0.0 else 'worse'}{shown}",
        alternatives=("right-handed",) if reversed_axes else ("pitch or yaw reversed",),
        key="[attitude] sign",
    )


def _axes_of_lean(proposal: Proposal, tested: LeanTest) -> Conclusion:
    """Return whether the lean is about the IMU's axes, which turn with the robot, or about the world's."""
    stems = {read_name(name).stem for name in proposal.roles.attitude[:2]}
    one_letter = WORLD_ONE_LETTER if len(stems) == 1 else WORLD_THETA_PHI
    prior = one_letter if stems & {"theta", "phi"} else WORLD_ROLL_PITCH
    seen = min(max(advantage_confidence(tested.body_frame), 1.0 - MOST), MOST)
    odds = (1.0 - prior) / prior * seen / (1.0 - seen)
    confidence = min(odds / (1.0 + odds), MOST)
    compared = "better" if tested.body_frame >= 0.0 else "worse"
    shown = "" if confidence >= 0.5 else f"; it is about the world's with {in_percent(1.0 - confidence)} %"
    return Conclusion(
        name="axes of the lean",
        value="about the IMU's axes",
        confidence=confidence,
        evidence="with a lean about axes that turn with the robot, the wheels explain it "
        f"{abs(tested.body_frame):.1f} standard errors {compared} than with one about the world's{shown}",
        alternatives=("about the world's: name its columns theta and phi in [columns]",),
        key="[attitude] from",
    )


def _turn_and_delay(proposal: Proposal) -> list[Conclusion]:
    tested, late, frame, gyro = proposal.lean_test, proposal.lean_delay, proposal.frame, proposal.gyro
    if tested is None or late is None:
        return []
    found = [
        Conclusion(
            name="turn of the IMU",
            value=f"{math.degrees(frame.turn):.1f} deg",
            confidence=turn_confidence(tested),
            evidence=f"measured {math.degrees(frame.measured_turn):.1f} deg; the confidence is that it is right to "
            f"{math.degrees(TURN):.0f} deg",
            error=None if tested.phase_error is None else math.degrees(tested.phase_error),
            unit="deg",
            key="[attitude] turn",
        ),
        Conclusion(
            name="delay of the lean",
            value=delay_words(late),
            confidence=late.confidence,
            evidence=delay_evidence(late, late.confidence),
            error=1e3 * late.error,
            unit="ms",
            key="[attitude] delay",
        ),
    ]
    if gyro is not None:
        found.append(
            Conclusion(
                name="gyro",
                value=f"{', '.join(proposal.roles.gyro[place] for place in gyro.order)} in {_gyro_words(gyro)}, "
                f"signs {list(gyro.signs)}",
                confidence=min(gyro.confidence, MOST),
                evidence=gyro.reason,
                key="[attitude] rates",
            )
        )
    return found


def delay_words(late: Delay) -> str:
    """Return a delay as it is undone."""
    return f"{1e3 * late.applied:.1f} ms{'' if late.measured else ', assumed'}"


def delay_evidence(late: Delay, confidence: float) -> str:
    """Return a delay's evidence; the confidence is that its error is harmless, and may be high of one not measured."""
    if late.measured:
        return late.evidence
    return f"{late.evidence}, {'harmless' if confidence >= CONFIDENT else 'which matters'} in this log"


def _gyro_words(gyro: GyroTest) -> str:
    return gyro.unit if gyro.scale == 1.0 else f"counts, {1.0 / gyro.scale:.4g} per {gyro.unit}"


def _commands(proposal: Proposal) -> list[Conclusion]:
    drive = proposal.drive
    assigned = drive.assigned if drive else None
    if drive is None or assigned is None:
        return [
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
        return [_strange_command(proposal, assigned, assigned.strange)]
    own = [wheel + 1 for wheel in assigned.wheels]
    found = [
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
    confidence = command_delay_confidence(late, drive.braked)
    delay = Conclusion(
        name="delay of the commands",
        value=delay_words(late),
        confidence=confidence,
        evidence=delay_evidence(late, confidence),
        error=1e3 * late.error,
        unit="ms",
        key="[input] delay",
    )
    return [*found, delay, *_dead_band(proposal)]


def _strange_command(proposal: Proposal, assigned: Assignment, strange: int) -> Conclusion:
    """Return which column taken for a command is none; what else is unclear of the commands follows from that."""
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
    if found is not None and math.isfinite(found.gain):
        shown = (
            f"{found.gain:.3g} units of the command act as 1 N m (error {100 * found.gain_error:.0f} %), and "
            f"{found.damping:.3f} N m s/rad of damping (error {found.damping_error:.3f})"
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
        evidence=shown,
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


def _alike(one: Unit, other: Unit) -> bool:
    """Return whether two scales differ by less than a motor's data does."""
    return abs(math.log(one.scale / other.scale)) < ALIKE


def _scale_words(unit: Unit) -> str:
    if unit.kind == "duty":
        return f"{next(full for full in FULL_DUTIES if abs(full * unit.scale - 1.0) < 1e-9):g}"
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
    if drive.response is None:
        return []
    confidence = dead_band_confidence(drive.turning_against)
    return [
        Conclusion(
            name="dead band",
            value="counted as less dry friction",
            confidence=confidence,
            alternatives=() if confidence >= CONFIDENT else ("the duty that the firmware adds",),
            evidence="a dead band acts as less dry friction, but for what it adds while a wheel turns against its "
            f"duty, or coasts: {100.0 * drive.turning_against:.0f} % of its size, beside the torque of the wheel that "
            "this changes most",
            key="[input] dead_band",
        )
    ]
