"""The firmware on an emulated Cortex-M4F, from two wheels of pip: `ziglang` compiles, `unicorn` runs.

Code lies in flash, records and stack in RAM, as on an STM32F303. The numbers are those of the processor's FPU to the
bit, and instructions are counted exactly: the emulator reports each block of instructions that it runs, and one that a
condition skips counts, as it takes a cycle. Cycles are `CYCLES` for each instruction.

    image = compile_image(sources)
    board = Board(image)
    record = board.place(numbers)
    run = board.call("ballbot_onboard_update", record, ...)
    run.instructions, run.stack
"""

import itertools
import os
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.firmware.build import NUMERICS, ZIG, run_tool, weights_folder
from ballbot.firmware.header import SOURCES

_Scalar = TypeVar("_Scalar", bound=np.generic)

#: clock of the thesis's processor [Hz]
CLOCK = 72e6
#: of an instruction, at most on the average: by the tables of ARM DDI 0439, with every branch taken and two wait states
#: for each 64 bits of code and each word of constants in flash (ST RM0316), the functions of law, estimators and link
#: took 2.6 to 3.3. Interrupts and other bus masters come on top
CYCLES = 3.3
#: the processor
PROCESSOR = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp")
#: functions begin with a line of flash, so that what one takes does not follow from the length of those before it
_BUILD = ("-O2", "-g0", "-fomit-frame-pointer", "-ffreestanding", "-ffunction-sections", "-fno-unwind-tables",
          "-fstack-size-section", "-falign-functions=8")  # fmt: skip
#: functions that a compiler calls on a processor without a C library, and in which it must recognise none
_RUNTIME, _RUNTIME_BUILD = Path(__file__).parent / "emulator_runtime.c", ("-fno-builtin",)

FLASH, FLASH_SIZE = 0x0800_0000, 256 * 1024
RAM, RAM_SIZE = 0x2000_0000, 256 * 1024  # more than the chip's, for many records at a time
_RETURN = 0x0900_0000  # where a function that was called returns to
_PAINT = 0xA5  # of RAM that was never written
_STACK = 16 * 1024  # [bytes] at the end of RAM

_LINKER_SCRIPT = f"""
SECTIONS {{
  . = {FLASH:#x};
  .text : {{ *(.text*) }}
  .rodata : {{ *(.rodata*) }}
  . = {RAM:#x};
  .data : {{ *(.data*) }}
  .bss : {{ *(.bss*) *(COMMON) }}
  .stack_sizes (INFO) : {{ *(.stack_sizes) }}
  /DISCARD/ : {{ *(.ARM.ex*) *(.comment) }}
}}
"""


@dataclass(frozen=True, kw_only=True)
class Image:
    """Compiled code as it lies in memory."""

    segments: Mapping[int, bytes]  #: address -> bytes
    functions: Mapping[str, range]  #: name, with the address if there are more of it -> addresses
    is_code: Mapping[int, bool]  #: addresses at which instructions or constants begin
    frames: Mapping[int, int]  #: address of a function -> bytes of its stack frame, by the compiler
    flash: int  #: code and constants [bytes]
    ram: int  #: variables [bytes]

    def stack_bound(self, name: str) -> int:
        """Return the most stack [bytes] that a call of a function takes, along its deepest chain of calls.

        InputError if functions call each other in a circle.
        """

        def deepest(function: str, above: tuple[str, ...]) -> int:
            if function in above:
                raise InputError(
                    f"The firmware's {' calls '.join([*above, function])}; there is no bound of its stack."
                )
            below = [deepest(other, (*above, function)) for other in self.calls(function)]
            return self.frames.get(self.functions[function].start, 0) + max(below, default=0)

        return deepest(name, ())

    def calls(self, name: str) -> set[str]:
        """Return the names of the functions that a function calls."""
        names = {addresses.start: function for function, addresses in self.functions.items()}
        addresses = self.functions[name]
        called = set()
        for address, code in self._instructions(addresses):
            target = branch_target(code, address)
            if target is not None and target not in addresses:
                called |= {names[target]} if target in names else set()
        return called

    def _instructions(self, addresses: range) -> Iterator[tuple[int, bytes]]:
        """Return address and code of each instruction of a function, without the constants among them."""
        start, code = next(
            (start, code)
            for start, code in self.segments.items()
            if start <= addresses.start < start + len(code)
        )
        address, is_code = addresses.start, True
        while address < addresses.stop:
            is_code = self.is_code.get(address, is_code)
            instruction = code[address - start : address - start + 4]
            if is_code:
                yield address, instruction
            address += _length(instruction) if is_code else 2


