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

/* Enable the motors and balance from the next step on. The robot must be held upright. */
void robot_arm(struct robot *robot);

/* Take one sample: read the sensors, command the torques, and disable the motors after a stop. */
void robot_step(struct robot *robot);

#endif
