"""Measure the firmware's functions (ballbot_math.h) against float64.

Functions of one argument are measured at every float that they accept; the sine is odd and the cosine even, which the
tests check, so that half of all angles are enough. A C compiler is needed.
"""

import ctypes
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.firmware.build import compile_sources
from ballbot.firmware.header import SOURCES

Floats = NDArray[np.float32]

#: what the header states, in ulp; of the power per 1 + |log2 result|
STATED = {"sine": 2.5, "cosine": 2.5, "exponential": 1.1, "power": 1.2, "square root": 0.5, "arctangent": 2.5,
          "hyperbolic tangent": 1.6}  # fmt: skip
#: bits of infinity: all non-negative floats below it
_INFINITY = 0x7F800000
_CHUNK = 1 << 21


@cache
def library() -> ctypes.CDLL:
    """Return the functions on arrays, compiled."""
    with tempfile.TemporaryDirectory(prefix="ballbot-math-", ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "math.so"
        compile_sources(
            target,
            [SOURCES / "ballbot_math.c", Path(__file__).with_suffix(".c")],
            flags=("-O2", "-fPIC", "-shared", "-Wno-missing-prototypes"),
        )
        return ctypes.CDLL(str(target))


def called(name: str, *arguments: Floats, results: int = 1) -> tuple[Floats, ...]:
    """Return the arrays (N,) that a function gives for arrays (N,) of arguments."""
    given = [np.ascontiguousarray(one, dtype=np.float32) for one in arguments]
    found = tuple(np.empty_like(given[0]) for _ in range(results))
    pointers = [ctypes.c_void_p(one.ctypes.data) for one in (*given, *found)]
    getattr(library(), name)(ctypes.c_size_t(len(given[0])), *pointers)
    return found


def ulp_errors(found: Floats, exact: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return errors (N,) in units in the last place of the exact values, as float32 has it."""
    exponent = np.maximum(np.frexp(exact)[1] - 24, -149)
    return np.abs(found.astype(np.float64) - exact) / np.ldexp(1.0, exponent)


def floats(step: int, largest: float) -> Iterator[Floats]:
    """Return, in chunks, every `step`-th float from zero to `largest`."""
    end = min(int(np.float32(largest).view(np.uint32)) + 1, _INFINITY)
    for start in range(0, end, _CHUNK * step):
        bits = np.arange(start, min(start + _CHUNK * step, end), step, dtype=np.uint64)
        yield bits.astype(np.uint32).view(np.float32)


def largest_errors(step: int, pairs: int) -> dict[str, float]:
    """Return each function's largest error in ulp, of the power per 1 + |log2 result|.

    Parameters
    ----------
    step : int
        Every how many floats a function of one argument is measured; 1 measures all.
    pairs : int
        Random pairs of arguments.
    """
    worst = dict.fromkeys(STATED, 0.0)

    def see(name: str, errors: NDArray[np.float64]) -> None:
        worst[name] = max(worst[name], float(errors.max()))  # a NaN stays

    for x in floats(step, np.inf):
        wide = x.astype(np.float64)
        sine, cosine = called("sine_cosine", x, results=2)
        see("sine", ulp_errors(sine, np.sin(wide)))
        see("cosine", ulp_errors(cosine, np.cos(wide)))
        see("square root", ulp_errors(called("square_root", x)[0], np.sqrt(wide)))
        see("hyperbolic tangent", ulp_errors(called("hyperbolic_tangent", x)[0], np.tanh(wide)))
        see("arctangent", ulp_errors(called("arctangent", x, np.ones_like(x))[0], np.arctan(wide)))
    for x in floats(step, 87.0):
        for signed in (x, -x):
            exact = np.exp(signed.astype(np.float64))
            see("exponential", ulp_errors(called("exponential", signed)[0], exact))
    random = np.random.default_rng(1)
    for _ in range(0, pairs, _CHUNK):
        see("power", _power_errors(random))
        see("arctangent", _arctangent_errors(random))
    return worst


def _power_errors(random: np.random.Generator) -> NDArray[np.float64]:
    base = random.integers(0x00800000, _INFINITY, _CHUNK).astype(np.uint32).view(np.float32)
    near_one = (2.0 ** random.uniform(-4.0, 4.0, _CHUNK)).astype(np.float32)
    base = np.where(random.random(_CHUNK) < 0.5, base, near_one)
    exponent = (random.choice([0.1, 1.0, 8.0], _CHUNK) * random.uniform(-1.0, 1.0, _CHUNK)).astype(np.float32)
    size = exponent.astype(np.float64) * np.log2(base.astype(np.float64))
    base, exponent, size = (one[np.abs(size) < 124.9] for one in (base, exponent, size))
    exact = base.astype(np.float64) ** exponent.astype(np.float64)
    relative = np.abs(called("power", base, exponent)[0] / exact - 1.0)
    return relative * 2.0**23 / (1.0 + np.abs(size))


def _arctangent_errors(random: np.random.Generator) -> NDArray[np.float64]:
    y, x = (
        (random.uniform(-1.0, 1.0, _CHUNK) * 10.0 ** random.uniform(-6.0, 6.0, _CHUNK)).astype(np.float32)
        for _ in range(2)
    )
    return ulp_errors(called("arctangent", y, x)[0], np.arctan2(y.astype(np.float64), x.astype(np.float64)))
