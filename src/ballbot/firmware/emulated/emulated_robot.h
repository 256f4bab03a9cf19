/* An emulated robot: robot.c on emulated hardware, behind two functions for bytes; on a computer or on an emulated board. */
#ifndef EMULATED_ROBOT_H
#define EMULATED_ROBOT_H

#include "hardware.h"
#include "robot.h"

struct emulated_robot {
    struct robot robot;
    struct emulated_hardware hardware;
};

/* Return the bytes that an emulated robot takes. */
size_t emulated_robot_size(void);

/* Start disarmed; return false if the parameters are of another version of the library. capabilities, starts: as robot_start. */
bool emulated_robot_start(struct emulated_robot *emulated, const struct ballbot_parameters *parameters,
                          int32_t capabilities, uint32_t starts);

/* Let the IMU be one that was mounted just now: its axes are to be checked. */
void emulated_robot_mount(struct emulated_robot *emulated);

/* Take bytes of the line, and a step with each sample in them. */
void emulated_robot_put(struct emulated_robot *emulated, const uint8_t *bytes, size_t count);

/* Fill at most `most` bytes that go out over the line; return how many. */
size_t emulated_robot_take(struct emulated_robot *emulated, uint8_t *bytes, size_t most);

/* Press the robot's button that lets a host arm it. */
void emulated_robot_confirm(struct emulated_robot *emulated);

#endif
