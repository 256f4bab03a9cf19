/* Calls the functions of ballbot_math.h on arrays, so that Python can measure them. */
#include "ballbot_math.h"

#include <stddef.h>

void sine_cosine(size_t count, const float *angle, float *sine, float *cosine)
{
    for (size_t i = 0; i < count; ++i) {
        ballbot_sine_cosine(angle[i], &sine[i], &cosine[i]);
    }
}

void exponential(size_t count, const float *x, float *result)
{
    for (size_t i = 0; i < count; ++i) {
        result[i] = ballbot_exponential(x[i]);
    }
}

void power(size_t count, const float *base, const float *exponent, float *result)
{
    for (size_t i = 0; i < count; ++i) {
        result[i] = ballbot_power(base[i], exponent[i]);
    }
}

void square_root(size_t count, const float *x, float *result)
{
    for (size_t i = 0; i < count; ++i) {
        result[i] = ballbot_square_root(x[i]);
    }
}

void arctangent(size_t count, const float *y, const float *x, float *result)
{
    for (size_t i = 0; i < count; ++i) {
        result[i] = ballbot_arctangent(y[i], x[i]);
    }
}
