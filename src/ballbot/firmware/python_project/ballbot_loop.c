/* One robot behind functions of plain numbers: what ballbot_loop.py calls beside those of ballbot.h. */
#include <stddef.h>

#include "ballbot.h"
#include "ballbot_parameters.h"
#include "encoders.h"

struct ballbot_loop {
    struct ballbot_state state; /* first: functions of ballbot.h take the same address */
    struct ballbot_encoders encoders;
};

/* Return the bytes that a loop takes. */
size_t ballbot_loop_size(void)
{
    return sizeof(struct ballbot_loop);
}

/* Start disarmed, in bytes that are zero; return false if the parameters are not allowed. */
bool ballbot_loop_start(struct ballbot_loop *loop)
{
    return ballbot_init(&loop->state, &ballbot_parameters);
}

/* Take a sample at a time [us], as ballbot_update: counts or NULL; gyro and attitude, NaN for a value that is missing. */
void ballbot_loop_update(struct ballbot_loop *loop, uint32_t time, const int32_t counts[], const float imu[6],
                         const float reference[10], float torques[BALLBOT_MAX_WHEELS])
{
    struct ballbot_reading_record reading = BALLBOT_NO_READING;

    for (int i = 0; i < 3; ++i) {
        reading.gyro[i] = imu[i];
        reading.attitude[i] = imu[3 + i];
    }
    ballbot_take_encoders(&loop->encoders, &ballbot_parameters, counts, &reading);
    (void)ballbot_update(&loop->state, &ballbot_parameters, &reading, time, reference, torques);
}

/* Return the wheel that a stop or the result of the self-test is about; 0 for none. */
int32_t ballbot_loop_wheel(const struct ballbot_loop *loop)
{
    return (loop->state.safety.stop != BALLBOT_STOP_NONE) ? loop->state.safety.stop_wheel : loop->state.self_test.wheel;
}
