"""Sine, cosine, exponential and logarithm without branches, so that loops over robots become vector code.

The library functions are calls, and a loop with a call in it stays scalar. Ranges are reduced in the
usual way (W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980) and the rest is a
polynomial: Taylor's, long enough that the first term left out is below the rounding error.
Accuracy is measured in tests/test_elementary.py.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ballbot.mechanics.compiled import inlined_in_order

# pi/2 in three parts, so that k * part is exact while |k| < 2^20 (angles to a million radians)
_HALF_PI_1 = 1.5707963267341256
_HALF_PI_2 = 6.0771005063039070e-11
_HALF_PI_3 = 2.0222662487959506e-21
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_LOG2_E = 1.4426950408889634
_SQRT_HALF = 0.7071067811865476
_SHIFT = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits


@intrinsic
def bits_of(typing_context, value):
    """Return the 64 bits of a float64 as int64."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


@intrinsic
def float_of(typing_context, value):
    """Return the float64 that has these 64 bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), generate


@inlined_in_order
def nearest_integer(x):
    """Return x rounded to an integer, as a float, for |x| < 2^51; a GPU's compiler knows no rint."""
    return (x + _SHIFT) - _SHIFT


@inlined_in_order
def sine_cosine(angle):
    """Return sin and cos of an angle [rad] (see the module for the range)."""
    k = nearest_integer(angle * 0.6366197723675814)
    r = ((angle - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
    r2 = r * r
    sine = r + r * r2 * (
        -1.6666666666666666e-01
        + r2
        * (
            8.3333333333333332e-03
            + r2
            * (
                -1.9841269841269841e-04
                + r2
                * (
                    2.7557319223985893e-06
                    + r2
                    * (-2.5052108385441719e-08 + r2 * (1.6059043836821613e-10 - r2 * 7.6471637318198164e-13))
                )
            )
        )
    )
    cosine = 1.0 + r2 * (
        -0.5
        + r2
        * (
            4.1666666666666664e-02
            + r2
            * (
                -1.3888888888888889e-03
                + r2
                * (
                    2.4801587301587302e-05
                    + r2
                    * (
                        -2.7557319223985888e-07
                        + r2
                        * (
                            2.0876756987868099e-09
                            + r2 * (-1.1470745597729725e-11 + r2 * 4.7794773323873853e-14)
                        )
                    )
                )
            )
        )
    )
    quadrant = np.int64(k)
    odd = (quadrant & 1) != 0
    sine_size = cosine if odd else sine
    cosine_size = sine if odd else cosine
    return (
        -sine_size if (quadrant & 2) != 0 else sine_size,
        -cosine_size if ((quadrant + 1) & 2) != 0 else cosine_size,
    )


@inlined_in_order
def exponential(x):
    """Return e^x; arguments beyond +-708 are taken as +-708."""
    x = min(max(x, -708.0), 708.0)
    k = nearest_integer(x * _LOG2_E)
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    series = 1.0 + r * (
        1.0
        + r
        * (
            0.5
            + r
            * (
                1.6666666666666666e-01
                + r
                * (
                    4.1666666666666664e-02
                    + r
                    * (
                        8.3333333333333332e-03
                        + r
                        * (
                            1.3888888888888889e-03
                            + r
                            * (
                                1.9841269841269841e-04
                                + r
                                * (
                                    2.4801587301587302e-05
                                    + r
                                    * (
                                        2.7557319223985893e-06
                                        + r
                                        * (
                                            2.7557319223985888e-07
                                            + r * (2.5052108385441720e-08 + r * 2.0876756987868100e-09)
                                        )
                                    )
                                )
                            )
                        )
                    )
                )
            )
        )
    )
    power = float_of((np.int64(k) + 1023) << 52)  # pyright: ignore[reportCallIssue] (Numba passes the context)
    return series * power


@inlined_in_order
def logarithm(x):
    """Return ln x for a normal positive x; zero gives about -709 instead of minus infinity."""
    bits = bits_of(x)  # pyright: ignore[reportCallIssue] (Numba passes the context)
    exponent = ((bits >> 52) & 0x7FF) - 1023
    mantissa = float_of((bits & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000)
    large = mantissa > 1.4142135623730951
    mantissa = 0.5 * mantissa if large else mantissa
    k = float(exponent) + (1.0 if large else 0.0)
    # ln m = 2 artanh((m - 1)/(m + 1)), |(m - 1)/(m + 1)| < 0.172
    f = (mantissa - 1.0) / (mantissa + 1.0)
    f2 = f * f
    series = f2 * (
        3.3333333333333333e-01
        + f2
        * (
            0.2
            + f2
            * (
                1.4285714285714285e-01
                + f2
                * (
                    1.1111111111111111e-01
                    + f2
                    * (
                        9.0909090909090912e-02
                        + f2
                        * (
                            7.6923076923076927e-02
                            + f2
                            * (
                                6.6666666666666666e-02
                                + f2 * (5.8823529411764705e-02 + f2 * 5.2631578947368418e-02)
                            )
                        )
                    )
                )
            )
        )
    )
    return k * _LN2_HIGH + (2.0 * (f + f * series) + k * _LN2_LOW)
