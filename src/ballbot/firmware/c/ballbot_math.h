/*
 * Sine, cosine, exponential, power, square root and arctangent in single precision.
 *
 * Every processor gives the same bits: only additions, multiplications, divisions and integers are used, each of which
 * IEEE 754 or C defines to the bit. Build with -ffp-contract=off, so that no compiler fuses a multiplication and an
 * addition. Nothing is read but the arguments, nothing is kept, and every loop is bounded.
 *
 * Errors are in units in the last place (ulp) of the exact result. They are the largest over all arguments that the
 * function accepts; the power and the arctangent, which have two, were measured at random ones
 * (`python -m campaigns.evidence firmware_math`).
 */
#ifndef BALLBOT_MATH_H
#define BALLBOT_MATH_H

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
 * Return the square root of x.
 *
 * The error is below 1 ulp. A negative x counts as zero. Infinity and NaN stay.
 */
float ballbot_square_root(float x);

/*
 * Return the angle of the point (x, y) from the x axis [rad], -pi to pi.
 *
 * The error is at most 2.5 ulp for |x| and |y| below 2^126. The angle of (0, 0) is 0. It is NaN if x or y is NaN or both
 * are infinite.
 */
float ballbot_arctangent(float y, float x);

/* Return the magnitude of x. */
float ballbot_magnitude(float x);

#endif
