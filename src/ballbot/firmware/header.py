"""The generated headers of the firmware: the structs of every record, and the numbers of one controller.

    c/ballbot_types.h       a struct for each schema: same names, order, units and array lengths; the same for every
                            controller, so it is kept beside the C sources that are written for it, as is
                            c/estimation/kalman_model.h (`ballbot.firmware.kalman_code`)
    ballbot_parameters.h    the numbers of a controller in single precision, written by `ballbot export`
    ballbot_policy_weights.h    the weights of its policy, a table in flash; beside the C sources is one without weights

A member is 4 bytes wide, `float` or `int32_t`. A struct therefore has no padding, and the bytes of a NumPy record of
`Schema.dtype("single")` are those of the struct. The header states each struct's size in a declaration that
compiles only if it is right, and so are the offsets then.

Structs and numbers hold the digest of all schemas. `ballbot_init` refuses parameters with another one.

If a record changes, the C code that reads it must change too. Then write the headers anew:

    python -m ballbot.firmware.header
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.friction_table import SPEEDS
from ballbot.control.parts.part import MAX_PAST
from ballbot.control.parts.policy import Policy, checksum
from ballbot.control.records import MAX_WHEELS, Number, Schema
from ballbot.control.tuning import MAX_GAINS
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.firmware.bounds import BOUNDS, FIRST_BOUND, Refusal, bounds_in_c
from ballbot.firmware.estimators import READING
from ballbot.firmware.kalman_code import KALMAN_HEADER, kalman_header
from ballbot.firmware.records import DIGEST_WORDS, FIRMWARE, PARAMETERS, digest_words

#: the C sources
SOURCES = Path(__file__).parent / "c"
TYPES_HEADER = "ballbot_types.h"
PARAMETERS_HEADER = "ballbot_parameters.h"
WEIGHTS_HEADER = "ballbot_policy_weights.h"
#: units of a policy's hidden layers for which firmware has stack
MAX_HIDDEN = 64
#: stands for a value that a sensor did not give: beyond any sensor's, without the NaN that fast math breaks
MISSING = 1e30
#: of a member
_BYTES = 4
#: lengths that have a name in C
_NAMED_LENGTHS = {
    MAX_WHEELS: "BALLBOT_MAX_WHEELS",
    MAX_PAST: "BALLBOT_MAX_PAST",
    SPEEDS: "BALLBOT_TABLE_SPEEDS",
}


def struct_name(schema: Schema) -> str:
    """Return the name of a schema's struct, as "ballbot_notch_record" of NotchRecord."""
    return "ballbot_" + re.sub(r"(?<=[a-z])(?=[A-Z])", "_", schema.name).lower()


