/* The IMU's axes against gravity and motion, before the first self-test: somebody moves the robot by hand.
 *
 *     upright and still      gravity: theta and phi are within 5 degrees of zero
 *     top tilted forward     the attitude turns about +y from there, and the gyro's integral is the same turn
 *     upright, tilted left   about -x
 *     upright, turned left   about +z
 *
 * Each position is held for half a second; a turn of 15 degrees, 45 about z, is plenty. Nothing is driven. An IMU that is mounted
 * turned, has an exchanged or a negated axis, or a gyro in another unit would make the balance push the robot over.
 */
#ifndef BALLBOT_IMU_CHECK_H
#define BALLBOT_IMU_CHECK_H

#include "ballbot_types.h"

/* Stages of the check, in `stage` of the state; the movements are the even ones. */
enum ballbot_imu_stage {
    BALLBOT_IMU_UPRIGHT = 1,
    BALLBOT_IMU_FORWARD = 2,
    BALLBOT_IMU_LEFT = 4,
    BALLBOT_IMU_TURN = 6,
    BALLBOT_IMU_DONE = 7,
    BALLBOT_IMU_WRONG_AXES = 8, /* the attitude turned about another axis or the other way, or not at all */
    BALLBOT_IMU_WRONG_GYRO = 9  /* the gyro's turn is not the attitude's */
};

/* Begin: upright. */
void ballbot_imu_check_start(struct ballbot_imu_check_state *check);

/* Take a sample; gyro: angular velocity, body frame [rad/s]; attitude: theta, phi, psi [rad]. Missing ones are beyond any sensor's. */
void ballbot_imu_check_step(struct ballbot_imu_check_state *check, float sample_time, const float gyro[3],
                            const float attitude[3]);

#endif
