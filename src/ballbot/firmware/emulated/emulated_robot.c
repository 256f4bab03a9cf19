#include "emulated_robot.h"

size_t emulated_robot_size(void)
{
    return sizeof(struct emulated_robot);
}

bool emulated_robot_start(struct emulated_robot *emulated, const struct ballbot_parameters *parameters,
                          int32_t capabilities, uint32_t starts)
{
    emulated_start(&emulated->hardware);
    emulated_select(&emulated->hardware);
    const uint32_t all = (uint32_t)capabilities | (uint32_t)BALLBOT_CAPABILITY_EMULATED;
    const bool started = robot_start(&emulated->robot, parameters, (int32_t)all, starts);

    ballbot_skip_imu_check(&emulated->robot.state); /* it has no mounting */
    return started;
}

void emulated_robot_mount(struct emulated_robot *emulated)
{
    emulated->robot.state.imu_check.passed = 0;
}

void emulated_robot_put(struct emulated_robot *emulated, const uint8_t *bytes, size_t count)
{
    const struct ballbot_state *state = &emulated->robot.state;

    emulated_select(&emulated->hardware);
    for (size_t k = 0; k < count; ++k) {
        if (emulated_put(&emulated->hardware, bytes[k])) {
            robot_step(&emulated->robot);
            emulated_finish(&emulated->hardware, ballbot_is_active(state) && state->run.armed != 0);
        }
    }
}

size_t emulated_robot_take(struct emulated_robot *emulated, uint8_t *bytes, size_t most)
{
    return emulated_take(&emulated->hardware, bytes, most);
}

void emulated_robot_confirm(struct emulated_robot *emulated)
{
    ballbot_link_confirm(&emulated->robot.link);
}
