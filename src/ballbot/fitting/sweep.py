"""A sweep: many runs, each of which leaves one finished file in a folder and is not made again while that is there.

A sweep that is stopped at any moment, by Ctrl-C, kill -9 or a power cut, goes on when it is started again: finished
runs are read, the others made. In the folder stands, beside the runs, what all of them are made from: digests of the
inputs, the options, and the versions and the processor that the last bits of a result depend on. Other runs are
refused there.

A run is made in a process of its own or by a worker of a Dask cluster (`ballbot.fitting.cluster`). What it returns is
written here, whole or not at all, and read back, so that a result is the same whether its run was made now or before.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Generic, Protocol, TypeVar, cast

import numpy as np
from llvmlite.binding import get_host_cpu_name
from numba.core.registry import cpu_target

from ballbot.errors import InputError
from ballbot.files import read_json, write_text
from ballbot.fitting.run import ExecutorError
from ballbot.processes import uninterrupted, worker_pool
from ballbot.progress import Progress, ProgressCallback, ignore_progress

#: in a folder of runs, what all of them are made from
HEADER = ".ballbot-runs.json"

Piece = TypeVar("Piece")
Result = TypeVar("Result")
Made = TypeVar("Made")
Finished = TypeVar("Finished")


class Workers(Protocol):
    """Make runs, several at a time."""

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place and the result of each piece, as they are finished.

        Parameters
        ----------
        make : callable
            Of a module, or a partial of one.
        pieces
            Of types that can be pickled.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Processes:
    """Processes of this machine."""

    count: int | None = None  #: one for each core where None; with one, all is done in this process

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place and the result of each piece, as they are finished.

        Raises
        ------
        ExecutorError
            If a process was killed.
        """
        workers = min(self.count or os.cpu_count() or 1, len(pieces))
        if workers < 2:
            yield from ((place, make(piece)) for place, piece in enumerate(pieces))
            return
        pool, finished = worker_pool(workers), False
        try:
            with uninterrupted():
                places = {pool.submit(make, piece): place for place, piece in enumerate(pieces)}
            for one in as_completed(places):
                yield places[one], one.result()
            finished = True
        except BrokenProcessPool:
            raise ExecutorError("A worker process was killed, perhaps because memory ran out.") from None
        finally:
            pool.shutdown(wait=finished, cancel_futures=True)


ALL_CORES = Processes()


