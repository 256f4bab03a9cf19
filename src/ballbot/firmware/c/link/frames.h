/* Frames: messages to bytes and back, with every check that a frame must pass.
 *
 * On the wire a frame is COBS(payload) and a zero byte. The payload is, little-endian,
 *
 *     version u8 | type u8 | session u32 | sequence u16 | body | CRC-32 of all before u32
 *
 * A body is a struct of ballbot_messages.h as a little-endian processor has it in memory.
 */
#ifndef BALLBOT_FRAMES_H
#define BALLBOT_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "link/ballbot_messages.h"

/* Bytes of the longest frame with its zero. */
#define BALLBOT_FRAME_ROOM (BALLBOT_LONGEST_FRAME + 1u)

/* A frame that has passed the layers up to the version; its body lies in the receiver until the next byte. */
struct ballbot_frame {
    uint8_t type;
    uint32_t session;
    uint16_t sequence;
    const uint8_t *body;
    size_t length; /* of the body */
};

/* Collects the bytes of a frame; zeros at the start. */
struct ballbot_receiver {
    uint8_t bytes[BALLBOT_LONGEST_FRAME];
    size_t count;
    bool too_long;
};

/* What a byte completed. */
enum ballbot_received {
    BALLBOT_RECEIVED_NOTHING = 0,
    BALLBOT_RECEIVED_FRAME = 1,
    BALLBOT_RECEIVED_REFUSED = 2
};

/* Take a byte. `frame` is filled if that completes one; `refused` has the layer if it was refused. */
enum ballbot_received ballbot_receiver_take(struct ballbot_receiver *receiver, uint8_t byte, struct ballbot_frame *frame,
                                            enum ballbot_layer *refused);

/* Fill the frame of a message, with its zero; return how many bytes it has.
 *
 * body: the message's struct of `length` bytes; NULL without one. coded: room for BALLBOT_FRAME_ROOM bytes.
 */
size_t ballbot_frame_encode(enum ballbot_message type, uint32_t session, uint16_t sequence, const void *body,
                            size_t length, uint8_t *coded);

/* Return whether a sequence number comes after the last one: by 1 to BALLBOT_SEQUENCE_WINDOW, modulo 2^16. */
bool ballbot_is_newer(uint16_t sequence, uint16_t last);

/* Copy the bytes of a body into its struct. */
void ballbot_copy_bytes(void *to, const uint8_t *from, size_t count);

#endif
