/* Notch: a narrow band about a resonance is taken out of each wheel's torque.
 *
 *     (b_0 + b_1/z + b_2/z^2) / (1 + a_1/z + a_2/z^2)      transposed direct form II
 */
#include "parts/parts.h"

float ballbot_notch_filter(const struct ballbot_law *law, struct ballbot_memory *memory, float torque, int32_t i)
{
    const struct ballbot_notch_record *own = &law->notch;
    float *delayed = memory->notch.delayed[i];

    if (own->on == 0) {
        return torque;
    }
    const float left = own->b_0 * torque + delayed[0];
    delayed[0] = own->b_1 * torque - own->a_1 * left + delayed[1];
    delayed[1] = own->b_2 * torque - own->a_2 * left;
    return left;
}
