"""Straight-line arithmetic of compiled code, written as plain Python functions on numbers and tuples of them.

A `traced` function is called by Python with floats or NumPy's arrays, and by Numba's code. There it runs once, while
that code is compiled, on stand-ins for the numbers (`TracedNumber`), and each operation on a stand-in adds an
instruction where the call stands. Python itself runs loops over tuples, choices by the kind of robot and functions
given as arguments; only arithmetic remains, which LLVM makes vector code of. Without tracing, Numba would infer the
types of every statement, and LLVM optimise every function and again each of its callers: most of a cold start.

A choice that depends on a number is `where`, not `if`; both sides are computed. `least`, `greatest`, `both`, `either`
and `root` stand for `min`, `max`, `and`, `or` and `math.sqrt`. This is Numba's low-level interface for extensions
(`type_callable`, `lower_builtin`) with llvmlite's builder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, wraps
from inspect import signature
from operator import add, eq, ge, gt, le, lt, mul, ne, neg, sub, truediv
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable

#: what the compiler may assume: reassociation and fused multiply-add, but NaN and infinity stay what they are
FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}
#: the same as LLVM's instructions have them, in one order; and those of code that is not reassociated
_FAST, _IN_ORDER = tuple(sorted(FAST)), ("contract",)

REAL, _WHOLE, _TRUTH = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
_NUMBA_TYPES = {REAL: types.float64, _WHOLE: types.int64, _TRUTH: types.boolean}

T = TypeVar("T")
F = TypeVar("F", bound=Callable)


class _Target:
    """Where instructions are added, and how freely they may be reordered."""

    builder: ir.IRBuilder
    flags = _FAST


def _real(operation: str) -> Callable:
    """Return an operator that adds a floating-point instruction, or the one of integers for two of them."""

    def operator(self: TracedNumber, other: TracedNumber | float) -> TracedNumber:
        left, right = _alike(self, other)
        if left.type == REAL:
            return TracedNumber(getattr(_Target.builder, f"f{operation}")(left, right, flags=_Target.flags))
        return TracedNumber(getattr(_Target.builder, operation)(left, right, flags=("nsw",)))

    return operator


def _swapped(operator: Callable) -> Callable:
    return lambda self, other: operator(TracedNumber(_value(other, like=self.value.type)), self)


def _comparison(sign: str) -> Callable:
    def operator(self: TracedNumber, other: TracedNumber | float) -> TracedNumber:
        left, right = _alike(self, other)
        if left.type != REAL:
            return TracedNumber(_Target.builder.icmp_signed(sign, left, right))
        ordered = _Target.builder.fcmp_unordered if sign == "!=" else _Target.builder.fcmp_ordered
        return TracedNumber(ordered(sign, left, right))

    return operator


def _bitwise(operation: str) -> Callable:
    def operator(self: TracedNumber, other: TracedNumber | int) -> TracedNumber:
        return TracedNumber(getattr(_Target.builder, operation)(*_alike(self, other)))

    return operator


class TracedNumber:
    """Stands for a float, an integer or a truth value of the code that is compiled."""

    def __init__(self, value: Any) -> None:
        self.value = value

    __add__, __sub__, __mul__ = _real("add"), _real("sub"), _real("mul")
    __radd__, __rsub__, __rmul__ = _swapped(__add__), _swapped(__sub__), _swapped(__mul__)
    __truediv__ = _real("div")
    __rtruediv__ = _swapped(__truediv__)
    __lt__, __le__, __gt__, __ge__ = (_comparison(sign) for sign in ("<", "<=", ">", ">="))
    __eq__, __ne__ = _comparison("=="), _comparison("!=")  # pyright: ignore[reportAssignmentType]
    __hash__ = None  # pyright: ignore[reportAssignmentType]
    __and__, __or__, __lshift__, __rshift__ = (_bitwise(name) for name in ("and_", "or_", "shl", "ashr"))
    __rand__, __ror__ = __and__, __or__

    def __neg__(self) -> TracedNumber:
        if self.value.type == REAL:
            return TracedNumber(_Target.builder.fneg(self.value, flags=_Target.flags))
        return 0 - self

    def __abs__(self) -> TracedNumber:
        return called("llvm.fabs", self)

    def __invert__(self) -> TracedNumber:
        return TracedNumber(_Target.builder.not_(self.value))

    def __bool__(self) -> bool:
        raise TypeError("A number of compiled code is known only when it runs; choose by `where`.")

    def __pow__(self, exponent: TracedNumber | float) -> TracedNumber:
        return FUNCTIONS[np.power](self, exponent)

    def __rpow__(self, base: float) -> TracedNumber:
        return FUNCTIONS[np.power](base, self)

    def __array_ufunc__(self, function: np.ufunc, method: str, *numbers: Any, **options: Any) -> Any:
        if method != "__call__" or options or function not in FUNCTIONS:
            return NotImplemented
        return FUNCTIONS[function](*(float(x) if isinstance(x, np.generic) else x for x in numbers))

    def __array_function__(self, function: Callable, kinds: object, arguments: tuple, options: object) -> Any:
        if options or function not in FUNCTIONS:
            return NotImplemented
        return FUNCTIONS[function](*arguments)


#: what stands for NumPy's functions in code that is compiled; `ballbot.mechanics.engine.elementary` adds to it
FUNCTIONS: dict[Callable, Callable] = {
    np.add: add,
    np.subtract: sub,
    np.multiply: mul,
    np.true_divide: truediv,
    np.negative: neg,
    np.absolute: abs,
    np.less: lt,
    np.less_equal: le,
    np.greater: gt,
    np.greater_equal: ge,
    np.equal: eq,
    np.not_equal: ne,
}


class Rows:
    """Stands for an array of float64 whose numbers lie one after another, or for C's pointer to them."""

    def __init__(self, data: Any) -> None:
        self.data = data

    def _at(self, index: TracedNumber | int) -> Any:
        return _Target.builder.gep(self.data, [_value(index, like=_WHOLE)], inbounds=True)

    def __getitem__(self, index: TracedNumber | int) -> TracedNumber:
        return TracedNumber(_Target.builder.load(self._at(index)))

    def __setitem__(self, index: TracedNumber | int, value: TracedNumber | float) -> None:
        _Target.builder.store(_value(value, like=REAL), self._at(index))


