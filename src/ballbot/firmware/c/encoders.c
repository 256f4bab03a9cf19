#include "encoders.h"

#include <stddef.h>

/* Largest count of missed samples; beyond it a float skips whole numbers. */
#define MOST_MISSED 0x1000000

/* Return how far a count went; the counter wraps around. */
static int32_t gone(int32_t now, int32_t before)
{
    return (int32_t)((uint32_t)now - (uint32_t)before);
}

void ballbot_take_encoders(struct ballbot_encoders *encoders, const struct ballbot_parameters *parameters,
                           const int32_t counts[], struct ballbot_reading_record *reading)
{
    const float time = parameters->sample_time * (float)(1 + encoders->missed);

    reading->encoders_valid = (counts != NULL) ? 1 : 0;
    for (int32_t i = 0; i < parameters->wheel_count && i < BALLBOT_MAX_WHEELS; ++i) {
        if (counts == NULL) {
            reading->wheel_speeds[i] = BALLBOT_MISSING;
            continue;
        }
        const int32_t steps = encoders->started ? gone(counts[i], encoders->counts[i]) : 0;

        reading->wheel_counts[i] = counts[i];
        reading->wheel_speeds[i] = parameters->encoder_step * (float)steps / time;
        encoders->counts[i] = counts[i];
    }
    if (counts != NULL || !encoders->started) {
        encoders->missed = 0;
    } else if (encoders->missed < MOST_MISSED) {
        encoders->missed += 1;
    } else {
        /* a robot at rest whose encoders have been off for days */
    }
    encoders->started = encoders->started || counts != NULL;
}
