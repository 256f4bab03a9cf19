#include "link/commands.h"

#include "link/crc32.h"
#include "parts/part.h"

/* Return a number in which every bit depends on every bit of another: the end of MurmurHash3. */
static uint32_t scattered(uint32_t value)
{
    uint32_t bits = value;

    bits ^= bits >> 16;
    bits *= 0x85EBCA6Bu;
    bits ^= bits >> 13;
    bits *= 0xC2B2AE35u;
    bits ^= bits >> 16;
    return bits;
}

void ballbot_link_mix(struct ballbot_link *link, uint32_t value)
{
    link->mixed = scattered(link->mixed + 0x9E3779B9u) ^ scattered(value);
}

uint32_t ballbot_link_new_number(struct ballbot_link *link, uint32_t time)
{
    ballbot_link_mix(link, time);
    ballbot_link_mix(link, link->host);
    return (link->mixed != 0u) ? link->mixed : 1u;
}

void ballbot_link_send(struct ballbot_link *link, enum ballbot_message type, uint32_t session, const void *body, size_t length)
{
    if (sizeof link->out - link->out_count < BALLBOT_FRAME_ROOM) {
        link->dropped += 1u;
        return;
    }
    link->sequence = (uint16_t)((link->sequence + 1u) & 0xFFFFu);
    link->out_count +=
        ballbot_frame_encode(type, session, link->sequence, body, length, &link->out[link->out_count]);
}

void ballbot_link_answer(struct ballbot_link *link, const struct ballbot_frame *frame, enum ballbot_result result, uint32_t value)
{
    const struct ballbot_message_answer body = { .command = (int32_t)frame->type,
                                                 .sequence = (int32_t)frame->sequence,
                                                 .result = (int32_t)result,
                                                 .value = (int32_t)value };

    ballbot_link_send(link, BALLBOT_MESSAGE_ANSWER, link->session, &body, sizeof body);
}

/* Take the first or the second step of arming. */
static void arm(struct ballbot_link *link, struct ballbot_state *state, const struct ballbot_frame *frame, uint32_t time)
{
    struct ballbot_message_arm asked;
    const int32_t nonce = link->nonce;

    ballbot_copy_bytes(&asked, frame->body, sizeof asked);
    if (ballbot_is_active(state)) {
        ballbot_link_answer(link, frame, BALLBOT_RESULT_ACTIVE, 0);
    } else if (ballbot_self_test_of(state) != BALLBOT_TEST_PASSED) {
        ballbot_link_answer(link, frame, BALLBOT_RESULT_SELF_TEST, 0);
    } else if (asked.nonce == 0) {
        link->nonce = (int32_t)ballbot_link_new_number(link, time);
        link->asked_controller = asked.controller;
        link->asked_ramp = asked.ramp;
        link->asked = time;
        link->confirmed = false;
        ballbot_link_answer(link, frame, BALLBOT_RESULT_CONFIRM, (uint32_t)link->nonce);
    } else if (asked.nonce != nonce || asked.controller != link->asked_controller ||
               time - link->asked > BALLBOT_LINK_CONFIRMATION) {
        link->nonce = 0; /* one attempt */
        ballbot_link_answer(link, frame, BALLBOT_RESULT_NONCE, 0);
    } else if (((uint32_t)link->capabilities & (uint32_t)BALLBOT_CAPABILITY_BUTTON) != 0u && !link->confirmed) {
        ballbot_link_answer(link, frame, BALLBOT_RESULT_BUTTON, 0);
    } else {
        link->nonce = 0;
        link->governs = ballbot_arm(state);
        link->controller = asked.controller;
        link->ramp = link->asked_ramp;
        link->armed_time = time;
        link->reference_new = false;
        link->torques_time = time;
        for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
            link->torques[i] = 0.0f;
        }
        ballbot_link_answer(link, frame, link->governs ? BALLBOT_RESULT_OK : BALLBOT_RESULT_SELF_TEST, 0);
    }
}