def _value(number: TracedNumber | float, *, like: Any) -> Any:
    """Return LLVM's value of a stand-in, or of a number that is known; integers become floats where asked for."""
    if not isinstance(number, TracedNumber):
        return ir.Constant(like, float(number) if like == REAL else int(number))
    if like == REAL and number.value.type == _WHOLE:
        return _Target.builder.sitofp(number.value, REAL)
    return number.value


def _alike(a: TracedNumber | float, b: TracedNumber | float) -> tuple[Any, Any]:
    """Return the values of two numbers as one type: the float's, if there is one."""
    kinds = [number.value.type if isinstance(number, TracedNumber) else _kind_of(number) for number in (a, b)]
    kind = REAL if REAL in kinds else _WHOLE if _WHOLE in kinds else _TRUTH
    return _value(a, like=kind), _value(b, like=kind)


def _kind_of(number: float) -> Any:
    if isinstance(number, bool):
        return _TRUTH
    return _WHOLE if isinstance(number, int) else REAL


def called(name: str, *numbers: TracedNumber) -> TracedNumber:
    """Return the result of an intrinsic function."""
    function = _Target.builder.module.declare_intrinsic(name, [REAL])
    return TracedNumber(_Target.builder.call(function, [_value(number, like=REAL) for number in numbers]))


# --- what stands for Python's own, on numbers of either kind ---


def where(condition: Any, this: T, other: T) -> T:
    """Return `this` or `other`, numbers or tuples of them."""
    if not isinstance(condition, TracedNumber | np.ndarray):
        return this if condition else other
    if isinstance(this, tuple) and isinstance(other, tuple):
        chosen = [where(condition, a, b) for a, b in zip(this, other, strict=True)]
        return _tuple_like(this, chosen)
    if isinstance(condition, np.ndarray):
        return np.where(condition, this, other)  # pyright: ignore[reportArgumentType, reportCallIssue, reportReturnType]
    left, right = _alike(this, other)  # pyright: ignore[reportArgumentType]
    return TracedNumber(_Target.builder.select(condition.value, left, right))  # pyright: ignore[reportReturnType]


