/* One robot: sensors, firmware and motors put together, used by both examples. */
#ifndef ROBOT_H
#define ROBOT_H

#include "ballbot.h"
#include "encoders.h"

struct robot {
    struct ballbot_state state;
    struct ballbot_encoders encoders;
    struct ballbot_reading_record reading;
};

/* Start disarmed, motors disabled; return false if the parameters are of another version of the library. */
bool robot_start(struct robot *robot);

/* Enable the motors and test the wheels, half a second in all, from the next step on. Hold the robot. */
void robot_test(struct robot *robot);

/* Enable the motors and balance from the next step on. The robot must be upright. False, and
 * disarmed, unless the test has passed.
 */
bool robot_arm(struct robot *robot);

/* Disable the motors; end a self-test that is running. */
void robot_disarm(struct robot *robot);

/* Take one sample: read the sensors, command the torques, and disable the motors after a stop or a self-test. */
void robot_step(struct robot *robot);

#endif
