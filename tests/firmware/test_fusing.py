"""No compiler fuses a multiplication and an addition of the library, whatever its options: all give the same bits."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller
from ballbot.firmware.build import compile_sources, compilers, has_zig, source_files
from ballbot.firmware.emulator import compile_image
from ballbot.firmware.estimators import READING
from ballbot.firmware.export import export_controller
from ballbot.firmware.records import STATE
from tests.support.compiled_firmware import library
from tests.support.control_examples import FRICTION, alten, everything

#: how each compiler is asked to fuse: Clang's own default, and GCC's; on a processor that can
FUSING = {"gcc": "-ffp-contract=fast", "clang": "-ffp-contract=on", "zig": "-ffp-contract=on"}
CPU = Path("/proc/cpuinfo")


@pytest.fixture
def alone(tmp_path: Path) -> Path:
    """Return a source without the library's pragma, which is fused."""
    path, head = tmp_path / "alone.c", "float alone(float a, float b, float c)"
    path.write_text(f"{head};\n{head} {{ return a * b - c; }}\n")
    return path


def compiled(compiler: str, sources: list[Path], target: Path) -> ctypes.CDLL:
    flags = ("-std=gnu11", "-O2", "-fPIC", "-shared", "-mfma", "-mavx2", FUSING[compiler])
    compile_sources(target, sources, flags=flags, compiler=compiler)
    return ctypes.CDLL(str(target))


def run(functions: ctypes.CDLL, controller: Controller) -> tuple[np.ndarray, bytes]:
    """Return torques and the last state of filter and law over readings of a robot that sways."""
    parameters, state = export_controller(controller).parameters, np.zeros(1, STATE.dtype("single"))
    reference, torques = np.zeros(10, np.float32), np.zeros((400, 4), np.float32)
    random = np.random.default_rng(6)

    def pointer(array: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    assert functions.ballbot_init(pointer(state), pointer(parameters)) & 1
    functions.ballbot_skip_self_test(pointer(state))
    assert functions.ballbot_arm(pointer(state)) & 1
    for k in range(len(torques)):
        record = np.zeros(1, READING.dtype("single"))
        record["encoders_valid"], record["fix_position"], record["fix_heading"] = 1, np.nan, np.nan
        phases = 0.005 * k * np.array([5.0, 7.0, 3.0])
        record["attitude"], record["gyro"] = 0.05 * np.sin(phases), 0.3 * np.cos(phases)
        record["gyro"] += 0.01 * random.standard_normal(3)
        record["wheel_counts"][0, :3] = np.round(2000.0 * np.sin(phases))
        record["wheel_speeds"][0, :3] = 6.0 * np.cos(phases)
        reference[:2] = 0.2 * np.sin(0.01 * k), 0.1
        args = (pointer(state), pointer(parameters), pointer(record), 5000 * k, pointer(reference))
        functions.ballbot_update(*args, pointer(torques[k]))
    return torques, state.tobytes()


@pytest.mark.skipif(not CPU.exists() or " fma " not in CPU.read_text(), reason="no x86-64 with FMA")
@pytest.mark.parametrize(
    "compiler", ["gcc", *(pytest.param(name, marks=pytest.mark.board) for name in ("clang", "zig"))]
)
def test_library_has_the_same_bits_where_the_compiler_may_fuse(compiler, alone, tmp_path):
    if compiler not in compilers():
        pytest.skip(f"{compiler} is missing")
    function = compiled(compiler, [alone], tmp_path / "alone.so").alone
    function.restype = ctypes.c_float
    factor, product = ctypes.c_float(1.0 + 2.0**-23), ctypes.c_float(1.0 + 2.0**-22)
    assert function(factor, factor, product) == 2.0**-46
    fused = compiled(compiler, source_files(), tmp_path / "library.so")
    controller = everything(alten(FRICTION))
    torques, state = run(fused, controller)
    wanted, wanted_state = run(library().functions, controller)
    assert np.abs(wanted).max() > 0.1
    assert torques.tobytes() == wanted.tobytes()
    assert state == wanted_state


@pytest.mark.board
@pytest.mark.skipif(not has_zig(), reason="no ziglang")
def test_no_instruction_for_a_cortex_m4f_is_fused(alone):
    # on a Cortex-M4 Clang takes fused instructions for slow, and has none by itself
    flags = ("-mcpu=cortex_m4+vfp4d16sp-slowfpvfmx", "-std=gnu11", "-Os", FUSING["zig"])
    image = compile_image([*source_files(), alone], flags=flags)
    fused = {
        name
        for name, addresses in image.functions.items()
        for _, code in image._instructions(addresses)
        if is_fused(*(int.from_bytes(code[k : k + 2], "little") for k in (0, 2)))
    }
    assert fused == {"alone"}


def is_fused(first: int, second: int) -> bool:
    """Return whether two halfwords are VFMA, VFMS, VFNMA or VFNMS of single precision (ARM DDI 0403, A7.7)."""
    return first & 0xFFB0 in (0xEEA0, 0xEE90) and second & 0x0F10 == 0x0A00
