/* What both estimators ask of a reading. */
#ifndef BALLBOT_ESTIMATION_KNOWN_H
#define BALLBOT_ESTIMATION_KNOWN_H

#include "ballbot_math.h"

#include <stdint.h>

/* a value beyond this is not a sensor's: angles [rad], speeds [rad/s] */
#define BALLBOT_LARGEST_READING 1.0e6f

/* Return whether a sensor's value is valid: a number, and within a sensor's range. */
static inline int32_t ballbot_known(float value)
{
    return (ballbot_magnitude(value) <= BALLBOT_LARGEST_READING) ? 1 : 0;
}

/* Return whether all of a sensor's values are valid. */
static inline int32_t ballbot_all_known(const float *values, int32_t count)
{
    int32_t all = 1;
    for (int32_t i = 0; i < count; ++i) {
        all &= ballbot_known(values[i]);
    }
    return all;
}

#endif
