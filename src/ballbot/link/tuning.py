"""Changes of a robot's controller while it balances: typed at the terminal, or read from a file with times.

    gain 0.3               of two gains the second with 0.3; or a weight for each gain, with a sum of 1: gain 0.7 0.3
    compensation 0.8       share of the compensation that was exported
    back                   the setting before the last change

A change that is refused is answered in a sentence, here or by the robot; the run goes on.
"""

import math
import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbot.control.tuning import Setting, check_setting
from ballbot.errors import InputError, check_known
from ballbot.files import read_text
from ballbot.link.messages import AnswerResult, wrapped
from ballbot.link.references import require_terminal
from ballbot.link.session import Session, reason

#: the source of changes that are typed
TERMINAL = "terminal"
_COMMANDS = ("gain", "compensation", "back")


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change that the robot accepted."""

    t: float  #: since arming [s]
    setting: Setting  #: to which the robot moves from then on


class TypedLines:
    """Lines typed at a terminal of Linux or macOS. InputError if the input is not a terminal."""

    def __init__(self, descriptor: int) -> None:
        require_terminal(descriptor, "--tune terminal")
        self._descriptor, self._waiting = descriptor, b""

    def until(self, t: float) -> Iterator[str]:  # noqa: ARG002
        """Yield the lines that were typed since the last call."""
        if select.select([self._descriptor], [], [], 0.0)[0]:
            with suppress(OSError):  # the terminal is gone; the robot goes on as it is
                self._waiting += os.read(self._descriptor, 1024)
        *lines, self._waiting = self._waiting.split(b"\n")
        yield from (line.decode(errors="replace") for line in lines)


class FileLines:
    """The lines of a file, each a time since arming [s] and a command. InputError if the times do not increase."""

    def __init__(self, path: Path) -> None:
        self._timed: list[tuple[float, str]] = []
        for row, line in enumerate(read_text(path).splitlines(), start=1):
            first, _, command = line.partition("#")[0].strip().partition(" ")
            if not first:
                continue
            try:
                t = float(first)
            except ValueError:
                t = math.nan
            if not t >= (self._timed[-1][0] if self._timed else 0.0):
                raise InputError(
                    f"{path}, row {row}: {first!r} is no time [s] after that of the row before; a row is a time and a "
                    "command, such as 2.5 gain 0.3."
                )
            self._timed.append((t, command))

    def until(self, t: float) -> Iterator[str]:
        """Yield the commands whose time has come."""
        while self._timed and self._timed[0][0] <= t:
            yield self._timed.pop(0)[1]


#: the source of the commands
Lines = TypedLines | FileLines


def command_lines(source: str) -> Lines:
    """Return the commands of the terminal, or of a file; InputError if there is none."""
    return TypedLines(sys.stdin.fileno()) if source == TERMINAL else FileLines(Path(source))


class Tuner:
    """Obeys commands by asking a balancing robot, and keeps the changes that it accepted."""

    def __init__(
        self,
        lines: Lines,
        own: np.void,  # the robot's record of `TuningRecord`
        *,
        say: Callable[[str], None],  # prints a line
    ) -> None:
        self.changes: list[Change] = []
        self._lines, self._own, self._say = lines, own, say
        self._setting = self._former = Setting()

    def update(self, session: Session, t: float, time: int) -> None:
        """Obey the new commands at a sample: t since arming [s], and by the robot's clock [us] modulo 2^32."""
        for line in self._lines.until(t):
            if not line.strip():
                continue
            try:
                wanted = self._setting_of(line.split())
            except InputError as refusal:
                self._say(str(refusal))
                continue
            result, changed = session.tune(wanted)
            if result != AnswerResult.OK:
                self._say(f"The robot refuses {line.strip()!r}: {reason(result)}.")
                continue
            setting = self._former if wanted is None else wanted
            if wanted is not None and wanted.numbers() != self._setting.numbers():
                self._former = self._setting
            self._setting = setting
            moment = t + 1e-6 * int(wrapped(changed - time))
            self.changes.append(Change(t=round(moment, 6), setting=setting))
            self._say(f"{moment:.2f} s: {setting.words()}")

    def _setting_of(self, words: list[str]) -> Setting | None:
        """Return the setting that a command asks for, None for the former one; InputError if there is none."""
        command, *texts = words
        if command == "back" and not texts:
            return None
        try:
            numbers = tuple(map(float, texts))
        except ValueError:
            numbers = ()
        check_known(command, _COMMANDS, f"There is no command {command!r}", otherwise="they are")
        if command == "compensation" and len(numbers) == 1:
            wanted = replace(self._setting, compensation=numbers[0])
        elif command == "gain" and numbers:
            weights = (1.0 - numbers[0], *numbers) if len(numbers) == 1 else numbers
            wanted = replace(self._setting, weights=weights)
        else:
            raise InputError(
                f"{' '.join(words)!r} must be a command and numbers, such as gain 0.3 or compensation 0.8."
            )
        check_setting(self._own, wanted)
        return wanted
