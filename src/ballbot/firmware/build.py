"""Compile the firmware's C sources, for this computer or for another processor, and keep what was compiled.

    functions = shared_library("library", source_files())      compiled by the first call ever, then loaded

What is compiled is kept in the user's cache folder, under a digest of everything that it follows from: the sources,
the headers, the options, the compiler and the kind of computer. A folder that cannot be written is no error: the file
then lies in a temporary folder until this process ends.
"""

import atexit
import ctypes
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.firmware.header import SOURCES, WEIGHTS_HEADER

#: warnings of the compiler, all of them errors; the library compiles without one
WARNINGS = (
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Wdouble-promotion",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wcast-qual",
    "-Wvla",
    "-Werror",
)
#: options that the numbers depend on: no fused multiply-add, no reordering
NUMERICS = ("-std=c99", "-ffp-contract=off", "-fno-fast-math", "-fno-math-errno")
#: Clang and LLD from a wheel of pip, for every processor
ZIG = (sys.executable, "-m", "ziglang")
_SHARED = ("-O2", "-fPIC", "-shared")
#: for a compiler [s]; the slowest takes some seconds
_PATIENCE = 300.0


def has_zig() -> bool:
    """Return whether the wheel `ziglang` is installed."""
    return importlib.util.find_spec("ziglang") is not None


def compilers() -> dict[str, tuple[str, ...]]:
    """Return the C compilers of this computer by name, each as the start of its command line."""
    commands: dict[str, tuple[str, ...]] = {
        name: (path,) for name in ("gcc", "clang") if (path := shutil.which(name))
    }
    if has_zig():
        commands["zig"] = (*ZIG, "cc")
    return commands


def run_tool(*command: str | Path, name: str = "The compiler") -> None:
    """Run a compiler or a linker; raise InputError with what it prints if it fails or does not end."""
    words = [str(word) for word in command]
    environment = dict(os.environ)
    if tuple(words[: len(ZIG)]) == ZIG:  # it hangs if its cache cannot be written
        environment.setdefault("ZIG_GLOBAL_CACHE_DIR", str(_cache_folder("zig")))
    try:
        done = subprocess.run(
            words, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
            timeout=_PATIENCE,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(f"{name} has not ended after {_PATIENCE:g} s.") from None
    if done.returncode:
        raise InputError(f"{name} refuses the sources: {done.stderr.strip()}")


def source_files(folder: Path = SOURCES) -> list[Path]:
    """Return the C sources of the library in a folder, in order."""
    return sorted(folder.rglob("*.c"))


def compile_sources(
    target: Path,  # the file to write
    sources: Sequence[Path],  # files; they find the library's headers
    *,
    flags: Sequence[str] = _SHARED,  # more options of the compiler; by default those of a shared library
    compiler: str | None = None,  # one of `compilers`; the first of them by default
) -> None:
    """Compile C sources for this computer without a warning.

    InputError if there is no such compiler, or it refuses the sources.
    """
    name, command = _compiler(compiler)
    run_tool(*command, *NUMERICS, *WARNINGS, *flags, f"-I{SOURCES}", *sources, "-o", target, name=name)


def _compiler(name: str | None = None) -> tuple[str, tuple[str, ...]]:
    """Return name and command of the compiler of that name, or of the first one there is; InputError without one."""
    known = compilers()
    wanted = name or next(iter(known), "")
    if wanted not in known:
        named = f" {wanted!r}" if wanted else ""
        raise InputError(
            f"There is no C compiler{named} on this computer; install gcc or clang, or `pip install ziglang`."
        )
    return wanted, known[wanted]


def shared_library(
    name: str,  # of the file, before its digest
    sources: Sequence[Path],
    *,
    include: Sequence[Path] = (),  # folders of headers besides the library's own
    weights: str = "",  # text of the header of a policy's weights; without one, the library's own, which has none
) -> ctypes.CDLL:
    """Return C sources as a loaded library, compiled by the first of `compilers` unless that is kept.

    InputError if there is no compiler, or it refuses the sources.
    """
    compiler, command = _compiler()
    headers = [path for folder in (SOURCES, *include) for path in sorted(folder.rglob("*.h"))]
    options = (*NUMERICS, *WARNINGS, *_SHARED)
    parts = [tool_identity(compiler, command), *options, *map(Path.read_bytes, (*sources, *headers)), weights]

    def build(path: Path) -> None:
        folders = (*weights_folder(path.parent, weights), *include)
        compile_sources(path, sources, flags=(*_SHARED, *(f"-I{folder}" for folder in folders)))

    return ctypes.CDLL(str(kept_build(f"{name}.so", parts, build)))


def weights_folder(folder: Path, weights: str) -> list[Path]:
    """Write the text of a header of weights into a folder; return the folders to include before the library's own."""
    if not weights:
        return []
    write_text(folder / WEIGHTS_HEADER, weights)
    return [folder]


def tool_identity(name: str, command: Sequence[str]) -> str:
    """Return a text that changes with a compiler and with the kind of computer."""
    if command[: len(ZIG)] == ZIG:
        compiler = f"ziglang {version('ziglang')}"
    else:
        path = Path(command[0]).resolve()
        compiler = f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}"
    return f"{name} {compiler} {sys.platform} {platform.machine()}"


def kept_build(
    name: str,  # of the file; the digest is put before its ending
    parts: Iterable[str | bytes],  # all that the file follows from
    build: Callable[[Path], None],  # writes the file
) -> Path:
    """Return a built file, from the user's cache folder if it was built before."""
    digest = sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    stem, ending = os.path.splitext(name)
    target = _cache_folder("ballbot") / f"{stem}-{digest.hexdigest()[:32]}{ending}"
    if not target.exists():
        with tempfile.TemporaryDirectory(dir=target.parent) as room:
            build(Path(room) / target.name)
            (Path(room) / target.name).replace(target)  # at once: another process may look for it
    return target


def _cache_folder(name: str) -> Path:
    """Return a folder in the user's cache; if none can be written, a temporary one until this process ends."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    try:
        if not base.is_absolute():
            raise FileNotFoundError(base)
        folder = base / name
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="ballbot-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
