"""Checkpoints: a long run that is killed continues bit for bit from a journal of its computed values.

A run is determined by its inputs and by the answers to its expensive questions: the costs of a population, the
normal equations about a point, a batch of a bootstrap. Each answer is written, with its question, before it is used.
Resuming is running again: the questions come in the same order, those on file are answered from it, and no private
state of the search or of its random numbers has to be kept. A question that differs by one bit ends the run.

The file is text, a JSON object a line, floats with as many digits as give the same bits back:

    {"format": "ballbot checkpoint 4", "belongs_to": {"robot": "sha256 ...", ...}, "sha256": "..."}
    {"stage": "evolution", "question": {"shape": [24, 12], ...}, "answer": [...], "sha256": "..."}

It is written anew, whole, at every answer (`ballbot.files`), so that it never holds a part of an answer. A line ends
with the SHA-256 of the line before's and of its own text, so that a line that was changed, added or taken out is
noticed before any of it is used.

The last bits of a result also depend on the versions of the packages and on the processor that code is compiled for.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import cast

import numpy as np
from llvmlite.binding import get_host_cpu_name
from numba.core.registry import cpu_target
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import check_file, remove, write_bytes
from ballbot.fitting.run import Arrays
from ballbot.log import Log
from ballbot.robot import Robot

_PACKAGES = ("ballbot", "numpy", "scipy", "numba", "cmaes")


@cache
def machine() -> dict[str, str]:
    """Return the versions and the processor's kind, each by a plain name.

    In brackets stands a digest of the instructions that Numba compiles to.
    """
    _, _, features = cpu_target.target_context.codegen().magic_tuple()  # pyright: ignore[reportAttributeAccessIssue]
    compiled_for = hashlib.sha256(features.encode()).hexdigest()[:8]
    processor = f"{get_host_cpu_name()} ({compiled_for})"
    return {package: version(package) for package in _PACKAGES} | {"processor": processor}


_FORMAT = "ballbot checkpoint 4"
_ANY_FORMAT = re.compile(r"ballbot checkpoint (\d+)")
_SEAL = b', "sha256": "'
_END = b'"}\n'


class CheckpointError(InputError):
    """A checkpoint that is damaged or another run's; it is its owner's to delete."""


class Checkpoint:
    """A run's journal; made by `open_checkpoint`."""

    def __init__(self, path: Path, lines: Sequence[bytes]) -> None:
        """Keep the lines of the file at `path`, the header first."""
        self._path = path
        self._lines = list(lines)
        self._next = 1  # the line that the next question is compared with

    def memoize(
        self, stage: str, question: NDArray[np.float64], answer: Callable[[], Sequence[NDArray[np.float64]]]
    ) -> Arrays:
        """Answer as `ballbot.fitting.run.Run.memoize` describes; a new answer is on file before it is returned.

        Raises
        ------
        CheckpointError
            If the file has an answer to another question in this place, or is damaged.
        InputError
            If it cannot be written.
        """
        if self._next == len(self._lines):
            arrays = tuple(np.asarray(array, float) for array in answer())
            self._lines.append(_line(stage, question, arrays, after=self._lines[-1]))
            write_bytes(self._path, b"".join(self._lines))
        else:
            arrays = self._on_file(stage, question)
        self._next += 1
        return arrays

    def remove(self) -> None:
        """Delete the file, as its run's results are kept elsewhere now."""
        remove(self._path)

    def _on_file(self, stage: str, question: NDArray[np.float64]) -> Arrays:
        try:
            entry = json.loads(self._lines[self._next])
            same = entry["stage"] == stage and _text(entry["question"]) == _text(_plain(question))
            answered = tuple(_array(one) for one in entry["answer"])
        except (ValueError, KeyError, TypeError):
            raise CheckpointError(
                f"{self._path} is damaged at line {self._next + 1}; delete it to start again."
            ) from None
        if not same:
            raise CheckpointError(
                f"{self._path} cannot be resumed: from line {self._next + 1} on the "
                "run differs from the one that wrote it. Delete it to start again."
            )
        return answered


def open_checkpoint(path: str | Path, *, belongs_to: Mapping[str, str], resume: bool) -> Checkpoint:
    """Return the journal of a run, a new one or one to go on with; the file is written at the first answer.

    Parameters
    ----------
    path : str or Path
        The checkpoint's file.
    belongs_to : mapping of str to str
        Hashes and values of all inputs that the answers depend on, by plain names; see `identity`.
    resume : bool
        Continue from the file; begin a new one if it does not exist.

    Raises
    ------
    InputError
        If there is a file that is not to be resumed, that belongs to another run or is no checkpoint, or where it
        cannot be read or written.
    """
    path = Path(path)
    if not check_file(path).exists():
        return Checkpoint(path, [_sealed({"format": _FORMAT, "belongs_to": dict(belongs_to)}, after=b"")])
    if not resume:
        raise InputError(
            f"{path} holds a run that was not finished; resume it (--resume), or delete it to start again."
        )
    lines = _read(path)
    begun = _header(path, lines)  # first, so that a file of another kind is named as such
    _check_seals(path, lines)
    _check_same(path, begun, belongs_to)
    return Checkpoint(path, lines)


def identity(robot: Robot, logs: Sequence[Log], options: Mapping[str, object]) -> dict[str, str]:
    """Return the identity of a run: hashes of its robot and logs, its options, the kind of machine and the versions."""
    columns = [(log.names, *(log[name] for name in log.names)) for log in logs]
    return identity_of({"robot": [robot], "logs": [part for log in columns for part in log]}, options)


