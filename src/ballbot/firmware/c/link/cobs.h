/* COBS, consistent overhead byte stuffing: bytes without zeros, so that a zero can end a frame.
 *
 * S. Cheshire and M. Baker, "Consistent overhead byte stuffing", IEEE/ACM Transactions on Networking 7(2), 1999.
 */
#ifndef BALLBOT_COBS_H
#define BALLBOT_COBS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Most bytes that an encoding takes. */
#define BALLBOT_COBS_ROOM(count) ((count) + (count) / 254u + 1u)

/* Fill the encoding of `count` bytes, without a zero at its end; return how many bytes it has. */
size_t ballbot_cobs_encode(const uint8_t *bytes, size_t count, uint8_t *coded);

/* Decode `count` bytes in place and set `count` to what is left; return false if they are no encoding. */
bool ballbot_cobs_decode(uint8_t *bytes, size_t *count);

#endif
