/* The C side's codec behind functions that a test can call: all frames of a stream, and encodings. */
#include "link/frames.h"

/* A frame as it was received. */
struct found {
    uint32_t type;
    uint32_t session;
    uint32_t sequence;
    uint32_t length;
    uint8_t body[BALLBOT_LONGEST_PAYLOAD];
};

size_t decode_stream(const uint8_t *bytes, size_t count, struct found found[], uint32_t refused[BALLBOT_LAYERS]);
size_t encode_frame(uint32_t type, uint32_t session, uint32_t sequence, const uint8_t *body, size_t length,
                    uint8_t *coded);

size_t decode_stream(const uint8_t *bytes, size_t count, struct found found[], uint32_t refused[BALLBOT_LAYERS])
{
    struct ballbot_receiver receiver = { .count = 0 };
    size_t frames = 0;

    for (size_t k = 0; k < count; ++k) {
        struct ballbot_frame frame;
        enum ballbot_layer layer = BALLBOT_LAYER_FRAMING;
        const enum ballbot_received received = ballbot_receiver_take(&receiver, bytes[k], &frame, &layer);

        if (received == BALLBOT_RECEIVED_REFUSED) {
            refused[layer] += 1u;
        }
        if (received == BALLBOT_RECEIVED_FRAME) {
            found[frames].type = frame.type;
            found[frames].session = frame.session;
            found[frames].sequence = frame.sequence;
            found[frames].length = (uint32_t)frame.length;
            ballbot_copy_bytes(found[frames].body, frame.body, frame.length);
            frames += 1u;
        }
    }
    return frames;
}

size_t encode_frame(uint32_t type, uint32_t session, uint32_t sequence, const uint8_t *body, size_t length,
                    uint8_t *coded)
{
    return ballbot_frame_encode((enum ballbot_message)type, session, (uint16_t)sequence, body, length, coded);
}
