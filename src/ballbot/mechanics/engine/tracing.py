"""Straight-line arithmetic of compiled code, written as plain Python functions on numbers and tuples of them.

A `traced` function is called by Python with floats or NumPy's arrays, and by Numba's code. There it runs once, while
that code is compiled, on stand-ins for the numbers (`Number`), and each operation on a stand-in adds an instruction
where the call stands. Loops over tuples, choices by the kind of robot and functions as arguments are Python's own,
and are gone by then: what is left is what LLVM makes vector code of. Numba would infer the types of every statement,
and LLVM optimise every function and again each of its callers, which took most of a cold start.

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


class _Place:
    """Where instructions are added, and how freely they may be reordered."""

    builder: ir.IRBuilder
    flags = _FAST


def _real(operation: str) -> Callable:
    """Return an operator that adds a floating-point instruction, or the one of integers for two of them."""

    def operator(self: Number, other: Number | float) -> Number:
        one, two = _alike(self, other)
        if one.type == REAL:
            return Number(getattr(_Place.builder, f"f{operation}")(one, two, flags=_Place.flags))
        return Number(getattr(_Place.builder, operation)(one, two, flags=("nsw",)))

    return operator


def _swapped(operator: Callable) -> Callable:
    return lambda self, other: operator(Number(_value(other, like=self.value.type)), self)


def _comparison(sign: str) -> Callable:
    def operator(self: Number, other: Number | float) -> Number:
        one, two = _alike(self, other)
        if one.type != REAL:
            return Number(_Place.builder.icmp_signed(sign, one, two))
        ordered = _Place.builder.fcmp_unordered if sign == "!=" else _Place.builder.fcmp_ordered
        return Number(ordered(sign, one, two))

    return operator


def _bitwise(operation: str) -> Callable:
    def operator(self: Number, other: Number | int) -> Number:
        return Number(getattr(_Place.builder, operation)(*_alike(self, other)))

    return operator


class Number:
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

    def __neg__(self) -> Number:
        if self.value.type == REAL:
            return Number(_Place.builder.fneg(self.value, flags=_Place.flags))
        return 0 - self

    def __abs__(self) -> Number:
        return _called("llvm.fabs", self)

    def __invert__(self) -> Number:
        return Number(_Place.builder.not_(self.value))

    def __bool__(self) -> bool:
        raise TypeError("A number of compiled code is known only when it runs; choose by `where`.")

    def __pow__(self, exponent: Number | float) -> Number:
        return FUNCTIONS[np.power](self, exponent)

    def __rpow__(self, base: float) -> Number:
        return FUNCTIONS[np.power](base, self)

    def __array_ufunc__(self, function: np.ufunc, method: str, *numbers: Any, **options: Any) -> Any:
        if method != "__call__" or options or function not in FUNCTIONS:
            return NotImplemented
        return FUNCTIONS[function](*(float(one) if isinstance(one, np.generic) else one for one in numbers))

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

    def _at(self, index: Number | int) -> Any:
        return _Place.builder.gep(self.data, [_value(index, like=_WHOLE)], inbounds=True)

    def __getitem__(self, index: Number | int) -> Number:
        return Number(_Place.builder.load(self._at(index)))

    def __setitem__(self, index: Number | int, value: Number | float) -> None:
        _Place.builder.store(_value(value, like=REAL), self._at(index))


def _value(number: Number | float, *, like: Any) -> Any:
    """Return LLVM's value of a stand-in, or of a number that is known; integers become floats where asked for."""
    if not isinstance(number, Number):
        return ir.Constant(like, float(number) if like == REAL else int(number))
    if like == REAL and number.value.type == _WHOLE:
        return _Place.builder.sitofp(number.value, REAL)
    return number.value


def _alike(a: Number | float, b: Number | float) -> tuple[Any, Any]:
    """Return the values of two numbers as one type: the float's, if there is one."""
    kinds = [one.value.type if isinstance(one, Number) else _kind_of(one) for one in (a, b)]
    kind = REAL if REAL in kinds else _WHOLE if _WHOLE in kinds else _TRUTH
    return _value(a, like=kind), _value(b, like=kind)


def _kind_of(number: float) -> Any:
    if isinstance(number, bool):
        return _TRUTH
    return _WHOLE if isinstance(number, int) else REAL


def _called(name: str, *numbers: Number) -> Number:
    function = _Place.builder.module.declare_intrinsic(name, [REAL])
    return Number(_Place.builder.call(function, [_value(one, like=REAL) for one in numbers]))


# --- what stands for Python's own, on numbers of either kind ---


def where(condition: Any, this: T, other: T) -> T:
    """Return `this` or `other`, numbers or tuples of them."""
    if not isinstance(condition, Number | np.ndarray):
        return this if condition else other
    if isinstance(this, tuple) and isinstance(other, tuple):
        chosen = [where(condition, a, b) for a, b in zip(this, other, strict=True)]
        return _tuple_like(this, chosen)
    if isinstance(condition, np.ndarray):
        return np.where(condition, this, other)  # pyright: ignore[reportArgumentType, reportCallIssue, reportReturnType]
    one, two = _alike(this, other)  # pyright: ignore[reportArgumentType]
    return Number(_Place.builder.select(condition.value, one, two))  # pyright: ignore[reportReturnType]


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
    found = conditions[0]
    for one in conditions[1:]:
        found = join(found, one)
    return found


def root(x):
    """Return the square root."""
    return _called("llvm.sqrt", x) if isinstance(x, Number) else np.sqrt(x)


FUNCTIONS |= {np.where: where, np.minimum: least, np.maximum: greatest, np.sqrt: root}


