/* Self-test before the first balance: each wheel is pushed forward and back, and its encoder must turn as it is pushed.
 *
 * One wheel after the other gets a torque that rises until the wheel which turns most has made the counts of
 * `self_test` in the parameters. Then the same push follows backward, from its end to its beginning, and a rest of the same
 * length. It takes about a second. A motor or an encoder with the wrong sign, or cables in the wrong order, would turn
 * the balance's feedback into a push away from upright; here they move a wheel by some degrees. Hold the robot
 * meanwhile, or let it stand upright by itself.
 */
#ifndef BALLBOT_SELF_TEST_H
#define BALLBOT_SELF_TEST_H

#include <stdbool.h>

#include "ballbot_types.h"

enum ballbot_self_test {
    BALLBOT_TEST_NOT_RUN = 0,
    BALLBOT_TEST_RUNNING = 1,
    BALLBOT_TEST_PASSED = 2,
    BALLBOT_TEST_DEAD_MOTOR = 3,   /* the wheel was pushed and no encoder turned */
    BALLBOT_TEST_TORQUE_ORDER = 4, /* another encoder turned the most */
    BALLBOT_TEST_TORQUE_SIGN = 5,  /* pushed forward, the encoder turned backward */
    BALLBOT_TEST_STOPPED = 6,      /* disarmed, stopped by the safety layer, or encoders were missing */
    /* the check of the IMU's axes before the first test (imu_check.h); nothing is driven */
    BALLBOT_TEST_HOLD_UPRIGHT = 7, /* waits until the robot is held upright and still */
    BALLBOT_TEST_TILT_FORWARD = 8, /* waits until its top is tilted forward and held */
    BALLBOT_TEST_TILT_LEFT = 9,    /* or to the left */
    BALLBOT_TEST_TURN_LEFT = 10,   /* or until it is turned to the left */
    BALLBOT_TEST_IMU_PASSED = 11,  /* begin the test again for motors and encoders */
    BALLBOT_TEST_IMU_AXES = 12,    /* in movement `wheel` the attitude turned about another axis or the other way */
    BALLBOT_TEST_IMU_GYRO = 13     /* in movement `wheel` the gyro's turn was not the attitude's */
};

/* Begin. */
void ballbot_self_test_start(struct ballbot_self_test_state *test);

/* Take a sample's encoders; fill the torques of all wheels [N m]. Ends with a result and zero torques. */
void ballbot_self_test_step(struct ballbot_self_test_state *test, const struct ballbot_parameters *parameters,
                            const struct ballbot_reading_record *reading, float torques[BALLBOT_MAX_WHEELS]);

#endif
