"""The Kalman filter's equations as C: `ballbot.estimation.kalman_model` called with a builder that writes C.

Its functions are traced as for compiled code (`ballbot.mechanics.engine.tracing`), where each operation calls a method
of LLVM's builder. Here it becomes an expression of C in single precision, with the operations in the same order. What
is used once is written where it is used, what is used more than once gets a name. So the firmware has every state,
sensor and noise of Python's filter, and the update of its covariance; `c/estimation/kalman.c` calls them in order.

If the model changes, write the header anew:

    python -m tests.support.firmware_headers
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import TypeAlias

import numpy as np
from llvmlite import ir

from ballbot.estimation.kalman_model import (
    DIRECT,
    DRIVEN,
    ENTRIES,
    ENTRY_OF,
    FIRST,
    MODEL_SHAPE,
    NUMBERS,
    PIVOTING_SEEN,
    PSI,
    SENSORS,
    SHOWN_TOGETHER,
    STATE_NAMES,
    STATES,
    Numbers,
    carried,
    corrected,
    faded,
    moved,
    projected,
    propagated,
    transition,
)
from ballbot.mechanics.engine.tracing import REAL, TracedNumber, called, written_by

KALMAN_HEADER = "estimation/kalman_model.h"
_INTRINSICS = {"llvm.sqrt": "ballbot_square_root({})"}
_SINE_COSINE = "ballbot_sine_cosine({}, &turn[0], &turn[1])"
_COLUMNS = 118

_Operand: TypeAlias = "_Expression | ir.Constant"
#: numbers of C by what they are assigned to
Results: TypeAlias = "dict[str, TracedNumber | float]"


@dataclass(eq=False)
class _Expression:
    """A number of the code that is written: a name or a literal, or an operation on others."""

    form: str  #: text with a place for each operand
    operands: tuple[_Expression, ...] = ()
    type: ir.Type = field(default=REAL)
    uses: int = 0
    name: str = ""  #: of an operation that is used more than once

    @property
    def text(self) -> str:
        return self.name or self.form.format(*(operand.text for operand in self.operands))


def _binary(sign: str) -> Callable[..., _Expression]:
    def operation(self: _Writer, left: _Operand, right: _Operand, flags: Sequence[str] = ()) -> _Expression:  # noqa: ARG001
        return self.operation(f"({{}} {sign} {{}})", left, right)

    return operation


class _Writer:
    """Has those methods of LLVM's builder that the filter's equations call; equal operations are written once."""

    def __init__(self) -> None:
        self.module = self
        self._made: dict[tuple, _Expression] = {}

    def operation(self, form: str, *numbers: _Operand) -> _Expression:
        operands = tuple(
            self.operation(_literal(number.constant)) if isinstance(number, ir.Constant) else number  # pyright: ignore[reportAttributeAccessIssue]
            for number in numbers
        )
        made = self._made.setdefault((form, *map(id, operands)), _Expression(form, operands))
        if made.operands is operands:
            for operand in operands:
                operand.uses += 1
        return made

    fadd, fsub, fdiv, or_, _product = (_binary(sign) for sign in ("+", "-", "/", "||", "*"))

    def fmul(self, left: _Operand, right: _Operand, flags: Sequence[str] = ()) -> _Operand:
        for factor, rest in ((left, right), (right, left)):
            if isinstance(factor, ir.Constant) and factor.constant == 1.0:  # pyright: ignore[reportAttributeAccessIssue]
                return rest
        return self._product(left, right, flags)

    def fneg(self, number: _Operand, flags: Sequence[str] = ()) -> _Expression:  # noqa: ARG002
        return self.operation("(-{})", number)

    def fcmp_ordered(self, sign: str, left: _Operand, right: _Operand) -> _Expression:
        return self.operation(f"({{}} {sign} {{}})", left, right)

    def select(self, condition: _Expression, left: _Operand, right: _Operand) -> _Expression:
        return self.operation("({} ? {} : {})", condition, left, right)

    def declare_intrinsic(self, name: str, _: Sequence[ir.Type]) -> str:
        return _INTRINSICS.get(name, name)

    def call(self, function: str, arguments: Sequence[_Operand]) -> _Expression:
        return self.operation(function, *arguments)

    def statements(self, results: Results) -> Iterator[str]:
        """Yield the statements that give the results."""
        values = {
            target: self.operation(
                "{}", number.value if isinstance(number, TracedNumber) else ir.Constant(REAL, number)
            )
            for target, number in results.items()
        }
        names = (f"t{number}" for number in count())
        for operation in self._made.values():
            if operation.form == _SINE_COSINE:
                text, operation.name = operation.text, "turn"
                yield from ("float turn[2];", f"{text};")
            elif operation.operands and operation.uses > 1:
                text, operation.name = operation.text, next(names)
                yield f"const float {operation.name} = {_bare(text)};"
        for target, value in values.items():
            if _bare(value.text) != target:
                yield f"{target} = {_bare(value.text)};"


def _literal(number: float) -> str:
    return f"{np.float32(number)!s}f"


def _bare(text: str) -> str:
    """Return an expression without the brackets around the whole."""
    depth = 0
    for index, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and index < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") else text


def _lines(make: Callable[[], Results], *, indent: int = 1) -> list[str]:
    """Return the lines of the statements that give what a function makes of stand-ins."""
    writer = _Writer()
    with written_by(writer):  # pyright: ignore[reportArgumentType] (it has the methods that are called)
        results = make()
    first, more = "    " * indent, "    " * (indent + 1)
    wrapped = (
        textwrap.wrap(text, _COLUMNS, initial_indent=first, subsequent_indent=more, break_long_words=False)
        for text in writer.statements(results)
    )
    return [line for lines in wrapped for line in lines]


def _function(comment: str, head: str, body: Iterable[str]) -> str:
    lines = list(body)
    names = re.findall(r"(\w+)(?:\[\w+\])*(?:, |\))", head)
    lines += [f"    (void){name};" for name in names if not re.search(rf"\b{name}\b", "\n".join(lines))]
    opening = textwrap.wrap(f"static inline void {head}", _COLUMNS, subsequent_indent=" " * 8)
    return "\n".join([*textwrap.wrap(f"/* {comment} */", _COLUMNS), *opening, "{", *lines, "}", ""])


def _named(text: str) -> TracedNumber:
    """Return what stands for a number of C."""
    return TracedNumber(_Expression(text))


def _array(text: str, *shape: int) -> tuple:
    """Return what stands for the numbers of an array of C, as tuples."""
    inner = shape[1:]
    return tuple(_array(f"{text}[{i}]", *inner) if inner else _named(f"{text}[{i}]") for i in range(shape[0]))


def _numbered(target: str, numbers: Iterable[TracedNumber | float], first: int = 0) -> Results:
    return {f"{target}[{i}]": number for i, number in enumerate(numbers, first)}


def _vector(name: str) -> tuple[TracedNumber, ...]:
    """Return what stands for an array of C with a number for each state."""
    return tuple(_named(f"{name}[{state}]") for state in STATE_NAMES)


_MODEL = Numbers._make(
    _array(f"record->{name}", *np.shape(like)) if isinstance(like, tuple) else _named(f"record->{name}")
    for name, like in MODEL_SHAPE._asdict().items()
)
_X, _GYRO, _VELOCITY, _F = _vector("x"), _array("gyro", 3), _array("velocity", 2), _array("f", len(ENTRIES))
_GIVEN = "const struct ballbot_kalman_record *record, const float x[STATES], const float gyro[3]"


def _entry(i: int, j: int) -> TracedNumber:
    """Return what stands for an entry of P, i >= j; C has what lies above the diagonal."""
    return _named(f"P[{STATE_NAMES[j]}][{STATE_NAMES[i]}]")


def _triangle(numbers: Iterable[TracedNumber | float]) -> Results:
    """Return the entries of P by a lower triangle's, row by row."""
    names = (f"P[{STATE_NAMES[j]}][{STATE_NAMES[i]}]" for i in range(STATES) for j in range(i + 1))
    return dict(zip(names, numbers, strict=True))


