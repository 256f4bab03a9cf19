#include "drivers/escon.h"

#include <float.h>

#include "parts/part.h"

#define NO_CURRENT 0.5f
#define SPAN 0.4f

float ballbot_escon_duty(const struct ballbot_escon *driver, float torque)
{
    const float most = driver->torque_per_ampere * driver->current_range;

    /* both comparisons fail for a NaN */
    if (!(ballbot_magnitude(torque) <= FLT_MAX) || !(ballbot_magnitude(most) > 0.0f)) {
        return NO_CURRENT;
    }
    return NO_CURRENT + SPAN * ballbot_clipped(torque / most, 1.0f);
}
