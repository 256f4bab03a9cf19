"""All conclusions on a foreign log, in the order in which they rest on one another."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ballbot.log.mapping_inference.command_conclusions import command_conclusions
from ballbot.log.mapping_inference.evidence import (
    CONFIDENT,
    MOST,
    TINY,
    Conclusion,
    advantage_confidence,
    in_percent,
)
from ballbot.log.mapping_inference.file_signals import GyroTest
from ballbot.log.mapping_inference.frame import Frame, HeadingTest
from ballbot.log.mapping_inference.names import read_name
from ballbot.log.mapping_inference.placement import LEAST_TIME, LeanTest
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.mapping_inference.time_units import time_conclusion
from ballbot.log.mapping_inference.tolerances import (
    TURN,
    delay_evidence,
    delay_words,
    turn_confidence,
)
from ballbot.log.mapping_inference.units import GAIN_DEVIATION, Scale, step_of

#: prior probability that columns are about the world's axes, chosen and not measured: theta and phi, as papers on ball
#: balancing call them; angles of one letter, theta_x and theta_y, as an IMU's three are often called; roll and pitch
WORLD_THETA_PHI, WORLD_ONE_LETTER, WORLD_ROLL_PITCH = 0.5, 0.15, 0.01
#: a heading that turns by less than this [rad] around its mean leaves no question of the lean's axes: the other
#: reading turns the lean by no more
STEADY_HEADING = math.radians(4.0)


#: a log that leaves a question open makes no answer more certain
_BESIDE_OPEN = 0.99


def conclusions_of(proposal: Proposal) -> tuple[Conclusion, ...]:
    """Return the conclusions of a proposal."""
    found = [
        _columns(proposal),
        _time(proposal),
        _unit_of_wheels(proposal),
        *_coarse_speeds(proposal),
    ]
    if proposal.lean is not None:
        found.append(_scale("unit of the lean", proposal.lean, "[attitude] unit"))
        heading = proposal.heading_unit
        if heading is not None and (heading.unit != proposal.lean.unit or heading.confidence < CONFIDENT):
            found.append(_scale("unit of the heading", heading, "[attitude] unit"))
        found += _frame(proposal)
    found += command_conclusions(proposal)
    if all(one.determined for one in found):
        return tuple(found)
    return tuple(replace(one, confidence=min(one.confidence, _BESIDE_OPEN)) for one in found)


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
        evidence=f"time, lean, wheel {roles.measured}s and commands are recognised {named}",
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
    measured = proposal.roles.measured
    found = _scale(f"unit of the wheel {measured}s", proposal.wheel, f"[wheels] {measured}")
    tested = proposal.lean_test
    gain = tested.gain if tested else None
    if tested is None or gain is None or not math.isfinite(tested.gain_error):
        return found
    off, deviation = math.log(max(gain, 1e-12)), math.hypot(GAIN_DEVIATION, tested.gain_error)
    if abs(off) < GAIN_CONTRADICTED * deviation * (TOO_SMALL if off < 0.0 else 1.0):
        return found
    unlike = (
        f"a robot unlike its file: the lean responds to the wheels {gain:.2g} times as strongly as it should"
    )
    return replace(found, confidence=min(found.confidence, 0.5), alternatives=(*found.alternatives, unlike))


#: rounding of wheel speeds beyond this part of their size makes angles and friction wrong; one encoder count a row is
#: exact in their sum
LARGEST_ROUNDING = 0.1


def _coarse_speeds(proposal: Proposal) -> list[Conclusion]:
    """Return that wheel speeds are rounded too much for their integrals to be angles, if they are."""
    roles, columns = proposal.roles, proposal.table.columns
    if not roles.of_speeds or proposal.wheel.counted:
        return []
    sizes = [float(np.nanstd(columns[name])) for name in roles.angles]
    steps = [step_of(columns[name]) or 0.0 for name in roles.angles]
    rounding = max(step / math.sqrt(12.0) / max(size, TINY) for step, size in zip(steps, sizes, strict=True))
    if rounding < LARGEST_ROUNDING:
        return []
    return [
        Conclusion(
            name="wheel speeds",
            value="as they are",
            confidence=0.5,
            evidence=f"they are rounded to {max(steps):g}, an error of {100.0 * rounding:.0f} % of their size",
            alternatives=("finer speeds, or angles",),
            key="[wheels] speed",
        )
    ]


def _frame(proposal: Proposal) -> list[Conclusion]:
    tested, frame, heading = proposal.lean_test, proposal.frame, proposal.heading
    if tested is None:
        sentence = (
            f"the log has less than {LEAST_TIME:.0f} s of balancing, too little to test where the wheels are"
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
            harmless=late.harmless,
            evidence=delay_evidence(late, late.harmless),
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


def _gyro_words(gyro: GyroTest) -> str:
    return gyro.unit if gyro.scale == 1.0 else f"counts, {1.0 / gyro.scale:.4g} per {gyro.unit}"
