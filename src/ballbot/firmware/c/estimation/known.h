/* Generated from ballbot/estimation/known.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * What both estimators ask of a reading.
 */
#ifndef BALLBOT_KNOWN_H
#define BALLBOT_KNOWN_H

#include <stdbool.h>

#include "ballbot_math.h"
#include "ballbot_types.h"
#include "compensated_sum.h"

/* a larger value is not a valid measurement: angles [rad], speeds [rad/s] */
#define LARGEST_READING 1e+06f

/* Return whether a sensor's value is valid: a number, and within a sensor's range. */
static inline bool ballbot_is_known(float value)
{
    return ballbot_magnitude(value) <= LARGEST_READING;
}

/* Return whether all of a sensor's values are valid. */
static inline bool ballbot_are_known(const float values[], int32_t count)
{
    for (int32_t i = 0; i < count; ++i) {
        if (!ballbot_is_known(values[i])) {
            return false;
        }
    }
    return true;
}

#endif
