/* Authenticated datagrams, for a board with a network of its own: a frame and a truncated HMAC-SHA-256 under the robot's key.
 *
 *     frame | HMAC-SHA-256(key, direction | frame), the first BALLBOT_TAG bytes
 *
 * A board takes datagrams of other computers only if they pass ballbot_datagram_open, and then only from the address whose
 * `hello` it has answered. FIPS 180-4 and RFC 2104 describe the functions.
 */
#ifndef BALLBOT_DATAGRAM_H
#define BALLBOT_DATAGRAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Bytes of the truncated HMAC. */
#define BALLBOT_TAG 16u
/* Bytes of the longest key. */
#define BALLBOT_LONGEST_KEY 64u

/* Which way a datagram goes. */
#define BALLBOT_TO_ROBOT 0x52u
#define BALLBOT_TO_HOST 0x48u

/* The robot's key: 16 to BALLBOT_LONGEST_KEY bytes. */
struct ballbot_key {
    const uint8_t *bytes;
    size_t count;
};

/* Append the tag to a frame of `count` bytes, for which there must be room; return how many bytes the datagram has. */
size_t ballbot_datagram_seal(const struct ballbot_key *key, uint8_t direction, uint8_t *datagram, size_t count);

/* Return the length of the frame in a datagram; 0 if the datagram was not made with the key. */
size_t ballbot_datagram_open(const struct ballbot_key *key, uint8_t direction, const uint8_t *datagram, size_t count);

#endif
