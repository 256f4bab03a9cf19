#include "link/link.h"

#include <float.h>
#include <stddef.h>

#include "ballbot_math.h"
#include "law.h"
#include "link/commands.h"
#include "parts/part.h"

/* Words of the parameters. */
#define WORDS ((int32_t)(sizeof(struct ballbot_parameters) / sizeof(int32_t)))

void ballbot_link_init(struct ballbot_link *link, const struct ballbot_parameters *parameters, int32_t capabilities,
                       uint32_t starts)
{
    uint8_t *bytes = (uint8_t *)link;

    for (size_t k = 0; k < sizeof *link; ++k) {
        bytes[k] = 0u;
    }
    link->mixed = 0x9E3779B9u ^ starts;
    link->state_every = 1;
    link->capabilities = capabilities;
    link->written = *parameters;
}

void ballbot_link_confirm(struct ballbot_link *link)
{
    link->confirmed = link->nonce != 0;
}

void ballbot_link_release(struct ballbot_link *link)
{
    link->governs = false;
    link->controller = (int32_t)BALLBOT_CONTROLLER_ROBOT;
    link->ramp = 0.0f;
}

static void refuse(struct ballbot_link *link, enum ballbot_layer layer)
{
    link->refused[layer] += 1u;
}

/* Remember the host's last frame. */
static void listen(struct ballbot_link *link, const struct ballbot_frame *frame, uint32_t time)
{
    link->last = frame->sequence;
    link->heard = time;
}

/* Return whether two digests are the same. */
static bool are_same(const int32_t a[], const int32_t b[])
{
    bool same = true;

    for (int k = 0; k < 8; ++k) {
        same = same && a[k] == b[k];
    }
    return same;
}

/* Take the handshake of a host: with the number of the open session it is a repetition, with another it opens a new one. */
static void greet(struct ballbot_link *link, const struct ballbot_state *state,
                  const struct ballbot_parameters *parameters, const struct ballbot_frame *frame, uint32_t time)
{
    static const int32_t firmware[] = BALLBOT_SCHEMA_WORDS;
    static const int32_t messages[] = BALLBOT_MESSAGE_WORDS;
    struct ballbot_message_hello hello;
    struct ballbot_message_welcome welcome = { .wheel_count = parameters->wheel_count,
                                               .sample_time = parameters->sample_time,
                                               .capabilities = link->capabilities };
    const bool again = link->session != 0u && frame->session == link->host;
    const float most = BALLBOT_LINK_STATE_INTERVAL / parameters->sample_time;

    ballbot_copy_bytes(&hello, frame->body, sizeof hello);
    if (again && !ballbot_is_newer(frame->sequence, link->last)) {
        refuse(link, BALLBOT_LAYER_SEQUENCE);
        return;
    }
    if (!again && ballbot_is_active(state)) { /* nobody takes a moving robot over */
        refuse(link, BALLBOT_LAYER_SESSION);
        return;
    }
    if (frame->session == 0u || hello.state_every < 1) {
        refuse(link, BALLBOT_LAYER_VALUES);
        return;
    }
    ballbot_copy_bytes(welcome.firmware, (const uint8_t *)firmware, sizeof firmware);
    ballbot_copy_bytes(welcome.messages, (const uint8_t *)messages, sizeof messages);
    link->accepted += 1u;
    if (are_same(hello.firmware, firmware) && are_same(hello.messages, messages)) {
        if (!again) {
            link->host = frame->session;
            link->session = ballbot_link_new_number(link, time);
            link->nonce = 0;
            link->written = *parameters;
        }
        listen(link, frame, time);
        link->state_every = ((float)hello.state_every > most) ? (int32_t)most : hello.state_every;
        link->state_every = (link->state_every < 1) ? 1 : link->state_every;
        link->state_due = 1;
        welcome.session = (int32_t)link->session;
    }
    ballbot_link_send(link, BALLBOT_MESSAGE_WELCOME, frame->session, &welcome, sizeof welcome);
}

/* Return whether every number is finite. */
static bool are_finite(const float values[], int count)
{
    bool all = true;

    for (int k = 0; k < count; ++k) {
        all = all && ballbot_magnitude(values[k]) <= FLT_MAX;
    }
    return all;
}

