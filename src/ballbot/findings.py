"""What a check found: one value for the findings of every check and command.

A finding has a stable code, by which results.json and `--accept` name it. An error stops the command that met it,
because a result from such input would be wrong; `--accept CODE` goes on, and the finding stays in the report.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from ballbot.errors import InputError, suggest

Severity = Literal["error", "warning", "note"]

_ORDER = ("error", "warning", "note")

#: every code with its meaning, in alphabetical order
CODES: Mapping[str, str] = MappingProxyType(
    {
        "adequacy": "whether the logs may be those of the model, and up to which horizon its predictions may be",
        "alignment": "comparison of a log's sensors with motion capture",
        "another-force": "a force beside the recorded one acts on an axis",
        "at-bound": "a parameter is at a bound",
        "ball-axes": "x and y are swapped or negated against the wheels",
        "ball-omega": "the angular velocity of the ball on the clamped robot has other axes, signs or units",
        "between-logs": "how far the estimate from another log may be",
        "chatter": "the wheels oscillate within the play of the gears",
        "closed-loop": "which model predicts the closed loop better",
        "columns": "columns of a foreign file are recognised by their values, or needed ones are missing",
        "constant": "a column never changes",
        "contacts": "what the ball loses where the wheels touch it",
        "copied": "two columns have the same values",
        "correlated": "parameters that the data cannot separate",
        "corrupted": "rows with corrupted values are not used",
        "dead-band": "the duty that the firmware adds to overcome friction",
        "dead-motor": "a torque is zero or constant though its wheel moves, or a wheel does not respond to its torque",
        "degrees": "angles or rates are in degrees, or mixed with radians",
        "discrepancy": "parts of a log want different parameters, or an effect that the model lacks would move them",
        "disturbance": "something other than wheels and gravity moves the lean",
        "encoders": "an encoder counts for another wheel, backward, with another scale or not at all",
        "excitation": "the logs do not excite a parameter",
        "fall": "the robot falls, or is not on its ball",
        "file": "how a foreign file was read",
        "file-value": "a value of the robot file that the logs refute, or of which no log tells anything",
        "fitted-log": "a model is validated on a log that it was identified from",
        "force-delay": "the force on an axis seems to act later or earlier than its rows",
        "force-sign": "the force on an axis has the opposite sign, or is delayed",
        "force-unrelated": "the motion of an axis does not explain its force",
        "friction-differs": "a log needs more or less friction than was identified",
        "gap": "rows are missing",
        "geometry": "how the geometry in the robot file agrees with the logs",
        "hands": "the robot is held or pushed",
        "heading-sign": "psi is negated against the wheels",
        "held": "values are held over several rows",
        "horizon": "how the error of a prediction grows with its length",
        "jitter": "the time from row to row varies",
        "jump": "a position or an angle jumps",
        "law": "which friction law was chosen, and which did not improve the prediction",
        "lean-axes": "theta and phi are swapped, negated or turned against the ball's acceleration",
        "lean-offset": "the lean is not zero on average",
        "lean-scale": "the ball accelerates more or less than the lean implies",
        "logs-differ": "the logs disagree on the friction by more than chance explains",
        "methods-differ": "two methods or stages estimate a parameter differently by more than their errors",
        "mirrored": "the frame of motion capture is left-handed, or an axis of the log is negated",
        "missing": "values are missing (NaN)",
        "motors-alike": "motors that the logs cannot separate are fitted as one",
        "no-breakaway": "friction at rest cannot be distinguished from friction in motion",
        "no-evidence": "a log cannot show which of two models is better: it does not move, or one of them simulated it",
        "no-influence": "a parameter has no influence on the logs",
        "no-robot-file": "no robot file was written",
        "not-predicted": "friction does not improve the prediction of a state, or an axis is not predicted at all",
        "open-loop": "which model predicts the open loop better",
        "other-record": "how well another record of an axis is predicted, and whether that was expected",
        "physics": "the log cannot show whether lean and torques are right",
        "pivoting": "the ball pivots on the floor",
        "poorly-determined": "the standard error of a parameter is large",
        "reset": "an encoder was reset",
        "residuals": "what the one-step residuals of a model show",
        "robot-balance": "the robot's motors or controller cannot balance its body",
        "robot-ball": "the ball's size and mass do not fit together",
        "robot-body": "the body's mass, height and inertia do not fit together",
        "robot-deviation": "a standard deviation is too large to determine a parameter, or friction has none",
        "robot-drive": "the robot's gear, motor or supply do not fit together",
        "robot-friction": "the friction in the robot file is too large for its motors",
        "robot-gravity": "the robot's gravity is not the Earth's",
        "robot-sensors": "the robot's sample time, encoders or noise are unusual",
        "robot-twin": "the twin cannot simulate the robot",
        "robot-wheels": "the robot's wheels do not fit its ball or body",
        "robots": "logs are of different robots, or of one that changed",
        "rows": "too few rows",
        "saturation": "torques stay at their limit",
        "scale": "a rate, a gain or a unit is wrong by a factor",
        "sign": "an angle and its rate have opposite signs",
        "speed-limit": "wheels turn faster than the motors can turn them",
        "spike": "single values jump away and back",
        "spin": "results of a video of the ball",
        "stuck": "a sensor repeats its value for a long time",
        "swapped": "two columns are swapped",
        "swing": "what a swing shows of the body's inertia",
        "swing-fit": "the recording is not a free swing of a pendulum",
        "swing-inertia": "a swing gives an implausible inertia",
        "swing-unit": "the angle of a swing appears to be in degrees, or hardly changes",
        "time": "time does not increase throughout a foreign file",
        "time-scale": "time is in another unit, or runs too fast or too slowly",
        "timing": "the times of rows differ from the times of sampling",
        "torque-delay": "the torques are too late or too early relative to the states",
        "torque-limit": "torques exceed the robot's limit",
        "torque-order": "the torques drive other wheels than their columns name",
        "torque-scale": "the torques are larger or smaller than the motion needs",
        "torque-sign": "torques have the opposite sign of what the motion needs",
        "torque-unrelated": "the torques are unrelated to the motion",
        "two-optima": "a fit has two optima that differ in a parameter",
        "undetermined": "the records do not determine a parameter of an axis, and its number is of no use",
        "unit": "a column appears to be in another unit than it is taken for, or was converted from it",
        "unknown": "columns that Ballbot does not know",
        "unlimited": "the data limit a parameter on one side only, or not at all",
        "use": "the log lacks columns for a use",
        "weak-state": "a state that the model does not predict significantly better",
        "wheels": "wheel angles or speeds contradict the states, or the places of the wheels are uncertain",
        "wrap": "an angle jumps by a full turn",
    }
)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where something was found; every part is optional."""

    file: str = ""  #: file or name of the log
    columns: tuple[str, ...] = ()  #: the columns it is about
    time: float | None = None  #: [s], where it is or begins, if at one place


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that a check found.

    An error makes results wrong; a warning must be known before they are used; a note is a fact.
    """

    code: str  #: stable, in kebab case: gap, jitter, torque-sign, ...
    severity: Severity
    text: str  #: one sentence: what is wrong, where, and what would be right
    where: Place = Place()


def finding(code: str, severity: Severity, text: str, *columns: str, time: float | None = None) -> Finding:
    """Return a finding on these columns that is, or begins, at a time [s]."""
    return Finding(code=code, severity=severity, text=text, where=Place(columns=columns, time=time))


def error(code: str, text: str, *columns: str, time: float | None = None) -> Finding:
    """Return a finding that makes results wrong."""
    return Finding(code=code, severity="error", text=text, where=Place(columns=columns, time=time))


def warning(code: str, text: str, *columns: str, time: float | None = None) -> Finding:
    """Return a finding that must be known before results are used."""
    return Finding(code=code, severity="warning", text=text, where=Place(columns=columns, time=time))


def note(code: str, text: str, *columns: str, time: float | None = None) -> Finding:
    """Return a finding that is a fact."""
    return Finding(code=code, severity="note", text=text, where=Place(columns=columns, time=time))


def texts(findings: Iterable[Finding]) -> list[str]:
    """Return the sentences of findings."""
    return [finding.text for finding in findings]


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings with errors first, then warnings, then notes; the order is kept within each."""
    return tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.severity)))


