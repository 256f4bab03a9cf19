/* What the parts of the control law work on, and what they share.
 *
 * A part has a record in `struct ballbot_law` and a state in `struct ballbot_memory`, both by its name, and a function
 * ballbot_NAME_STAGE for each stage of the law in which it does something (law.c calls them in order). A controller
 * that lacks a part has zeros in its record; its functions then return at once, or add zero.
 */
#ifndef BALLBOT_PART_H
#define BALLBOT_PART_H

#include <stdbool.h>
#include <stdint.h>

#include "attitude.h"
#include "ballbot_math.h"
#include "ballbot_types.h"

/* The reference of x, y or psi with its derivatives: [m] or [rad], and the same per s, s^2, s^3 and s^4. */
struct ballbot_smooth {
    float value;
    float rate;
    float second;
    float third;
    float fourth;
};

/* All that is known when the torques are computed.
 *
 * x, y and psi are relative to the measured pose: a difference of two places is rounded in proportion to itself, and
 * not to their distance from the origin. Without a prediction, x, y and psi of the state are therefore zero.
 */
struct ballbot_sample {
    float pose[3];               /* x, y [m] and psi [rad] as measured, psi unwrapped */
    const float *reference;      /* the state (10) that is asked for, psi unwrapped */
    struct ballbot_heading a;    /* of the state */
    float state[10];             /* measured; predicted after the stage `predict`; relative to the pose */
    struct ballbot_smooth x;     /* the reference that is followed, relative to the pose */
    struct ballbot_smooth y;
    struct ballbot_smooth psi;
    float e[10];                 /* error, heading frame */
    bool error_limited;          /* whether a part reduced it */
};

/* Numbers of a setting, and where the one after the weights of the other gains stands. */
#define BALLBOT_TUNING_NUMBERS BALLBOT_MAX_GAINS
#define BALLBOT_TUNING_COMPENSATION (BALLBOT_MAX_GAINS - 1)

/* Return the share that a reduction leaves, 0 to 1: whatever a memory holds, no compensation is above the exported one. */
static inline float ballbot_share(float reduction)
{
    const float share = 1.0f - reduction;

    if (!(share > 0.0f)) {
        return 0.0f;
    }
    return (share < 1.0f) ? share : 1.0f;
}

/* Return a value within -limit .. limit; NaN stays NaN. */
static inline float ballbot_clipped(float value, float limit)
{
    if (value > limit) {
        return limit;
    }
    return (value < -limit) ? -limit : value;
}

static inline float ballbot_smaller(float a, float b)
{
    return (a < b) ? a : b;
}

static inline float ballbot_larger(float a, float b)
{
    return (a > b) ? a : b;
}

#endif