def least(a, b):
    """Return the smaller of two; the first where the second is no number."""
    return where(b < a, b, a)


def greatest(a, b):
    """Return the larger of two; the first where the second is no number."""
    return where(b > a, b, a)


def both(*conditions):
    """Return whether all hold."""
    return _joined(conditions, lambda a, b: a & b)


def either(*conditions):
    """Return whether one holds."""
    return _joined(conditions, lambda a, b: a | b)


def _joined(conditions: Sequence, join: Callable):
    joined = conditions[0]
    for condition in conditions[1:]:
        joined = join(joined, condition)
    return joined


def root(x):
    """Return the square root."""
    return called("llvm.sqrt", x) if isinstance(x, TracedNumber) else np.sqrt(x)


FUNCTIONS |= {np.where: where, np.minimum: least, np.maximum: greatest, np.sqrt: root}


def bits_of(x):
    """Return the 64 bits of a float64 as an integer."""
    if isinstance(x, TracedNumber):
        return TracedNumber(_Target.builder.bitcast(x.value, _WHOLE))
    return np.float64(x).view(np.int64)


def float_of(bits):
    """Return the float64 that has these 64 bits."""
    if isinstance(bits, TracedNumber):
        return TracedNumber(_Target.builder.bitcast(bits.value, REAL))
    return np.int64(bits).view(np.float64)


def whole(x):
    """Return the integer part of a float."""
    if isinstance(x, TracedNumber):
        return TracedNumber(_Target.builder.fptosi(x.value, _WHOLE))
    return np.int64(x)


def lanes(first: TracedNumber | int, last: TracedNumber | int) -> Iterator[Any]:
    """Yield the index of a loop from `first` to `last` - 1; its body is run once, to be compiled."""
    builder = _Target.builder
    start, stop = _value(first, like=_WHOLE), _value(last, like=_WHOLE)
    with cgutils.for_range(builder, stop, start=start, intp=_WHOLE) as loop:
        yield TracedNumber(loop.index)


def outside(address, *arguments) -> None:
    """Call C code at an address with arrays, of whose numbers it gets the place, and integers."""
    values = [item.data if isinstance(item, Rows) else _value(item, like=_WHOLE) for item in arguments]
    kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
    builder = _Target.builder
    builder.call(builder.inttoptr(address.value, kind.as_pointer()), values)


# --- how Numba's code calls a traced function ---


def traced(function: F) -> F:
    """Let Numba's code call a function of numbers, tuples and arrays; it is inlined."""
    parameters = signature(function)

    @type_callable(function)
    def _type(context):
        def typer(*arguments):
            return _result_type(function, arguments)

        typer.__signature__ = parameters  # pyright: ignore[reportFunctionMemberAccess]
        return typer

    @lower_builtin(function, types.VarArg(types.Any))
    def _lower(context, builder, signature, arguments):
        with written_by(builder):
            values = zip(signature.args, arguments, strict=True)
            result = function(*(_stand_in(context, kind, value) for kind, value in values))
            return _packed(context, signature.return_type, result)

    return function


def borrowed(arrays: T) -> T:
    """Return an array, or a named tuple with arrays, whose references compiled code does not count.

    Its caller keeps the arrays. Counting locks the memory bus, and each slice is counted twice: that took three tenths
    of a closed loop's time, and more in two threads.
    """
    return arrays


@type_callable(borrowed)
def _borrowed_type(context):
    return lambda arrays: arrays


@lower_builtin(borrowed, types.Any)
def _borrow(context, builder, signature, arguments):
    return _uncounted(context, builder, signature.return_type, arguments[0])


def _uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo, array.parent = (ir.Constant(part.type, None) for part in (array.meminfo, array.parent))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        values = cgutils.unpack_tuple(builder, value, len(kind))
        items = [_uncounted(context, builder, *pair) for pair in zip(kind.types, values, strict=True)]  # pyright: ignore[reportAttributeAccessIssue]
        return context.make_tuple(builder, kind, items)
    return value


