/* What the coverage-guided fuzzer runs: a robot's firmware under parameters, states, sensors, times and frames of its choice.
 *
 * The input chooses a controller and is then read as a list of actions: change a number of the parameters or of the state,
 * take a sample, send bytes or a whole frame, arm, test, disarm. After each sample the torques are checked, and that
 * every fault of the sample is latched. A check that fails ends the process, and so do the sanitizers.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ballbot_hardware.h"
#include "link/crc32.h"
#include "robot.h"

#include "firmware_fuzz_records.h" /* parameter records, and which words of the state are real numbers */

#define MOST_SAMPLES 200

struct input {
    const uint8_t *data;
    size_t left;
};

/* The robot, its sensors of this sample, and what the host sees. */
static struct robot robot;
static float gyro[3], attitude[3];
static bool imu_valid, encoders_valid, enabled;
static int32_t counts[BALLBOT_MAX_WHEELS];
static uint32_t now;
static float commanded[BALLBOT_MAX_WHEELS];
static uint8_t waiting[512];
static size_t waiting_count;
static int32_t nonce;
static uint16_t sequence;
static struct ballbot_receiver host;

static uint32_t take(struct input *input, size_t bytes)
{
    uint32_t value = 0;

    for (size_t k = 0; k < bytes; ++k) {
        value = value << 8;
        if (input->left > 0) {
            value |= *input->data++;
            --input->left;
        }
    }
    return value;
}

static float any_float(struct input *input)
{
    const uint32_t bits = take(input, 4);
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

/* A number of the size that sensors give, or any bits. */
static float reading(struct input *input, float scale)
{
    const uint32_t kind = take(input, 1);

    return (kind == 255u) ? any_float(input) : scale * ((float)(int32_t)take(input, 2) - 32768.0f) / 32768.0f;
}

bool ballbot_read_imu(float to_gyro[3], float to_attitude[3])
{
    memcpy(to_gyro, gyro, sizeof gyro);
    memcpy(to_attitude, attitude, sizeof attitude);
    return imu_valid;
}

bool ballbot_read_encoders(int32_t to[BALLBOT_MAX_WHEELS])
{
    memcpy(to, counts, sizeof counts);
    return encoders_valid;
}

uint32_t ballbot_read_time(void)
{
    return now;
}

void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS])
{
    memcpy(commanded, torques, sizeof commanded);
}

void ballbot_set_enable(bool value)
{
    enabled = value;
}

size_t ballbot_receive(uint8_t *bytes, size_t most)
{
    const size_t count = (waiting_count < most) ? waiting_count : most;

    memcpy(bytes, waiting, count);
    memmove(waiting, &waiting[count], waiting_count - count);
    waiting_count -= count;
    return count;
}

/* Read the robot's frames as a host does, for the number of the first step of arming. */
void ballbot_send(const uint8_t *bytes, size_t count)
{
    struct ballbot_frame frame;
    enum ballbot_layer layer;

    for (size_t k = 0; k < count; ++k) {
        if (ballbot_receiver_take(&host, bytes[k], &frame, &layer) == BALLBOT_RECEIVED_FRAME &&
            frame.type == BALLBOT_MESSAGE_ANSWER) {
            struct ballbot_message_answer answer;

            ballbot_copy_bytes(&answer, frame.body, sizeof answer);
            nonce = (answer.result == BALLBOT_RESULT_CONFIRM) ? answer.value : nonce;
        }
    }
}

static void fail(const char *what)
{
    fprintf(stderr, "%s: stop %d, armed %d, test %d, torques %g %g %g %g\n", what, (int)robot.state.safety.stop,
            (int)robot.state.run.armed, (int)robot.state.self_test.result, (double)commanded[0], (double)commanded[1],
            (double)commanded[2], (double)commanded[3]);
    abort();
}

static void check_torques(void)
{
    /* the self-test has a torque of its own, which a wheel that breaks away hard needs */
    const float limit = robot.state.run.armed != 0 ? robot.parameters.law.torque_limit : robot.parameters.self_test.torque;
    const bool active = ballbot_is_active(&robot.state);

    if (enabled != active) {
        fail("motors are enabled without reason, or disabled");
    }
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        const float torque = commanded[i];

        if (!isfinite(torque)) {
            fail("a torque is not a number");
        }
        if (torque != 0.0f && !(fabsf(torque) <= limit)) {
            fail("a torque is beyond the limit");
        }
        if (torque != 0.0f && (!active || i >= robot.parameters.wheel_count)) {
            fail("a torque without permission");
        }
    }
}

