"""What a check found: one value for the remarks of every check and command.

A finding has a stable code, by which results.json and `--accept` name it. An error stops the command that met it,
because a result from such input would be wrong; `--accept CODE` goes on, and the finding stays in the report.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from ballbot.errors import InputError

Severity = Literal["error", "warning", "note"]

_ORDER = ("error", "warning", "note")


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


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings with errors first, then warnings, then notes; the order is kept within each."""
    return tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.severity)))


def stop_on_errors(findings: Sequence[Finding], *, accept: Collection[str] = ()) -> None:
    """Raise InputError on the first error whose code is not accepted.

    Parameters
    ----------
    findings : sequence of Finding
    accept : collection of str
        Codes of errors that the user knows of.

    Raises
    ------
    InputError
        With the error's text and file, how many more there are, and the option that goes on.
    """
    errors = [finding for finding in findings if finding.severity == "error" and finding.code not in accept]
    if not errors:
        return
    first = errors[0]
    file = f"{first.where.file}: " if first.where.file else ""
    options = " ".join(f"--accept {code}" for code in dict.fromkeys(finding.code for finding in errors))
    more = f" ({len(errors) - 1} more, in `ballbot check-log`)" if len(errors) > 1 else ""
    raise InputError(f"{file}{first.text}{more} To go on all the same: {options}.")