def in_order(function: F) -> F:
    """Let no operation of a function be reassociated, which would undo a range reduction."""

    @wraps(function)
    def ordered(*arguments):
        flags, _Target.flags = _Target.flags, _IN_ORDER
        try:
            return function(*arguments)
        finally:
            _Target.flags = flags

    return ordered  # pyright: ignore[reportReturnType]


@contextmanager
def written_by(builder: ir.IRBuilder) -> Iterator[None]:
    """Add instructions there; Numba compiles in one thread at a time. What has a builder's methods will do."""
    before = _Target.__dict__.get("builder"), _Target.flags
    _Target.builder, _Target.flags = builder, _FAST
    try:
        yield
    finally:
        _Target.builder, _Target.flags = before  # pyright: ignore[reportAttributeAccessIssue]


def instructions_of(function: Callable, count: int) -> str:
    """Return the instructions that a function of so many numbers stands for; TypeError if it returns no number."""
    scratch = ir.Function(ir.Module(), ir.FunctionType(REAL, [REAL] * count), "scratch")
    with written_by(ir.IRBuilder(scratch.append_basic_block())):
        result = function(*(TracedNumber(argument) for argument in scratch.args))
        _Target.builder.ret(_value(result, like=REAL))
    return str(scratch)


@cache
def _result_type(function: Callable, arguments: tuple[types.Type, ...]) -> types.Type:
    """Return the type of a function's result, found by writing it where it is thrown away."""
    scratch = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), ()), "scratch")
    with written_by(ir.IRBuilder(scratch.append_basic_block())):
        return _type_of(function(*(_stand_in(None, kind, None) for kind in arguments)))


def _type_of(result: object) -> types.Type:
    if result is None:
        return types.none
    if isinstance(result, tuple):
        kind = type(result) if hasattr(result, "_fields") else None
        return types.BaseTuple.from_types([_type_of(part) for part in result], kind)  # pyright: ignore[reportReturnType]
    return _NUMBA_TYPES[result.value.type if isinstance(result, TracedNumber) else _kind_of(result)]  # pyright: ignore[reportArgumentType]


def _stand_in(context: Any, kind: types.Type, value: Any | None) -> Any:
    """Return what stands for an argument of Numba's type; of no value while types are inferred."""
    if isinstance(kind, types.BaseTuple):
        items = tuple(kind)  # pyright: ignore[reportArgumentType] (each kind of tuple is iterable, their base is not)
        parts = [
            _stand_in(context, item, None if value is None else _Target.builder.extract_value(value, i))
            for i, item in enumerate(items)
        ]
        return kind.instance_class(*parts) if isinstance(kind, types.BaseNamedTuple) else tuple(parts)  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(kind, types.Array):
        if value is None:
            return Rows(ir.Constant(ir.PointerType(REAL), None))
        return Rows(cgutils.create_struct_proxy(kind)(context, _Target.builder, value=value).data)
    if isinstance(kind, types.CPointer):
        return Rows(ir.Constant(ir.PointerType(REAL), None) if value is None else value)
    if isinstance(kind, types.Function):
        return kind.typing_key
    if isinstance(kind, types.Dispatcher):
        return kind.dispatcher.py_func
    if isinstance(kind, types.NoneType):
        return None
    plain = REAL if isinstance(kind, types.Float) else _TRUTH if isinstance(kind, types.Boolean) else _WHOLE
    return TracedNumber(ir.Constant(plain, ir.Undefined) if value is None else value)


def _packed(context: Any, kind: types.Type, result: Any) -> Any:
    """Return LLVM's value of a result."""
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.BaseTuple):
        items = tuple(kind)  # pyright: ignore[reportArgumentType]
        parts = [_packed(context, item, part) for item, part in zip(items, result, strict=True)]
        return context.make_tuple(_Target.builder, kind, parts)
    return _value(result, like=context.get_value_type(kind))


def _tuple_like(like: tuple, items: list) -> Any:
    return type(like)(*items) if hasattr(like, "_fields") else tuple(items)