/* Return whether the IMU repeats itself once too often, after the samples that the safety layer had watched before. */
static bool is_stuck(const struct ballbot_safety_state *before)
{
    const int32_t most = robot.parameters.safety.max_unchanged;
    bool repeated = imu_valid && before->watched != 0;

    for (int i = 0; i < 3; ++i) {
        repeated = repeated && gyro[i] == before->imu[i] && attitude[i] == before->imu[3 + i];
    }
    return repeated && most > 0 && before->imu_unchanged + 1 >= most;
}

/* Return whether this sample has a fault that must stop an active robot. */
static bool is_faulty(uint32_t passed, bool started, const struct ballbot_safety_state *before)
{
    const struct ballbot_safety_record *limits = &robot.parameters.safety;
    const float *estimate = robot.state.run.estimate;
    const int32_t missing = (imu_valid && encoders_valid) ? 0 : before->missing + 1;
    bool known = true;

    for (int i = 0; i < 10; ++i) {
        known = known && fabsf(estimate[i]) <= 1e6f;
    }
    return (started && 1e-6f * (float)passed > limits->max_interval) || missing > limits->max_missing ||
           is_stuck(before) || (known && fmaxf(fabsf(estimate[2]), fabsf(estimate[3])) > limits->lean);
}

static void sample(struct input *input)
{
    static const uint32_t steps[] = { 5000, 5000, 5000, 5001, 10000, 17000, 18000, 60000 };
    const uint32_t kind = take(input, 1);
    const struct ballbot_run_state before = robot.state.run;
    const enum ballbot_stop stop_before = ballbot_stop_of(&robot.state);
    const bool was_active = ballbot_is_active(&robot.state);
    const struct ballbot_safety_state watched = robot.state.safety;

    now += (kind & 0x80u) ? take(input, 4) : steps[kind & 7u];
    imu_valid = (kind & 0x08u) == 0u;
    encoders_valid = (kind & 0x10u) == 0u;
    if ((kind & 0x20u) != 0u) {
        for (int i = 0; i < 3; ++i) {
            gyro[i] = reading(input, 3.0f);
            attitude[i] = reading(input, (i < 2) ? 0.4f : 30.0f);
        }
    }
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        const uint32_t gone = (kind & 0x40u) ? take(input, 4) : take(input, 1) - 128u;

        counts[i] = (int32_t)((uint32_t)counts[i] + gone);
    }
    robot_step(&robot);
    check_torques();
    const enum ballbot_stop stop = ballbot_stop_of(&robot.state);

    /* only arming again, the self-test and new parameters forget a stop; these disarm */
    if (stop_before != BALLBOT_STOP_NONE && stop == BALLBOT_STOP_NONE && robot.state.run.armed != 0 &&
        !robot.link.governs) {
        fail("a stop was not latched");
    }
    /* active before and not disarmed by the host: what was wrong must have stopped it */
    if (was_active && robot.state.run.armed != 0 && before.armed != 0 && stop == BALLBOT_STOP_NONE &&
        is_faulty(now - (uint32_t)before.time, before.started != 0, &watched)) {
        fail("a fault did not stop the robot");
    }
}

/* A setting within what the robot has exported, or with one number of any bits. */
static struct ballbot_message_tune tune(struct input *input, bool wrong)
{
    const struct ballbot_tuning_record *own = &robot.parameters.law.tuning;
    struct ballbot_message_tune setting = { .compensation = own->compensation * (float)take(input, 1) / 255.0f };
    float left = 1.0f;

    for (int k = 1; k <= own->others && k < BALLBOT_MAX_GAINS; ++k) {
        setting.weights[k] = left * (float)take(input, 1) / 255.0f;
        left -= setting.weights[k];
    }
    setting.weights[0] = left;
    if (wrong) {
        const uint32_t number = take(input, 1) % (BALLBOT_MAX_GAINS + 1u);

        *((number < BALLBOT_MAX_GAINS) ? &setting.weights[number] : &setting.compensation) = any_float(input);
    }
    return setting;
}

