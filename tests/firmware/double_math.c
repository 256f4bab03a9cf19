/* The C library's functions in place of ballbot_math.c, in double precision. */
#include <math.h>

#include "ballbot_math.h"

void ballbot_sine_cosine(float angle, float *sine, float *cosine)
{
    *sine = sin(angle);
    *cosine = cos(angle);
}

float ballbot_exponential(float x)
{
    return exp(x);
}

float ballbot_power(float base, float exponent)
{
    return pow(base, exponent);
}

float ballbot_square_root(float x)
{
    return sqrt(x);
}
