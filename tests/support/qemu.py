"""A whole board under QEMU: the MPS2 with the image AN386, a Cortex-M4F with a serial line and a timer.

    image = folder / "board.elf"
    build_board(export_controller(controller).files, image)
    with QemuBoard(image) as board:
        board.line.sendall(...)

`board/` has what a board needs beside the exported firmware: vector table and reset, linker script, drivers of the
serial line and the timer, and the main loop. arm-none-eabi-gcc builds it, or Clang from the `ziglang` wheel.

The serial line is one end of a pair of sockets that QEMU inherits: no port is opened, and nobody else can connect. QEMU
runs below a shell that waits for the end of a pipe from this process. If this process ends, however it ends, the pipe
closes, and the shell kills QEMU.

Time. The firmware's clock is the time in the frames of the emulated sensors, not QEMU's: each such frame is one sample.
The torques therefore follow from the frames alone, however fast QEMU runs, and need no `-icount`. The board's own timer
wakes the main loop, and disarms the robot if no sample comes for a minute.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from ballbot.errors import InputError
from ballbot.firmware.build import (
    NUMERICS,
    RUNTIME,
    WARNINGS,
    ZIG,
    chosen_tool,
    compile_objects,
    has_zig,
    run_tool,
)
from ballbot.firmware.emulator import PROCESSOR
from ballbot.link.emulated import HARDWARE
from ballbot.link.transport import LinkError

#: what a board needs beside the exported firmware
BOARD = Path(__file__).with_name("board")
QEMU = "qemu-system-arm"
#: for which the host of a board may compute between two samples [s]; the first run of some plants compiles for a while
SILENCE = 60.0
_GCC = "arm-none-eabi-gcc"
_BUILD = ("-O2", "-g", "-ffreestanding", "-fno-common", "-ffunction-sections", "-fdata-sections")
#: kills the command that follows it when its standard input ends
_SUPERVISED = '"$@" </dev/null & board=$!; cat >/dev/null; kill -9 "$board" 2>/dev/null; wait "$board"'


@dataclass(frozen=True, kw_only=True)
class Toolchain:
    """A compiler and a linker for the board's processor."""

    name: str
    compile: tuple[str, ...]  #: start of the command that compiles one source
    link: tuple[str, ...]  #: start of the command that links objects
    libraries: tuple[str, ...] = ()  #: its end


def toolchains() -> dict[str, Toolchain]:
    """Return the toolchains on this computer by name: "gcc" and "zig"."""
    found = {}
    if path := shutil.which(_GCC):
        processor = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
        found["gcc"] = Toolchain(
            name="gcc",
            compile=(path, *processor),
            link=(path, *processor, "-nostdlib", "-Wl,--gc-sections", "-Wl,-z,noexecstack"),
            libraries=("-lgcc",),
        )
    if has_zig():
        found["zig"] = Toolchain(
            name="zig",
            compile=(*ZIG, "cc", *PROCESSOR, "-fno-unwind-tables"),
            link=(*ZIG, "ld.lld", "--gc-sections"),
        )
    return found


def what_to_install() -> str:
    """Return one sentence on what a board under QEMU needs and this computer lacks; empty if all is there."""
    missing = [] if shutil.which(QEMU) else [f"{QEMU} (Debian: apt-get install qemu-system-arm)"]
    if not toolchains():
        missing.append(f"{_GCC} (Debian: apt-get install gcc-arm-none-eabi) or `pip install ziglang`")
    return f"A board under QEMU needs {' and '.join(missing)}." if missing else ""


def build_board(
    files: Mapping[str, str],
    target: Path,
    *,
    toolchain: str | None = None,
    self_test: bool = True,
    silence: float = SILENCE,
) -> None:
    """Build an exported firmware with the board's main loop.

    Parameters
    ----------
    files : mapping of str to str
        Text by path, of an `Export` or of a folder that `ballbot export` wrote.
    target : Path
        The ELF file to write.
    toolchain : str, optional
        One of `toolchains`; the first of them by default.
    self_test : bool
        Whether the robot must pass its self-test before it arms; if not, its wiring counts as known.
    silence : float
        Without a sample for so long [s] the board disarms the robot.

    Raises
    ------
    InputError
        If there is no such toolchain, or it refuses the sources.
    """
    with tempfile.TemporaryDirectory(prefix="ballbot-board-") as name:
        folder = Path(name)
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
        sources = [folder / path for path in files if _is_source(path)]
        flags = [f"-DBALLBOT_SILENCE={round(1e6 * silence)}u"]
        flags += [] if self_test else ["-DBALLBOT_WIRING_IS_KNOWN"]
        compile_board(
            target,
            [*sources, *sorted(HARDWARE.glob("*.c")), *sorted(BOARD.glob("*.c"))],
            include=[folder / "ballbot", folder, HARDWARE],
            flags=flags,
            toolchain=toolchain,
        )


