/* Xsens MTi-3: angular velocity and attitude from messages MTData2 of the Xbus protocol.
 *
 *     FA FF 36 length data.. checksum      all bytes after FA add up to 0 modulo 256
 *     data: identifier (2 bytes), size, content; big-endian, single precision
 *
 * The sensor is configured to send quaternions (2010) and rates of turn (8020), in any frame whose z points up (ENU, the
 * default, or NWU). The quaternion is that of the sensor in the frame; R = Rx(theta) Ry(phi) Rz(psi) follows from it.
 */
#ifndef BALLBOT_DRIVERS_MTI3_H
#define BALLBOT_DRIVERS_MTI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The longest data of a message that is taken; longer ones are skipped. */
#define BALLBOT_MTI3_LONGEST 254

/* All zeros at the start, but for the mounting. */
struct ballbot_mti3 {
    float mounting[3][3]; /* takes the sensor's frame to the body's; the unit matrix if it is mounted straight */
    uint8_t data[BALLBOT_MTI3_LONGEST];
    uint8_t sum;    /* of the bytes since FA */
    uint8_t length; /* of the data */
    uint16_t place; /* bytes of the message so far */
    bool fresh;     /* a message came since the last reading */
    float gyro[3];
    float quaternion[4];
};

/* Take bytes as they come from the serial line. */
void ballbot_mti3_take(struct ballbot_mti3 *imu, const uint8_t *bytes, size_t count);

/* Fill the last message's values; return false if none with both values, and a quaternion of length one, came since the
 * last call.
 *
 * gyro: body frame [rad/s]. attitude: theta, phi, psi [rad], psi from -pi to pi.
 */
bool ballbot_mti3_read(struct ballbot_mti3 *imu, float gyro[3], float attitude[3]);

#endif
