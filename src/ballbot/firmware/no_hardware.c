/* Hardware that does nothing: with it robot.c is whole, so that its code, its memory and its stack can be measured. */
#include "ballbot_hardware.h"
#include "robot.h"

extern struct robot measured_robot;
struct robot measured_robot;

bool ballbot_read_imu(float gyro[3], float attitude[3])
{
    (void)gyro;
    (void)attitude;
    return false;
}

bool ballbot_read_encoders(int32_t counts[BALLBOT_MAX_WHEELS])
{
    (void)counts;
    return false;
}

uint32_t ballbot_read_time(void)
{
    return 0u;
}

void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS])
{
    (void)torques;
}

void ballbot_set_enable(bool enabled)
{
    (void)enabled;
}

void ballbot_send(const uint8_t *bytes, size_t count)
{
    (void)bytes;
    (void)count;
}

size_t ballbot_receive(uint8_t *bytes, size_t most)
{
    (void)bytes;
    (void)most;
    return 0u;
}
