#include "drivers/escon.h"

#include "parts/part.h"

#define NO_CURRENT 0.5f
#define SPAN 0.4f

float ballbot_escon_duty(const struct ballbot_escon *driver, float torque)
{
    const float share = ballbot_clipped(torque / (driver->torque_per_ampere * driver->current_range), 1.0f);

    return (ballbot_magnitude(share) <= 1.0f) ? NO_CURRENT + SPAN * share : NO_CURRENT; /* of a NaN it is not */
}