def types_header() -> str:
    """Return the text of ballbot_types.h."""
    structs = "\n".join(struct_text(schema) for schema in _schemas(FIRMWARE))
    words = ", ".join(map(str, digest_words(FIRMWARE.digest)))
    missing = READING.zeros().astype(READING.dtype("single"))
    for name, field in READING.fields.items():
        missing[name] = 0 if isinstance(field, Schema) or field.whole else MISSING
    no_reading = "".join(_members(missing[0], READING, indent=1)).replace("\n", " \\\n")
    refusals = "\n".join(f"    BALLBOT_REFUSED_{one.name} = {one.value}," for one in Refusal)
    bounds = ", \\\n".join(f"        ({condition})" for condition in bounds_in_c(PARAMETERS))
    return f"""\
/* The records of Ballbot as structs: parameters, state and sensor readings.
 *
 * Generated from the schemas of the Python package by `python -m ballbot.firmware.header`; do not edit.
 * Units are SI and stand behind each member; [1] is a number without a unit. Matrices are stored by rows.
 * State vectors are x, y, theta, phi, psi and their rates.
 */
#ifndef BALLBOT_TYPES_H
#define BALLBOT_TYPES_H

#include <stdint.h>

/* Wheels that a record has room for. */
#define BALLBOT_MAX_WHEELS {MAX_WHEELS}
/* Updates whose torques the law remembers. */
#define BALLBOT_MAX_PAST {MAX_PAST}
/* Gains that can be mixed. */
#define BALLBOT_MAX_GAINS {MAX_GAINS}
/* Speeds of the table of a friction law. */
#define BALLBOT_TABLE_SPEEDS {SPEEDS}
/* SHA-256 of names, order, types, lengths and units of everything below. */
#define BALLBOT_SCHEMA_DIGEST "{FIRMWARE.digest}"
/* The same as {DIGEST_WORDS} numbers of 31 bits, as the parameters hold it. */
#define BALLBOT_SCHEMA_WORDS {{ {words} }}

/* Every number below has the same width. */
typedef char ballbot_numbers_are_alike[(sizeof(float) == sizeof(int32_t)) ? 1 : -1];

{structs}
/* A reading without any value. Whatever lies beyond a sensor's range is missing. */
#define BALLBOT_MISSING {MISSING:g}f
#define BALLBOT_NO_READING \\
    {{ \\
{no_reading}    }}

/* Why parameters are refused; from BALLBOT_REFUSED_BOUND on it is the row of the bounds below. */
enum ballbot_refusal {{
    BALLBOT_REFUSED_NOT = 0,
{refusals}
    BALLBOT_REFUSED_BOUND = {FIRST_BOUND}
}};

/* Whether parameters keep each of their bounds (ballbot/firmware/bounds.py). */
#define BALLBOT_BOUNDS {len(BOUNDS)}
#define BALLBOT_BOUNDS_KEPT(parameters) \\
    {{ \\
{bounds} \\
    }}

#endif
"""


def parameters_header(
    record: NDArray[np.void],  # (1,) The numbers in single precision
    schema: Schema,  # of the record
    *,
    comment: str,  # lines that name the robot and the controller
) -> str:
    """Return the text of ballbot_parameters.h."""
    described = "".join(f" * {line}".rstrip() + "\n" for line in comment.splitlines())
    return f"""\
/* The numbers of one controller, in single precision.
 *
 * Generated by `ballbot export`; do not edit. Include it in one source file of the application.
 *
{described} */
#ifndef BALLBOT_PARAMETERS_H
#define BALLBOT_PARAMETERS_H

#include "{TYPES_HEADER}"

static const struct {struct_name(schema)} ballbot_parameters = {{
{"".join(_members(record[0], schema, indent=1))}}};

#endif
"""


def weights_header(policy: Policy | None) -> str:
    """Return the text of ballbot_policy_weights.h.

    InputError if the policy has more hidden units than firmware has room for.
    """
    layers = [policy.first, policy.second, policy.last] if policy else []
    hidden, wheels = (len(policy.first), len(policy.last)) if policy else (0, 0)
    if hidden > MAX_HIDDEN:
        raise InputError(
            f"The policy has {hidden} units in a hidden layer; firmware can have up to {MAX_HIDDEN}."
        )
    rows = [
        ", ".join(f"{weight!s}f" for weight in row.astype(np.float32)) for layer in layers for row in layer
    ]
    table = "".join(f"    {row},\n" for row in rows)
    if policy:
        table = f"static const float ballbot_policy_weights[BALLBOT_POLICY_SIZE] = {{\n{table}}};\n\n"
    return f"""\
/* The weights of a learned policy, in single precision; without a policy there are none.
 *
 * Written by `ballbot export`; do not edit. A line is a unit of the first hidden layer, the second, or the output of a
 * wheel: its weights, then its bias.
 */
#ifndef BALLBOT_POLICY_WEIGHTS_H
#define BALLBOT_POLICY_WEIGHTS_H

/* Units of each hidden layer. */
#define BALLBOT_POLICY_HIDDEN {hidden}
/* Wheels of the robot. */
#define BALLBOT_POLICY_WHEELS {wheels}
/* Weights and biases. */
#define BALLBOT_POLICY_SIZE {policy.weights.size if policy else 0}
/* What parameters must hold that belong to these weights. */
#define BALLBOT_POLICY_CHECKSUM {checksum(policy.weights) if policy else 0}

{table}#endif
"""


