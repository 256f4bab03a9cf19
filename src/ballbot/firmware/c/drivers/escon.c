#include "drivers/escon.h"

#define NO_CURRENT 0.5f
#define SPAN 0.4f

float ballbot_escon_duty(const struct ballbot_escon *driver, float torque)
{
    const float share = torque / (driver->torque_per_ampere * driver->current_range);

    if (share >= 1.0f) {
        return NO_CURRENT + SPAN;
    }
    if (share <= -1.0f) {
        return NO_CURRENT - SPAN;
    }
    return (share > -1.0f && share < 1.0f) ? NO_CURRENT + SPAN * share : NO_CURRENT; /* a NaN is in no range */
}