/* Send a part of the parameters. */
static void read_part(struct ballbot_link *link, const struct ballbot_parameters *parameters,
                      const struct ballbot_frame *frame)
{
    struct ballbot_message_read part;
    struct ballbot_message_parameters body = { .offset = 0 };

    ballbot_copy_bytes(&part, frame->body, sizeof part);
    body.offset = part.offset;
    body.count = part.count;
    ballbot_copy_bytes(body.words, &((const uint8_t *)parameters)[4u * (size_t)part.offset], 4u * (size_t)part.count);
    ballbot_link_send(link, BALLBOT_MESSAGE_PARAMETERS, link->session, &body, sizeof body);
}

/* Write a part of the parameters into the copy. */
static void write_part(struct ballbot_link *link, const struct ballbot_frame *frame)
{
    struct ballbot_message_write part;

    ballbot_copy_bytes(&part, frame->body, sizeof part);
    ballbot_copy_bytes(&((uint8_t *)&link->written)[4u * (size_t)part.offset], (const uint8_t *)part.words,
                       4u * (size_t)part.count);
    ballbot_link_answer(link, frame, BALLBOT_RESULT_OK, 0);
}

/* Use the copy of the parameters if it is whole, allowed and of a robot with the same wheels and sample time. */
static void commit(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                   const struct ballbot_frame *frame)
{
    const struct ballbot_parameters *written = &link->written;
    const uint32_t crc = ballbot_crc32((const uint8_t *)written, sizeof *written);
    int32_t refused = ballbot_refused(written);
    struct ballbot_message_commit wanted;

    ballbot_copy_bytes(&wanted, frame->body, sizeof wanted);
    if (refused == (int32_t)BALLBOT_REFUSED_NOT &&
        (written->wheel_count != parameters->wheel_count || written->sample_time < parameters->sample_time ||
         written->sample_time > parameters->sample_time)) {
        refused = (int32_t)BALLBOT_REFUSED_ROBOT;
    }
    if ((uint32_t)wanted.crc != crc) {
        ballbot_link_answer(link, frame, BALLBOT_RESULT_CHECKSUM, crc);
    } else if (refused != (int32_t)BALLBOT_REFUSED_NOT) {
        ballbot_link_answer(link, frame, BALLBOT_RESULT_PARAMETERS, (uint32_t)refused);
    } else {
        const bool imu_checked = state->imu_check.passed == 1; /* the IMU is the same */

        *parameters = *written;
        (void)ballbot_init(state, parameters);
        if (imu_checked) {
            ballbot_skip_imu_check(state);
        }
        ballbot_link_answer(link, frame, BALLBOT_RESULT_OK, crc);
    }
}

/* Return why a setting is refused, if it is. */
static enum ballbot_result refused_setting(const struct ballbot_tuning_record *own, const struct ballbot_message_tune *asked)
{
    float sum = 0.0f;

    for (int k = 0; k < BALLBOT_MAX_GAINS; ++k) {
        const float most = (k <= own->others) ? 1.0f : 0.0f;

        if (!(asked->weights[k] >= 0.0f && asked->weights[k] <= most)) {
            return BALLBOT_RESULT_GAINS;
        }
        sum += asked->weights[k];
    }
    if (ballbot_magnitude(sum - 1.0f) > BALLBOT_LINK_ROUNDING) {
        return BALLBOT_RESULT_GAINS;
    }
    return (asked->compensation >= 0.0f && asked->compensation <= own->compensation) ? BALLBOT_RESULT_OK :
                                                                                       BALLBOT_RESULT_COMPENSATION;
}

/* Take a setting that is not refused; the same again, when an answer was lost, leaves the former one. */
static void take_setting(struct ballbot_tuning_state *tuning, const struct ballbot_message_tune *asked)
{
    float wanted[BALLBOT_TUNING_NUMBERS]; /* every one is filled */
    bool same = true;

    for (int k = 1; k < BALLBOT_MAX_GAINS; ++k) {
        wanted[k - 1] = asked->weights[k];
    }
    wanted[BALLBOT_TUNING_COMPENSATION] = 1.0f - asked->compensation;
    for (int k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
        same = same && ballbot_magnitude(wanted[k] - tuning->wanted[k]) <= 0.0f;
    }
    for (int k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
        tuning->former[k] = same ? tuning->former[k] : tuning->wanted[k];
        tuning->wanted[k] = wanted[k];
    }
}

