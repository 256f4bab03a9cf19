#include "robot.h"

#include "ballbot_hardware.h"

/* Bytes that are read at a time, and how often in a sample at most. */
#define CHUNK 128
#define CHUNKS 8

/* Enable the motors, or disable them after a command of no torques, so that they hold none when they are enabled again. */
static void enable_motors(struct robot *robot, bool enabled)
{
    static const float none[BALLBOT_MAX_WHEELS] = { 0.0f };

    if (!enabled) {
        ballbot_set_torques(none);
    }
    ballbot_set_enable(enabled);
    robot->enabled = enabled;
}

bool robot_start(struct robot *robot, const struct ballbot_parameters *parameters, int32_t capabilities, uint32_t starts)
{
    static const struct ballbot_encoders no_counts = { .started = false };
    static const struct ballbot_reading_record nothing = BALLBOT_NO_READING;

    robot->parameters = *parameters;
    robot->encoders = no_counts;
    robot->reading = nothing;
    ballbot_link_init(&robot->link, parameters, capabilities, starts);
    enable_motors(robot, false);
    return ballbot_init(&robot->state, &robot->parameters);
}

void robot_test(struct robot *robot)
{
    ballbot_link_release(&robot->link);
    ballbot_start_self_test(&robot->state);
    enable_motors(robot, ballbot_is_active(&robot->state));
}

bool robot_arm(struct robot *robot)
{
    ballbot_link_release(&robot->link);
    if (!ballbot_arm(&robot->state)) {
        robot_disarm(robot);
        return false;
    }
    enable_motors(robot, true);
    return true;
}

void robot_disarm(struct robot *robot)
{
    ballbot_disarm(&robot->state);
    enable_motors(robot, false);
}

/* Obey what came from the host. */
static void obey_host(struct robot *robot, uint32_t time)
{
    uint8_t bytes[CHUNK];

    for (int k = 0; k < CHUNKS; ++k) {
        const size_t count = ballbot_receive(bytes, sizeof bytes);

        ballbot_link_receive(&robot->link, &robot->state, &robot->parameters, bytes, count, time);
        if (count < sizeof bytes) {
            return;
        }
    }
}

/* Mix the IMU's noise and the sample's time into the numbers of sessions and of arming, so that after a reset they are others. */
static void mix_noise(struct robot *robot, uint32_t time)
{
    for (int i = 0; i < 3; ++i) {
        uint32_t bits;

        ballbot_copy_bytes(&bits, (const uint8_t *)&robot->reading.gyro[i], sizeof bits);
        ballbot_link_mix(&robot->link, bits);
    }
    ballbot_link_mix(&robot->link, time);
}

static void read_sensors(struct robot *robot)
{
    struct ballbot_reading_record *reading = &robot->reading;
    int32_t counts[BALLBOT_MAX_WHEELS];

    if (!ballbot_read_imu(reading->gyro, reading->attitude)) {
        for (int i = 0; i < 3; ++i) {
            reading->gyro[i] = BALLBOT_MISSING;
            reading->attitude[i] = BALLBOT_MISSING;
        }
    }
    const bool counted = ballbot_read_encoders(counts);

    ballbot_take_encoders(&robot->encoders, &robot->parameters, counted ? counts : NULL, reading);
}

void robot_step(struct robot *robot)
{
    const uint32_t time = ballbot_read_time();
    float torques[BALLBOT_MAX_WHEELS];

    if (robot->state.run.known == 0) {
        return; /* parameters that were refused hold no number of wheels to rely on */
    }
    obey_host(robot, time);
    read_sensors(robot);
    if (!ballbot_is_active(&robot->state)) {
        mix_noise(robot, time);
    }
    (void)ballbot_link_update(&robot->link, &robot->state, &robot->parameters, &robot->reading, time, torques);
    if (!ballbot_is_active(&robot->state)) {
        enable_motors(robot, false);
    } else {
        if (!robot->enabled) {
            enable_motors(robot, true);
        }
        ballbot_set_torques(torques);
    }
    ballbot_send(robot->link.out, robot->link.out_count);
    robot->link.out_count = 0;
}
