/* An emulated robot: robot.c on emulated hardware. Sensors and motors are arguments of a step, the host's bytes wait in queues. */
#ifndef EMULATED_ROBOT_H
#define EMULATED_ROBOT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "robot.h"

/* Bytes that wait for the robot, and for the host, at most; what does not fit is lost, as on a board. */
#define EMULATED_ROOM 4096

struct emulated_bytes {
    uint8_t bytes[EMULATED_ROOM];
    size_t first;
    size_t count;
};

/* Bits of what emulated_robot_step returns: whether the motors are enabled, and whether the robot balances or follows torques. */
enum emulated_motors { EMULATED_ENABLED = 1, EMULATED_ARMED = 2 };

struct emulated_robot {
    struct robot robot;
    uint32_t time;         /* of the sample [us] */
    const float *imu;      /* gyro [rad/s] and attitude [rad] of the sample; NULL if the IMU gives nothing */
    const int32_t *counts; /* of the encoders; NULL if they give nothing */
    bool enabled;
    float torques[BALLBOT_MAX_WHEELS];
    struct emulated_bytes to_robot;
    struct emulated_bytes to_host;
};

/* Return the bytes that an emulated robot takes. */
size_t emulated_robot_size(void);

/* Start disarmed, in bytes that are zero; return false if the parameters are of another version of the library. capabilities, starts: as robot_start. */
bool emulated_robot_start(struct emulated_robot *emulated, const struct ballbot_parameters *parameters,
                          int32_t capabilities, uint32_t starts);

/* Let the IMU be one that was mounted just now: its axes are to be checked. */
void emulated_robot_mount(struct emulated_robot *emulated);

/* Take a sample at a time [us], with imu (6) or NULL and counts or NULL; fill the torques, zero if the motors are disabled. */
int32_t emulated_robot_step(struct emulated_robot *emulated, uint32_t time, const float *imu, const int32_t *counts,
                            float torques[BALLBOT_MAX_WHEELS]);

/* Let the host send bytes. */
void emulated_robot_put(struct emulated_robot *emulated, const uint8_t *bytes, size_t count);

/* Fill at most `most` of the bytes that the robot has sent to the host; return how many. */
size_t emulated_robot_take(struct emulated_robot *emulated, uint8_t *bytes, size_t most);

/* Press the robot's button that lets a host arm it. */
void emulated_robot_confirm(struct emulated_robot *emulated);

#endif
