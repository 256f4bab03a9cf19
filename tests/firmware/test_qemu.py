"""The board under QEMU: its drivers, and that it leaves nothing behind."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError
from tests.support import qemu
from tests.support.processes import PATIENCE, Child
from tests.support.qemu import BOARD, QemuBoard, compile_board, toolchains, what_to_install

pytestmark = [
    pytest.mark.board,
    pytest.mark.skipif(bool(what_to_install()), reason=what_to_install() or "all is installed"),
]

ECHO = Path(__file__).with_name("board_echo.c")


@pytest.fixture(scope="module", params=["gcc", "zig"])
def echo(request, tmp_path_factory) -> Path:
    """Return the image of the program that echoes, for each toolchain."""
    if request.param not in toolchains():
        pytest.skip(f"the toolchain {request.param} is not installed")
    image = tmp_path_factory.mktemp("echo") / "echo.elf"
    drivers = [path for path in sorted(BOARD.glob("*.c")) if path.name != "main.c"]
    compile_board(image, [*drivers, ECHO], toolchain=request.param)
    return image


def received(board: QemuBoard, count: int) -> bytes:
    """Return so many bytes from the board; fail if none comes for a while, or the board has gone."""
    board.line.settimeout(PATIENCE)
    found = b""
    while len(found) < count:
        more = board.line.recv(count - len(found))
        assert more, "the board has closed its line"
        found += more
    return found


def test_serial_line_gives_back_every_byte_in_order(echo):
    random = np.random.default_rng(1)
    with QemuBoard(echo) as board:
        for _ in range(
            5
        ):  # a ring of the board holds 4096 bytes; what comes when it is full is lost, as on any board
            sent = random.integers(0, 254, 3000, dtype=np.uint8).tobytes()
            board.line.sendall(sent)
            assert received(board, len(sent)) == sent


def test_timer_runs_with_the_time_of_this_computer(echo):
    def asked(board: QemuBoard) -> tuple[float, float, float]:
        """Return the time here before the question, that of the board, and that here after the answer [s]."""
        before = time.monotonic()
        board.line.sendall(b"\xff")
        answer = int.from_bytes(received(board, 4), "little")
        return before, 1e-6 * answer, time.monotonic()

    with QemuBoard(echo) as board:
        first = asked(board)
        time.sleep(1.0)
        second = asked(board)
    # however late a busy computer asks and answers; a step of the board's timer is 40 ns, and it counts whole us
    passed = second[1] - first[1]
    assert second[0] - first[2] - 0.01 <= passed <= second[2] - first[0] + 0.01


def test_timer_never_goes_back(echo):
    with QemuBoard(echo) as board:
        board.line.sendall(b"\xfe")
        assert int.from_bytes(received(board, 4), "little") == 0


def processes_of(image: Path) -> list[int]:
    """Return the processes whose command line has a path."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if str(image).encode() in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
        except OSError:
            continue  # it has ended meanwhile
    return [one for one in found if one != os.getpid()]


def gone(image: Path) -> bool:
    """Return whether sooner or later no process has the path in its command line."""
    end = time.monotonic() + PATIENCE
    while processes_of(image) and time.monotonic() < end:
        time.sleep(0.02)
    return not processes_of(image)


@pytest.mark.skipif(
    not Path("/proc").is_dir(), reason="processes are listed in /proc, which this system lacks"
)
def test_board_that_is_closed_is_gone(echo):
    board = QemuBoard(echo)
    assert board.running
    board.line.sendall(b"a")
    assert received(board, 1) == b"a"
    board.close()
    assert not board.running
    assert gone(echo)


@pytest.mark.skipif(
    not Path("/proc").is_dir(), reason="processes are listed in /proc, which this system lacks"
)
def test_board_of_a_process_that_is_killed_is_gone(echo):
    program = (
        "import sys\nfrom pathlib import Path\nfrom tests.support.qemu import QemuBoard\n"
        "board = QemuBoard(Path(sys.argv[1]))\nboard.line.sendall(b'a')\nboard.line.recv(1)\n"
        "print('runs', flush=True)\nsys.stdin.read()\n"
    )
    with Child("-c", program, str(echo)) as owner:
        assert owner.line() == "runs"
        assert len(processes_of(echo)) >= 2
        owner.kill()
    assert gone(echo)


def test_missing_toolchain_and_qemu_are_named(monkeypatch, tmp_path):
    with pytest.raises(InputError, match="no toolchain for the board's processor 'other'"):
        compile_board(tmp_path / "none.elf", [], toolchain="other")
    (tmp_path / "wrong.c").write_text("int main(void) { return missing(); }\n")
    with pytest.raises(InputError, match="compiler refuses"):
        compile_board(tmp_path / "none.elf", [tmp_path / "wrong.c"])
    monkeypatch.setattr(qemu, "QEMU", "qemu-of-nobody")
    with pytest.raises(InputError, match="Emulating a board needs qemu-of-nobody"):
        QemuBoard(tmp_path / "none.elf")
    monkeypatch.setattr(qemu, "toolchains", dict)
    assert "apt-get install gcc-arm-none-eabi" in what_to_install()