/* Put a frame of the protocol into what the robot receives, with its checks in order but for what the input chooses. */
static void frame(struct input *input)
{
    static const uint8_t types[] = { 1, 2, 3, 4, 4, 5, 6, 7, 8, 9, 10, 11, 12, 12, 13 };
    static const int32_t firmware[] = BALLBOT_SCHEMA_WORDS;
    static const int32_t messages[] = BALLBOT_MESSAGE_WORDS;
    static const size_t lengths[] = { 0,
                                      sizeof(struct ballbot_message_hello),
                                      0,
                                      0,
                                      sizeof(struct ballbot_message_arm),
                                      0,
                                      sizeof(struct ballbot_message_reference),
                                      sizeof(struct ballbot_message_torques),
                                      sizeof(struct ballbot_message_read),
                                      sizeof(struct ballbot_message_write),
                                      sizeof(struct ballbot_message_commit),
                                      0,
                                      sizeof(struct ballbot_message_tune),
                                      0 };
    const uint32_t kind = take(input, 1);
    const uint8_t type = types[kind % sizeof types];
    uint32_t session = (type == 1) ? 1u + kind : robot.link.session;
    uint8_t body[256] = { 0 };
    uint8_t coded[BALLBOT_FRAME_ROOM];
    size_t length = lengths[type];

    if (type == 1) {
        memcpy(body, firmware, sizeof firmware);
        memcpy(&body[sizeof firmware], messages, sizeof messages);
        body[sizeof firmware + sizeof messages] = 1;
    } else if (type == 4) {
        const int32_t controller = (int32_t)(take(input, 1) % 2u);
        const int32_t step = (kind & 0x40u) ? nonce : 0;

        memcpy(body, &step, sizeof step);
        memcpy(&body[4], &controller, sizeof controller);
    } else if (type == 6 || type == 7) {
        for (size_t k = 0; k < length / 4; ++k) {
            const float value = reading(input, (type == 6) ? 1.0f : 20.0f);

            memcpy(&body[4 * k], &value, sizeof value);
        }
    } else if (type == 12) {
        struct ballbot_message_tune setting = tune(input, (kind & 0x40u) != 0u);

        memcpy(body, &setting, sizeof setting);
    } else if (type == 10 && (kind & 0x40u)) {
        const uint32_t crc = ballbot_crc32((const uint8_t *)&robot.link.written, sizeof robot.link.written);

        memcpy(body, &crc, sizeof crc);
    } else {
        for (size_t k = 0; k < length; ++k) {
            body[k] = (k % 4 == 0 || type == 9) ? (uint8_t)take(input, 1) : 0;
        }
    }
    sequence = (uint16_t)(sequence + ((kind & 0x80u) ? take(input, 2) : 1u));
    size_t count = ballbot_frame_encode((enum ballbot_message)type, session, sequence, body, length, coded);

    if (count > sizeof waiting - waiting_count) {
        return;
    }
    memcpy(&waiting[waiting_count], coded, count);
    if (kind == 0x7Fu) { /* a byte is changed */
        waiting[waiting_count + take(input, 1) % count] ^= (uint8_t)take(input, 1);
    }
    waiting_count += count;
}

static void bytes(struct input *input)
{
    const size_t count = take(input, 1) % 64u;

    for (size_t k = 0; k < count && waiting_count < sizeof waiting; ++k) {
        waiting[waiting_count++] = (uint8_t)take(input, 1);
    }
}

/* Change a number of the state: any real number of it, to any finite value; an estimator or a law may have diverged. */
static void disturb(struct input *input)
{
    const uint16_t word = REAL_WORDS[take(input, 2) % (sizeof REAL_WORDS / sizeof REAL_WORDS[0])];
    const float value = any_float(input);

    memcpy(&((uint8_t *)&robot.state)[4u * word], &value, sizeof value);
}

static bool act(struct input *input)
{
    switch (take(input, 1) % 12u) {
    case 0:
        disturb(input);
        return false;
    case 1:
        bytes(input);
        return false;
    case 2:
    case 3:
        frame(input);
        return false;
    case 4:
        robot_test(&robot);
        return false;
    case 5:
        ballbot_skip_self_test(&robot.state);
        (void)robot_arm(&robot);
        return false;
    case 6:
        if (take(input, 1) < 32u) {
            robot_disarm(&robot);
        }
        return false;
    default:
        sample(input);
        return true;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct input input = { data, size };
    static struct ballbot_parameters parameters;

    memcpy(&parameters, RECORDS[take(&input, 1) % RECORD_COUNT], sizeof parameters);
    for (uint32_t changes = take(&input, 1) % 4u; changes > 0; --changes) {
        const uint32_t word = take(&input, 2) % (sizeof parameters / 4u);
        const uint32_t bits = take(&input, 4);

        memcpy(&((uint8_t *)&parameters)[4u * word], &bits, sizeof bits);
    }
    memset(&robot, 0, sizeof robot);
    memset(counts, 0, sizeof counts);
    memset(gyro, 0, sizeof gyro);
    memset(attitude, 0, sizeof attitude);
    memset(commanded, 0, sizeof commanded);
    memset(&host, 0, sizeof host);
    waiting_count = 0;
    nonce = 0;
    sequence = 0;
    now = take(&input, 4);
    (void)robot_start(&robot, &parameters, 0, 0u);
    check_torques();
    for (int samples = 0; samples < MOST_SAMPLES && input.left > 0;) {
        samples += act(&input) ? 1 : 0;
    }
    return 0;
}