@dataclass(frozen=True, kw_only=True)
class RunFolder(Generic[Made, Finished]):
    """A folder of finished runs."""

    path: Path
    made_from: Mapping[str, str]  #: what all its runs depend on, by plain names; see `identity`
    write: Callable[[Path, Made], object]  #: writes what a run has made, whole or not at all
    #: returns a finished run, None if it is not there or not whole; InputError if it may not be replaced
    read: Callable[[Path], Finished | None]

    def complete(
        self,
        make: Callable[[Piece], Made],
        runs: Mapping[str, Piece],
        *,
        workers: Workers,
        stage: str,
        progress: ProgressCallback = ignore_progress,
    ) -> tuple[dict[str, Finished], frozenset[str]]:
        """Make the runs that the folder lacks.

        Parameters
        ----------
        make : callable
            Makes a run from its piece; see `Workers`.
        runs : mapping
            The piece of each run by the name of its file in the folder.
        workers : Workers
        stage : str
            What is being done, for the progress, which is reported after each run.
        progress : callable, optional

        Returns
        -------
        results : dict
            Every run by its name, in the order of `runs`.
        before : frozenset of str
            Those that were there before.

        Raises
        ------
        InputError
            If the folder holds runs that are made from something else, or a run cannot be made or written.
        """
        self._check(runs)
        found = {name: one for name in runs if (one := self.read(self.path / name)) is not None}
        before = frozenset(found)
        missing = [name for name in runs if name not in found]
        progress(Progress(stage=stage, done=len(found), total=len(runs)))
        try:
            with closing(self._made(workers.each(make, [runs[name] for name in missing]))) as making:
                for place, made in making:
                    name = missing[place]
                    found[name] = self._kept(self.path / name, made)
                    progress(Progress(stage=stage, done=len(found), total=len(runs)))
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "interrupted; the same command goes on with the runs that are finished."
            ) from None
        return {name: found[name] for name in runs}, before

    def _made(self, making: Generator[Result, None, None]) -> Generator[Result, None, None]:
        """Yield what runs have made; of lost workers, say that the finished runs are kept."""
        try:
            yield from making
        except ExecutorError as error:  # nothing is wrong with the run
            raise ExecutorError(
                f"{error} Finished runs are kept; the same command goes on with them."
            ) from None

    def _kept(self, path: Path, made: Made) -> Finished:
        """Write what a run has made, with what it is made from before the first one, and read it."""
        header = self.path / HEADER
        if not header.exists():
            write_text(header, json.dumps({"made_from": dict(self.made_from)}, indent=2) + "\n")
        self.write(path, made)
        kept = self.read(path)
        assert kept is not None, f"{path} was written and cannot be read"
        return kept

    def _check(self, names: Collection[str]) -> None:
        """Raise InputError unless the runs in the folder are made from the same as these."""
        header = self.path / HEADER
        if not header.exists():
            there = next((name for name in names if (self.path / name).exists()), None)
            if there:
                raise InputError(
                    f"{self.path / there} was not written by this command; choose another folder with --out."
                )
            return
        try:
            before = cast("dict[str, dict[str, str]]", read_json(header))["made_from"]
            names = [
                one for one in {**self.made_from, **before} if before.get(one) != self.made_from.get(one)
            ]
        except (KeyError, AttributeError, TypeError):
            raise InputError(f"{header} is damaged; delete {self.path}, or choose another folder.") from None
        if names:
            raise InputError(
                f"{self.path} holds finished runs that differ from these in: {', '.join(names)}; delete that folder to "
                "start again, or choose another one with --out."
            )


def identity(inputs: Mapping[str, Sequence[object]], options: Mapping[str, object]) -> dict[str, str]:
    """Return what runs are made from: digests of their inputs by name (each a list of parts for `digest`), their
    options, the versions and the processor's kind.
    """
    return {
        **{name: digest(*parts) for name, parts in inputs.items()},
        **{name: str(value) for name, value in options.items()},
        **machine(),
    }


@cache
def machine() -> dict[str, str]:
    """Return the versions and the processor's kind, each by a plain name.

    In brackets stands a digest of the instructions that Numba compiles to.
    """
    _, _, features = cpu_target.target_context.codegen().magic_tuple()  # pyright: ignore[reportAttributeAccessIssue]
    compiled_for = hashlib.sha256(features.encode()).hexdigest()[:8]
    packages = ("ballbot", "numpy", "scipy", "numba", "cmaes", "mujoco")
    return {one: _version(one) for one in packages} | {"processor": f"{get_host_cpu_name()} ({compiled_for})"}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # MuJoCo is an extra
        return "not installed"


def digest(*parts: object) -> str:
    """Return the SHA-256 of arrays, of dataclasses by their fields, and of values whose `repr` is complete."""
    found = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            found.update(f"{part.dtype} {part.shape}\n".encode())
            found.update(np.ascontiguousarray(part).tobytes())
        else:
            found.update(f"{_complete(part)}\n".encode())
    return found.hexdigest()


def _complete(value: object) -> str:
    """Return a text with every field of a dataclass, however deep: the `repr` of a robot is a summary of it."""
    if type(value) in (list, tuple):
        return f"{type(value).__name__}({', '.join(map(_complete, cast('Sequence[object]', value)))})"
    if isinstance(value, dict | MappingProxyType):
        return f"mapping({', '.join(f'{name!r}: {_complete(one)}' for name, one in value.items())})"
    if not is_dataclass(value) or isinstance(value, type):
        return repr(value)
    parts = (f"{one.name}={_complete(getattr(value, one.name))}" for one in fields(value) if one.repr)
    return f"{type(value).__qualname__}({', '.join(parts)})"
