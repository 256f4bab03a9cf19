"""Vectors as tuples of numbers, in compiled code: 3-vectors, rotation matrices (three rows) and
symmetric 3 x 3 matrices (xx, yy, zz, xy, xz, yz).

A tuple costs nothing: it is taken apart into registers, in one robot's code and in vector lanes alike.
What is done to each wheel, or to each number of a state, is written once (`each`) and compiled for the tuple's
length.
"""

from collections.abc import Callable

from ballbot.mechanics.engine.compiled import by_types_of, inlined


@inlined
def dot(a, b):
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def add(a, b):
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inlined
def subtract(a, b):
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined
def scale(a, factor):
    """Return factor a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


@inlined
def rotate(R, a):
    """Return R a, for R given by its rows."""
    return (dot(R[0], a), dot(R[1], a), dot(R[2], a))


@inlined
def rotate_back(R, a):
    """Return R^T a, for R given by its rows."""
    return (
        R[0][0] * a[0] + R[1][0] * a[1] + R[2][0] * a[2],
        R[0][1] * a[0] + R[1][1] * a[1] + R[2][1] * a[2],
        R[0][2] * a[0] + R[1][2] * a[1] + R[2][2] * a[2],
    )


@inlined
def symmetric_times(S, a):
    """Return S a, for a symmetric S."""
    xx, yy, zz, xy, xz, yz = S
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )


@inlined
def symmetric_sum(S, T, factor):
    """Return S + factor T of two symmetric matrices."""
    return (
        S[0] + factor * T[0],
        S[1] + factor * T[1],
        S[2] + factor * T[2],
        S[3] + factor * T[3],
        S[4] + factor * T[4],
        S[5] + factor * T[5],
    )


def each(function, *tuples) -> tuple:  # pragma: no cover (its compiled form is below)
    """Return the tuple of function(item of the first, item of the second, ..), for tuples of one length."""
    raise NotImplementedError("compiled code only")


@by_types_of(each)
def _each(function, *tuples):
    calls = [", ".join(f"tuples[{k}][{i}]" for k in range(len(tuples))) for i in range(len(tuples[0]))]
    return written("function, *tuples", _tuple(f"function({items})" for items in calls))


@inlined
def second(_, value):
    """Return the second of two, to make a tuple of as many of it as another has items (`each_with`)."""
    return value


@inlined
def element(place, values):
    """Return the number at that place of an array, to make a tuple of an array's numbers (`each_with`)."""
    return values[place]


def advanced(a, rate, h) -> tuple:  # pragma: no cover
    """Return a + h rate."""
    raise NotImplementedError("compiled code only")


@by_types_of(advanced)
def _advanced(a, rate, h):
    return written("a, rate, h", _tuple(f"a[{i}] + h * rate[{i}]" for i in range(len(a))))


def each_with(function, items, shared) -> tuple:  # pragma: no cover
    """Return the tuple of function(item, shared)."""
    raise NotImplementedError("compiled code only")


@by_types_of(each_with)
def _each_with(function, items, shared):
    return written(
        "function, items, shared", _tuple(f"function(items[{i}], shared)" for i in range(len(items)))
    )


def total(vectors) -> tuple:  # pragma: no cover
    """Return the sum of the wheels' 3-vectors."""
    raise NotImplementedError("compiled code only")


@by_types_of(total)
def _total(vectors):
    sums = (" + ".join(f"vectors[{i}][{axis}]" for i in range(len(vectors))) for axis in range(3))
    return written("vectors", _tuple(sums))


def smallest(numbers) -> float:  # pragma: no cover
    """Return the smallest of a tuple's numbers; a NaN after the first does not show."""
    raise NotImplementedError("compiled code only")


@by_types_of(smallest)
def _smallest(numbers):
    least = "numbers[0]"
    for i in range(1, len(numbers)):
        least = f"min({least}, numbers[{i}])"
    return written("numbers", least)


def solve_dense(K, right) -> tuple:  # pragma: no cover (compiled form below)
    """Return K^-1 right by elimination without pivoting, for K given by its rows."""
    raise NotImplementedError("compiled code only")


@by_types_of(solve_dense)
def _solve_dense(K, right):
    n = len(right)
    lines = [f"k{i}_{j} = K[{i}][{j}]" for i in range(n) for j in range(n)]
    lines += [f"x{i} = right[{i}]" for i in range(n)]
    for pivot in range(n):
        lines.append(f"p{pivot} = 1.0 / k{pivot}_{pivot}")
        for i in range(pivot + 1, n):
            lines.append(f"f{i}_{pivot} = k{i}_{pivot} * p{pivot}")
            lines += [f"k{i}_{j} = k{i}_{j} - f{i}_{pivot} * k{pivot}_{j}" for j in range(pivot + 1, n)]
            lines.append(f"x{i} = x{i} - f{i}_{pivot} * x{pivot}")
    for i in reversed(range(n)):
        rest = "".join(f" - k{i}_{j} * x{j}" for j in range(i + 1, n))
        lines.append(f"x{i} = (x{i}{rest}) * p{i}")
    return written("K, right", _tuple(f"x{i}" for i in range(n)), *lines)


def written(signature: str, value: str, *lines: str, **names: Callable) -> Callable:
    """Return a function of that signature and value, for Numba to compile: a loop over a tuple, written out.

    `lines` come before the value is returned; `names` are the functions that are called.
    """
    scope = dict(names)
    body = "".join(f"    {line}\n" for line in lines)
    exec(f"def form({signature}):\n{body}    return {value}", scope)
    return scope["form"]


def _tuple(items) -> str:
    return f"({', '.join(items)},)"
