/* The hardware behind seven functions, which the application writes for its board.
 *
 * None of them waits: each answers within a small part of a sample time. SI units, radians; x forward, y left, z up; a
 * positive torque turns a wheel as the robot file has it.
 */
#ifndef BALLBOT_HARDWARE_H
#define BALLBOT_HARDWARE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "ballbot_types.h"

/* Fill what the AHRS measured since the last call; return false if there is nothing new and valid.
 *
 * gyro: angular velocity of the body, body frame [rad/s]. attitude: theta, phi, psi of R = Rx Ry Rz [rad]; psi may
 * begin again after a turn.
 */
bool ballbot_read_imu(float gyro[3], float attitude[3]);

/* Fill the counts of all encoders, in quadrature; return false if they cannot be read. */
bool ballbot_read_encoders(int32_t counts[BALLBOT_MAX_WHEELS]);

/* Return the time [us], modulo 2^32. */
uint32_t ballbot_read_time(void);

/* Command the torques at the wheels [N m], held until the next call. */
void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS]);

/* Enable or disable all motor drivers. */
void ballbot_set_enable(bool enabled);

/* Send bytes to the host; what does not fit into the buffer is dropped. */
void ballbot_send(const uint8_t *bytes, size_t count);

/* Fill at most `most` bytes that came from the host; return how many. */
size_t ballbot_receive(uint8_t *bytes, size_t most);

#endif
