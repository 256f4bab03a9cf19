"""The generated headers: structs as NumPy has the records, numbers that a compiler reads back bit for bit."""

import re
import subprocess
from collections.abc import Iterator

import numpy as np
import pytest

from ballbot.control.safety import SafetyLimits
from ballbot.errors import InputError
from ballbot.firmware.build import compile_sources, compilers
from ballbot.firmware.header import (
    PARAMETERS_HEADER,
    SOURCES,
    TYPES_HEADER,
    parameters_header,
    struct_name,
)
from ballbot.firmware.records import FIRMWARE, PARAMETERS, parameter_record
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import Schema
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled
from tests.support.firmware_headers import types_header
from tests.support.firmware_law import law_files
from tests.support.kalman_header import KALMAN_HEADER, kalman_header
from tests.support.python_to_c import REAL, Program

LIMITS = SafetyLimits.on_robot(alten(), sample_time=0.005, torque_limit=1.0)

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")


def test_generated_sources_are_those_of_the_records_the_model_and_the_law():
    generated = {TYPES_HEADER: types_header(), KALMAN_HEADER: kalman_header(), **law_files()}
    for name, text in generated.items():
        assert (SOURCES / name).read_text() == text, f"{name}: run python -m tests.support.firmware_headers"


def offsets(schema: Schema, dtype: np.dtype, above: str = "", first: int = 0) -> Iterator[tuple[str, int]]:
    """Return each member's path and its place in bytes."""
    for (name, one), (inner, place, *_) in zip(
        schema.fields.items(), (dtype.fields or {}).values(), strict=True
    ):
        yield f"{above}{name}", first + place
        if isinstance(one, Schema):
            yield from offsets(one, inner, f"{above}{name}.", first + place)


@needs_compiler
def test_compiler_lays_structs_out_as_numpy_lays_records_out(tmp_path):
    lines = ["#include <stddef.h>", f'#include "{TYPES_HEADER}"']
    for schema in FIRMWARE.fields.values():
        assert isinstance(schema, Schema)
        dtype, name = schema.dtype("single"), f"struct {struct_name(schema)}"
        lines.append(f"typedef char {schema.name}_size[(sizeof({name}) == {dtype.itemsize}u) ? 1 : -1];")
        for number, (path, place) in enumerate(offsets(schema, dtype)):
            lines.append(
                f"typedef char {schema.name}_{number}[(offsetof({name}, {path}) == {place}u) ? 1 : -1];"
            )
    assert len(lines) > 100
    (tmp_path / "layout.c").write_text("\n".join([*lines, "extern int here;", ""]))
    compile_sources(tmp_path / "layout.o", [tmp_path / "layout.c"], flags=("-c",))


@needs_compiler
@pytest.mark.parametrize("robot", [alten(FRICTION), four_wheeled(friction=True)], ids=["3", "4"])
def test_compiler_reads_the_numbers_back_bit_for_bit(robot, tmp_path):
    record = parameter_record(everything(robot), LIMITS)
    (tmp_path / PARAMETERS_HEADER).write_text(parameters_header(record, PARAMETERS, comment="A test."))
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "ballbot_parameters.h"\n'
        "int main(void) { return fwrite(&ballbot_parameters, sizeof ballbot_parameters, 1, stdout) != 1; }\n"
    )
    compile_sources(tmp_path / "main", [tmp_path / "main.c"], flags=())
    assert subprocess.run([tmp_path / "main"], capture_output=True, check=True).stdout == record.tobytes()


@inlined
def two_values(torque):
    first, second = divmod(torque, 2.0)
    return first + second


@inlined
def changing_type(torque):
    kept = 0
    if torque > 0.0:
        kept = torque
    return kept


@inlined
def longer_loop(torque):
    for i in range(0, 4, 2):
        torque += i
    return torque


@pytest.mark.parametrize(
    ("function", "construct"),
    [
        (two_values, "first, second = divmod(torque, 2.0)"),
        (changing_type, "kept"),
        (longer_loop, "range(0, 4, 2)"),
    ],
)
def test_what_c_cannot_express_is_refused_with_its_line(function, construct):
    with pytest.raises(InputError) as refusal:
        Program(externals={}, names={}).add(function, [REAL])
    assert re.match(rf"{re.escape(__file__)}:\d+: {re.escape(repr(construct))} has no", str(refusal.value))