/* Return whether a part of the parameters is one. */
static bool is_part(int32_t offset, int32_t count)
{
    return offset >= 0 && count >= 1 && count <= BALLBOT_PARAMETER_WORDS && offset <= WORDS - count;
}

/* Return what is wrong with the values of a frame. */
static enum ballbot_result values_of(const struct ballbot_parameters *parameters, const struct ballbot_frame *frame)
{
    struct ballbot_message_arm arm;
    struct ballbot_message_reference reference;
    struct ballbot_message_torques torques;
    struct ballbot_message_read part; /* as `write` begins */
    bool good = true;

    switch ((enum ballbot_message)frame->type) {
    case BALLBOT_MESSAGE_ARM:
        ballbot_copy_bytes(&arm, frame->body, sizeof arm);
        good = (arm.controller == (int32_t)BALLBOT_CONTROLLER_ROBOT || arm.controller == (int32_t)BALLBOT_CONTROLLER_HOST) &&
               arm.ramp >= 0.0f && arm.ramp <= BALLBOT_LINK_LONGEST_RAMP;
        break;
    case BALLBOT_MESSAGE_REFERENCE:
        ballbot_copy_bytes(&reference, frame->body, sizeof reference);
        good = ballbot_refused_place(&parameters->law, reference.reference) == BALLBOT_ALLOWED;
        break;
    case BALLBOT_MESSAGE_TORQUES:
        ballbot_copy_bytes(&torques, frame->body, sizeof torques);
        good = are_finite(torques.torques, BALLBOT_MAX_WHEELS);
        break;
    case BALLBOT_MESSAGE_READ:
    case BALLBOT_MESSAGE_WRITE:
        ballbot_copy_bytes(&part, frame->body, sizeof part);
        return is_part(part.offset, part.count) ? BALLBOT_RESULT_OK : BALLBOT_RESULT_RANGE;
    default:
        break;
    }
    return good ? BALLBOT_RESULT_OK : BALLBOT_RESULT_VALUES;
}

/* Take a frame through the layers after the version. */
static void check(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                 const struct ballbot_frame *frame, uint32_t time)
{
    static const int16_t lengths[] = BALLBOT_BODY_LENGTHS;
    const int32_t length = (frame->type < sizeof lengths / sizeof lengths[0]) ? lengths[frame->type] : -1;
    enum ballbot_result values;

    if (length < 0) {
        refuse(link, BALLBOT_LAYER_TYPE);
        return;
    }
    if (frame->length != (size_t)length) {
        refuse(link, BALLBOT_LAYER_BODY);
        return;
    }
    if (frame->type == (uint8_t)BALLBOT_MESSAGE_HELLO) {
        greet(link, state, parameters, frame, time);
        return;
    }
    if (link->session == 0u || frame->session != link->session) {
        refuse(link, BALLBOT_LAYER_SESSION);
        return;
    }
    if (!ballbot_is_newer(frame->sequence, link->last)) {
        refuse(link, BALLBOT_LAYER_SEQUENCE);
        return;
    }
    values = values_of(parameters, frame);
    if (values != BALLBOT_RESULT_OK) {
        refuse(link, BALLBOT_LAYER_VALUES);
        ballbot_link_answer(link, frame, values, 0);
        return;
    }
    link->accepted += 1u;
    listen(link, frame, time);
    ballbot_link_obey(link, state, parameters, frame, time);
}

void ballbot_link_receive(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                          const uint8_t *bytes, size_t count, uint32_t time)
{
    for (size_t k = 0; k < count; ++k) {
        struct ballbot_frame frame;
        enum ballbot_layer layer = BALLBOT_LAYER_FRAMING;
        const enum ballbot_received received = ballbot_receiver_take(&link->receiver, bytes[k], &frame, &layer);

        if (received == BALLBOT_RECEIVED_REFUSED) {
            refuse(link, layer);
        } else if (received == BALLBOT_RECEIVED_FRAME) {
            check(link, state, parameters, &frame, time);
        } else {
            /* a frame goes on */
        }
    }
}

