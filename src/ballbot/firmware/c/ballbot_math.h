/*
 * Sine, cosine, exponential, power, hyperbolic tangent, arctangent and square root in single precision.
 *
 * Every processor gives the same bits: only additions, multiplications, divisions, roots and integers are used, each
 * of which IEEE 754 or C defines to the bit. Build with -fno-math-errno, so that a root is one instruction. Nothing is read but the arguments, nothing is kept,
 * and every loop is bounded.
 *
 * Errors are in units in the last place (ulp) of the exact result. The bounds hold at every 211th float that a function
 * accepts, and at millions of random pairs; `python -m campaigns.evidence firmware_math` measures every float.
 */
#ifndef BALLBOT_MATH_H
#define BALLBOT_MATH_H

/* No compiler may fuse a multiplication and an addition, here and in every source, each of which includes this header before it computes:
 * also where no options can be given, as on Arduino. GCC ignores the standard pragma, and when it vectorizes it fuses in spite of
 * -ffp-contract=off (GCC 12, x86-64 with FMA).
 */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off", "no-tree-vectorize")
#else
#pragma STDC FP_CONTRACT OFF
#endif

/* IEEE 754 defines root and magnitude to the bit; GNU C has them as instructions, without a library. */
#if defined(__GNUC__)
#define BALLBOT_SQUARE_ROOT(x) __builtin_sqrtf(x)
#define BALLBOT_MAGNITUDE(x) __builtin_fabsf(x)
#else
#include <math.h>
#define BALLBOT_SQUARE_ROOT(x) sqrtf(x)
#define BALLBOT_MAGNITUDE(x) fabsf(x)
#endif

/* Return the magnitude of x. */
static inline float ballbot_magnitude(float x)
{
    return BALLBOT_MAGNITUDE(x);
}

/* Return the smaller and the larger of two numbers; b if either is NaN. */
static inline float ballbot_smaller(float a, float b)
{
    return (a < b) ? a : b;
}

static inline float ballbot_larger(float a, float b)
{
    return (a > b) ? a : b;
}

/* Return the square root of x, the float nearest to it. A negative x counts as zero. NaN stays NaN. */
static inline float ballbot_square_root(float x)
{
    return BALLBOT_SQUARE_ROOT((x < 0.0f) ? 0.0f : x);
}

/*
 * Return the sine and the cosine of an angle [rad].
 *
 * Any finite angle is reduced soundly: it is multiplied by 192 bits of 2/pi in integers. The error is at most 2.5 ulp.
 * Both are NaN if the angle is NaN or infinite.
 */
void ballbot_sine_cosine(float angle, float *sine, float *cosine);

/*
 * Return e to the power of x.
 *
 * An x beyond +-87 counts as +-87: 1.6e-38 and 6.1e37. The error is at most 1.1 ulp. NaN stays NaN.
 */
float ballbot_exponential(float x);

/*
 * Return a base, zero or more, to the power of an exponent.
 *
 * The result is kept from 2^-125 to 2^125. Its relative error is at most 1.2 * 2^-23 (1 + |log2 result|). Zero to a positive
 * exponent is 0, to zero 1; a base below 2^-126 counts as zero, and so does a negative one. NaN stays NaN.
 */
float ballbot_power(float base, float exponent);

/*
 * Return the hyperbolic tangent of x.
 *
 * It is odd to the bit. The error is at most 1.6 ulp. NaN stays NaN.
 */
float ballbot_hyperbolic_tangent(float x);

/*
 * Return the angle of the point (x, y) from the x axis [rad], -pi to pi.
 *
 * The error is at most 2.5 ulp for |x| and |y| below 2^126. The angle of (0, 0) is 0. It is NaN if x or y is NaN or both
 * are infinite.
 */
float ballbot_arctangent(float y, float x);

/* Return an angle less its whole turns [rad]: at most half a turn to either side, and rounding. NaN stays NaN. */
float ballbot_within_half_turn(float angle);

/* Return a quiet NaN. */
float ballbot_not_a_number(void);

#endif
