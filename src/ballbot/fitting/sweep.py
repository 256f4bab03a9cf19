"""A sweep: many runs, each of which leaves one finished file in a folder.

A sweep that is stopped at any moment, by Ctrl-C, kill -9 or a power cut, continues when it is started again: finished
runs are read, and the others are made. A header file in the folder identifies the inputs of all runs: digests of the
inputs, the options, and the versions and the processor, on which the last bits of a result depend. Runs with other
inputs are refused.

The result of a worker is written completely or not at all, and read back, so that a result is the same whether its run
was made now or before.
"""

import hashlib
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Generic, TypeVar, cast

from llvmlite.binding import get_host_cpu_name
from numba.core.registry import cpu_target

from ballbot.errors import InputError
from ballbot.files import read_json, write_text
from ballbot.fitting.run import Executor, ExecutorError, Piece
from ballbot.progress import Progress, ProgressCallback, ignore_progress

#: file in the folder with the identity of its runs
HEADER = ".ballbot-runs.json"

Made = TypeVar("Made")
Finished = TypeVar("Finished")


@dataclass(frozen=True, kw_only=True)
class RunFolder(Generic[Made, Finished]):
    """A folder of finished runs."""

    path: Path
    made_from: Mapping[str, str]  #: identity of its runs, by plain names; see `identity`
    write: Callable[[Path, Made], object]  #: writes the result of a run, completely or not at all
    #: returns a finished run, None if it is missing or incomplete; InputError if it must not be replaced
    read: Callable[[Path], Finished | None]

    def complete(
        self,
        make: Callable[[Piece], Made],
        runs: Mapping[str, Piece],
        *,
        workers: Executor,
        stage: str,
        progress: ProgressCallback = ignore_progress,
    ) -> dict[str, Finished]:
        """Make the missing runs, and return all runs by name, in the order of `runs`.

        `make` makes a run from its piece (`ballbot.fitting.run.Executor.each`), and `runs` has the piece of each run by
        the name of its file. Progress is reported after each run. InputError if the folder holds runs with other
        inputs, or a run cannot be made or written.
        """
        self._check(runs)
        finished = {name: run for name in runs if (run := self.read(self.path / name)) is not None}
        missing = [name for name in runs if name not in finished]
        progress(Progress(stage=stage, done=len(finished), total=len(runs)))
        try:
            with closing(workers.each(make, [runs[name] for name in missing])) as making:
                for number, made in making:
                    path, header = self.path / missing[number], self.path / HEADER
                    if not header.exists():
                        write_text(header, json.dumps({"made_from": dict(self.made_from)}, indent=2) + "\n")
                    self.write(path, made)
                    run = self.read(path)
                    assert run is not None, f"{path} was written and cannot be read"
                    finished[path.name] = run
                    progress(Progress(stage=stage, done=len(finished), total=len(runs)))
        except ExecutorError as error:  # nothing is wrong with the run
            text = f"{error} Finished runs are kept; the same command goes on with them."
            raise ExecutorError(text) from None
        except KeyboardInterrupt:
            text = "interrupted; the same command goes on with the runs that are finished."
            raise KeyboardInterrupt(text) from None
        return {name: finished[name] for name in runs}

    def _check(self, names: Collection[str]) -> None:
        """Raise InputError unless the runs in the folder have the same identity as these."""
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
            differing = [
                name for name in {**self.made_from, **before} if before.get(name) != self.made_from.get(name)
            ]
        except (KeyError, AttributeError, TypeError):
            raise InputError(f"{header} is damaged; delete {self.path}, or choose another folder.") from None
        if differing:
            raise InputError(
                f"{self.path} holds finished runs that differ from these in: {', '.join(differing)}; delete that "
                "folder to start again, or choose another one with --out."
            )


def identity(inputs: Mapping[str, Sequence[object]], options: Mapping[str, object]) -> dict[str, str]:
    """Return the identity of runs: digests of their inputs (each the parts of `digest`), options and `machine`."""
    return {
        **{name: digest(*parts) for name, parts in inputs.items()},
        **{name: str(value) for name, value in options.items()},
        **machine(),
    }


@cache
def machine() -> dict[str, str]:
    """Return the versions of packages and the processor, with a digest of its instruction set in brackets."""
    _, _, features = cpu_target.target_context.codegen().magic_tuple()  # pyright: ignore[reportAttributeAccessIssue]
    compiled_for = hashlib.sha256(features.encode()).hexdigest()[:8]
    versions = {}
    for package in ("ballbot", "numpy", "scipy", "numba", "mujoco"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:  # MuJoCo is an extra
            versions[package] = "not installed"
    return {**versions, "processor": f"{get_host_cpu_name()} ({compiled_for})"}


def digest(*parts: object) -> str:
    """Return the SHA-256 of dataclasses by their fields, and of values whose `repr` is complete."""
    return hashlib.sha256("".join(f"{_complete(part)}\n" for part in parts).encode()).hexdigest()


def _complete(value: object) -> str:
    """Return a text with every field of a dataclass, however deep: the `repr` of a robot is a summary of it."""
    if type(value) in (list, tuple):
        return f"{type(value).__name__}({', '.join(map(_complete, cast('Sequence[object]', value)))})"
    if isinstance(value, dict | MappingProxyType):
        return f"mapping({', '.join(f'{name!r}: {_complete(entry)}' for name, entry in value.items())})"
    if not is_dataclass(value) or isinstance(value, type):
        return repr(value)
    parts = (f"{field.name}={_complete(getattr(value, field.name))}" for field in fields(value) if field.repr)
    return f"{type(value).__qualname__}({', '.join(parts)})"