/* Change the law's setting while it balances, or return to the former one, with no more compensation than is certain. */
static void tune(struct ballbot_link *link, struct ballbot_state *state, const struct ballbot_parameters *parameters,
                 const struct ballbot_frame *frame)
{
    const struct ballbot_tuning_record *own = &parameters->law.tuning;
    struct ballbot_tuning_state *tuning = &state->memory.tuning;
    enum ballbot_result result = BALLBOT_RESULT_OK;
    struct ballbot_message_tune asked;

    if (state->run.armed == 0 || !ballbot_is_active(state) || link->controller != (int32_t)BALLBOT_CONTROLLER_ROBOT) {
        result = BALLBOT_RESULT_DISARMED;
    } else if (frame->type == (uint8_t)BALLBOT_MESSAGE_TUNE) {
        ballbot_copy_bytes(&asked, frame->body, sizeof asked);
        result = refused_setting(own, &asked);
        if (result == BALLBOT_RESULT_OK) {
            take_setting(tuning, &asked);
        }
    } else {
        for (int k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
            tuning->wanted[k] = tuning->former[k];
        }
        tuning->wanted[BALLBOT_TUNING_COMPENSATION] =
            ballbot_larger(tuning->wanted[BALLBOT_TUNING_COMPENSATION], 1.0f - own->compensation);
    }
    ballbot_link_answer(link, frame, result, (uint32_t)state->run.time);
}

/* Send the counts of frames. */
static void send_counts(struct ballbot_link *link)
{
    struct ballbot_message_counts body = { .accepted = (int32_t)link->accepted, .dropped = (int32_t)link->dropped };

    for (int k = 0; k < BALLBOT_LAYERS; ++k) {
        body.refused[k] = (int32_t)link->refused[k];
    }
    ballbot_link_send(link, BALLBOT_MESSAGE_COUNTS, link->session, &body, sizeof body);
}

/* Obey a command that is refused while the robot is active. */
static void obey_at_rest(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                         const struct ballbot_frame *frame)
{
    if (ballbot_is_active(state)) {
        ballbot_link_answer(link, frame, BALLBOT_RESULT_ACTIVE, 0);
    } else if (frame->type == (uint8_t)BALLBOT_MESSAGE_WRITE) {
        write_part(link, frame);
    } else if (frame->type == (uint8_t)BALLBOT_MESSAGE_COMMIT) {
        commit(link, state, parameters, frame);
    } else {
        ballbot_start_self_test(state);
        link->ramp = 0.0f; /* of an arming that has ended */
        link->governs = true;
        ballbot_link_answer(link, frame, BALLBOT_RESULT_OK, 0);
    }
}

void ballbot_link_obey(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                 const struct ballbot_frame *frame, uint32_t time)
{
    switch ((enum ballbot_message)frame->type) {
    case BALLBOT_MESSAGE_ARM:
        arm(link, state, frame, time);
        break;
    case BALLBOT_MESSAGE_DISARM:
        ballbot_disarm(state);
        ballbot_link_answer(link, frame, BALLBOT_RESULT_OK, 0);
        break;
    case BALLBOT_MESSAGE_REFERENCE:
        ballbot_copy_bytes(link->reference, frame->body, sizeof link->reference);
        link->reference_new = true;
        break;
    case BALLBOT_MESSAGE_TORQUES:
        ballbot_copy_bytes(link->torques, frame->body, sizeof link->torques);
        link->torques_time = time;
        break;
    case BALLBOT_MESSAGE_READ:
        read_part(link, parameters, frame);
        break;
    case BALLBOT_MESSAGE_SELF_TEST:
    case BALLBOT_MESSAGE_WRITE:
    case BALLBOT_MESSAGE_COMMIT:
        obey_at_rest(link, state, parameters, frame);
        break;
    case BALLBOT_MESSAGE_ASK_COUNTS:
        send_counts(link);
        break;
    case BALLBOT_MESSAGE_TUNE:
    case BALLBOT_MESSAGE_STEP_BACK:
        tune(link, state, parameters, frame);
        break;
    case BALLBOT_MESSAGE_KEEP:
    default:
        break;
    }
}