def bits_of(x):
    """Return the 64 bits of a float64 as an integer."""
    if isinstance(x, Number):
        return Number(_Place.builder.bitcast(x.value, _WHOLE))
    return np.float64(x).view(np.int64)


def float_of(bits):
    """Return the float64 that has these 64 bits."""
    if isinstance(bits, Number):
        return Number(_Place.builder.bitcast(bits.value, REAL))
    return np.int64(bits).view(np.float64)


def whole(x):
    """Return the integer part of a float."""
    if isinstance(x, Number):
        return Number(_Place.builder.fptosi(x.value, _WHOLE))
    return np.int64(x)


def lanes(first: Number | int, last: Number | int) -> Iterator[Any]:
    """Yield the index of a loop from `first` to `last` - 1; its body is run once, to be compiled."""
    builder = _Place.builder
    start, stop = _value(first, like=_WHOLE), _value(last, like=_WHOLE)
    with cgutils.for_range(builder, stop, start=start, intp=_WHOLE) as loop:
        yield Number(loop.index)


def outside(address, *arguments) -> None:
    """Call C code at an address with arrays, of whose numbers it gets the place, and integers."""
    values = [one.data if isinstance(one, Rows) else _value(one, like=_WHOLE) for one in arguments]
    kind = ir.FunctionType(ir.VoidType(), [one.type for one in values])
    builder = _Place.builder
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
            found = function(*(_stand_in(context, kind, value) for kind, value in values))
            return _packed(context, signature.return_type, found)

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
        array.meminfo, array.parent = (ir.Constant(one.type, None) for one in (array.meminfo, array.parent))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        values = cgutils.unpack_tuple(builder, value, len(kind))
        items = [_uncounted(context, builder, *one) for one in zip(kind.types, values, strict=True)]  # pyright: ignore[reportAttributeAccessIssue]
        return context.make_tuple(builder, kind, items)
    return value


def in_order(function: F) -> F:
    """Let no operation of a function be reassociated, which would undo a range reduction."""

    @wraps(function)
    def ordered(*arguments):
        flags, _Place.flags = _Place.flags, _IN_ORDER
        try:
            return function(*arguments)
        finally:
            _Place.flags = flags

    return ordered  # pyright: ignore[reportReturnType]


@contextmanager
def written_by(builder: ir.IRBuilder) -> Iterator[None]:
    """Add instructions there; Numba compiles in one thread at a time. What has a builder's methods will do."""
    before = _Place.__dict__.get("builder"), _Place.flags
    _Place.builder, _Place.flags = builder, _FAST
    try:
        yield
    finally:
        _Place.builder, _Place.flags = before  # pyright: ignore[reportAttributeAccessIssue]


def instructions_of(function: Callable, count: int) -> str:
    """Return the instructions that a function of so many numbers stands for; TypeError if it returns no number."""
    scratch = ir.Function(ir.Module(), ir.FunctionType(REAL, [REAL] * count), "scratch")
    with written_by(ir.IRBuilder(scratch.append_basic_block())):
        found = function(*(Number(one) for one in scratch.args))
        _Place.builder.ret(_value(found, like=REAL))
    return str(scratch)


@cache
def _result_type(function: Callable, arguments: tuple[types.Type, ...]) -> types.Type:
    """Return the type of a function's result, found by writing it where it is thrown away."""
    scratch = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), ()), "scratch")
    with written_by(ir.IRBuilder(scratch.append_basic_block())):
        return _type_of(function(*(_stand_in(None, kind, None) for kind in arguments)))


def _type_of(found: object) -> types.Type:
    if found is None:
        return types.none
    if isinstance(found, tuple):
        kind = type(found) if hasattr(found, "_fields") else None
        return types.BaseTuple.from_types([_type_of(one) for one in found], kind)  # pyright: ignore[reportReturnType]
    return _NUMBA_TYPES[found.value.type if isinstance(found, Number) else _kind_of(found)]  # pyright: ignore[reportArgumentType]


def _stand_in(context: Any, kind: types.Type, value: Any | None) -> Any:
    """Return what stands for an argument of Numba's type; of no value while types are inferred."""
    if isinstance(kind, types.BaseTuple):
        items = tuple(kind)  # pyright: ignore[reportArgumentType] (each kind of tuple is iterable, their base is not)
        parts = [
            _stand_in(context, one, None if value is None else _Place.builder.extract_value(value, i))
            for i, one in enumerate(items)
        ]
        return kind.instance_class(*parts) if isinstance(kind, types.BaseNamedTuple) else tuple(parts)  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(kind, types.Array):
        if value is None:
            return Rows(ir.Constant(ir.PointerType(REAL), None))
        return Rows(cgutils.create_struct_proxy(kind)(context, _Place.builder, value=value).data)
    if isinstance(kind, types.CPointer):
        return Rows(ir.Constant(ir.PointerType(REAL), None) if value is None else value)
    if isinstance(kind, types.Function):
        return kind.typing_key
    if isinstance(kind, types.Dispatcher):
        return kind.dispatcher.py_func
    if isinstance(kind, types.NoneType):
        return None
    plain = REAL if isinstance(kind, types.Float) else _TRUTH if isinstance(kind, types.Boolean) else _WHOLE
    return Number(ir.Constant(plain, ir.Undefined) if value is None else value)


def _packed(context: Any, kind: types.Type, found: Any) -> Any:
    """Return LLVM's value of a result."""
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.BaseTuple):
        items = tuple(kind)  # pyright: ignore[reportArgumentType]
        parts = [_packed(context, one, part) for one, part in zip(items, found, strict=True)]
        return context.make_tuple(_Place.builder, kind, parts)
    return _value(found, like=context.get_value_type(kind))


def _tuple_like(like: tuple, items: list) -> Any:
    return type(like)(*items) if hasattr(like, "_fields") else tuple(items)
