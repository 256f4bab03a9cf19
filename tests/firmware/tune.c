/* Reads parameters, then for each sample a command with the numbers of a setting and a reading; writes the answer's result and
 * the torques. Built with the sanitizers, which a shared library inside Python cannot have.
 */
#include <stdio.h>

#include "link/link.h"

/* What comes before each sample. */
struct sample {
    int32_t type; /* of a message, or 0 */
    struct ballbot_message_tune setting;
    struct ballbot_reading_record reading;
};

#define SESSION 7u

/* Return the result in the answer among the frames that are sent; -1 without one. */
static int32_t answer_in(const struct ballbot_link *link)
{
    static struct ballbot_receiver receiver;
    struct ballbot_message_answer answer = { .result = -1 };

    for (size_t k = 0; k < link->out_count; ++k) {
        struct ballbot_frame frame;
        enum ballbot_layer layer;

        if (ballbot_receiver_take(&receiver, link->out[k], &frame, &layer) == BALLBOT_RECEIVED_FRAME &&
            frame.type == (uint8_t)BALLBOT_MESSAGE_ANSWER) {
            ballbot_copy_bytes(&answer, frame.body, sizeof answer);
        }
    }
    return answer.result;
}

int main(void)
{
    static struct ballbot_parameters parameters;
    static struct ballbot_state state;
    static struct ballbot_link link;
    struct sample sample;
    uint16_t sequence = 0;

    if (fread(&parameters, sizeof parameters, 1, stdin) != 1 || !ballbot_init(&state, &parameters)) {
        return 1;
    }
    ballbot_link_init(&link, &parameters, 0, 1);
    link.session = SESSION;
    ballbot_skip_self_test(&state);
    for (uint32_t time = 0; fread(&sample, sizeof sample, 1, stdin) == 1; time += 5000u) {
        uint8_t bytes[BALLBOT_LONGEST_FRAME + 1];
        float torques[BALLBOT_MAX_WHEELS];
        const size_t length = (sample.type == BALLBOT_MESSAGE_TUNE) ? sizeof sample.setting : 0u;

        link.out_count = 0;
        if (sample.type == BALLBOT_MESSAGE_ARM) {
            (void)ballbot_arm(&state);
        } else if (sample.type != 0) {
            sequence += 1u;
            const size_t count = ballbot_frame_encode((enum ballbot_message)sample.type, SESSION, sequence, &sample.setting,
                                                      length, bytes);

            ballbot_link_receive(&link, &state, &parameters, bytes, count, time);
        } else {
            /* a sample without a command */
        }
        const int32_t result = answer_in(&link);

        (void)ballbot_link_update(&link, &state, &parameters, &sample.reading, time, torques);
        if (fwrite(&result, sizeof result, 1, stdout) != 1 || fwrite(torques, sizeof torques, 1, stdout) != 1 ||
            fwrite(&state.memory.tuning, sizeof state.memory.tuning, 1, stdout) != 1) {
            return 1;
        }
    }
    return 0;
}
