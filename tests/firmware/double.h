/* Included before all else: the law in double precision, with records of 8 bytes a number and the functions of the C
 * library in place of ballbot_math.h.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define float double
#define int32_t int64_t

#define BALLBOT_MATH_H
static inline float ballbot_magnitude(float x)
{
    return fabs(x);
}

static inline float ballbot_square_root(float x)
{
    return sqrt(x);
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
