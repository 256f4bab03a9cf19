/* Included before all else: the firmware in double precision, with records of 8 bytes a number and the functions of the
 * C library in place of ballbot_math.h.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define BALLBOT_DOUBLE
#define float double
#define int32_t int64_t

#define BALLBOT_MATH_H
static inline float ballbot_magnitude(float x)
{
    return fabs(x);
}

static inline float ballbot_smaller(float a, float b)
{
    return (a < b) ? a : b;
}

static inline float ballbot_larger(float a, float b)
{
    return (a > b) ? a : b;
}

static inline float ballbot_square_root(float x)
{
    return sqrt((x < 0.0) ? 0.0 : x);
}

static inline float ballbot_exponential(float x)
{
    return exp(x);
}

static inline float ballbot_power(float base, float exponent)
{
    return pow(base, exponent);
}

static inline void ballbot_sine_cosine(float angle, float *sine, float *cosine)
{
    *sine = sin(angle);
    *cosine = cos(angle);
}

static inline float ballbot_hyperbolic_tangent(float x)
{
    return tanh(x);
}

static inline float ballbot_arctangent(float y, float x)
{
    return atan2(y, x);
}

static inline float ballbot_within_half_turn(float angle)
{
    return remainder(angle, 6.283185307179586);
}

static inline float ballbot_not_a_number(void)
{
    return NAN;
}
