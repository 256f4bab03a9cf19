#include "robot.h"

#include "ballbot_hardware.h"
#include "ballbot_parameters.h"

/* In place of a value that the IMU did not give: beyond any sensor's. */
#define MISSING 1e30f

/* Command no torques, so that none is held when the drivers are enabled again, and disable them. */
static void stop_motors(void)
{
    static const float none[BALLBOT_MAX_WHEELS] = { 0.0f };

    ballbot_set_torques(none);
    ballbot_set_enable(false);
}

bool robot_start(struct robot *robot)
{
    static const struct ballbot_encoders no_counts = { .started = false };
    static const struct ballbot_reading_record no_fix = { .fix_position = { MISSING, MISSING },
                                                          .fix_heading = MISSING };

    robot->encoders = no_counts;
    robot->reading = no_fix;
    stop_motors();
    return ballbot_init(&robot->state, &ballbot_parameters);
}

void robot_test(struct robot *robot)
{
    ballbot_start_self_test(&robot->state);
    ballbot_set_enable(true);
}

bool robot_arm(struct robot *robot)
{
    if (!ballbot_arm(&robot->state)) {
        robot_disarm(robot);
        return false;
    }
    ballbot_set_enable(true);
    return true;
}

void robot_disarm(struct robot *robot)
{
    ballbot_disarm(&robot->state);
    stop_motors();
}

static void read_sensors(struct robot *robot)
{
    struct ballbot_reading_record *reading = &robot->reading;
    int32_t counts[BALLBOT_MAX_WHEELS];

    if (!ballbot_read_imu(reading->gyro, reading->attitude)) {
        for (int i = 0; i < 3; ++i) {
            reading->gyro[i] = MISSING;
            reading->attitude[i] = MISSING;
        }
    }
    const bool counted = ballbot_read_encoders(counts);

    ballbot_take_encoders(&robot->encoders, &ballbot_parameters, counted ? counts : NULL, reading);
}

void robot_step(struct robot *robot)
{
    float torques[BALLBOT_MAX_WHEELS];

    read_sensors(robot);
    (void)ballbot_update(&robot->state, &ballbot_parameters, &robot->reading, ballbot_read_time(), NULL, torques);
    ballbot_set_torques(torques);
    const bool testing = ballbot_self_test_of(&robot->state) == BALLBOT_TEST_RUNNING;

    if (ballbot_stop_of(&robot->state) != BALLBOT_STOP_NONE || (robot->state.run.armed == 0 && !testing)) {
        stop_motors(); /* also when a self-test has ended */
    }
}