def _states(target: str, numbers: Iterable[TracedNumber | float]) -> Results:
    return {f"{target}[{name}]": number for name, number in zip(STATE_NAMES, numbers, strict=True)}


def _turn_of(angle: TracedNumber) -> tuple[TracedNumber, ...]:
    """Return what stands for an angle's sine and cosine, which a function of C fills."""
    filled = called(_SINE_COSINE, angle).value
    return tuple(TracedNumber(_Expression(f"{{}}[{place}]", (filled,))) for place in (0, 1))


def _moved() -> Results:
    change, velocity = moved(_MODEL, _X, _GYRO, _turn_of)
    return _states("change", change) | _numbered("velocity", velocity)


def _linearized() -> Results:
    return _numbered("f", transition(_MODEL, _X, _GYRO, _turn_of(_X[PSI])))


def _carried() -> Results:
    column = _vector("column")
    return {f"product[{STATE_NAMES[i]}]": carried(i, _F, column) for i in range(DRIVEN, STATES)}


def _faded() -> Results:
    above = _triangle(faded(_entry, _named("forgotten")))
    below = {f"P[{STATE_NAMES[i]}][{STATE_NAMES[j]}]": _entry(i, j) for i in range(STATES) for j in range(i)}
    return above | below


def _propagated() -> Results:
    # what nothing drives F leaves as it is
    FP = [
        [*(_entry(max(i, j), min(i, j)) for i in range(DRIVEN)), *_vector(f"FP[{state}]")[DRIVEN:]]
        for j, state in enumerate(STATE_NAMES)
    ]
    return _triangle(propagated(FP, _F, _named("record->gyro_variance"), _array("record->walk", STATES)))


