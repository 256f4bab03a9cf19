#include "emulated_robot.h"

#include "ballbot_hardware.h"

/* Whose functions those of ballbot_hardware.h are. */
static struct emulated_robot *selected;

/* Append bytes to those that wait; without room they are lost. */
static void append(struct emulated_bytes *waiting, const uint8_t *bytes, size_t count)
{
    for (size_t k = 0; k < count && waiting->count < EMULATED_ROOM; ++k) {
        waiting->bytes[(waiting->first + waiting->count) % EMULATED_ROOM] = bytes[k];
        waiting->count += 1u;
    }
}

/* Take at most so many of the bytes that wait. */
static size_t removed(struct emulated_bytes *waiting, uint8_t *bytes, size_t most)
{
    const size_t count = (waiting->count < most) ? waiting->count : most;

    for (size_t k = 0; k < count; ++k) {
        bytes[k] = waiting->bytes[waiting->first];
        waiting->first = (waiting->first + 1u) % EMULATED_ROOM;
    }
    waiting->count -= count;
    return count;
}

size_t emulated_robot_size(void)
{
    return sizeof(struct emulated_robot);
}

bool emulated_robot_start(struct emulated_robot *emulated, const struct ballbot_parameters *parameters,
                          int32_t capabilities, uint32_t starts)
{
    const uint32_t all = (uint32_t)capabilities | (uint32_t)BALLBOT_CAPABILITY_EMULATED;

    selected = emulated;
    const bool started = robot_start(&emulated->robot, parameters, (int32_t)all, starts);

    ballbot_skip_imu_check(&emulated->robot.state); /* it has no mounting */
    return started;
}

void emulated_robot_mount(struct emulated_robot *emulated)
{
    emulated->robot.state.imu_check.passed = 0;
}

int32_t emulated_robot_step(struct emulated_robot *emulated, uint32_t time, const float *imu, const int32_t *counts,
                            float torques[BALLBOT_MAX_WHEELS])
{
    const struct ballbot_state *state = &emulated->robot.state;

    selected = emulated;
    emulated->time = time;
    emulated->imu = imu;
    emulated->counts = counts;
    robot_step(&emulated->robot);
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        torques[i] = emulated->enabled ? emulated->torques[i] : 0.0f;
    }
    return (emulated->enabled ? EMULATED_ENABLED : 0) |
           (ballbot_is_active(state) && state->run.armed != 0 ? EMULATED_ARMED : 0);
}

void emulated_robot_put(struct emulated_robot *emulated, const uint8_t *bytes, size_t count)
{
    append(&emulated->to_robot, bytes, count);
}

size_t emulated_robot_take(struct emulated_robot *emulated, uint8_t *bytes, size_t most)
{
    return removed(&emulated->to_host, bytes, most);
}

void emulated_robot_confirm(struct emulated_robot *emulated)
{
    ballbot_link_confirm(&emulated->robot.link);
}

bool ballbot_read_imu(float gyro[3], float attitude[3])
{
    for (int i = 0; i < 3 && selected->imu != NULL; ++i) {
        gyro[i] = selected->imu[i];
        attitude[i] = selected->imu[3 + i];
    }
    return selected->imu != NULL;
}

bool ballbot_read_encoders(int32_t counts[BALLBOT_MAX_WHEELS])
{
    for (int i = 0; i < BALLBOT_MAX_WHEELS && selected->counts != NULL; ++i) {
        counts[i] = selected->counts[i];
    }
    return selected->counts != NULL;
}

uint32_t ballbot_read_time(void)
{
    return selected->time;
}

void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS])
{
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        selected->torques[i] = torques[i];
    }
}

void ballbot_set_enable(bool enabled)
{
    selected->enabled = enabled;
}

void ballbot_send(const uint8_t *bytes, size_t count)
{
    append(&selected->to_host, bytes, count);
}

size_t ballbot_receive(uint8_t *bytes, size_t most)
{
    return removed(&selected->to_robot, bytes, most);
}
