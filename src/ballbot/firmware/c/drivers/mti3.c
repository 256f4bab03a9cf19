#include "drivers/mti3.h"

#include "ballbot_math.h"

#define PREAMBLE 0xFAu
#define BUS 0xFFu
#define DATA 0x36u
/* Identifiers in single precision, in the frame ENU; with the next bit it is NWU, whose z points up as well. */
#define QUATERNION 0x2010u
#define RATE_OF_TURN 0x8020u
#define NWU 0x0008u
/* Bytes before the data: FA FF 36 length. */
#define HEAD 4u

/* Largest error of the square of a quaternion's length; rounding is 1e-6. */
#define LONGEST_ERROR 1e-3f

/* Return the number of 4 bytes, the highest first. */
static float number(const uint8_t *bytes)
{
    union {
        uint32_t bits;
        float value;
    } both;

    both.bits = ((uint32_t)bytes[0] << 24) | ((uint32_t)bytes[1] << 16) | ((uint32_t)bytes[2] << 8) | bytes[3];
    return both.value;
}

static void numbers(const uint8_t *bytes, size_t count, float values[])
{
    for (size_t k = 0; k < count; ++k) {
        values[k] = number(&bytes[4 * k]);
    }
}

/* Take over the values of a message. */
static void take_message(struct ballbot_mti3 *imu)
{
    bool turned = false;
    bool turning = false;
    size_t at = 0;

    while (at + 3u <= imu->length) {
        const uint32_t identifier = (((uint32_t)imu->data[at] << 8) | imu->data[at + 1u]) & ~NWU;
        const uint8_t size = imu->data[at + 2u];
        const uint8_t *content = &imu->data[at + 3u];

        at += 3u + size;
        if (at > imu->length) {
            return;
        }
        if (identifier == QUATERNION && size == 16u) {
            numbers(content, 4, imu->quaternion);
            turned = true;
        } else if (identifier == RATE_OF_TURN && size == 12u) {
            numbers(content, 3, imu->gyro);
            turning = true;
        } else {
            /* something else that the sensor is configured to send */
        }
    }
    imu->fresh = turned && turning;
}

/* Take one byte; wrong ones let the search for a message begin anew. */
static void take(struct ballbot_mti3 *imu, uint8_t byte)
{
    static const uint8_t head[3] = { PREAMBLE, BUS, DATA };
    const uint16_t place = imu->place;

    imu->sum = (place == 0u) ? 0u : (uint8_t)(imu->sum + byte);
    imu->place = (uint16_t)(place + 1u);
    if (place < 3u) {
        if (byte != head[place]) {
            imu->sum = 0u;
            imu->place = (byte == PREAMBLE) ? 1u : 0u;
        }
    } else if (place == 3u) {
        imu->length = byte;
        if (byte > BALLBOT_MTI3_LONGEST) {
            imu->place = 0u;
        }
    } else if (place < HEAD + imu->length) {
        imu->data[place - HEAD] = byte;
    } else {
        imu->place = 0u;
        if (imu->sum == 0u) {
            take_message(imu);
        } else if (byte == PREAMBLE) {
            imu->sum = 0u;
            imu->place = 1u; /* a byte was lost: the next message begins here */
        } else {
            /* the search goes on */
        }
    }
}

void ballbot_mti3_take(struct ballbot_mti3 *imu, const uint8_t *bytes, size_t count)
{
    for (size_t k = 0; k < count; ++k) {
        take(imu, bytes[k]);
    }
}

/* Fill the rotation (3, 3) of a quaternion q_0 + q_1 i + q_2 j + q_3 k of length one. */
static void rotation(const float q[4], float R[3][3])
{
    R[0][0] = 1.0f - 2.0f * (q[2] * q[2] + q[3] * q[3]);
    R[0][1] = 2.0f * (q[1] * q[2] - q[0] * q[3]);
    R[0][2] = 2.0f * (q[1] * q[3] + q[0] * q[2]);
    R[1][0] = 2.0f * (q[1] * q[2] + q[0] * q[3]);
    R[1][1] = 1.0f - 2.0f * (q[1] * q[1] + q[3] * q[3]);
    R[1][2] = 2.0f * (q[2] * q[3] - q[0] * q[1]);
    R[2][0] = 2.0f * (q[1] * q[3] - q[0] * q[2]);
    R[2][1] = 2.0f * (q[2] * q[3] + q[0] * q[1]);
    R[2][2] = 1.0f - 2.0f * (q[1] * q[1] + q[2] * q[2]);
}

/* Fill A B^T of two matrices (3, 3). */
static void times_transposed(float A[3][3], float B[3][3], float product[3][3])
{
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            product[i][j] = A[i][0] * B[j][0] + A[i][1] * B[j][1] + A[i][2] * B[j][2];
        }
    }
}

bool ballbot_mti3_read(struct ballbot_mti3 *imu, float gyro[3], float attitude[3])
{
    float of_sensor[3][3];
    float R[3][3];

    if (!imu->fresh) {
        return false;
    }
    imu->fresh = false;
    const float *q = imu->quaternion;
    const float square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];

    /* zeros would pass for upright; a NaN fails too */
    if (!(ballbot_magnitude(square - 1.0f) <= LONGEST_ERROR)) {
        return false;
    }
    rotation(imu->quaternion, of_sensor);
    times_transposed(of_sensor, imu->mounting, R); /* the body's frame to the sensor's, and that to the world's */
    attitude[0] = ballbot_arctangent(-R[1][2], R[2][2]);
    attitude[1] = ballbot_arctangent(R[0][2], ballbot_square_root(R[1][2] * R[1][2] + R[2][2] * R[2][2]));
    attitude[2] = ballbot_arctangent(-R[0][1], R[0][0]);
    for (int i = 0; i < 3; ++i) {
        gyro[i] = imu->mounting[i][0] * imu->gyro[0] + imu->mounting[i][1] * imu->gyro[1] +
                  imu->mounting[i][2] * imu->gyro[2];
    }
    return true;
}
