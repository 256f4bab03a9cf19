"""The firmware on the emulated processor: the bits of this computer, exact counts."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang", reason="ziglang, of the extra `test`, is not installed")
pytest.importorskip("unicorn", reason="unicorn, of the extra `test`, is not installed")

import unicorn

from ballbot import InputError
from ballbot.firmware.emulator import FLASH, FLASH_SIZE, Board, compile_image
from ballbot.firmware.header import SOURCES
from tests.support import firmware_math


def test_instructions_are_counted_exactly():
    """As the emulator reports them one by one, and with those that a condition skips: they take a cycle too."""
    sources = [SOURCES / "ballbot_math.c", Path(firmware_math.__file__).with_suffix(".c")]
    board = Board(compile_image(sources))
    addresses: list[int] = []
    hooked = {"begin": FLASH, "end": FLASH + FLASH_SIZE}
    board._core.hook_add(unicorn.UC_HOOK_CODE, lambda _, address, *__: addresses.append(address), **hooked)
    bits = np.random.default_rng(1).integers(0, 2**32, 40, dtype=np.uint32)
    given, answer = board.place(bits.view(np.float32)), board.place(np.zeros(80, np.float32))
    run = board.call("sine_cosine", 40, given, answer, answer + 160)
    skipped = left = (
        0  # instructions that a condition skips; those of an IT block (IT, up to four) still to come
    )
    for here, after in zip(addresses, [*addresses[1:], 0], strict=True):
        first = int.from_bytes(board._core.mem_read(here, 2), "little")
        place = here + (4 if first >> 11 >= 0b11101 else 2)
        mask = first & 0xF
        left = 5 - (mask & -mask).bit_length() if first >> 8 == 0xBF and mask else left - 1
        while left > 0 and here < place < after <= here + 20:
            first = int.from_bytes(board._core.mem_read(place, 2), "little")
            place, skipped, left = place + (4 if first >> 11 >= 0b11101 else 2), skipped + 1, left - 1
    assert len(addresses) > 1000
    assert run.instructions == len(addresses) + skipped


def test_recursion_and_wrong_sources_are_refused(tmp_path):
    source = tmp_path / "circle.c"
    source.write_text(
        "int even(int n);\nint odd(int n);\n"
        "__attribute__((noinline)) int even(int n) { return n == 0 ? 1 : odd(n - 1) + 2; }\n"
        "__attribute__((noinline)) int odd(int n) { return n == 0 ? 0 : even(n - 1) + 3; }\n"
    )
    circle = compile_image([source])
    with pytest.raises(InputError, match="no bound of its stack"):
        circle.stack_bound("even")
    source.write_text("int wrong(void) { return missing(); }\n")
    with pytest.raises(InputError, match="compiler refuses"):
        compile_image([source])
