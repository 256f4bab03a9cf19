/* Encoders: whole counts of each sample become those of a reading, and wheel speeds. */
#ifndef BALLBOT_ENCODERS_H
#define BALLBOT_ENCODERS_H

#include <stdbool.h>

#include "ballbot_types.h"

/* What is remembered; zeros at the start. */
struct ballbot_encoders {
    int32_t counts[BALLBOT_MAX_WHEELS]; /* when they were last there */
    int32_t missed;                     /* samples since then */
    bool started;
};

/* Fill the encoders' part of a reading: counts, and speeds [rad/s] differenced from the last counts.
 *
 * counts: of all wheels, in quadrature, positive if the wheel turns forward; they may wrap around. NULL if they are
 * missing: then the reading lacks them. The first speeds are zero: the robot stands still.
 */
void ballbot_take_encoders(struct ballbot_encoders *encoders, const struct ballbot_parameters *parameters,
                           const int32_t counts[], struct ballbot_reading_record *reading);

#endif
