"""Vectors as tuples of numbers, in compiled code: 3-vectors, rotation matrices (three rows) and
symmetric 3 x 3 matrices (xx, yy, zz, xy, xz, yz).

A tuple costs nothing: it is taken apart into registers, in one robot's code and in vector lanes alike.
"""

from ballbot.mechanics.compiled import by_types_of, inlined


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


def each(function, items, shared) -> tuple:  # pragma: no cover (its compiled form is below)
    """Return the tuple of function(item, shared), one for each wheel."""
    raise NotImplementedError("compiled code only")


@by_types_of(each)
def _each(function, items, shared):
    if len(items) == 3:
        return lambda function, items, shared: (
            function(items[0], shared),
            function(items[1], shared),
            function(items[2], shared),
        )
    return lambda function, items, shared: (
        function(items[0], shared),
        function(items[1], shared),
        function(items[2], shared),
        function(items[3], shared),
    )


def each_pair(function, items, others) -> tuple:  # pragma: no cover
    """Return the tuple of function(item, other), one for each wheel."""
    raise NotImplementedError("compiled code only")


@by_types_of(each_pair)
def _each_pair(function, items, others):
    if len(items) == 3:
        return lambda function, items, others: (
            function(items[0], others[0]),
            function(items[1], others[1]),
            function(items[2], others[2]),
        )
    return lambda function, items, others: (
        function(items[0], others[0]),
        function(items[1], others[1]),
        function(items[2], others[2]),
        function(items[3], others[3]),
    )


def each_of_four(function, items, second, third, fourth) -> tuple:  # pragma: no cover
    """Return the tuple of function(item, second, third, fourth), one for each wheel."""
    raise NotImplementedError("compiled code only")


@by_types_of(each_of_four)
def _each_of_four(function, items, second, third, fourth):
    if len(items) == 3:
        return lambda function, items, second, third, fourth: (
            function(items[0], second[0], third[0], fourth[0]),
            function(items[1], second[1], third[1], fourth[1]),
            function(items[2], second[2], third[2], fourth[2]),
        )
    return lambda function, items, second, third, fourth: (
        function(items[0], second[0], third[0], fourth[0]),
        function(items[1], second[1], third[1], fourth[1]),
        function(items[2], second[2], third[2], fourth[2]),
        function(items[3], second[3], third[3], fourth[3]),
    )


def total(vectors) -> tuple:  # pragma: no cover
    """Return the sum of the wheels' 3-vectors."""
    raise NotImplementedError("compiled code only")


@by_types_of(total)
def _total(vectors):
    if len(vectors) == 3:
        return lambda vectors: add(add(vectors[0], vectors[1]), vectors[2])
    return lambda vectors: add(add(vectors[0], vectors[1]), add(vectors[2], vectors[3]))


def smallest(numbers) -> float:  # pragma: no cover
    """Return the smallest of the wheels' numbers."""
    raise NotImplementedError("compiled code only")


@by_types_of(smallest)
def _smallest(numbers):
    if len(numbers) == 3:
        return lambda numbers: min(min(numbers[0], numbers[1]), numbers[2])
    return lambda numbers: min(min(numbers[0], numbers[1]), min(numbers[2], numbers[3]))
