/* The hardware of an emulated robot: messages `sensors` in, messages `motors` out, and the host's bytes between them.
 *
 *     emulated_select(&hardware)                        whose functions of ballbot_hardware.h are called
 *     emulated_put(&hardware, byte)                     what came over the line; returns whether a sample is complete
 *     robot_step(&robot), emulated_finish(&hardware, armed)       if so
 *     emulated_take(&hardware, bytes, most)             what goes out over the line
 *
 * One message `sensors` is one sample, and its time is the robot's clock, so that every run is the same. All other bytes go to
 * the robot as they came. After the step a message `motors` goes out. emulated_robot.h does all of this.
 */
#ifndef EMULATED_HARDWARE_H
#define EMULATED_HARDWARE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "link/frames.h"

/* Bytes that wait for the robot, and for the line, at most; what does not fit is lost, as on a board. */
#define EMULATED_ROOM 4096

struct emulated_bytes {
    uint8_t bytes[EMULATED_ROOM];
    size_t first;
    size_t count;
};

struct emulated_hardware {
    struct ballbot_receiver receiver;
    struct ballbot_message_sensors sensors;
    bool started;      /* whether there was a sample */
    uint16_t last;     /* sequence number of the last sample */
    uint16_t sequence; /* of the last message `motors` */
    bool enabled;
    float torques[BALLBOT_MAX_WHEELS];
    uint8_t raw[BALLBOT_FRAME_ROOM]; /* of the frame that comes in */
    size_t raw_count;
    struct emulated_bytes to_robot;
    struct emulated_bytes to_line;
};

/* Begin: nothing came, motors disabled. */
void emulated_start(struct emulated_hardware *hardware);

/* Make the functions of ballbot_hardware.h those of this hardware. */
void emulated_select(struct emulated_hardware *hardware);

/* Take one byte of the line; return whether it completes a sample, which robot_step must take now. */
bool emulated_put(struct emulated_hardware *hardware, uint8_t byte);

/* After robot_step: append the message `motors`. */
void emulated_finish(struct emulated_hardware *hardware, bool armed);

/* Fill at most `most` bytes that go out over the line; return how many. */
size_t emulated_take(struct emulated_hardware *hardware, uint8_t *bytes, size_t most);

#endif
