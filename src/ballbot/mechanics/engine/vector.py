"""Vectors as tuples of numbers, in compiled code: 3-vectors, rotation matrices (three rows) and
symmetric 3 x 3 matrices (xx, yy, zz, xy, xz, yz).

A tuple costs nothing: it is taken apart into registers, in one robot's code and in vector lanes alike.
"""

from collections.abc import Callable, Iterable
from functools import reduce

from ballbot.mechanics.engine.tracing import least, traced


@traced
def dot(a, b):
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@traced
def cross(a, b):
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@traced
def add(a, b):
    """Return a + b, of any length."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


@traced
def subtract(a, b):
    """Return a - b, of any length."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@traced
def scale(a, factor):
    """Return factor a, of any length."""
    return tuple(x * factor for x in a)


@traced
def advanced(a, rate, h):
    """Return a + h rate, of any length."""
    return tuple(x + h * y for x, y in zip(a, rate, strict=True))


@traced
def rotate(R, a):
    """Return R a, for R given by its rows."""
    return (dot(R[0], a), dot(R[1], a), dot(R[2], a))


@traced
def rotate_back(R, a):
    """Return R^T a, for R given by its rows."""
    return tuple(R[0][i] * a[0] + R[1][i] * a[1] + R[2][i] * a[2] for i in range(3))


@traced
def symmetric_times(S, a):
    """Return S a, for a symmetric S."""
    xx, yy, zz, xy, xz, yz = S
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )


def each(function: Callable, *tuples):
    """Return the tuple of function(item of the first, item of the second, ..), for tuples of one length."""
    return tuple(function(*items) for items in zip(*tuples, strict=True))


@traced
def from_array(like, numbers):
    """Return as many of a flat array's numbers as a tuple has."""
    return tuple(numbers[i] for i in range(len(like)))


@traced
def smallest(numbers):
    """Return the smallest of a tuple's numbers; a NaN after the first does not show."""
    return reduce(least, numbers)


def total(vectors):
    """Return the sum of the wheels' 3-vectors."""
    return reduce(add, vectors)


def inner(a, b):
    """Return the sum of the products of two tuples' numbers."""
    return summed(x * y for x, y in zip(a, b, strict=True))


def summed(numbers: Iterable):
    """Return the sum of at least one number."""
    return reduce(lambda total, other: total + other, numbers)


def solve_dense(K, right):
    """Return K^-1 right by elimination without pivoting, for K given by its rows."""
    n, k, x = len(right), [list(row) for row in K], list(right)
    inverse = []
    for pivot in range(n):
        inverse.append(1.0 / k[pivot][pivot])
        for i in range(pivot + 1, n):
            factor = k[i][pivot] * inverse[pivot]
            for j in range(pivot + 1, n):
                k[i][j] = k[i][j] - factor * k[pivot][j]
            x[i] = x[i] - factor * x[pivot]
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            x[i] = x[i] - k[i][j] * x[j]
        x[i] = x[i] * inverse[i]
    return tuple(x)
