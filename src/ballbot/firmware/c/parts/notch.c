/* Generated from ballbot/control/parts/notch.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * A notch: it removes a narrow band about a resonance from each wheel's torque.
 *
 *     H(s) = (s^2 + depth width w s + w^2) / (s^2 + width w s + w^2)        w = 2 pi frequency
 *
 * sampled by the bilinear transform with w prewarped. Slow torques pass unchanged in size but with a phase lag: well below
 * w it is about (1 - depth) width f / frequency [rad] at a frequency f, so a notch far above the loop's crossover is cheap
 * and one near it is not.
 */
#include "parts/steps.h"

/* Return a wheel's torque through the notch, and step its state. */
float ballbot_notched(const struct ballbot_law *law, struct ballbot_memory *memory, float torque, int32_t i)
{
    const struct ballbot_notch_record *own = &law->notch;
    float (*delayed)[2] = memory->notch.delayed;

    if (own->on == 0) {
        return torque;
    }
    const float left = own->b_0 * torque + delayed[i][0];

    delayed[i][0] = own->b_1 * torque - own->a_1 * left + delayed[i][1];
    delayed[i][1] = own->b_2 * torque - own->a_2 * left;
    return left;
}
