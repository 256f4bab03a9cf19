#include "self_test.h"

#include "parts/part.h"

void ballbot_self_test_start(struct ballbot_self_test_state *test)
{
    const struct ballbot_self_test_state start = { .result = BALLBOT_TEST_RUNNING };

    *test = start;
}

static void end(struct ballbot_self_test_state *test, enum ballbot_self_test result, int32_t wheel)
{
    test->result = (int32_t)result;
    test->wheel = wheel;
}

/* End the push forward, if the wheel that turned the most has gone far enough; end the test if that is not the pushed one. */
static void look(struct ballbot_self_test_state *test, const struct ballbot_parameters *parameters, const int32_t counts[])
{
    const int32_t wheel = test->pushed;
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
    if (most < parameters->self_test.counts) {
        if (test->sample >= 2 * parameters->self_test.ramp) {
            end(test, BALLBOT_TEST_DEAD_MOTOR, wheel + 1);
        }
    } else if (fastest != wheel) {
        end(test, BALLBOT_TEST_TORQUE_ORDER, wheel + 1);
    } else if (direction < 0) {
        end(test, BALLBOT_TEST_TORQUE_SIGN, wheel + 1);
    } else {
        test->forward = test->sample;
    }
}

/* Return the torque of a sample of the push forward: it rises, and then stays. */
static float pushing(const struct ballbot_self_test_record *own, int32_t sample)
{
    return own->torque * ballbot_smaller((float)(sample + 1) / (float)own->ramp, 1.0f);
}

void ballbot_self_test_step(struct ballbot_self_test_state *test, const struct ballbot_parameters *parameters,
                            const struct ballbot_reading_record *reading, float torques[BALLBOT_MAX_WHEELS])
{
    const struct ballbot_self_test_record *own = &parameters->self_test;

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
    if (test->forward != 0 && test->sample >= 3 * test->forward) { /* it has had as long to come to rest */
        test->pushed += 1;
        test->sample = 0;
        test->forward = 0;
    }
    if (test->pushed >= parameters->wheel_count) {
        end(test, BALLBOT_TEST_PASSED, 0);
        return;
    }
    if (test->sample == 0) {
        for (int32_t i = 0; i < parameters->wheel_count; ++i) {
            test->counts[i] = reading->wheel_counts[i];
        }
    } else if (test->forward == 0) {
        look(test, parameters, reading->wheel_counts);
    } else {
        /* it goes back, or rests */
    }
    if (test->result == BALLBOT_TEST_RUNNING) {
        if (test->forward == 0) {
            torques[test->pushed] = pushing(own, test->sample);
        } else if (test->sample < 2 * test->forward) {
            torques[test->pushed] = -pushing(own, 2 * test->forward - 1 - test->sample);
        } else {
            /* between two wheels */
        }
    }
    test->sample += 1;
}
