#include "self_test.h"

#include "ballbot_math.h"

/* Duration of the whole test [s]. */
#define DURATION 0.5f
/* Fraction of a wheel's time in which it is pushed forward; then it is pushed back for as long. */
#define PUSH_FRACTION 0.2f
/* A wheel that turns by fewer counts than this has not moved. */
#define LEAST_COUNTS 20
/* Added to the time in wheels' turns, so that rounding does not put a sample before its turn. */
#define ROUNDING 1e-5f

void ballbot_self_test_start(struct ballbot_self_test_state *test)
{
    const struct ballbot_self_test_state start = { .result = BALLBOT_TEST_RUNNING };

    *test = start;
}

/* Return the sample that is nearest to a place of the test, in turns of the wheels. */
static int32_t sample_of(const struct ballbot_parameters *parameters, float turns)
{
    return (int32_t)(turns * DURATION / ((float)parameters->wheel_count * parameters->sample_time) + 0.5f);
}

static void end(struct ballbot_self_test_state *test, enum ballbot_self_test result, int32_t wheel)
{
    test->result = (int32_t)result;
    test->wheel = wheel;
}

/* End the test if the counts that all encoders made while a wheel was pushed forward are wrong. */
static void judge(struct ballbot_self_test_state *test, const struct ballbot_parameters *parameters,
                  const int32_t counts[], int32_t wheel)
{
    int32_t most = 0;
    int32_t fastest = 0;
    int32_t direction = 0;

    for (int32_t i = 0; i < parameters->wheel_count; ++i) {
        const uint32_t gone = (uint32_t)counts[i] - (uint32_t)test->counts[i];
        const bool backward = gone >= 0x80000000u;
        const uint32_t size = backward ? 0u - gone : gone;
        const int32_t made = (size > 0x7FFFFFFFu) ? INT32_MAX : (int32_t)size;

        if (made > most) {
            most = made;
            fastest = i;
        }
        if (i == wheel) {
            direction = backward ? -1 : 1;
        }
    }
    if (most < LEAST_COUNTS) {
        end(test, BALLBOT_TEST_DEAD_MOTOR, wheel + 1);
    } else if (fastest != wheel) {
        end(test, BALLBOT_TEST_TORQUE_ORDER, wheel + 1);
    } else if (direction < 0) {
        end(test, BALLBOT_TEST_TORQUE_SIGN, wheel + 1);
    } else {
        /* as it should be */
    }
}

/* Look at the encoders where a wheel's push forward begins and ends. */
static void look(struct ballbot_self_test_state *test, const struct ballbot_parameters *parameters,
                 const struct ballbot_reading_record *reading)
{
    for (int32_t wheel = 0; wheel < parameters->wheel_count; ++wheel) {
        if (test->sample == sample_of(parameters, (float)wheel)) {
            for (int32_t i = 0; i < parameters->wheel_count; ++i) {
                test->counts[i] = reading->wheel_counts[i];
            }
        }
        /* after the line above: a push shorter than a sample moves nothing, and fails */
        if (test->sample == sample_of(parameters, (float)wheel + PUSH_FRACTION)) {
            judge(test, parameters, reading->wheel_counts, wheel);
        }
    }
}

void ballbot_self_test_step(struct ballbot_self_test_state *test, const struct ballbot_parameters *parameters,
                            const struct ballbot_reading_record *reading, float torques[BALLBOT_MAX_WHEELS])
{
    const float n = (float)parameters->wheel_count;
    const float turns = (float)test->sample * parameters->sample_time * n / DURATION + ROUNDING;

    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        torques[i] = 0.0f;
    }
    if (test->result != BALLBOT_TEST_RUNNING) {
        return;
    }
    if (reading->encoders_valid == 0) {
        end(test, BALLBOT_TEST_STOPPED, 0);
        return;
    }
    look(test, parameters, reading);
    if (test->result == BALLBOT_TEST_RUNNING && turns >= n) {
        end(test, BALLBOT_TEST_PASSED, 0);
    }
    if (test->result == BALLBOT_TEST_RUNNING) {
        const int32_t wheel = (int32_t)turns;
        const float within = turns - (float)wheel;

        if (within < PUSH_FRACTION) {
            torques[wheel] = parameters->self_test_torque;
        } else if (within < 2.0f * PUSH_FRACTION) {
            torques[wheel] = -parameters->self_test_torque;
        } else {
            /* between two wheels */
        }
    }
    test->sample += 1;
}
