"""Sine, cosine, powers of two and their logarithm without branches, so that loops over robots become vector code.

The library functions are calls, and a loop with a call in it stays scalar. Ranges are reduced in the
usual way (W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980); the rest is a polynomial,
the Chebyshev fit of so many terms that it errs by no more than rounding (`campaigns/polynomials.py` makes them).
Its terms are summed in pairs (Estrin's scheme), not one after another: a robot's step is a long chain of operations
that wait for each other, and these polynomials are most of it. Accuracy is measured in
tests/mechanics/test_elementary.py.
"""

from math import prod

import numpy as np

from ballbot.mechanics.engine.tracing import (
    FUNCTIONS,
    bits_of,
    float_of,
    greatest,
    in_order,
    least,
    root,
    traced,
    where,
    whole,
)

# pi/2 in three parts, so that k * part is exact while |k| < 2^20 (angles to a million radians)
_HALF_PI_1 = 1.5707963267341256
_HALF_PI_2 = 6.0771005063039070e-11
_HALF_PI_3 = 2.0222662487959506e-21
_SHIFT = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits
_BITS_OF_SHIFT = 0x4338000000000000
_BITS_OF_ONE = 0x3FF0000000000000
_BITS_OF_SQRT_HALF = 0x3FE6A09E667F3BCD

# (sin x - x)/x^3 and (cos x - 1)/x^2 in x^2, for |x| < pi/4
_SINE = (
    -0.16666666666666666,
    0.008333333333330925,
    -0.00019841269836722418,
    2.755731608381636e-06,
    -2.5051127944014188e-08,
    1.5917848524808262e-10,
)
_COSINE = (
    -0.49999999999999967,
    0.04166666666663057,
    -0.0013888888882073777,
    2.4801582595279208e-05,
    -2.7555849667039985e-07,
    2.0665084193224383e-09,
)
# the same for |x| < 1.3
_SINE_OF_LEAN = (
    -0.16666666666666666,
    0.008333333333332563,
    -0.0001984126984054048,
    2.7557318964906746e-06,
    -2.5052064545261855e-08,
    1.60552329049735e-10,
    -7.482600559931239e-13,
)
_COSINE_OF_LEAN = (
    -0.4999999999999998,
    0.0416666666666536,
    -0.001388888888765145,
    2.4801586862006167e-05,
    -2.7557244832099035e-07,
    2.0870289005447105e-09,
    -1.1191332777315705e-11,
)
# (2^x - 1)/x for |x| < 1/2
_POWER = (
    0.6931471805599462,
    0.24022650695910075,
    0.05550410866465167,
    0.009618129107618665,
    0.0013333558200794592,
    0.00015403530424776529,
    1.5252672924850737e-05,
    1.3215451633221434e-06,
    1.0205905413765595e-07,
    7.070977866508138e-09,
)
# log2((1 + f)/(1 - f))/f in f^2, for |f| < (sqrt 2 - 1)/(sqrt 2 + 1)
_LOGARITHM = (
    2.885390081777927,
    0.9617966939243345,
    0.5770780172463286,
    0.4121984020482752,
    0.32061638813224547,
    0.2614442493522915,
    0.2429160853987535,
)


def polynomial(x, coefficients):
    """Return sum_i coefficients[i] x^i, summed in pairs."""
    terms, power = list(coefficients), x
    while len(terms) > 1:
        pairs = [a + power * b for a, b in zip(terms[::2], terms[1::2], strict=False)]
        terms = pairs + terms[2 * len(pairs) :]
        power = power * power
    return terms[0]


@in_order
def nearest_integer(x):
    """Return x rounded to an integer, as a float, for |x| < 2^51."""
    return (x + _SHIFT) - _SHIFT


@traced
@in_order
def sine_cosine(angle):
    """Return sin and cos of an angle [rad] up to a million."""
    k = nearest_integer(angle * 0.6366197723675814)
    r = ((angle - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
    r2 = r * r
    sine = r + (r * r2) * polynomial(r2, _SINE)
    cosine = 1.0 + r2 * polynomial(r2, _COSINE)
    quadrant = whole(k)
    odd = (quadrant & 1) != 0
    sine_size, cosine_size = where(odd, cosine, sine), where(odd, sine, cosine)
    return (
        where((quadrant & 2) != 0, -sine_size, sine_size),
        where(((quadrant + 1) & 2) != 0, -cosine_size, cosine_size),
    )


@traced
@in_order
def sine_cosine_of_lean(angle):
    """Return sin and cos of an angle of at most 1.3 rad to either side; of a larger one, a number without meaning."""
    square = angle * angle
    sine = angle + (angle * square) * polynomial(square, _SINE_OF_LEAN)
    return sine, 1.0 + square * polynomial(square, _COSINE_OF_LEAN)


@traced
@in_order
def power_of_two(x):
    """Return 2^x for |x| < 1022."""
    shifted = x + _SHIFT
    r = x - (shifted - _SHIFT)
    scale = float_of((bits_of(shifted) << 52) + _BITS_OF_ONE)
    return scale + (scale * r) * polynomial(r, _POWER)


@traced
@in_order
def binary_logarithm(x):
    """Return log2 x for a normal positive x; of zero, infinity and NaN it makes -1023, 1024 and 1024.6."""
    bits = bits_of(x)
    k = (bits - _BITS_OF_SQRT_HALF) >> 52
    m = float_of(bits - (k << 52))  # x / 2^k, from sqrt(1/2) to sqrt(2)
    f = (m - 1.0) / (m + 1.0)
    # k as a float, which few processors can do to eight integers at once
    return (float_of(k + _BITS_OF_SHIFT) - _SHIFT) + f * polynomial(f * f, _LOGARITHM)


# --- NumPy's functions, for what a user writes (`ballbot.robot.friction_law`) ---

_LARGEST_POWER = 1000.0  # of two, that a float holds


def _raised(exponent):
    return power_of_two(least(greatest(exponent, -_LARGEST_POWER), _LARGEST_POWER))


def exponential(x):
    """Return e^x, kept where a float holds it."""
    return _raised(x * 1.4426950408889634)


def logarithm(x):
    """Return ln x of a positive x."""
    return 0.6931471805599453 * binary_logarithm(x)


def hyperbolic_tangent(x):
    """Return tanh x; to an absolute error of rounding."""
    return 1.0 - 2.0 / (exponential(2.0 * x) + 1.0)


def power(base, exponent):
    """Return base^exponent: by products for a whole exponent from 0 to 8, else of a base of zero or more."""
    if isinstance(exponent, int | float):
        if exponent == 0.5:
            return root(base)
        if exponent in range(9):
            return prod([base] * int(exponent))
    return _raised(exponent * binary_logarithm(base))


FUNCTIONS |= {np.exp: exponential, np.log: logarithm, np.tanh: hyperbolic_tangent, np.power: power}
FUNCTIONS |= {np.square: lambda x: x * x, np.float_power: power}
