"""Random numbers of many robots in compiled code: a stream for each robot, so that they depend on its seed alone.

A stream is a generator xoshiro256++ (D. Blackman and S. Vigna, Scrambled Linear Pseudorandom Number Generators, 2021):
four whole numbers of 64 bits. Normal numbers are drawn by the ziggurat (G. Marsaglia and W. W. Tsang, 2000) in the form
of J. A. Doornik (2005): the density's right half is covered by 256 layers of equal area, of which the lowest has the
tail. A point in a layer is nearly always below the density; then its abscissa is the number.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.engine.compiled import inlined

#: where the tail begins, and the area of each layer, of 256
_TAIL, _AREA = 3.6541528853610088, 0.00492867323399
_LAYERS = 256


def _layer_edges() -> NDArray[np.float64]:
    """Return the widths (257,) of the layers from the lowest, which is as wide as its area needs, to the top: zero."""
    edges = [_AREA / math.exp(-0.5 * _TAIL**2), _TAIL]
    while len(edges) < _LAYERS:
        height = _AREA / edges[-1] + math.exp(-0.5 * edges[-1] ** 2)
        edges.append(math.sqrt(-2.0 * math.log(height)))
    return np.array([*edges, 0.0])


_EDGES = _layer_edges()
_HEIGHTS = np.exp(-0.5 * _EDGES**2)
_LOWEST = np.uint64(_LAYERS - 1)  # bits of a word that choose the layer
_UNIT = 1.0 / (1 << 53)
_S11, _S17, _S23, _S41, _S45, _S19 = (np.uint64(bits) for bits in (11, 17, 23, 41, 45, 19))


def stream_of(seed: int | Sequence[int]) -> NDArray[np.uint64]:
    """Return the state (4,) of a stream at its begin."""
    return np.random.SeedSequence(seed).generate_state(4, np.uint64).astype(np.uint64)


@inlined
def next_word(stream):
    """Return 64 random bits of a stream (4,)."""
    total = stream[0] + stream[3]
    word = ((total << _S23) | (total >> _S41)) + stream[0]
    shifted = stream[1] << _S17
    stream[2] ^= stream[0]
    stream[3] ^= stream[1]
    stream[1] ^= stream[2]
    stream[0] ^= stream[3]
    stream[2] ^= shifted
    stream[3] = (stream[3] << _S45) | (stream[3] >> _S19)
    return word


@inlined
def uniform(stream, low, high):
    """Return a number between two others."""
    return low + (high - low) * (_UNIT * float(next_word(stream) >> _S11))


@inlined
def _tail(stream):
    """Return a normal number beyond the tail's begin, by G. Marsaglia (1964)."""
    while True:
        x = -math.log(1.0 - uniform(stream, 0.0, 1.0)) / _TAIL
        if -2.0 * math.log(1.0 - uniform(stream, 0.0, 1.0)) > x * x:
            return _TAIL + x


@inlined
def normal(stream):
    """Return a standard normal number."""
    while True:
        word = next_word(stream)
        layer = np.int64(word & _LOWEST)
        share = 2.0 * _UNIT * float(word >> _S11) - 1.0
        x = share * _EDGES[layer]
        if abs(x) < _EDGES[layer + 1]:
            return x
        if layer == 0:
            return math.copysign(_tail(stream), share)
        height = uniform(stream, _HEIGHTS[layer], _HEIGHTS[layer + 1])
        if height < math.exp(-0.5 * x * x):
            return x


@inlined
def fill_normal(stream, out):
    """Fill an array with standard normal numbers."""
    for i in range(len(out)):
        out[i] = normal(stream)
