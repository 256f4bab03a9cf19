"""Why a proposed mapping cannot be used as it is: one sentence, of the cause before what follows from it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ballbot.findings import Finding
from ballbot.log.checks.stuck_encoders import stuck_findings
from ballbot.log.mapping_inference.command_signs import far_from_zero, never_negative
from ballbot.log.mapping_inference.evidence import Conclusion
from ballbot.log.mapping_inference.names import read_names
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.signals import INTERVAL

#: errors of a log that are faults of the recording, under whatever mapping: they stop the analysis of the log, which
#: names them again, and not the mapping. None of the others is found in the 90 variants of
#: campaigns/mapping_corpus.py that were tried, of 5 to 60 s
OF_THE_RECORDING = frozenset(
    ("copied", "corrupted", "gap", "held", "jump", "missing", "rows", "spike", "stuck", "torque-clipped")
)


def errors_of(found: Iterable[Finding]) -> list[Finding]:
    """Return the findings on the log that a mapping makes that are errors, those that contradict the mapping first."""
    errors = [
        replace(one, severity="error", code="contradiction") if _contradicts(one) else one
        for one in found
        if one.severity == "error" or _contradicts(one)
    ]
    return sorted(errors, key=lambda one: one.code != "contradiction")


def _contradicts(found: Finding) -> bool:
    """Return whether a finding on the log that a mapping makes contradicts the mapping or the robot file."""
    dead = found.code == "constant" and any(name.startswith("wheel") for name in found.where.columns)
    of_mapping = found.severity == "error" and found.code not in OF_THE_RECORDING
    return dead or of_mapping or found.code == "wheel-unlike"


def contradiction(errors: Sequence[Finding], mapping: str) -> str:
    """Return that the log that a mapping makes contradicts the robot; empty if no error of `errors_of` says so."""
    if not errors or errors[0].code != "contradiction":
        return ""
    return (
        f"the log that the mapping makes contradicts the robot: {_without_advice(errors[0].text)} Correct "
        f"{mapping} or the robot file."
    )


def refusal_of(proposal: Proposal, conclusions: Sequence[Conclusion], mapping: str) -> str:
    """Return why a proposal makes no log; empty if it does."""
    open_questions = [one for one in conclusions if not one.determined]
    if unsigned := _unsigned(proposal):
        return unsigned
    if proposal.stuck:
        return _without_stuck_rows(proposal, open_questions, mapping)
    if open_questions:
        return _question(open_questions, mapping) + _likely_cause(proposal, open_questions)
    return _missing_between_rows(proposal)


def _without_advice(sentences: str) -> str:
    """Return a finding's text without a last sentence that says to correct columns and mapping."""
    said, stop, advice = sentences.rpartition(". ")
    return f"{said}." if stop and advice.startswith("Correct ") else sentences


def _question(open_questions: Sequence[Conclusion], mapping: str) -> str:
    first = open_questions[0]
    more = (
        f" ({len(open_questions) - 1} more, see the lines with cannot determine)"
        if len(open_questions) > 1
        else ""
    )
    if first.key == "--columns":
        return f"cannot determine: {first.question}; name them with --columns in the file's order{more}."
    return f"cannot determine: {first.question}; write it in {mapping}, {first.key}{more}."


#: part of its path by which a wheel that turns one way only ends away from its start
ONE_WAY = 0.98


def _unsigned(proposal: Proposal) -> str:
    """Return that the commands of a balancing robot have no sign; empty if they have one, or turn a wheel in a rig."""
    columns, roles, commands = proposal.table.columns, proposal.roles, proposal.roles.commands
    if proposal.lean_test is None or not commands or roles.zero is not None or roles.directions:
        return ""
    values = np.column_stack([columns[name] for name in commands])
    if not never_negative(values):
        return ""
    if far_from_zero(values):
        return (
            f"the commands {', '.join(commands)} stay between {np.nanmin(values):g} and {np.nanmax(values):g}, as "
            f"pulses or duties whose zero is about {np.nanmedian(values):.4g}: write the number that stands for zero "
            "in a mapping file, [input] zero."
        )
    angles = np.column_stack([columns[name] for name in roles.angles])
    steps = np.diff(angles[np.isfinite(angles).all(axis=1)], axis=0)
    if (np.abs(steps.sum(axis=0)) > ONE_WAY * np.abs(steps).sum(axis=0)).all():
        return (
            f"the commands {', '.join(commands)} never change sign, and the wheels turn one way only, as in a "
            "free-wheel sweep: it is no log of balancing. `ballbot identify-driveline` identifies the friction of the "
            "wheels from it."
        )
    direction = [
        one.name
        for one in read_names(list(columns))
        if one.index is not None
        and one.kind == "other"
        and len(np.unique(columns[one.name][np.isfinite(columns[one.name])])) == 2
    ]
    hint = f" (is it in {', '.join(direction)}?)" if len(direction) == len(commands) else ""
    return (
        f"the commands {', '.join(commands)} never change sign, but a balancing robot drives its wheels in both "
        f"directions: log each command with its sign{hint}."
    )


