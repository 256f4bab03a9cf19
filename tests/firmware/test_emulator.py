"""The firmware on the emulated processor: the bits of this computer, exact counts, cycles of the manual."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang", reason="ziglang, of the extra `test`, is not installed")
pytest.importorskip("unicorn", reason="unicorn, of the extra `test`, is not installed")

import unicorn

from ballbot import InputError, Robot
from ballbot.firmware.cortex_m4 import block_cost, branch_target, instruction
from ballbot.firmware.emulator import FLASH, FLASH_SIZE, Board, Image, compile_image, read_elf
from ballbot.firmware.header import SOURCES
from campaigns import firmware_math
from campaigns.firmware_numbers import controllers
from campaigns.firmware_timing import direct_runs, estimator_runs, image, law_runs

ALTEN = Robot.load("alten")


@cache
def math_image() -> Image:
    return compile_image([SOURCES / "ballbot_math.c", Path(firmware_math.__file__).with_suffix(".c")])


def code(text: str) -> bytes:
    """Return instructions from their half words as the manual writes them."""
    return b"".join(int(word, 16).to_bytes(2, "little") for word in text.split())


@pytest.mark.parametrize(
    ("words", "length", "cycles"),
    [
        ("4293", 2, 1),  # cmp r3, r2
        ("b580", 2, 3),  # push {r7, lr}
        ("bd80", 2, 6),  # pop {r7, pc}
        ("4770", 2, 4),  # bx lr
        ("d902", 2, 4),  # bls
        ("e077", 2, 4),  # b
        ("b112", 2, 4),  # cbz r2
        ("6860", 2, 2),  # ldr r0, [r4, #4]
        ("4808", 2, 2),  # ldr r0, [pc, #32]
        ("c807", 2, 4),  # ldmia r0, {r0, r1, r2}
        ("bf48", 2, 1),  # it mi
        ("46f7", 2, 4),  # mov pc, lr... a branch
        ("f64f 7cff", 4, 1),  # movw
        ("f7ff ff4c", 4, 4),  # bl
        ("e92d 0700", 4, 4),  # push {r8, r9, r10}
        ("e8bd 8ff0", 4, 13),  # pop {r4-r11, pc}
        ("e9d4 9802", 4, 3),  # ldrd
        ("e8df f003", 4, 5),  # tbb
        ("fba2 250c", 4, 1),  # umull
        ("fbb2 f3f1", 4, 12),  # udiv
        ("fb93 f2f1", 4, 12),  # sdiv
        ("f85e 202a", 4, 2),  # ldr.w
        ("eb06 068a", 4, 1),  # add.w with a shift
        ("ed9f 2a66", 4, 2),  # vldr s4
        ("ed9f 2b66", 4, 3),  # vldr d2
        ("ed2d 8b10", 4, 17),  # vpush {d8-d15}
        ("ee31 1a41", 4, 1),  # vsub.f32
        ("ee82 0a01", 4, 14),  # vdiv.f32
        ("eeb1 1ac0", 4, 14),  # vsqrt.f32
        ("eea0 1a01", 4, 3),  # vfma.f32
        ("eef1 fa10", 4, 1),  # vmrs
        ("ec53 2b14", 4, 2),  # vmov r2, r3, d4
    ],
)
def test_length_and_cycles_of_an_instruction(words, length, cycles):
    assert instruction(code(words)) == (length, cycles)


def test_instruction_that_uses_a_result_at_once_waits_a_cycle():
    multiply, other, uses = "ee21 3a02", "ee34 4a05", "ee33 4a05"  # s6 = s2 s4; s8 = s8 + s10; s8 = s6 + s10
    move = "2200"
    assert block_cost(code(f"{multiply} {other} {move}"), 0).cycles == 3
    assert block_cost(code(f"{multiply} {uses} {move}"), 0).cycles == 4
    assert block_cost(code(f"{multiply} {move} {uses} {move}"), 0).cycles == 4


def test_each_line_of_flash_waits_two_cycles():
    assert [block_cost(code("2200 2200 2200 2200"), address).waits for address in (0, 2, 6, 8)] == [
        2,
        4,
        4,
        2,
    ]


def test_branch_goes_where_the_linker_wrote():
    assert branch_target(code("f7ff fffe"), 0x100) == 0x100
    assert branch_target(code("f000 f802"), 0x100) == 0x108
    assert branch_target(code("ee31 1a41"), 0x100) is None


def random_floats(count: int, seed: int) -> np.ndarray:
    bits = np.random.default_rng(seed).integers(0, 2**32, count, dtype=np.uint32)
    return bits.view(np.float32)


@pytest.mark.parametrize(
    ("name", "arguments", "results"),
    [
        ("sine_cosine", 1, 2),
        ("exponential", 1, 1),
        ("power", 2, 1),
        ("square_root", 1, 1),
        ("arctangent", 2, 1),
    ],
)
def test_functions_have_the_bits_of_this_computer(name, arguments, results):
    count = 3000
    given = [random_floats(count, seed) for seed in range(arguments)]
    if name == "power":
        given[1] = np.random.default_rng(7).uniform(-3.0, 3.0, count).astype(np.float32)
    board = Board(math_image())
    places = [board.place(one) for one in given]
    answers = [board.place(np.zeros(count, np.float32)) for _ in range(results)]
    board.call(name, count, *places, *answers)
    for place, expected in zip(answers, firmware_math.called(name, *given, results=results), strict=True):
        found = board.read(place, expected)
        # the sign and the payload of a NaN are the processor's own
        same = (found.view(np.uint32) == expected.view(np.uint32)) | (np.isnan(found) & np.isnan(expected))
        assert same.all(), [one[~same][:3] for one in given]


@pytest.mark.parametrize(
    ("name", "most"), [pytest.param("kalman", 9_000, marks=pytest.mark.slow), ("onboard", 1_000)]
)
def test_estimators_have_the_bits_of_this_computer(name, most):
    rows = list(estimator_runs(name, ALTEN, samples=60, missing=0.05))
    assert all(same for _, same in rows)
    assert max(run.instructions for run, _ in rows) < most
    assert max(run.stack for run, _ in rows) <= image().stack_bound(f"ballbot_{name}_update")


def test_fix_is_taken_in_with_the_bits_of_this_computer():
    assert all(same for _, same in estimator_runs("kalman", ALTEN, samples=30, missing=0.1, fixes=0.3))


@pytest.mark.parametrize("name", ["every part, 3 wheels", "precise, 4 wheels"])
def test_control_law_has_the_bits_of_this_computer(name):
    rows = list(law_runs(controllers()[name](), lanes=10, count=4))
    assert all(same for _, same in rows)
    assert max(run.stack for run, _ in rows) <= image().stack_bound("ballbot_control_law")


def test_filter_is_a_fraction_of_its_direct_translation():
    (direct,) = direct_runs(ALTEN, samples=1)
    typical = [run.cycles for run, _ in estimator_runs("kalman", ALTEN, samples=4)]
    assert max(typical) < 0.25 * direct.cycles


def test_instructions_are_counted_exactly():
    """As the emulator reports them one by one, and with those that a condition skips: they take a cycle too."""
    board = Board(math_image())
    addresses: list[int] = []
    hooked = {"begin": FLASH, "end": FLASH + FLASH_SIZE}
    board._core.hook_add(unicorn.UC_HOOK_CODE, lambda _, address, *__: addresses.append(address), **hooked)
    given, answer = board.place(random_floats(40, 1)), board.place(np.zeros(80, np.float32))
    run = board.call("sine_cosine", 40, given, answer, answer + 160)
    skipped = 0
    for here, after in zip(addresses, [*addresses[1:], 0], strict=True):
        length, cycles = instruction(bytes(board._core.mem_read(here, 4)))
        place = here + length
        while cycles < 4 and place < after:  # no branch: what lies between was skipped
            place, skipped = place + instruction(bytes(board._core.mem_read(place, 4)))[0], skipped + 1
    assert len(addresses) > 1000
    assert run.instructions == len(addresses) + skipped


def test_recursion_and_unknown_functions_are_refused(tmp_path):
    source = tmp_path / "circle.c"
    source.write_text(
        "int even(int n);\nint odd(int n);\n"
        "__attribute__((noinline)) int even(int n) { return n == 0 ? 1 : odd(n - 1) + 2; }\n"
        "__attribute__((noinline)) int odd(int n) { return n == 0 ? 0 : even(n - 1) + 3; }\n"
    )
    circle = compile_image([source])
    with pytest.raises(InputError, match="no bound of its stack"):
        circle.stack_bound("even")
    with pytest.raises(InputError, match="no function 'none'"):
        Board(circle).call("none")
    source.write_text("int wrong(void) { return missing(); }\n")
    with pytest.raises(InputError, match="compiler refuses"):
        compile_image([source])
    with pytest.raises(InputError, match="no 32-bit ELF"):
        read_elf(b"nothing" * 10)


def test_ram_that_is_full_is_refused():
    with pytest.raises(InputError, match="RAM is full"):
        Board(math_image()).place(np.zeros(300_000, np.uint8))
