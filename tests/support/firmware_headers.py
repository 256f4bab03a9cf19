"""The C that is written from Python: the structs of every record, the law, and the Kalman filter's equations.

    c/ballbot_types.h            a struct for each schema: same names, order, units and array lengths
    c/estimation/kalman_model.h  see `tests.support.kalman_header`
    c/decide.c, c/parts/*        the control law and its parts but the policy, and c/estimation/{heading,swing}.*:
                                 see `tests.support.firmware_law`
    c/ballbot_policy_weights.h   the header of a controller without a policy

A member is 4 bytes wide, `float` or `int32_t`. A struct therefore has no padding, and the bytes of a NumPy record of
`Schema.dtype("single")` are those of the struct. The header states each struct's size in a declaration that
compiles only if it is right, and so are the offsets then.

Structs and numbers hold the digest of all schemas. `ballbot_init` refuses parameters with another one.

If a record changes, the C by hand that reads it must change too. Then write these files anew:

    python -m tests.support.firmware_headers
"""

from collections.abc import Iterator

import numpy as np

from ballbot.control.friction_table import SPEEDS
from ballbot.control.parts.part import MAX_PAST
from ballbot.control.tuning import MAX_GAINS
from ballbot.files import write_text
from ballbot.firmware.bounds import BOUNDS, FIRST_BOUND, Refusal
from ballbot.firmware.estimators import READING
from ballbot.firmware.header import (
    SOURCES,
    TYPES_HEADER,
    WEIGHTS_HEADER,
    initializer,
    struct_name,
    weights_header,
)
from ballbot.firmware.records import DIGEST_WORDS, FIRMWARE, PARAMETERS, digest_words
from ballbot.records import MAX_WHEELS, Number, Schema
from tests.support.firmware_law import law_files
from tests.support.kalman_header import KALMAN_HEADER, kalman_header
from tests.support.python_to_c import lengths

#: stands for a value that a sensor did not give: beyond any sensor's, without the NaN that fast math breaks
MISSING = 1e30
#: of a member
_BYTES = 4


def types_header() -> str:
    """Return the text of ballbot_types.h."""
    structs = "\n".join(struct_text(schema) for schema in _schemas(FIRMWARE))
    words = ", ".join(map(str, digest_words(FIRMWARE.digest)))
    missing = READING.zeros().astype(READING.dtype("single"))
    for name, field in READING.fields.items():
        missing[name] = 0 if isinstance(field, Schema) or field.whole else MISSING
    no_reading = "".join(initializer(missing[0], READING, indent=1)).replace("\n", " \\\n")
    refusals = "\n".join(f"    BALLBOT_REFUSED_{one.name} = {one.value}," for one in Refusal)
    bounds = ", \\\n".join(f"        ({condition})" for condition in _bounds_in_c(PARAMETERS))
    return f"""\
/* The records of Ballbot as structs: parameters, state and sensor readings.
 *
 * Generated from the schemas of the Python package by `python -m tests.support.firmware_headers`; do not edit.
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
/* Numbers of a setting, and the place of the one after the weights of the other gains. */
#define BALLBOT_TUNING_NUMBERS BALLBOT_MAX_GAINS
#define BALLBOT_TUNING_COMPENSATION (BALLBOT_MAX_GAINS - 1)
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
    sizes = "".join(f"[{length}]" for length in lengths(field.shape))
    unit = "" if field.whole else f" /* [{field.unit}] */"
    return f"    {'int32_t' if field.whole else 'float'} {name}{sizes};{unit}\n"


def member(schema: Schema, field: str) -> Number:
    """Return a parameter of a schema by its dotted name."""
    first, _, rest = field.partition(".")
    found = schema.fields[first]
    return member(found, rest) if isinstance(found, Schema) else found


def _bounds_in_c(schema: Schema) -> Iterator[str]:
    """Yield each row of the table as a condition in C on `parameters`, which points to a struct of the schema."""
    for bound in BOUNDS:
        is_whole = member(schema, bound.field).whole

        def term(side: float | str, *, is_whole: bool = is_whole) -> str:
            if isinstance(side, str):
                return f"(parameters)->{side}"
            return str(int(side)) if is_whole else f"{np.float32(side)!s}f"

        condition = f"{term(bound.field)} >= {term(bound.least)}"
        yield condition + (f" && {term(bound.field)} <= {term(bound.most)}" if bound.most is not None else "")


if __name__ == "__main__":
    write_text(SOURCES / TYPES_HEADER, types_header())
    write_text(SOURCES / WEIGHTS_HEADER, weights_header(None))
    write_text(SOURCES / KALMAN_HEADER, kalman_header())
    for file, text in law_files().items():
        write_text(SOURCES / file, text)