def _corrected() -> Results:
    P, change = corrected(_entry, _vector("change"), _vector("q"), _named("residual"), _named("inverse"))
    return _triangle(P) | _states("change", change)


def _shown() -> tuple[Results, list[TracedNumber | float]]:
    """Return the residuals, and the entries of H in their order."""
    residuals: Results = {}
    entries: list[TracedNumber | float] = []
    for sensor in SENSORS:
        source = f"reading->{sensor.name}" if sensor in DIRECT else sensor.name
        numbers, h = sensor.seen(_MODEL, _X, _array(source, len(sensor.states)), _GYRO, _VELOCITY)
        residuals |= _numbered("residual", numbers, FIRST[sensor.name])
        entries += h
    return residuals, entries


def _expected() -> Results:
    residuals, entries = _shown()
    return residuals | _numbered("h", (entry for entry in entries if isinstance(entry, TracedNumber)))


def _projected(number: int, h: Sequence[TracedNumber | float]) -> Results:
    mine = h[ENTRY_OF[number] : ENTRY_OF[number + 1]]
    q, spread, known = projected(number, mine, _entry, _vector("change"))
    return _states("q", q) | {"*spread": spread, "*known": known}


def _cases(h: Sequence[TracedNumber | float]) -> Iterator[str]:
    """Yield a case for each seen number; the last one is the default, so that the compiler sees a result for all."""
    yield "    switch (number) {"
    for number in range(NUMBERS):
        yield f"    case {number}: {{" if number < NUMBERS - 1 else "    default: {"
        yield from _lines(lambda number=number: _projected(number, h), indent=2)
        yield from ("        break;", "    }")
    yield "    }"


