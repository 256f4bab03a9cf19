"""What a foreign log is, and how it becomes one of Ballbot's: the search, its evidence, and what it leaves to ask.

The user states the kind of the command, names say which columns there are and in which units; the search finds from the
motion the order and signs of wheels and commands and how the IMU sits. Every question is asked at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.errors import InputError
from ballbot.findings import Finding, Place, Severity
from ballbot.log.formats import read_foreign_table
from ballbot.log.mapping_search.commands import KINDS, drive_of, needs_of, turned_by
from ballbot.log.mapping_search.evidence import CONFIDENT
from ballbot.log.mapping_search.frame import frame_of
from ballbot.log.mapping_search.motion import Columned, Motion, Stated, motion_of_file
from ballbot.log.mapping_search.roles import Roles, roles_of
from ballbot.log.mapping_search.text import Proposal, Question, What, mapped
from ballbot.log.mapping_search.units import lean_units, other_encoder, time_unit
from ballbot.log.row_order import increasing_rows, longest_run, repeated_rows, rows_in_order
from ballbot.log.signals import INTERVAL, MOVING_SPEED, row_spans
from ballbot.log.wrapping import clock_note, continuous_clock
from ballbot.robot import Robot

#: standard errors by which a lean about the world's axes must fit better to be asked about, and of the IMU's turn [rad]
WORLD_BETTER, CLEAR_TURN = 1.5, math.radians(8.0)
#: response of the lean to the wheels over the robot's beyond which it is another robot: 1.0 to 1.4 on real logs of one
GAIN_RANGE = (0.5, 2.0)
#: nothing explains the lean if the best placement leaves more of its acceleration
HELD = 0.8
#: no robot on a ball leans further than this [rad] in a tenth of the time in which its wheels turn
LARGEST_LEAN = 0.2
#: the largest ratio of torques, in either direction, that friction which the law lacks explains in a weak motion (2.8
#: on a real log)
LARGEST_RATIO = 4.0


def propose(path: str | Path, robot: Robot, stated: Stated | None = None) -> Proposal:
    """Read a foreign log and propose how it becomes one of Ballbot's.

    Parameters
    ----------
    path : str or Path
        A table of any format that Ballbot reads.
    robot : Robot
        Its geometry, encoders and drives.
    stated : Stated, optional
        What the user says.

    Raises
    ------
    InputError
        If the file is no table, or no names say which columns are the time, and the lean or the wheels.
    """
    stated = stated or Stated()
    table, roles = roles_of(path, read_foreign_table(path, names=stated.columns), robot.wheel_count)
    clock, again = continuous_clock(table.columns[roles.time])
    table = replace(table, columns={**table.columns, roles.time: clock})
    notes = [_finding("note", "file", note) for note in table.notes]
    if again.size:
        notes.append(_finding("warning", "time", clock_note(roles.time, again), (roles.time,)))
    time = time_unit(clock, roles.unit((roles.time,)))
    if time is None:
        raise InputError(
            f"{path}: {roles.time} is no time in s, ms, us or ns by its intervals (median "
            f"{float(np.median(np.diff(clock))):.6g}); write a mapping file with its scale, "
            f'[columns] t = {{ from = "{roles.time}", scale = .. }} in seconds.'
        )
    repeated = repeated_rows(table.columns, roles.time)
    t = time.factor * clock
    first, last = longest_run(t, repeated)
    part = {name: values[first:last] for name, values in table.columns.items()}
    unordered = not bool(increasing_rows(t[first:last][~repeated[first:last]]).all())
    cut = rows_in_order(part, t[first:last], repeated=repeated[first:last], unordered=unordered)
    whole = (first, last) == (0, len(t))
    if not whole:
        sentence = f"The longest run is rows {first + 1} to {last}; others are left out."
        notes.append(_finding("warning", "time", sentence))
    base = Columned(
        path=Path(path),
        cut=cut,
        roles=roles,
        t=cut[roles.time] * time.factor,
        robot=robot,
        stated=stated,
    )
    motion = motion_of_file(base) if roles.angles else None
    if motion and roles.commands and _what(roles, motion) != "free wheels" and _on_a_stand(base, motion):
        base = replace(base, roles=replace(roles, attitude=(), gyro=(), quaternion=(), half_turn=None))
        motion = motion_of_file(base)
    tested = motion.tested if motion else None
    lean = motion.units[0] if motion else lean_units(base.raw_attitude[:, :2], roles.unit(roles.attitude))[0]
    proposal = Proposal(
        table=table,
        base=base,
        rows=None if whole else (first + 1, last),
        repeated=bool(repeated.any()),
        unordered=unordered,
        time=time,
        lean=lean if base.roles.attitude else None,
        motion=motion,
        frame=frame_of(robot, tested, motion.heading if motion else None),
        keep=row_spans(motion.signals.rows, motion.signals.usable & ~tested.pushed) or None
        if motion and tested
        else None,
        what=_what(base.roles, motion),
    )
    if motion is None:
        return replace(proposal, findings=tuple(notes))
    if roles.commands:
        try:
            needs = needs_of(mapped(proposal, robot), robot) if base.roles.attitude and tested else None
        except InputError:  # too short, or rows without a value
            needs = None
        proposal = replace(proposal, drive=drive_of(base, motion, proposal.frame, needs))
    return replace(
        proposal,
        questions=tuple(_questions(proposal, motion)),
        contradiction=_contradiction(proposal, motion),
        findings=(*notes, *_findings(proposal, motion)),
    )


def _contradiction(proposal: Proposal, motion: Motion) -> str:
    """Return why it is not this robot's log; empty if nothing says so."""
    base, tested = proposal.base, motion.tested
    if not base.roles.of_speeds:
        angles = base.stacked(base.roles.angles)
        other = other_encoder(angles, motion.units[1], base.robot, base.stated.counts_per_turn)
        if other:
            return other
    if proposal.what != "balancing" or tested is None or tested.confidence < CONFIDENT:
        return ""
    gain = tested.placements[0].gain
    if GAIN_RANGE[0] < gain < GAIN_RANGE[1]:
        return ""
    return (
        f"the lean responds to the wheels {gain:.3g} times as strongly as this robot's should: a unit, the counts per "
        "turn, a radius or the height of the centre of mass is another."
    )