def _is_source(path: str) -> bool:
    """Return whether an exported file belongs to a program with a main loop of its own."""
    return path.endswith(".c") and not path.startswith("examples/")


def compile_board(
    target: Path,
    sources: Sequence[Path],
    *,
    include: Sequence[Path] = (),
    flags: Sequence[str] = (),
    toolchain: str | None = None,
) -> None:
    """Compile and link a program for the board.

    Parameters
    ----------
    target : Path
        The ELF file to write.
    sources : sequence of Path
        One of them has `main`; the board's own sources are not added.
    include : sequence of Path
        Folders of headers; the board's own is added.
    flags : sequence of str
        More options of the compiler.
    toolchain : str, optional
        One of `toolchains`; the first of them by default.

    Raises
    ------
    InputError
        If there is no such toolchain, or it refuses the sources.
    """
    _, tools = _toolchain(toolchain)
    paths = [f"-I{path}" for path in (*include, BOARD)]
    command = (*tools.compile, *_BUILD, *flags, *paths)
    with tempfile.TemporaryDirectory(prefix="ballbot-board-") as folder:
        objects = compile_objects(
            Path(folder), [*sources, RUNTIME], command=command, own=(*WARNINGS, *NUMERICS)
        )
        script = BOARD / "mps2_an386.ld"
        run_tool(*tools.link, "-T", script, *objects, *tools.libraries, "-o", target)


def _toolchain(name: str | None = None) -> tuple[str, Toolchain]:
    return chosen_tool(toolchains(), name, kind="toolchain for the board's processor", install=_GCC)


class QemuBoard:
    """A board that runs a program, until it is closed or this process ends.

    Parameters
    ----------
    image : Path
        ELF file of the program.

    Attributes
    ----------
    line : socket.socket
        The other end of the board's serial line.

    Raises
    ------
    InputError
        If QEMU is not installed.
    """

    def __init__(self, image: Path) -> None:
        if not shutil.which(QEMU):
            raise InputError(f"Emulating a board needs {QEMU}; on Debian, apt-get install qemu-system-arm.")
        self.line, theirs = socket.socketpair()
        command = (
            QEMU, "-machine", "mps2-an386", "-nodefaults", "-nic", "none", "-display", "none", "-monitor", "none",
            "-kernel", str(image),
            "-chardev", f"socket,id=line,fd={theirs.fileno()}", "-serial", "chardev:line",
        )  # fmt: skip
        with theirs:
            self._process = subprocess.Popen(
                ("sh", "-c", _SUPERVISED, "board", *command),
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,  # Ctrl-C is for this process, which then closes the board
            )

    @property
    def running(self) -> bool:
        """Whether the board has neither been closed nor ended by itself."""
        ended = os.WEXITED | os.WNOHANG | os.WNOWAIT
        return self._process.returncode is None and os.waitid(os.P_PID, self._process.pid, ended) is None

    def close(self) -> None:
        """Stop the board, now."""
        self.line.close()
        if self._process.returncode is None:  # not waited for: the number still belongs to this group
            os.killpg(self._process.pid, signal.SIGKILL)
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()

    def __enter__(self) -> Self:
        """Return the board."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the board."""
        self.close()


#: for the board to take bytes, before it counts as gone [s]
_WRITE_PATIENCE = 20.0
#: for bytes to gather [s]
_GATHERING = 3e-4


class BoardLine:
    """The serial line of a board under QEMU, as a transport; closing it stops the board."""

    def __init__(self, board: QemuBoard) -> None:
        self._board, self._line = board, board.line
        self._line.settimeout(_WRITE_PATIENCE)

    def read(self, timeout: float) -> bytes:
        """Return what has come; wait for it at most `timeout` [s], then return b""."""
        first = self._come(timeout)
        if not first:
            return b""
        time.sleep(_GATHERING)  # bytes come one by one; to wake for each would take longer
        return first + self._come(0.0)

    def _come(self, timeout: float) -> bytes:
        if not select.select([self._line], [], [], timeout)[0]:
            return b""
        try:
            data = self._line.recv(65536)
        except OSError as problem:
            raise LinkError(f"The board has gone: {problem}") from None
        if not data:
            raise LinkError("The board has gone: it has closed the line.")
        return data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._line.sendall(data)
        except OSError as problem:
            raise LinkError(f"The board has gone: {problem}") from None

    def close(self) -> None:
        """Stop the board."""
        self._board.close()