def compile_image(
    sources: Sequence[Path],  # C sources; together they call nothing that they lack
    *,
    include: Sequence[Path] = (SOURCES,),  # folders of headers
    flags: Sequence[str] = (),  # more options of the compiler
    weights: str = "",  # as for `ballbot.firmware.build.shared_library`
) -> Image:
    """Compile and link sources for a Cortex-M4F, by `ziglang`; InputError if the compiler refuses them."""
    with tempfile.TemporaryDirectory(prefix="ballbot-arm-") as name:
        folder = Path(name)
        folders = (*weights_folder(folder, weights), *include)
        command = (*ZIG, "cc", *PROCESSOR, *NUMERICS, *_BUILD, *flags, *(f"-I{path}" for path in folders))

        def compiled(number: int, source: Path) -> Path:
            target = folder / f"{number}.o"
            run_tool(*command, *(_RUNTIME_BUILD if source == _RUNTIME else ()), "-c", source, "-o", target)
            return target

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = list(pool.map(compiled, itertools.count(), [*sources, _RUNTIME]))
        script, target = folder / "memory.ld", folder / "image.elf"
        script.write_text(_LINKER_SCRIPT)
        run_tool(*ZIG, "ld.lld", "-T", script, "--entry=0", *objects, "-o", target)
        return read_elf(target.read_bytes())


#: an ELF32 file: header of a section, symbol; types of sections
_SECTION, _SYMBOL = struct.Struct("<10I"), struct.Struct("<3IBBH")
_NO_BITS, _SYMBOL_TABLE = 8, 2
_ALLOCATED, _WRITTEN = 2, 1
_FUNCTION = 2


def read_elf(content: bytes) -> Image:
    """Return the code, functions and sizes in an ELF32 file of a little-endian ARM."""
    (table,), (width, count, names_at) = (
        struct.unpack_from("<I", content, 32),
        struct.unpack_from("<3H", content, 46),
    )
    rows = [_SECTION.unpack_from(content, table + width * i) for i in range(count)]

    def text(section: int, position: int) -> str:
        start = rows[section][4] + position
        return content[start : content.index(b"\0", start)].decode()

    segments: dict[int, bytes] = {}
    functions: dict[str, range] = {}
    frames: dict[int, int] = {}
    is_code: dict[int, bool] = {}
    flash = ram = 0
    for row in rows:
        label, kind, flags, address, offset, size, link = row[:7]
        data = content[offset : offset + size]
        if flags & _ALLOCATED and size:
            segments[address] = bytes(size) if kind == _NO_BITS else data
            ram += size if flags & _WRITTEN else 0
            flash += 0 if kind == _NO_BITS else size
        elif kind == _SYMBOL_TABLE:
            for name, value, length, info, _, _ in _SYMBOL.iter_unpack(data):
                mark = text(link, name)[:2]  # the linker marks where code and constants begin
                if mark in ("$t", "$d"):
                    is_code[value & ~1] = mark == "$t"
                if info & 0xF == _FUNCTION:
                    key = text(link, name)
                    key = key if key not in functions else f"{key} at {value:#x}"  # static, in another file
                    functions[key] = range(value & ~1, (value & ~1) + length)
        elif text(names_at, label) == ".stack_sizes":
            frames = dict(_stack_sizes(data))
    return Image(segments=segments, functions=functions, is_code=is_code, frames=frames, flash=flash, ram=ram)


def _stack_sizes(content: bytes) -> Iterator[tuple[int, int]]:
    """Return address and stack frame of each function from what LLVM writes with -fstack-size-section."""
    position = 0
    while position < len(content):
        (address,) = struct.unpack_from("<I", content, position)
        position, size, shift = position + 4, 0, 0
        while True:
            byte = content[position]
            position, size, shift = position + 1, size | (byte & 0x7F) << shift, shift + 7
            if byte < 0x80:
                break
        yield address & ~1, size


@dataclass(frozen=True, kw_only=True)
class EmulatedCall:
    """A call of a function."""

    instructions: int  #: executed
    stack: int  #: used [bytes]


