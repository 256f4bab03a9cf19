"""How long a Cortex-M4F takes: the length and the most cycles of each instruction, and waiting for flash.

Cycles are those of the Cortex-M4 Technical Reference Manual (ARM DDI 0439, section 3.3 "Instruction set summary" and
section 7.2.3 "FPU instruction set"). If it gives a range, the largest is taken:

    arithmetic, multiplication 1           division of integers 12         load or store of one word 2
    n words by LDM, STM, PUSH, POP 1 + n   two words by LDRD, STRD 3       taken branch 1 + 3
    VADD, VMUL, VCMP, VCVT, VMOV 1         VDIV, VSQRT 14                  VMLA, VFMA 3       VLDR, VSTR 2
    n words by VLDM, VSTM 1 + n            VMOV of two registers 2

Every branch counts as taken. An arithmetic instruction of the FPU takes one cycle more if the next instruction
uses its result.

Flash of an STM32F303 gives 64 bits a time, at 72 MHz after two wait states (ST RM0316, section "Embedded Flash
memory"). Its prefetch buffer hides a part of that; here nothing is hidden: both wait states count for each 64 bits of
code that are run through, again at the target of each branch, and for each word of data in flash.

The estimate is therefore an upper one, but for interrupts and for other bus masters such as DMA.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

#: cycles that a read of flash waits at 72 MHz
WAIT_STATES = 2
#: clock of the thesis's processor [Hz]
CLOCK = 72e6

_REFILL = 3  # of the pipeline after a branch, at most
_FLASH_LINE = 8  # bytes
_DIVISION = 12  # SDIV, UDIV at most
_FLOAT_DIVISION = 14  # VDIV, VSQRT
_DEPENDENT = 1  # an FPU instruction waits for the result of the one before


@dataclass(frozen=True)
class Cost:
    """What a run of instructions costs."""

    instructions: int
    cycles: int  #: at most, from memory that does not wait
    waits: int  #: more cycles at most, from flash with two wait states


@cache
def block_cost(code: bytes, address: int) -> Cost:
    """Return the cost of instructions that lie one after the other.

    Parameters
    ----------
    code : bytes
        Thumb-2 instructions.
    address : int
        Of the first.
    """
    place, instructions, cycles = 0, 0, 0
    result: int | None = None  # register of the FPU that the instruction before has just computed
    while place < len(code):
        here = code[place : place + 4]
        length, taken = instruction(here)
        if result in _float_sources(here):
            cycles += _DEPENDENT
        result = _float_result(here)
        place, instructions, cycles = place + length, instructions + 1, cycles + taken
    cycles += _DEPENDENT if result is not None else 0  # the next block may use it
    lines = (address + len(code) - 1) // _FLASH_LINE - address // _FLASH_LINE + 1
    return Cost(instructions, cycles, WAIT_STATES * lines)


def instruction(code: bytes) -> tuple[int, int]:
    """Return the length [bytes] and the most cycles of the instruction at the start of some code.

    Raises
    ------
    ValueError
        If the instruction is not one that compilers generate for a Cortex-M4F.
    """
    first, second = _words(code)
    if first >> 11 < 0b11101:
        return 2, _short(first)
    if first & 0xEC00 == 0xEC00:
        return 4, _float(first, second)
    return 4, _long(first, second)


def branch_target(code: bytes, address: int) -> int | None:
    """Return where a branch with link (BL) at an address goes; None if it is another instruction."""
    first, second = _words(code)
    return (
        _target(first, second, address)
        if first >> 11 == 0b11110 and second >> 14 == 3 and second >> 12 & 1
        else None
    )


def tail_call_target(code: bytes, address: int) -> int | None:
    """Return where an unconditional long branch (B.W) at an address goes; None if it is another instruction."""
    first, second = _words(code)
    return _target(first, second, address) if first >> 11 == 0b11110 and second & 0xD000 == 0x9000 else None


def _target(first: int, second: int, address: int) -> int:
    sign = first >> 10 & 1
    i1, i2 = (1 - ((second >> place & 1) ^ sign) for place in (13, 11))
    offset = i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1
    return address + 4 + offset - (sign << 24)


def _short(code: int) -> int:
    """Return the cycles of a 16-bit instruction."""
    top = code >> 8
    if code >> 11 == 0b11100 or code >> 12 == 0b1101:  # B
        return 1 + _REFILL
    if top == 0b01000111:  # BX, BLX
        return 1 + _REFILL
    if code >> 10 == 0b010001:  # ADD, CMP, MOV with high registers
        return 1 + (_REFILL if code & 0x87 == 0x87 and top != 0b01000101 else 0)
    if code >> 11 == 0b01001 or 0b0101 <= code >> 12 <= 0b1001:  # LDR, STR
        return 2
    if code >> 12 == 0b1100:  # LDM, STM
        return 1 + (code & 0xFF).bit_count()
    if code >> 12 == 0b1011:
        if top & 0b0101 == 0b0001:  # CBZ, CBNZ
            return 1 + _REFILL
        if top & 0b0110 == 0b0100:  # PUSH, POP
            returns = top == 0b10111101
            return 1 + (code & 0x1FF).bit_count() + (_REFILL if returns else 0)
    return 1


def _long(first: int, second: int) -> int:
    """Return the cycles of a 32-bit instruction of the core."""
    kind = first >> 8
    if kind in (0xE8, 0xE9):
        if first & 0x0040 == 0:  # LDM, STM
            loads_pc = first & 0x0010 and second & 0x8000
            return 1 + second.bit_count() + (_REFILL if loads_pc else 0)
        if first & 0xFFF0 == 0xE8D0 and second & 0xFFE0 == 0xF000:  # TBB, TBH
            return 2 + _REFILL
        return 3  # LDRD, STRD
    if kind in (0xF8, 0xF9):  # LDR, STR
        loads_pc = first & 0x0010 and second >> 12 == 0xF
        return 2 + (_REFILL if loads_pc and first & 0x0060 == 0x0040 else 0)
    if kind == 0xFB:
        return _DIVISION if first & 0x00D0 == 0x0090 else 1
    if kind in (0xEA, 0xEB, 0xFA):
        return 1
    if first >> 11 == 0b11110:
        return 1 + _REFILL if second & 0x8000 else 1
    raise ValueError(f"{first:04x} {second:04x} is no instruction of a Cortex-M4")


def _float(first: int, second: int) -> int:
    """Return the cycles of an instruction of the FPU."""
    if second >> 8 & 0xE != 0xA:
        raise ValueError(f"{first:04x} {second:04x} is no instruction of a Cortex-M4's FPU")
    if first & 0xFF00 != 0xEE00:
        if first & 0xFFE0 == 0xEC40:  # VMOV of two registers
            return 2
        words = second & 0xFF
        if first & 0x0120 == 0x0100:  # VLDR, VSTR
            return 3 if second & 0x0100 else 2
        return 1 + words
    if second & 0x0010:  # VMOV, VMRS
        return 1
    operation = first >> 4 & 0b1011
    if operation == 0b1000 or (operation == 0b1011 and first & 0xF == 1 and second & 0x00C0 == 0x00C0):
        return _FLOAT_DIVISION  # VDIV, VSQRT
    if operation in (0b0000, 0b0001, 0b1001, 0b1010):  # VMLA, VNMLA, VFNMA, VFMA
        return 3
    return 1


def _words(code: bytes) -> tuple[int, int]:
    """Return the two halves of a 32-bit instruction; the second means nothing if the first is a 16-bit one."""
    return int.from_bytes(code[:2], "little"), int.from_bytes(code[2:4], "little")


def _is_arithmetic(first: int, second: int) -> bool:
    return first & 0xEF00 == 0xEE00 and second & 0x0F10 == 0x0A00


def _float_result(code: bytes) -> int | None:
    """Return the number of the single-precision register that arithmetic writes; None for another instruction."""
    first, second = _words(code)
    return (second >> 12) << 1 | (first >> 6 & 1) if _is_arithmetic(first, second) else None


def _float_sources(code: bytes) -> set[int]:
    """Return the numbers of the single-precision registers that an instruction may read, a few too many."""
    first, second = _words(code)
    if first & 0xEC00 != 0xEC00 or second & 0x0E00 != 0x0A00:
        return set()
    written_or_stored = (second >> 12) << 1 | (first >> 6 & 1)
    left, right = (first & 0xF) << 1 | (second >> 7 & 1), (second & 0xF) << 1 | (second >> 5 & 1)
    return {written_or_stored, left, right}