def identity_of(inputs: Mapping[str, Sequence[object]], options: Mapping[str, object]) -> dict[str, str]:
    """Return the identity of a run from its inputs by name (each a list of parts for `digest`) and its options."""
    return {
        **{name: digest(*parts).hex() for name, parts in inputs.items()},
        **{name: str(value) for name, value in options.items()},
        **machine(),
        "mujoco": _mujoco(),
    }


def _mujoco() -> str:
    """Return the version of the twin's engine, which answers come from where a run uses the twin."""
    try:
        return version("mujoco")
    except PackageNotFoundError:
        return "not installed"


def digest(*parts: object) -> bytes:
    """Return the SHA-256 of arrays, of dataclasses by their fields, and of values whose `repr` is complete."""
    found = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            found.update(f"{part.dtype} {part.shape}\n".encode())
            found.update(np.ascontiguousarray(part).tobytes())
        else:
            found.update(f"{_complete(part)}\n".encode())
    return found.digest()


def _complete(value: object) -> str:
    """Return a text with every field of a dataclass, however deep: the `repr` of a robot is a summary of it."""
    if type(value) in (list, tuple):
        items = ", ".join(map(_complete, cast("Sequence[object]", value)))
        if isinstance(value, list):
            return f"[{items}]"
        return f"({items},)" if len(cast("Sequence[object]", value)) == 1 else f"({items})"
    if isinstance(value, dict | MappingProxyType):
        items = ", ".join(f"{name!r}: {_complete(one)}" for name, one in value.items())
        return f"{{{items}}}" if isinstance(value, dict) else f"mappingproxy({{{items}}})"
    if not is_dataclass(value) or isinstance(value, type):
        return repr(value)
    parts = (f"{one.name}={_complete(getattr(value, one.name))}" for one in fields(value) if one.repr)
    return f"{type(value).__qualname__}({', '.join(parts)})"


def _read(path: Path) -> list[bytes]:
    try:
        return path.read_bytes().splitlines(keepends=True)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None


def _header(path: Path, lines: Sequence[bytes]) -> dict[str, str]:
    """Return the identity of the file's run; raise InputError if the file is no checkpoint of this version."""
    try:
        header = json.loads(lines[0])
        written, belongs_to = str(header["format"]), dict(header["belongs_to"])
    except (IndexError, ValueError, KeyError, TypeError, RecursionError):
        written, belongs_to = "", {}
    numbered = _ANY_FORMAT.fullmatch(written)
    if numbered and written != _FORMAT:
        raise InputError(
            f"{path} is a checkpoint of format {numbered[1]}, and Ballbot {version('ballbot')} has format "
            f"{_FORMAT.rsplit(' ', 1)[1]}; resume it with the version that wrote it, or delete it to start again."
        )
    if written != _FORMAT or not lines[-1].endswith(b"\n"):
        raise InputError(
            f"{path} is not a complete checkpoint of this version of Ballbot; delete it to start again."
        )
    return belongs_to


def _check_seals(path: Path, lines: Sequence[bytes]) -> None:
    """Raise CheckpointError unless every line is as it was written, after the lines that it was written after."""
    for number, (before, line) in enumerate(pairwise((b"", *lines)), start=1):
        text, seal, rest = line.rpartition(_SEAL)
        if not seal or rest != _seal(text, before) + _END:
            raise CheckpointError(
                f"{path} is damaged or was edited at line {number}; delete it to start again."
            )


def _check_same(path: Path, begun: Mapping[str, str], now: Mapping[str, str]) -> None:
    then, here = (one.get("ballbot") for one in (begun, now))
    if then and here and then != here:
        raise InputError(
            f"{path} was begun by Ballbot {then}, and this is Ballbot {here}; resume it with the version that "
            "began it, or delete it to start again."
        )
    differing = [name for name in [*now, *begun] if begun.get(name) != now.get(name)]
    names = ", ".join(dict.fromkeys(differing))
    if names:
        raise InputError(
            f"{path} belongs to another run, which differs in: {names}; "
            "resume with the same inputs, or delete it to start again."
        )


def _line(stage: str, question: NDArray[np.float64], answer: Arrays, *, after: bytes) -> bytes:
    entry = {"stage": stage, "question": _plain(question), "answer": [_plain(array) for array in answer]}
    return _sealed(entry, after=after)


def _sealed(entry: Mapping[str, object], *, after: bytes) -> bytes:
    """Return the line of an entry that stands after another line."""
    text = json.dumps(entry).encode().removesuffix(b"}")
    return text + _SEAL + _seal(text, after) + _END


def _seal(text: bytes, before: bytes) -> bytes:
    previous = before.rpartition(_SEAL)[2].removesuffix(_END)
    return hashlib.sha256(previous + text).hexdigest().encode()


def _plain(array: NDArray[np.float64]) -> dict[str, list]:
    return {"shape": list(np.shape(array)), "values": np.asarray(array, float).ravel().tolist()}


def _array(plain: Mapping[str, list]) -> NDArray[np.float64]:
    return np.array(plain["values"], float).reshape(plain["shape"])


def _text(plain: object) -> str:
    """Return a value as text of the file; equal texts are equal bits, except for the many kinds of NaN."""
    return json.dumps(plain)