def _what(roles: Roles, motion: Motion | None) -> What:
    if motion is None:
        return "IMU only"
    if not roles.attitude:
        return "free wheels"
    tested, lean = motion.tested, motion.signals.lean
    moving = np.abs(motion.signals.wheels.rate).max(axis=1) > MOVING_SPEED
    if tested is None or lean is None or not moving.any():
        return "balancing"  # or standing: too little motion, which is asked for
    if tested.placements[0].unexplained > HELD:
        return "held by hand"
    away = np.abs(lean.value - np.median(lean.value, axis=0)).max(axis=1)[moving]
    return "held by hand" if np.quantile(away, 0.9) > LARGEST_LEAN else "balancing"


def _on_a_stand(base: Columned, motion: Motion) -> bool:
    """Return whether wheels follow commands that no balancing robot gives: of one sign, or alike."""
    commands = base.stacked(base.roles.commands)
    one_way = not commands.min() < 0.0 < commands.max() or np.allclose(commands, commands[:, :1])
    return bool(one_way and turned_by(base, motion) is not None)


def _questions(proposal: Proposal, motion: Motion) -> Iterator[Question]:
    """Yield everything that the log and its user leave open."""

    def question(key: str, name: str, answers: Sequence[str], evidence: str) -> Question:
        return Question(key=key, name=name, answers=tuple(answers), evidence=evidence)

    if proposal.what == "held by hand":
        return
    for place, (key, name) in enumerate((("[attitude] unit", "lean"), ("[wheels] angle", "wheels"))):
        shares: dict[str, float] = {}
        for units, share in motion.likely.items():
            shares[units[place].name] = shares.get(units[place].name, 0.0) + share
        ranked = sorted(shares, key=lambda one: -shares[one])[:3]
        if shares[ranked[0]] < CONFIDENT:
            shown = ", ".join(f"{100.0 * shares[one]:.0f} %" for one in ranked)
            yield question(key, f"unit of the {name}", ranked, f"probabilities {shown}")
    tested, frame = motion.tested, proposal.frame
    if tested is not None:
        best, other = tested.placements[:2]
        if tested.confidence < CONFIDENT:
            words, evidence = (
                (best.description, other.description),
                f"the first fits {tested.margin:.2f} times better than the second",
            )
            yield question("[wheels] order", "order and signs of the wheels", words, evidence)
        elif frame.direction < CONFIDENT:
            words = str(list(frame.signs)), str([-sign for sign in frame.signs])
            evidence = (
                "the heading turns too little; with the other signs the IMU is turned by half a turn more"
            )
            yield question("[wheels] sign", "direction in which all wheels count", words, evidence)
        elif frame.handedness < CONFIDENT:
            evidence = f"the turning of the heading shows it by {abs(tested.handedness):.1f} standard errors"
            words = str(list(frame.axis_signs)), "one axis reversed"
            yield question("[attitude] sign", "axes of the IMU", words, evidence)
        if tested.body_frame < -WORLD_BETTER:
            words = "about the world's axes", "about the IMU's axes"
            evidence = f"the world's fit {-tested.body_frame:.1f} standard errors better"
            yield question("[attitude] from", "axes of the lean", words, evidence)
        if tested.phase_error is None or tested.phase_error > CLEAR_TURN:
            known = (
                "unknown"
                if tested.phase_error is None
                else f"known to {math.degrees(tested.phase_error):.0f} deg"
            )
            yield question(
                "[attitude] turn", "turn of the IMU", (f"{math.degrees(frame.turn):.0f} deg",), known
            )
    elif proposal.roles.attitude:
        words = "order and signs of the wheels"
        yield question("[wheels] order", words, ("as in the file",), "the robot hardly moves")
    drive = proposal.drive
    if drive is None:
        return
    if drive.kind is None:
        shown = [
            f"as {one} the torques are {times:.2g} times those that the motion needs"
            for one, (_, times) in drive.ratios.items()
            if math.isfinite(times)
        ]
        evidence = "; ".join(shown) or "state it with --command"
        yield question("[input] kind", "kind of the command", KINDS, evidence)
    elif drive.scales:
        name = "full scale of the duty" if drive.kind == "duty" else f"unit of the {drive.kind}"
        yield question("[input] scale", name, drive.scales, "the motion fits both")
    elif math.isfinite(drive.ratio) and not 1.0 / LARGEST_RATIO < drive.ratio < LARGEST_RATIO:
        evidence = f"as it is stated the torques are {drive.ratio:.2g} times those that the motion needs"
        yield question("[input] scale", "kind and scale of the command", (drive.kind, "another"), evidence)
    if tested is None:
        return
    values, one = (
        np.column_stack([proposal.base.cut[name] for name in proposal.roles.commands]),
        drive.assigned,
    )
    if not np.nanmin(values) < 0.0:
        evidence = f"they stay between {np.nanmin(values):g} and {np.nanmax(values):g}"
        words = f"zero = {np.nanmedian(values):.4g}", "direction = [..], columns with their directions"
        yield question("[input] zero", "sign of the commands", words, evidence)
    elif one is None or one.confidence < CONFIDENT:
        words, evidence = ("as numbered",), "too little motion"
        if one is not None:
            words = (
                f"for wheels {[wheel + 1 for wheel in one.wheels]}, signs {list(one.signs)}",
                one.next_best,
            )
            explained = f"the first explains {100.0 * one.explained:.0f} %"
            evidence = f"{explained}, {one.advantage:.1f} standard errors better"
        yield question("[input] sign", "order and signs of the commands", words, evidence)


