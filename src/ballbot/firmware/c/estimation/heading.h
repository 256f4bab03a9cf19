/* Generated from ballbot/estimation/heading.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Unwrapped headings.
 */
#ifndef BALLBOT_HEADING_H
#define BALLBOT_HEADING_H

#include <stdbool.h>

#include "ballbot_math.h"
#include "ballbot_types.h"
#include "compensated_sum.h"

/* Return the whole turns to add to a heading [rad], from the value before it and the turns added to that. */
int32_t ballbot_turns_after(float angle, float last, int32_t turns);

/* Return the next value of a heading [rad] without a jump of a turn; the memory is zero before the first one. */
float ballbot_unwrapped(struct ballbot_heading_memory *memory, float angle);

#endif