def _functions(h: Sequence[TracedNumber | float]) -> Iterator[str]:
    yield _function(
        "Give what a sample adds to the state, and the mean of v (2) [m/s] over it.",
        f"moved({_GIVEN}, float change[STATES], float velocity[2])",
        _lines(_moved),
    )
    yield _function(
        "Give the entries of F.",
        f"linearized({_GIVEN}, float f[F_ENTRIES])",
        _lines(_linearized),
    )
    yield _function(
        "Take from P what is forgotten of states' errors, and fill in what lies below its diagonal.",
        "faded(float forgotten, float P[STATES][STATES])",
        _lines(_faded),
    )
    yield _function(
        "Give the elements from DRIVEN on of F times a column.",
        "carried(const float f[F_ENTRIES], const float column[STATES], float product[STATES])",
        _lines(_carried),
    )
    yield _function(
        "Overwrite P by F P F^T + Q, of the columns of F P; what lies below its diagonal is wrong after it.",
        "propagated(const struct ballbot_kalman_record *record, const float f[F_ENTRIES], "
        "float FP[STATES][STATES], float P[STATES][STATES])",
        _lines(_propagated),
    )
    yield _function(
        "Give the residuals of all that the sensors show, and the entries of H that vary; wrong where it is missing.",
        f"expected({_GIVEN}, const float velocity[2], const struct ballbot_reading_record *reading, "
        "const float wheels[3], const float attitude[3], const float fix[3], "
        "float residual[NUMBERS], float h[H_ENTRIES])",
        _lines(_expected),
    )
    yield _function(
        "Give q = P h of a number, h^T q, and what h expects of the known changes of the state. Of P nothing below the "
        "diagonal is read.",
        "projected(int32_t number, float P[STATES][STATES], const float h[H_ENTRIES], const float change[STATES], "
        "float q[STATES], float *spread, float *known)",
        _cases(h),
    )
    yield _function(
        "Overwrite P by P - q q^T / s, and the changes of the state; `inverse` is 1 / s.",
        "corrected(const float q[STATES], float residual, float inverse, float P[STATES][STATES], "
        "float change[STATES])",
        _lines(_corrected),
    )


def kalman_header() -> str:
    """Return the text of `KALMAN_HEADER`."""
    with written_by(_Writer()):  # pyright: ignore[reportArgumentType]
        entries = _shown()[1]
    indices = count()
    h = [_named(f"h[{next(indices)}]") if isinstance(entry, TracedNumber) else entry for entry in entries]
    sensors = ", ".join(f"{name.upper()} = {first}" for name, first in FIRST.items())
    together = ", ".join(f"{{{STATE_NAMES[i]}, {STATE_NAMES[j]}}}" for i, j in SHOWN_TOGETHER)
    return f"""\
/* The equations of the Kalman filter: its states, its sensors, and the entries of its matrices.
 *
 * Generated from ballbot/estimation/kalman_model.py, which explains them, by
 * `python -m tests.support.firmware_headers`; do not edit.
 */
#ifndef BALLBOT_ESTIMATION_KALMAN_MODEL_H
#define BALLBOT_ESTIMATION_KALMAN_MODEL_H

#include "ballbot_math.h"
#include "ballbot_types.h"

/* The states; those before DRIVEN drive the others, and nothing drives them. */
enum {{
    {", ".join(STATE_NAMES)}, STATES,
    DRIVEN = {STATE_NAMES[DRIVEN]}
}};

/* Place of each sensor's first number. */
enum {{ {sensors}, NUMBERS = {NUMBERS} }};

/* Entries of F besides the unit matrix, and those of H that vary. */
enum {{ F_ENTRIES = {len(ENTRIES)}, H_ENTRIES = {next(indices)} }};

/* Omega_z, which counts the less the more the ball pivots. */
enum {{ PIVOTING_SEEN = {PIVOTING_SEEN} }};

/* Pairs of states that are known from the start only together. */
static const int32_t TOGETHER[{len(SHOWN_TOGETHER)}][2] = {{{together}}};

{chr(10).join(_functions(h))}
#endif
"""
