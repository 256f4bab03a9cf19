/* Calls the functions of ballbot_math.h on arrays, so that Python can measure them. */
#include "ballbot_math.h"

#include <stddef.h>

void sine_cosine(size_t count, const float *angle, float *sine, float *cosine)
{
    for (size_t i = 0; i < count; ++i) {
        ballbot_sine_cosine(angle[i], &sine[i], &cosine[i]);
    }
}

/* A function of one argument, and one of two. */
#define OF_ONE(name) \
    void name(size_t count, const float *x, float *result) \
    { \
        for (size_t i = 0; i < count; ++i) { \
            result[i] = ballbot_##name(x[i]); \
        } \
    }
#define OF_TWO(name) \
    void name(size_t count, const float *a, const float *b, float *result) \
    { \
        for (size_t i = 0; i < count; ++i) { \
            result[i] = ballbot_##name(a[i], b[i]); \
        } \
    }

OF_ONE(exponential)
OF_ONE(square_root)
OF_ONE(hyperbolic_tangent)
OF_TWO(power)
OF_TWO(arctangent)
