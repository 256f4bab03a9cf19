/* One robot: sensors, firmware, link and motors put together, used by both examples, and by the emulated robots. */
#ifndef ROBOT_H
#define ROBOT_H

#include "ballbot.h"
#include "encoders.h"
#include "link/link.h"

struct robot {
    struct ballbot_parameters parameters; /* in RAM: a host may write others */
    struct ballbot_state state;
    struct ballbot_encoders encoders;
    struct ballbot_reading_record reading;
    struct ballbot_link link;
    bool enabled;
};

/* Start disarmed, motors disabled; return false if the parameters are of another version of the library.
 *
 * capabilities: bits of ballbot_capability; BALLBOT_CAPABILITY_BUTTON if a host may be on another computer. starts: a number that
 * is another one at each start, such as a counter in a backup register (link/link.h).
 */
bool robot_start(struct robot *robot, const struct ballbot_parameters *parameters, int32_t capabilities, uint32_t starts);

/* Begin the self-test. The first one since the start checks the IMU's axes: move the robot by hand (imu_check.h), and call this again
 * when ballbot_self_test_of gives BALLBOT_TEST_IMU_PASSED. Then the motors are enabled and each wheel is tested, about a second
 * in all. Hold the robot.
 */
void robot_test(struct robot *robot);

/* Enable the motors and balance from the next step on. The robot must be upright. False unless the test has passed. */
bool robot_arm(struct robot *robot);

/* Disable the motors. */
void robot_disarm(struct robot *robot);

/* Take one sample: obey the host, read the sensors, command the torques, send the state. The motors are enabled while the robot
 * is armed or tests itself, and disabled after a stop.
 */
void robot_step(struct robot *robot);

#endif
