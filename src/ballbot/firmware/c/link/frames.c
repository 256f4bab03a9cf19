#include "link/frames.h"

#include "link/cobs.h"
#include "link/crc32.h"

/* Places in a payload. */
#define SESSION 2u
#define SEQUENCE 6u
#define BODY 8u
/* Bytes of the CRC-32. */
#define CRC 4u

static uint32_t little_endian(const uint8_t *bytes, size_t count)
{
    uint32_t found = 0;

    for (size_t k = count; k > 0u; --k) {
        found = (found << 8) | bytes[k - 1u];
    }
    return found;
}

static void put_little_endian(uint8_t *bytes, uint32_t value, size_t count)
{
    for (size_t k = 0; k < count; ++k) {
        bytes[k] = (uint8_t)((value >> (8u * k)) & 0xFFu);
    }
}

void ballbot_copy_bytes(void *to, const uint8_t *from, size_t count)
{
    uint8_t *bytes = (uint8_t *)to;

    for (size_t k = 0; k < count; ++k) {
        bytes[k] = from[k];
    }
}

/* Fill the frame of the bytes between two zeros, decoded in place; return whether it was refused, and by which layer. */
static bool refuses(uint8_t *bytes, size_t coded, struct ballbot_frame *frame, enum ballbot_layer *layer)
{
    size_t count = coded;

    if (!ballbot_cobs_decode(bytes, &count)) {
        *layer = BALLBOT_LAYER_FRAMING;
        return true;
    }
    if (count < BALLBOT_FRAME_OVERHEAD || count > BALLBOT_LONGEST_PAYLOAD) {
        *layer = BALLBOT_LAYER_LENGTH;
        return true;
    }
    if (ballbot_crc32(bytes, count - CRC) != little_endian(&bytes[count - CRC], CRC)) {
        *layer = BALLBOT_LAYER_CHECKSUM;
        return true;
    }
    if (bytes[0] != BALLBOT_LINK_VERSION) {
        *layer = BALLBOT_LAYER_VERSION;
        return true;
    }
    frame->type = bytes[1];
    frame->session = little_endian(&bytes[SESSION], 4);
    frame->sequence = (uint16_t)little_endian(&bytes[SEQUENCE], 2);
    frame->body = &bytes[BODY];
    frame->length = count - BALLBOT_FRAME_OVERHEAD;
    return false;
}

enum ballbot_received ballbot_receiver_take(struct ballbot_receiver *receiver, uint8_t byte, struct ballbot_frame *frame,
                                            enum ballbot_layer *refused)
{
    const size_t count = receiver->count;
    const bool too_long = receiver->too_long;

    if (byte != 0u) {
        if (count < BALLBOT_LONGEST_FRAME) {
            receiver->bytes[count] = byte;
            receiver->count += 1u;
        } else {
            receiver->too_long = true;
        }
        return BALLBOT_RECEIVED_NOTHING;
    }
    receiver->count = 0;
    receiver->too_long = false;
    if (count == 0u) {
        return BALLBOT_RECEIVED_NOTHING;
    }
    if (too_long) {
        *refused = BALLBOT_LAYER_LENGTH;
        return BALLBOT_RECEIVED_REFUSED;
    }
    return refuses(receiver->bytes, count, frame, refused) ? BALLBOT_RECEIVED_REFUSED : BALLBOT_RECEIVED_FRAME;
}

size_t ballbot_frame_encode(enum ballbot_message type, uint32_t session, uint16_t sequence, const void *body,
                            size_t length, uint8_t *coded)
{
    uint8_t payload[BALLBOT_LONGEST_PAYLOAD];

    payload[0] = (uint8_t)BALLBOT_LINK_VERSION;
    payload[1] = (uint8_t)type;
    put_little_endian(&payload[SESSION], session, 4);
    put_little_endian(&payload[SEQUENCE], sequence, 2);
    ballbot_copy_bytes(&payload[BODY], (const uint8_t *)body, length);
    put_little_endian(&payload[BODY + length], ballbot_crc32(payload, BODY + length), CRC);

    const size_t count = ballbot_cobs_encode(payload, length + BALLBOT_FRAME_OVERHEAD, coded);

    coded[count] = 0u;
    return count + 1u;
}

bool ballbot_is_newer(uint16_t sequence, uint16_t last)
{
    const uint32_t step = ((uint32_t)sequence - (uint32_t)last) & 0xFFFFu;

    return step >= 1u && step <= BALLBOT_SEQUENCE_WINDOW;
}