def _schemas(schema: Schema) -> Iterator[Schema]:
    """Return the schemas within a schema, each once and before those that contain it."""
    schemas: dict[str, Schema] = {}

    def walk(outer: Schema) -> None:
        for inner in outer.fields.values():
            if isinstance(inner, Schema):
                walk(inner)
                assert schemas.setdefault(inner.name, inner).lines() == inner.lines(), inner.name

    walk(schema)
    return iter(schemas.values())


def struct_text(schema: Schema) -> str:
    """Return a struct with a check of its size."""
    name = struct_name(schema)
    comment = f"/* {schema.text} */\n" if schema.text else ""
    members = "".join(_member(key, field) for key, field in schema.fields.items())
    count = schema.dtype("single").itemsize // _BYTES
    return (
        f"{comment}struct {name} {{\n{members}}};\n"
        f"typedef char {name}_has_no_padding[(sizeof(struct {name}) == {count}u * sizeof(float)) ? 1 : -1];\n"
    )


def _member(name: str, field: Number | Schema) -> str:
    if isinstance(field, Schema):
        return f"    struct {struct_name(field)} {name};\n"
    lengths = "".join(f"[{length}]" for length in _lengths(field.shape))
    unit = "" if field.whole else f" /* [{field.unit}] */"
    return f"    {'int32_t' if field.whole else 'float'} {name}{lengths};{unit}\n"


def _lengths(shape: tuple[int, ...]) -> list[str]:
    """Return an array's lengths, the first ones by name: updates, then wheels."""
    lengths = [str(size) for size in shape]
    for axis, size in enumerate(shape):
        if size not in _NAMED_LENGTHS:
            break
        lengths[axis] = _NAMED_LENGTHS[size]
    return lengths


def _members(record: np.void, schema: Schema, *, indent: int) -> Iterator[str]:
    """Return the lines of a record's initializer."""
    space = "    " * indent
    for name, field in schema.fields.items():
        if isinstance(field, Number):
            unit = "" if field.whole else f" /* [{field.unit}] */"
            yield f"{space}.{name} = {_value(record[name], field, indent)},{unit}\n"
        elif not any(record[name].tobytes()):  # a part that the controller lacks
            yield f"{space}.{name} = {{ .{next(iter(field.fields))} = 0 }},\n"
        else:
            yield f"{space}.{name} = {{\n"
            yield from _members(record[name], field, indent=indent + 1)
            yield f"{space}}},\n"


def _value(value: NDArray[np.generic] | np.generic, field: Number, indent: int) -> str:
    """Return a number or an array as an initializer."""
    if not field.shape:
        return _literal(value, field)
    rows = np.asarray(value)
    if rows.ndim == 1:
        return f"{{ {', '.join(_literal(number, field) for number in rows)} }}"
    space = "    " * (indent + 1)
    inner = Number(unit=field.unit, shape=field.shape[1:], whole=field.whole)
    lines = "".join(f"{space}{_value(row, inner, indent + 1)},\n" for row in rows)
    return f"{{\n{lines}{'    ' * indent}}}"


def _literal(value: object, field: Number) -> str:
    """Return a number as a literal of its own type: the shortest that is read back as the same float."""
    return str(int(value)) if field.whole else f"{np.float32(value)!s}f"  # type: ignore[arg-type]


if __name__ == "__main__":
    write_text(SOURCES / TYPES_HEADER, types_header())
    write_text(SOURCES / WEIGHTS_HEADER, weights_header(None))
    write_text(SOURCES / KALMAN_HEADER, kalman_header())