def as_options(codes: Sequence[str]) -> str:
    """Return the options of a command line that accept these codes."""
    return " ".join(f"--accept {code}" for code in codes)


def as_argument(codes: Sequence[str]) -> str:
    """Return the argument of a Python function that accepts these codes."""
    return f"accept=[{', '.join(repr(code) for code in codes)}]"


def check_codes(
    accept: Iterable[str],
    *,
    # the codes that a command can meet, which the sentence on an unknown one names
    listed: Collection[str] = CODES,
) -> tuple[str, ...]:
    """Return codes to accept, each once.

    InputError if one is not in `CODES`; the sentence names the nearest.
    """
    codes = tuple(dict.fromkeys(accept))
    for code in codes:
        if code not in CODES:
            hint = suggest(code, listed, otherwise="the codes are")
            raise InputError(f"There is no finding with the code {code!r} to accept; {hint}")
    return codes


def stop_on_errors(
    findings: Sequence[Finding],
    *,
    accept: Collection[str] = (),  # codes of errors that the user knows of
    # returns how the user accepts codes: `as_options` on a command line, `as_argument` in Python
    going_on: Callable[[Sequence[str]], str] = as_options,
    others: str = "",  # where the other errors stand, as "above" or "`ballbot check`"
) -> None:
    """Raise InputError on the first error whose code is not accepted.

    InputError with the error's text and file, how many more there are, and the option that goes on.
    """
    errors = [finding for finding in findings if finding.severity == "error" and finding.code not in accept]
    if not errors:
        return
    file, text = errors[0].where.file, errors[0].text
    codes = list(dict.fromkeys(finding.code for finding in errors))
    more = (
        f"{len(errors) - 1} more error{'s' if len(errors) > 2 else ''}{f': see {others}' if others else ''}"
    )
    raise InputError(
        f"{f'{file}: ' if file else ''}{text}{f' ({more})' if len(errors) > 1 else ''} To continue despite this: "
        f"{going_on(codes)}."
    )
