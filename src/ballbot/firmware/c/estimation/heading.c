/* Generated from ballbot/estimation/heading.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Unwrap headings sample by sample: a jump from pi to -pi, or from 2 pi to 0, is not a motion.
 *
 * A jump of more than JUMP between two successive values within one turn (-pi to pi, or 0 to 2 pi) is a wrap: the
 * heading continues by the shorter way. A smaller jump is a motion, so that a commanded step of pi keeps its sign. Values
 * beyond one turn count turns by themselves and stay as they are.
 */
#include "estimation/heading.h"

#define TURN 6.2831855f
/* noise that may carry a value beyond one turn [rad] */
#define NOISE 0.1f
/* the smallest jump that is a wrap [rad], as in a log */
#define JUMP 4.712389f
/* a turn in single precision, and what it lacks [rad] */
#define SINGLE_TURN 6.2831855f
/* a turn in single precision, and what it lacks [rad] */
#define LACKING (-1.7484555e-07f)

/* Return the whole turns to add to a heading [rad], from the value before it and the turns added to that. */
int32_t ballbot_turns_after(float angle, float last, int32_t turns)
{
    const float low = ballbot_smaller(angle, last);
    const float high = ballbot_larger(angle, last);

    if (angle < -0.5f * TURN - NOISE || angle > TURN + NOISE) {
        return 0;
    }
    const bool about_zero = low >= -0.5f * TURN - NOISE && high <= 0.5f * TURN + NOISE;
    const bool above_zero = low >= -NOISE && high <= TURN + NOISE;

    if (high - low > JUMP && (about_zero || above_zero)) {
        return (angle < last) ? turns + 1 : turns - 1;
    }
    return turns;
}

/* Return the next value of a heading [rad] without a jump of a turn; the memory is zero before the first one. */
float ballbot_unwrapped(struct ballbot_heading_memory *memory, float angle)
{
    const float last = (memory->started == 1) ? memory->last : angle;

    memory->turns = ballbot_turns_after(angle, last, memory->turns);
    memory->last = angle;
    memory->started = 1;
    return angle + SINGLE_TURN * (float)memory->turns + LACKING * (float)memory->turns;
}