def _length(code: bytes) -> int:
    """Return the length [bytes] of the instruction at the start of some code."""
    return 4 if int.from_bytes(code[:2], "little") >> 11 >= 0b11101 else 2


def branch_target(code: bytes, address: int) -> int | None:
    """Return where a long branch at an address goes, a call (BL) or the last one (B.W); None if it is another one."""
    first, second = (int.from_bytes(code[k : k + 2], "little") for k in (0, 2))
    if first >> 11 != 0b11110 or second & 0xD000 not in (0xD000, 0x9000):
        return None
    sign = first >> 10 & 1
    i1, i2 = (1 - ((second >> bit & 1) ^ sign) for bit in (13, 11))
    offset = i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1
    return address + 4 + offset - (sign << 24)


class Board:
    """A Cortex-M4F with an image in its flash, and RAM, by `unicorn`."""

    def __init__(self, image: Image) -> None:
        import unicorn  # pyright: ignore[reportMissingImports]
        from unicorn import arm_const as arm  # pyright: ignore[reportMissingImports]

        self.image = image
        self._arm = arm
        self._core = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)  # pyright: ignore[reportPrivateImportUsage]
        self._core.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        self._core.mem_map(FLASH, FLASH_SIZE, unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        self._core.mem_map(RAM, RAM_SIZE, unicorn.UC_PROT_READ | unicorn.UC_PROT_WRITE)
        self._core.mem_map(_RETURN, 4096)
        for address, content in image.segments.items():
            self._core.mem_write(address, content)
        self._free = RAM + (image.ram + 7) // 8 * 8
        self._instructions = 0
        self._blocks: dict[tuple[int, int], int] = {}  # instructions in each block
        self._core.hook_add(unicorn.UC_HOOK_BLOCK, self._on_block, begin=FLASH, end=FLASH + FLASH_SIZE)

    def place(self, array: NDArray[np.generic]) -> int:
        """Copy an array or a record into RAM and return its address; InputError if RAM is full."""
        content = np.ascontiguousarray(array).tobytes()
        address = self._free
        self._free += (len(content) + 7) // 8 * 8
        if self._free > RAM + RAM_SIZE - _STACK:
            raise InputError("The emulated board's RAM is full.")
        self._core.mem_write(address, content)
        return address

    def write(self, address: int, array: NDArray[np.generic]) -> None:
        """Overwrite what lies at an address."""
        self._core.mem_write(address, np.ascontiguousarray(array).tobytes())

    def read(self, address: int, like: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return what lies at an address, as an array of the type and shape of another."""
        content = bytes(self._core.mem_read(address, like.nbytes))
        return np.frombuffer(content, like.dtype).reshape(like.shape).copy()

    def call(self, name: str, *arguments: int) -> EmulatedCall:
        """Call a function with addresses or whole numbers, and count."""
        arm, core = self._arm, self._core
        top = RAM + RAM_SIZE
        core.mem_write(top - _STACK, bytes([_PAINT]) * _STACK)
        more = b"".join((argument & 0xFFFFFFFF).to_bytes(4, "little") for argument in arguments[4:])
        pointer = top - (len(more) + 7) // 8 * 8
        core.mem_write(pointer, more)
        registers = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3)
        for register, value in zip(registers, arguments, strict=False):
            core.reg_write(register, value & 0xFFFFFFFF)
        core.reg_write(arm.UC_ARM_REG_SP, pointer)
        core.reg_write(arm.UC_ARM_REG_LR, _RETURN | 1)
        self._instructions = 0
        core.emu_start(self.image.functions[name].start | 1, _RETURN)
        stack = bytes(core.mem_read(top - _STACK, pointer - (top - _STACK)))
        return EmulatedCall(
            instructions=self._instructions,
            stack=len(stack.lstrip(bytes([_PAINT]))),
        )

    @property
    def executed(self) -> set[int]:
        """Addresses of all instructions that calls have gone through so far."""
        return {address for start, size in self._blocks for address in range(start, start + size, 2)}

    def _on_block(self, core, address: int, size: int, _) -> None:
        known = self._blocks.get((address, size))
        if known is None:
            code, position, known = bytes(core.mem_read(address, size)), 0, 0
            while position < size:
                position, known = position + _length(code[position:]), known + 1
            self._blocks[address, size] = known
        self._instructions += known
