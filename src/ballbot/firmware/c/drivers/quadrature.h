/* Quadrature counters of 16 bits, as a timer of an STM32 has them, as counts of 32 bits.
 *
 * Read them at least once in 32767 counts: at 55200 counts of a wheel's turn (500 lines, gear 27.6) that is half a turn.
 */
#ifndef BALLBOT_DRIVERS_QUADRATURE_H
#define BALLBOT_DRIVERS_QUADRATURE_H

#include <stdbool.h>
#include <stdint.h>

struct ballbot_quadrature {
    bool reversed;    /* the counter counts down while the wheel turns forward */
    bool started;     /* false at the start */
    uint16_t counter; /* when it was last read */
    int32_t count;    /* modulo 2^32 */
};

/* Take what the counter shows; return the wheel's count, 0 at the first. */
int32_t ballbot_quadrature_count(struct ballbot_quadrature *encoder, uint16_t counter);

#endif