def _finding(severity: Severity, code: str, sentence: str, columns: tuple[str, ...] = ()) -> Finding:
    return Finding(severity=severity, code=code, text=sentence, where=Place(columns=columns))


def _findings(proposal: Proposal, motion: Motion) -> Iterator[Finding]:
    """Yield what was noticed and not changed."""
    roles, tested, drive, cut = proposal.roles, motion.tested, proposal.drive, proposal.base.cut
    used = [name for name in (*roles.attitude, *roles.angles, *roles.commands, *roles.gyro) if name in cut]
    holes = sum(int((~np.isfinite(cut[name])).sum()) for name in used)
    if holes:
        yield _finding("warning", "missing", f"{holes} cells are missing; short gaps are filled.")
    if motion.largest_speed is not None or motion.wrap is not None:
        sentence = (
            "A wheel angle jumps by more than a wheel can turn: a reset or a full counter; it is continued."
        )
        yield _finding("warning", "reset", sentence, roles.angles)
    if roles.gyro and motion.gyro is None and roles.attitude:
        sentence = (
            f"The gyro ({', '.join(roles.gyro)}) does not follow the rates of the angles, which are used."
        )
        yield _finding("warning", "columns", sentence, roles.gyro)
    if not roles.commands:
        sentence = (
            "No column is named as a command of a motor, so that the log has no torques. If some are commands, name "
            "them u1, u2, .. with --columns."
        )
        yield _finding("warning", "columns", sentence)
    if tested is not None and tested.pushed.any():
        seconds = float(tested.pushed.sum()) * INTERVAL
        sentence = f"For {seconds:.1f} s something other than the wheels moves the robot; left out."
        yield _finding("warning", "hands", sentence)
    if tested is not None and tested.lag > 0.01 + tested.lag_error:
        sentence = (
            f"The lean seems {1e3 * tested.lag:.0f} ms late, as play makes it, too: write [attitude] delay if the "
            "IMU's data sheet gives one."
        )
        yield _finding("note", "timing", sentence, roles.attitude)
    if (
        drive is not None
        and math.isfinite(drive.ratio)
        and abs(math.log(max(drive.ratio, 1e-12))) > math.log(1.25)
    ):
        sentence = (
            f"The torques are {drive.ratio:.2f} times those that the motion and the robot file's masses need."
        )
        yield _finding("warning", "scale", sentence, roles.commands)


def agreement(proposals: Sequence[Proposal]) -> list[tuple[Proposal, str]]:
    """Return the logs of one robot that contradict the others, with what they contradict; the surest comes first."""

    def answer(one: Proposal) -> dict[str, object]:
        found: dict[str, object] = {}
        if one.tested is not None and one.tested.confidence >= CONFIDENT:
            found["order of the wheels"] = one.frame.order
            if one.frame.direction >= CONFIDENT:
                found["signs of the wheels"] = one.frame.signs
                found["turn of the IMU"] = round(math.degrees(one.frame.turn) / 30.0) % 12
        assigned = one.drive.assigned if one.drive else None
        if assigned is not None and assigned.confidence >= CONFIDENT:
            found["order and signs of the commands"] = (assigned.wheels, assigned.signs)
        return found

    wrong = []
    for one in proposals:
        for key, value in answer(one).items():
            votes = [answer(other).get(key) for other in proposals]
            others = [vote for vote in votes if vote is not None and vote != value]
            alone = others and one is not proposals[0] and votes.count(value) == 1
            if alone or len(others) > votes.count(value):
                wrong.append((one, key))
                break
    return wrong
