#include "drivers/quadrature.h"

int32_t ballbot_quadrature_count(struct ballbot_quadrature *encoder, uint16_t counter)
{
    const uint16_t forward = (uint16_t)(counter - encoder->counter);
    const uint16_t gone = encoder->reversed ? (uint16_t)(0u - forward) : forward;
    /* of 16 bits with a sign, as 32 */
    const uint32_t change = (gone < 0x8000u) ? gone : (0xFFFF0000u | gone);

    if (encoder->started) {
        encoder->count = (int32_t)((uint32_t)encoder->count + change);
    }
    encoder->counter = counter;
    encoder->started = true;
    return encoder->count;
}