/* Stop if the host is silent, or its controller is. */
static void watch(struct ballbot_link *link, struct ballbot_state *state, uint32_t time)
{
    const bool by_host = state->run.armed != 0 && link->controller == (int32_t)BALLBOT_CONTROLLER_HOST;

    if (!ballbot_is_active(state)) {
        link->governs = false;
    } else if (link->governs && (time - link->heard >= BALLBOT_LINK_WATCHDOG ||
                                 (by_host && time - link->torques_time >= BALLBOT_LINK_WATCHDOG))) {
        ballbot_halt(state, BALLBOT_STOP_LINK);
    } else {
        /* somebody is there */
    }
}

/* Keep the torques within a limit that rises from zero after arming. */
static void raise_limit(struct ballbot_link *link, struct ballbot_state *state,
                        const struct ballbot_parameters *parameters, uint32_t time, float torques[BALLBOT_MAX_WHEELS])
{
    const float passed = 1e-6f * (float)(time - link->armed_time);

    if (!(passed < link->ramp)) {
        link->ramp = 0.0f; /* the clock will wrap around */
        return;
    }
    const float limit = parameters->law.torque_limit * (passed / link->ramp);

    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        torques[i] = ballbot_clipped(torques[i], limit);
        state->run.torques[i] = torques[i];
    }
}

/* Append a state to what is sent. */
static void report(struct ballbot_link *link, const struct ballbot_state *state,
                   const struct ballbot_parameters *parameters, const struct ballbot_reading_record *reading,
                   uint32_t time)
{
    struct ballbot_message_state body = { .time = (int32_t)time,
                                          .sample = (int32_t)link->sample,
                                          .armed = (state->run.armed != 0 && ballbot_is_active(state)) ? 1 : 0,
                                          .stop = state->safety.stop,
                                          .stop_wheel = state->safety.stop_wheel,
                                          .self_test = state->self_test.result,
                                          .self_test_wheel = state->self_test.wheel,
                                          .controller = link->controller,
                                          .imu_valid = 1,
                                          .encoders_valid = (reading->encoders_valid != 0) ? 1 : 0,
                                          .estimate_valid = ballbot_is_state(state->run.estimate) ? 1 : 0 };

    for (int k = 0; k < 3; ++k) {
        const bool known = ballbot_magnitude(reading->gyro[k]) <= BALLBOT_LARGEST_STATE &&
                           ballbot_magnitude(reading->attitude[k]) <= BALLBOT_LARGEST_STATE;

        body.gyro[k] = known ? reading->gyro[k] : 0.0f;
        body.attitude[k] = known ? reading->attitude[k] : 0.0f;
        body.imu_valid = known ? body.imu_valid : 0;
    }
    for (int32_t i = 0; i < parameters->wheel_count; ++i) {
        body.wheel_counts[i] = reading->wheel_counts[i];
        body.wheel_speeds[i] = (reading->encoders_valid != 0) ? reading->wheel_speeds[i] : 0.0f;
        body.torques[i] = state->run.torques[i];
    }
    for (int k = 0; k < 10; ++k) {
        body.estimate[k] = (body.estimate_valid != 0) ? state->run.estimate[k] : 0.0f;
        body.reference[k] = state->run.reference[k];
    }
    ballbot_link_send(link, BALLBOT_MESSAGE_STATE, link->session, &body, sizeof body);
}

bool ballbot_link_update(struct ballbot_link *link, struct ballbot_state *state,
                         const struct ballbot_parameters *parameters, const struct ballbot_reading_record *reading,
                         uint32_t time, float torques[BALLBOT_MAX_WHEELS])
{
    bool may = false;

    if (state->run.known == 0) {
        return ballbot_update(state, parameters, reading, time, NULL, torques); /* zeros */
    }
    watch(link, state, time);
    if (link->governs && link->controller == (int32_t)BALLBOT_CONTROLLER_HOST) {
        may = ballbot_relay(state, parameters, reading, time, link->torques, torques);
    } else {
        may = ballbot_update(state, parameters, reading, time, link->reference_new ? link->reference : NULL, torques);
    }
    raise_limit(link, state, parameters, time, torques);
    link->reference_new = false;
    link->sample += 1u;
    if (link->session != 0u) {
        link->state_due -= 1;
        if (link->state_due <= 0) {
            link->state_due = link->state_every;
            report(link, state, parameters, reading, time);
        }
    }
    return may;
}