def _without_stuck_rows(proposal: Proposal, open_questions: Sequence[Conclusion], mapping: str) -> str:
    """Return that an encoder is stuck, and how to go on without its rows."""
    found = stuck_findings(proposal.stuck, names=proposal.roles.angles)[0].text
    if open_questions or not proposal.keep:
        return f"{found} Remove these rows from the file, or use another log."
    spans = ", ".join(f"{start:.6g} to {end:.6g} s" for start, end in proposal.keep)
    return f"{found} In {mapping}, [time] keep is the rest, {spans}: if that is enough, go on with --mapping."


#: largest part of the torques that may be missing between rows: its estimate is right to a quarter, and other errors
#: add to it, up to the fifth of all torques that a log can bear
LARGEST_MISSED = 0.12


def _missing_between_rows(proposal: Proposal) -> str:
    """Return that the rows miss too much of what the controller commands; empty if they do not."""
    if proposal.missed < LARGEST_MISSED:
        return ""
    columns, roles = proposal.table.columns, proposal.roles
    interval = 1e3 * proposal.time.factor * float(np.median(np.diff(columns[roles.time or ""])))
    return (
        f"the commands {', '.join(roles.commands)} change from each of the controller's samples to the next, and rows "
        f"that come every {interval:.3g} ms miss about {100.0 * proposal.missed:.0f} % of the torques: log every "
        "sample, or correct the sample time in the robot file if these are all."
    )


#: slower rows [s] show little of what commands do to wheels
SLOW_ROWS = 0.02
#: a log of balancing of so many seconds answers the questions on its motion, if it sways and turns: of variants of
#: campaigns/mapping_corpus.py from 15 s on, six to nine of ten are right without an answer from the user
ENOUGH_BALANCING = 15.0
#: questions that a longer log answers, by their names
_OF_THE_MOTION = (
    "order and signs of the wheels",
    "direction in which all wheels count",
    "axes of the IMU",
    "axes of the lean",
    "turn of the IMU",
    "delay of the lean",
    "gyro",
    "columns of the commands",
    "order and signs of the commands",
    "delay of the commands",
)


def too_short(proposal: Proposal) -> str:
    """Return, as a clause, that a log of balancing is too short for its motion to show much; empty if it is not."""
    if not proposal.roles.attitude:
        return ""
    signals, tested = proposal.signals, proposal.lean_test
    seconds = float((signals.usable if tested is None else tested.balancing).sum()) * INTERVAL
    if seconds >= ENOUGH_BALANCING:
        return ""
    whole = float(np.ptp(signals.rows))
    said = f"the log has {seconds:.0f} s of balancing"
    if whole > seconds + 2.0:
        said += f" in its {whole:.0f} s"
    return (
        f"{said}, too short for this: record at least {ENOUGH_BALANCING:.0f} s in which the robot leans in all "
        "directions and turns"
    )


def _likely_cause(proposal: Proposal, open_questions: Sequence[Conclusion]) -> str:
    """Return a property of the file, such as its length, that may prevent its motion from answering a question."""
    names = [one.name for one in open_questions]
    causes = []
    if any(name in _OF_THE_MOTION for name in names) and (short := too_short(proposal)):
        causes.append(short)
    if "order and signs of the commands" in names:
        causes += _sparse(proposal)
    return f" A likely cause: {'; and '.join(causes)}." if causes else ""


def _sparse(proposal: Proposal) -> list[str]:
    """Return, as clauses, that values are missing or that rows are rare, if it is so."""
    columns, roles = proposal.table.columns, proposal.roles
    names = (roles.time or "", *roles.attitude, *roles.angles, *roles.commands, *roles.gyro)
    used = np.column_stack([columns[name] for name in names if name in columns])
    missing = float((~np.isfinite(used)).any(axis=1).mean())
    interval = float(np.median(np.diff(used[:, 0]))) * proposal.time.factor
    causes = []
    if missing > 0.0:
        causes.append(f"{100.0 * missing:.0f} % of the rows lack a value")
    if interval > SLOW_ROWS:
        causes.append(f"rows come only every {1e3 * interval:.3g} ms")
    return causes
