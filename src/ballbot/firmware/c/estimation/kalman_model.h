/* The equations of the Kalman filter: its states, its sensors, and the entries of its matrices.
 *
 * Generated from ballbot/estimation/kalman_model.py, which explains them, by
 * `python -m tests.support.firmware_headers`; do not edit.
 */
#ifndef BALLBOT_ESTIMATION_KALMAN_MODEL_H
#define BALLBOT_ESTIMATION_KALMAN_MODEL_H

#include "ballbot_math.h"
#include "ballbot_types.h"

/* The states; those before DRIVEN drive the others, and nothing drives them. */
enum {
    B_X, B_Y, B_Z, DRIFT, A_X, A_Y, G_X, G_Y, S_X, S_Y, PSI, SHOWN_PSI, X, Y, STATES,
    DRIVEN = G_X
};

/* Place of each sensor's first number. */
enum { WHEELS = 0, ATTITUDE = 3, FIX = 6, NUMBERS = 9 };

/* Entries of F besides the unit matrix, and those of H that vary. */
enum { F_ENTRIES = 34, H_ENTRIES = 13 };

/* Omega_z, which does not count while the ball pivots. */
enum { PIVOTING_SEEN = 2 };

/* Variance of psi [rad^2], x or y [m^2] above which a sample multiplies the errors of all three by REMEMBERED */
#define FORGOTTEN_ABOVE 0.04f
#define REMEMBERED 0.9999962f

/* Pairs of states that are known from the start only together. */
static const int32_t TOGETHER[3][2] = {{A_X, G_X}, {A_Y, G_Y}, {PSI, SHOWN_PSI}};

/* Give what a sample adds to the states before the place, and the mean of v (2) [m/s] over it. */
static inline void moved(const struct ballbot_kalman_record *record, const float x[STATES], const float gyro[3], float
        change[X], float velocity[2])
{
    const float t0 = gyro[0] - x[B_X];
    const float t1 = gyro[1] - x[B_Y];
    const float t2 = gyro[2] - x[B_Z];
    const float t3 = (1.0f - (x[G_X] * x[G_X])) - (x[G_Y] * x[G_Y]);
    const float t4 = ballbot_square_root(((t3 < 1e-06f) ? 1e-06f : t3));
    const float t5 = 0.5f * record->sample_time;
    const float t6 = x[G_X] + (t5 * ((x[G_Y] * t2) - (t4 * t1)));
    const float t7 = x[G_Y] + (t5 * ((t4 * t0) - (x[G_X] * t2)));
    const float t8 = (1.0f - (t6 * t6)) - (t7 * t7);
    const float t9 = ballbot_square_root(((t8 < 1e-06f) ? 1e-06f : t8));
    const float t10 = t2 + (((t0 * t6) + (t1 * t7)) / (1.0f + t9));
    const float t11 = -t10;
    const float t12 = ((t10 * (x[S_Y] + (t5 * ((t11 * x[S_X]) - ((record->pull[1][0] * x[G_X]) + (record->pull[1][1] *
        x[G_Y])))))) - ((record->pull[0][0] * t6) + (record->pull[0][1] * t7))) * record->sample_time;
    const float t13 = ((t11 * (x[S_X] + (t5 * ((t10 * x[S_Y]) - ((record->pull[0][0] * x[G_X]) + (record->pull[0][1] *
        x[G_Y])))))) - ((record->pull[1][0] * t6) + (record->pull[1][1] * t7))) * record->sample_time;
    const float t14 = -record->forgotten;
    change[0] = 0.0f;
    change[1] = 0.0f;
    change[2] = 0.0f;
    change[3] = 0.0f;
    change[4] = x[A_X] * t14;
    change[5] = x[A_Y] * t14;
    change[6] = ((t7 * t2) - (t9 * t1)) * record->sample_time;
    change[7] = ((t9 * t0) - (t6 * t2)) * record->sample_time;
    change[8] = t12;
    change[9] = t13;
    change[10] = record->sample_time * t10;
    change[11] = record->sample_time * (t10 + x[DRIFT]);
    velocity[0] = (x[S_X] + (0.5f * t12)) - (((record->lever[0][0] * t0) + (record->lever[0][1] * t1)) +
        (record->lever[0][2] * t2));
    velocity[1] = (x[S_Y] + (0.5f * t13)) - (((record->lever[1][0] * t0) + (record->lever[1][1] * t1)) +
        (record->lever[1][2] * t2));
}

/* Give the entries of F; `turn` are sine and cosine of the heading. */
static inline void linearized(const struct ballbot_kalman_record *record, const float x[STATES], const float gyro[3],
        const float turn[2], float f[F_ENTRIES])
{
    const float t0 = gyro[0] - x[B_X];
    const float t1 = gyro[1] - x[B_Y];
    const float t2 = gyro[2] - x[B_Z];
    const float t3 = (1.0f - (x[G_X] * x[G_X])) - (x[G_Y] * x[G_Y]);
    const float t4 = ballbot_square_root(((t3 < 1e-06f) ? 1e-06f : t3));
    const float t5 = 1.0f + t4;
    const float t6 = record->sample_time * (t2 + (((t0 * x[G_X]) + (t1 * x[G_Y])) / t5));
    const float t7 = record->sample_time / t5;
    const float t8 = record->sample_time / t4;
    const float t9 = x[S_X] - (((record->lever[0][0] * t0) + (record->lever[0][1] * t1)) + (record->lever[0][2] *
        t2));
    const float t10 = x[S_Y] - (((record->lever[1][0] * t0) + (record->lever[1][1] * t1)) + (record->lever[1][2] *
        t2));
    const float t11 = turn[0] * record->sample_time;
    const float t12 = turn[1] * record->sample_time;
    const float t13 = -t11;
    const float t14 = t8 * t1;
    const float t15 = record->sample_time * t2;
    const float t16 = t8 * t0;
    const float t17 = -record->sample_time;
    const float t18 = -t7;
    f[0] = t14 * x[G_X];
    f[1] = t15 + (t14 * x[G_Y]);
    f[2] = -(t15 + (t16 * x[G_X]));
    f[3] = -(t16 * x[G_Y]);
    f[4] = record->sample_time * t4;
    f[5] = t17 * x[G_Y];
    f[6] = t17 * t4;
    f[7] = record->sample_time * x[G_X];
    f[8] = t6;
    f[9] = t17 * record->pull[0][0];
    f[10] = t17 * record->pull[0][1];
    f[11] = t17 * x[S_Y];
    f[12] = -t6;
    f[13] = t17 * record->pull[1][0];
    f[14] = t17 * record->pull[1][1];
    f[15] = record->sample_time * x[S_X];
    f[16] = t7 * t0;
    f[17] = t7 * t1;
    f[18] = t18 * x[G_X];
    f[19] = t18 * x[G_Y];
    f[20] = t17;
    f[21] = record->sample_time;
    f[22] = -((t11 * t9) + (t12 * t10));
    f[23] = t12;
    f[24] = t13;
    f[25] = (record->lever[0][0] * t12) + (record->lever[1][0] * t13);
    f[26] = (record->lever[0][1] * t12) + (record->lever[1][1] * t13);
    f[27] = (record->lever[0][2] * t12) + (record->lever[1][2] * t13);
    f[28] = (t12 * t9) - (t11 * t10);
    f[29] = t11;
    f[30] = t12;
    f[31] = (record->lever[0][0] * t11) + (record->lever[1][0] * t12);
    f[32] = (record->lever[0][1] * t11) + (record->lever[1][1] * t12);
    f[33] = (record->lever[0][2] * t11) + (record->lever[1][2] * t12);
}

/* Give the elements from DRIVEN on of F times a column; the result's lie `apart`. */
static inline void carried(const float f[F_ENTRIES], const float column[STATES], float *result, int32_t apart)
{
    const float t0 = ((((f[16] * column[G_X]) + (f[17] * column[G_Y])) + (f[18] * column[B_X])) + (f[19] *
        column[B_Y])) + (f[20] * column[B_Z]);
    result[G_X * apart] = column[G_X] + ((((f[0] * column[G_X]) + (f[1] * column[G_Y])) + (f[4] * column[B_Y])) +
        (f[5] * column[B_Z]));
    result[G_Y * apart] = column[G_Y] + ((((f[2] * column[G_X]) + (f[3] * column[G_Y])) + (f[6] * column[B_X])) +
        (f[7] * column[B_Z]));
    result[S_X * apart] = column[S_X] + ((((f[8] * column[S_Y]) + (f[9] * column[G_X])) + (f[10] * column[G_Y])) +
        (f[11] * column[B_Z]));
    result[S_Y * apart] = column[S_Y] + ((((f[12] * column[S_X]) + (f[13] * column[G_X])) + (f[14] * column[G_Y])) +
        (f[15] * column[B_Z]));
    result[PSI * apart] = column[PSI] + t0;
    result[SHOWN_PSI * apart] = column[SHOWN_PSI] + (t0 + (f[21] * column[DRIFT]));
    result[X * apart] = column[X] + ((((((f[22] * column[PSI]) + (f[23] * column[S_X])) + (f[24] * column[S_Y])) +
        (f[25] * column[B_X])) + (f[26] * column[B_Y])) + (f[27] * column[B_Z]));
    result[Y * apart] = column[Y] + ((((((f[28] * column[PSI]) + (f[29] * column[S_X])) + (f[30] * column[S_Y])) +
        (f[31] * column[B_X])) + (f[32] * column[B_Y])) + (f[33] * column[B_Z]));
}

/* Add to F P, in the columns of the bias, what a sample's noise of the gyro adds as if it were bias. */
static inline void shaken(const float f[F_ENTRIES], float gyro_variance, float FP[STATES][STATES])
{
    FP[G_X][B_Y] = FP[G_X][B_Y] + (gyro_variance * f[4]);
    FP[G_X][B_Z] = FP[G_X][B_Z] + (gyro_variance * f[5]);
    FP[G_Y][B_X] = FP[G_Y][B_X] + (gyro_variance * f[6]);
    FP[G_Y][B_Z] = FP[G_Y][B_Z] + (gyro_variance * f[7]);
    FP[S_X][B_Z] = FP[S_X][B_Z] + (gyro_variance * f[11]);
    FP[S_Y][B_Z] = FP[S_Y][B_Z] + (gyro_variance * f[15]);
    FP[PSI][B_X] = FP[PSI][B_X] + (gyro_variance * f[18]);
    FP[SHOWN_PSI][B_X] = FP[SHOWN_PSI][B_X] + (gyro_variance * f[18]);
    FP[PSI][B_Y] = FP[PSI][B_Y] + (gyro_variance * f[19]);
    FP[SHOWN_PSI][B_Y] = FP[SHOWN_PSI][B_Y] + (gyro_variance * f[19]);
    FP[PSI][B_Z] = FP[PSI][B_Z] + (gyro_variance * f[20]);
    FP[SHOWN_PSI][B_Z] = FP[SHOWN_PSI][B_Z] + (gyro_variance * f[20]);
    FP[X][B_X] = FP[X][B_X] + (gyro_variance * f[25]);
    FP[X][B_Y] = FP[X][B_Y] + (gyro_variance * f[26]);
    FP[X][B_Z] = FP[X][B_Z] + (gyro_variance * f[27]);
    FP[Y][B_X] = FP[Y][B_X] + (gyro_variance * f[31]);
    FP[Y][B_Y] = FP[Y][B_Y] + (gyro_variance * f[32]);
    FP[Y][B_Z] = FP[Y][B_Z] + (gyro_variance * f[33]);
}

/* Give the residuals of all that the sensors show, and the entries of H that vary; wrong where it is missing. */
static inline void expected(const struct ballbot_kalman_record *record, const float x[STATES], const float gyro[3],
        const float velocity[2], const struct ballbot_reading_record *reading, const float wheels[3], const float
        attitude[3], const float fix[3], float residual[NUMBERS], float h[H_ENTRIES])
{
    const float t0 = (1.0f - (x[G_X] * x[G_X])) - (x[G_Y] * x[G_Y]);
    const float t1 = ballbot_square_root(((t0 < 1e-06f) ? 1e-06f : t0));
    const float t2 = 1.0f / (1.0f + t1);
    const float t3 = 1.0f - ((t2 * x[G_X]) * x[G_X]);
    const float t4 = ((-t2) * x[G_X]) * x[G_Y];
    const float t5 = -x[G_X];
    const float t6 = 1.0f - ((t2 * x[G_Y]) * x[G_Y]);
    const float t7 = -x[G_Y];
    const float t8 = wheels[0] + (gyro[0] - x[B_X]);
    const float t9 = wheels[1] + (gyro[1] - x[B_Y]);
    const float t10 = wheels[2] + (gyro[2] - x[B_Z]);
    const float t11 = t4 * record->radius;
    const float t12 = record->radius * t10;
    residual[0] = (record->radius * (((t4 * t8) + (t6 * t9)) + (t7 * t10))) - velocity[0];
    residual[1] = ((-record->radius) * (((t3 * t8) + (t4 * t9)) + (t5 * t10))) - velocity[1];
    residual[2] = ((x[G_X] * t8) + (x[G_Y] * t9)) + (t1 * t10);
    residual[3] = attitude[0] - (x[A_X] + x[G_X]);
    residual[4] = attitude[1] - (x[A_Y] + x[G_Y]);
    residual[5] = attitude[2] - x[SHOWN_PSI];
    residual[6] = fix[0] - x[X];
    residual[7] = fix[1] - x[Y];
    residual[8] = fix[2] - x[PSI];
    h[0] = record->lever[0][0] + t11;
    h[1] = record->lever[0][1] + (t6 * record->radius);
    h[2] = record->lever[0][2] + (t7 * record->radius);
    h[3] = t12;
    h[4] = record->lever[1][0] - (t3 * record->radius);
    h[5] = record->lever[1][1] - t11;
    h[6] = record->lever[1][2] - (t5 * record->radius);
    h[7] = -t12;
    h[8] = x[G_X];
    h[9] = x[G_Y];
    h[10] = t1;
    h[11] = -t8;
    h[12] = -t9;
    (void)reading;
}

/* Give q = P h of a number, h^T q, and what h expects of the known changes of the state. Of P nothing below the
diagonal is read. */
static inline void projected(int32_t number, float P[STATES][STATES], const float h[H_ENTRIES], const float
        change[STATES], float q[STATES], float *spread, float *known)
{
    switch (number) {
    case 0: {
        const float t0 = (((P[B_X][S_X] + (P[B_X][B_X] * h[0])) + (P[B_X][B_Y] * h[1])) + (P[B_X][B_Z] * h[2])) +
            (P[B_X][G_Y] * h[3]);
        const float t1 = (((P[B_Y][S_X] + (P[B_X][B_Y] * h[0])) + (P[B_Y][B_Y] * h[1])) + (P[B_Y][B_Z] * h[2])) +
            (P[B_Y][G_Y] * h[3]);
        const float t2 = (((P[B_Z][S_X] + (P[B_X][B_Z] * h[0])) + (P[B_Y][B_Z] * h[1])) + (P[B_Z][B_Z] * h[2])) +
            (P[B_Z][G_Y] * h[3]);
        const float t3 = (((P[G_Y][S_X] + (P[B_X][G_Y] * h[0])) + (P[B_Y][G_Y] * h[1])) + (P[B_Z][G_Y] * h[2])) +
            (P[G_Y][G_Y] * h[3]);
        const float t4 = (((P[S_X][S_X] + (P[B_X][S_X] * h[0])) + (P[B_Y][S_X] * h[1])) + (P[B_Z][S_X] * h[2])) +
            (P[G_Y][S_X] * h[3]);
        q[B_X] = t0;
        q[B_Y] = t1;
        q[B_Z] = t2;
        q[DRIFT] = (((P[DRIFT][S_X] + (P[B_X][DRIFT] * h[0])) + (P[B_Y][DRIFT] * h[1])) + (P[B_Z][DRIFT] * h[2])) +
            (P[DRIFT][G_Y] * h[3]);
        q[A_X] = (((P[A_X][S_X] + (P[B_X][A_X] * h[0])) + (P[B_Y][A_X] * h[1])) + (P[B_Z][A_X] * h[2])) + (P[A_X][G_Y]
            * h[3]);
        q[A_Y] = (((P[A_Y][S_X] + (P[B_X][A_Y] * h[0])) + (P[B_Y][A_Y] * h[1])) + (P[B_Z][A_Y] * h[2])) + (P[A_Y][G_Y]
            * h[3]);
        q[G_X] = (((P[G_X][S_X] + (P[B_X][G_X] * h[0])) + (P[B_Y][G_X] * h[1])) + (P[B_Z][G_X] * h[2])) + (P[G_X][G_Y]
            * h[3]);
        q[G_Y] = t3;
        q[S_X] = t4;
        q[S_Y] = (((P[S_X][S_Y] + (P[B_X][S_Y] * h[0])) + (P[B_Y][S_Y] * h[1])) + (P[B_Z][S_Y] * h[2])) + (P[G_Y][S_Y]
            * h[3]);
        q[PSI] = (((P[S_X][PSI] + (P[B_X][PSI] * h[0])) + (P[B_Y][PSI] * h[1])) + (P[B_Z][PSI] * h[2])) + (P[G_Y][PSI]
            * h[3]);
        q[SHOWN_PSI] = (((P[S_X][SHOWN_PSI] + (P[B_X][SHOWN_PSI] * h[0])) + (P[B_Y][SHOWN_PSI] * h[1])) +
            (P[B_Z][SHOWN_PSI] * h[2])) + (P[G_Y][SHOWN_PSI] * h[3]);
        q[X] = (((P[S_X][X] + (P[B_X][X] * h[0])) + (P[B_Y][X] * h[1])) + (P[B_Z][X] * h[2])) + (P[G_Y][X] * h[3]);
        q[Y] = (((P[S_X][Y] + (P[B_X][Y] * h[0])) + (P[B_Y][Y] * h[1])) + (P[B_Z][Y] * h[2])) + (P[G_Y][Y] * h[3]);
        *spread = (((t4 + (h[0] * t0)) + (h[1] * t1)) + (h[2] * t2)) + (h[3] * t3);
        *known = (((change[S_X] + (h[0] * change[B_X])) + (h[1] * change[B_Y])) + (h[2] * change[B_Z])) + (h[3] *
            change[G_Y]);
        break;
    }
    case 1: {
        const float t0 = (((P[B_X][S_Y] + (P[B_X][B_X] * h[4])) + (P[B_X][B_Y] * h[5])) + (P[B_X][B_Z] * h[6])) +
            (P[B_X][G_X] * h[7]);
        const float t1 = (((P[B_Y][S_Y] + (P[B_X][B_Y] * h[4])) + (P[B_Y][B_Y] * h[5])) + (P[B_Y][B_Z] * h[6])) +
            (P[B_Y][G_X] * h[7]);
        const float t2 = (((P[B_Z][S_Y] + (P[B_X][B_Z] * h[4])) + (P[B_Y][B_Z] * h[5])) + (P[B_Z][B_Z] * h[6])) +
            (P[B_Z][G_X] * h[7]);
        const float t3 = (((P[G_X][S_Y] + (P[B_X][G_X] * h[4])) + (P[B_Y][G_X] * h[5])) + (P[B_Z][G_X] * h[6])) +
            (P[G_X][G_X] * h[7]);
        const float t4 = (((P[S_Y][S_Y] + (P[B_X][S_Y] * h[4])) + (P[B_Y][S_Y] * h[5])) + (P[B_Z][S_Y] * h[6])) +
            (P[G_X][S_Y] * h[7]);
        q[B_X] = t0;
        q[B_Y] = t1;
        q[B_Z] = t2;
        q[DRIFT] = (((P[DRIFT][S_Y] + (P[B_X][DRIFT] * h[4])) + (P[B_Y][DRIFT] * h[5])) + (P[B_Z][DRIFT] * h[6])) +
            (P[DRIFT][G_X] * h[7]);
        q[A_X] = (((P[A_X][S_Y] + (P[B_X][A_X] * h[4])) + (P[B_Y][A_X] * h[5])) + (P[B_Z][A_X] * h[6])) + (P[A_X][G_X]
            * h[7]);
        q[A_Y] = (((P[A_Y][S_Y] + (P[B_X][A_Y] * h[4])) + (P[B_Y][A_Y] * h[5])) + (P[B_Z][A_Y] * h[6])) + (P[A_Y][G_X]
            * h[7]);
        q[G_X] = t3;
        q[G_Y] = (((P[G_Y][S_Y] + (P[B_X][G_Y] * h[4])) + (P[B_Y][G_Y] * h[5])) + (P[B_Z][G_Y] * h[6])) + (P[G_X][G_Y]
            * h[7]);
        q[S_X] = (((P[S_X][S_Y] + (P[B_X][S_X] * h[4])) + (P[B_Y][S_X] * h[5])) + (P[B_Z][S_X] * h[6])) + (P[G_X][S_X]
            * h[7]);
        q[S_Y] = t4;
        q[PSI] = (((P[S_Y][PSI] + (P[B_X][PSI] * h[4])) + (P[B_Y][PSI] * h[5])) + (P[B_Z][PSI] * h[6])) + (P[G_X][PSI]
            * h[7]);
        q[SHOWN_PSI] = (((P[S_Y][SHOWN_PSI] + (P[B_X][SHOWN_PSI] * h[4])) + (P[B_Y][SHOWN_PSI] * h[5])) +
            (P[B_Z][SHOWN_PSI] * h[6])) + (P[G_X][SHOWN_PSI] * h[7]);
        q[X] = (((P[S_Y][X] + (P[B_X][X] * h[4])) + (P[B_Y][X] * h[5])) + (P[B_Z][X] * h[6])) + (P[G_X][X] * h[7]);
        q[Y] = (((P[S_Y][Y] + (P[B_X][Y] * h[4])) + (P[B_Y][Y] * h[5])) + (P[B_Z][Y] * h[6])) + (P[G_X][Y] * h[7]);
        *spread = (((t4 + (h[4] * t0)) + (h[5] * t1)) + (h[6] * t2)) + (h[7] * t3);
        *known = (((change[S_Y] + (h[4] * change[B_X])) + (h[5] * change[B_Y])) + (h[6] * change[B_Z])) + (h[7] *
            change[G_X]);
        break;
    }
    case 2: {
        const float t0 = ((((P[B_X][B_X] * h[8]) + (P[B_X][B_Y] * h[9])) + (P[B_X][B_Z] * h[10])) + (P[B_X][G_X] *
            h[11])) + (P[B_X][G_Y] * h[12]);
        const float t1 = ((((P[B_X][B_Y] * h[8]) + (P[B_Y][B_Y] * h[9])) + (P[B_Y][B_Z] * h[10])) + (P[B_Y][G_X] *
            h[11])) + (P[B_Y][G_Y] * h[12]);
        const float t2 = ((((P[B_X][B_Z] * h[8]) + (P[B_Y][B_Z] * h[9])) + (P[B_Z][B_Z] * h[10])) + (P[B_Z][G_X] *
            h[11])) + (P[B_Z][G_Y] * h[12]);
        const float t3 = ((((P[B_X][G_X] * h[8]) + (P[B_Y][G_X] * h[9])) + (P[B_Z][G_X] * h[10])) + (P[G_X][G_X] *
            h[11])) + (P[G_X][G_Y] * h[12]);
        const float t4 = ((((P[B_X][G_Y] * h[8]) + (P[B_Y][G_Y] * h[9])) + (P[B_Z][G_Y] * h[10])) + (P[G_X][G_Y] *
            h[11])) + (P[G_Y][G_Y] * h[12]);
        q[B_X] = t0;
        q[B_Y] = t1;
        q[B_Z] = t2;
        q[DRIFT] = ((((P[B_X][DRIFT] * h[8]) + (P[B_Y][DRIFT] * h[9])) + (P[B_Z][DRIFT] * h[10])) + (P[DRIFT][G_X] *
            h[11])) + (P[DRIFT][G_Y] * h[12]);
        q[A_X] = ((((P[B_X][A_X] * h[8]) + (P[B_Y][A_X] * h[9])) + (P[B_Z][A_X] * h[10])) + (P[A_X][G_X] * h[11])) +
            (P[A_X][G_Y] * h[12]);
        q[A_Y] = ((((P[B_X][A_Y] * h[8]) + (P[B_Y][A_Y] * h[9])) + (P[B_Z][A_Y] * h[10])) + (P[A_Y][G_X] * h[11])) +
            (P[A_Y][G_Y] * h[12]);
        q[G_X] = t3;
        q[G_Y] = t4;
        q[S_X] = ((((P[B_X][S_X] * h[8]) + (P[B_Y][S_X] * h[9])) + (P[B_Z][S_X] * h[10])) + (P[G_X][S_X] * h[11])) +
            (P[G_Y][S_X] * h[12]);
        q[S_Y] = ((((P[B_X][S_Y] * h[8]) + (P[B_Y][S_Y] * h[9])) + (P[B_Z][S_Y] * h[10])) + (P[G_X][S_Y] * h[11])) +
            (P[G_Y][S_Y] * h[12]);
        q[PSI] = ((((P[B_X][PSI] * h[8]) + (P[B_Y][PSI] * h[9])) + (P[B_Z][PSI] * h[10])) + (P[G_X][PSI] * h[11])) +
            (P[G_Y][PSI] * h[12]);
        q[SHOWN_PSI] = ((((P[B_X][SHOWN_PSI] * h[8]) + (P[B_Y][SHOWN_PSI] * h[9])) + (P[B_Z][SHOWN_PSI] * h[10])) +
            (P[G_X][SHOWN_PSI] * h[11])) + (P[G_Y][SHOWN_PSI] * h[12]);
        q[X] = ((((P[B_X][X] * h[8]) + (P[B_Y][X] * h[9])) + (P[B_Z][X] * h[10])) + (P[G_X][X] * h[11])) + (P[G_Y][X]
            * h[12]);
        q[Y] = ((((P[B_X][Y] * h[8]) + (P[B_Y][Y] * h[9])) + (P[B_Z][Y] * h[10])) + (P[G_X][Y] * h[11])) + (P[G_Y][Y]
            * h[12]);
        *spread = ((((h[8] * t0) + (h[9] * t1)) + (h[10] * t2)) + (h[11] * t3)) + (h[12] * t4);
        *known = ((((h[8] * change[B_X]) + (h[9] * change[B_Y])) + (h[10] * change[B_Z])) + (h[11] * change[G_X])) +
            (h[12] * change[G_Y]);
        break;
    }
    case 3: {
        const float t0 = P[A_X][A_X] + P[A_X][G_X];
        const float t1 = P[A_X][G_X] + P[G_X][G_X];
        q[B_X] = P[B_X][A_X] + P[B_X][G_X];
        q[B_Y] = P[B_Y][A_X] + P[B_Y][G_X];
        q[B_Z] = P[B_Z][A_X] + P[B_Z][G_X];
        q[DRIFT] = P[DRIFT][A_X] + P[DRIFT][G_X];
        q[A_X] = t0;
        q[A_Y] = P[A_X][A_Y] + P[A_Y][G_X];
        q[G_X] = t1;
        q[G_Y] = P[A_X][G_Y] + P[G_X][G_Y];
        q[S_X] = P[A_X][S_X] + P[G_X][S_X];
        q[S_Y] = P[A_X][S_Y] + P[G_X][S_Y];
        q[PSI] = P[A_X][PSI] + P[G_X][PSI];
        q[SHOWN_PSI] = P[A_X][SHOWN_PSI] + P[G_X][SHOWN_PSI];
        q[X] = P[A_X][X] + P[G_X][X];
        q[Y] = P[A_X][Y] + P[G_X][Y];
        *spread = t0 + t1;
        *known = change[A_X] + change[G_X];
        break;
    }
    case 4: {
        const float t0 = P[A_Y][A_Y] + P[A_Y][G_Y];
        const float t1 = P[A_Y][G_Y] + P[G_Y][G_Y];
        q[B_X] = P[B_X][A_Y] + P[B_X][G_Y];
        q[B_Y] = P[B_Y][A_Y] + P[B_Y][G_Y];
        q[B_Z] = P[B_Z][A_Y] + P[B_Z][G_Y];
        q[DRIFT] = P[DRIFT][A_Y] + P[DRIFT][G_Y];
        q[A_X] = P[A_X][A_Y] + P[A_X][G_Y];
        q[A_Y] = t0;
        q[G_X] = P[A_Y][G_X] + P[G_X][G_Y];
        q[G_Y] = t1;
        q[S_X] = P[A_Y][S_X] + P[G_Y][S_X];
        q[S_Y] = P[A_Y][S_Y] + P[G_Y][S_Y];
        q[PSI] = P[A_Y][PSI] + P[G_Y][PSI];
        q[SHOWN_PSI] = P[A_Y][SHOWN_PSI] + P[G_Y][SHOWN_PSI];
        q[X] = P[A_Y][X] + P[G_Y][X];
        q[Y] = P[A_Y][Y] + P[G_Y][Y];
        *spread = t0 + t1;
        *known = change[A_Y] + change[G_Y];
        break;
    }
    case 5: {
        q[B_X] = P[B_X][SHOWN_PSI];
        q[B_Y] = P[B_Y][SHOWN_PSI];
        q[B_Z] = P[B_Z][SHOWN_PSI];
        q[DRIFT] = P[DRIFT][SHOWN_PSI];
        q[A_X] = P[A_X][SHOWN_PSI];
        q[A_Y] = P[A_Y][SHOWN_PSI];
        q[G_X] = P[G_X][SHOWN_PSI];
        q[G_Y] = P[G_Y][SHOWN_PSI];
        q[S_X] = P[S_X][SHOWN_PSI];
        q[S_Y] = P[S_Y][SHOWN_PSI];
        q[PSI] = P[PSI][SHOWN_PSI];
        q[SHOWN_PSI] = P[SHOWN_PSI][SHOWN_PSI];
        q[X] = P[SHOWN_PSI][X];
        q[Y] = P[SHOWN_PSI][Y];
        *spread = P[SHOWN_PSI][SHOWN_PSI];
        *known = change[SHOWN_PSI];
        break;
    }
    case 6: {
        q[B_X] = P[B_X][X];
        q[B_Y] = P[B_Y][X];
        q[B_Z] = P[B_Z][X];
        q[DRIFT] = P[DRIFT][X];
        q[A_X] = P[A_X][X];
        q[A_Y] = P[A_Y][X];
        q[G_X] = P[G_X][X];
        q[G_Y] = P[G_Y][X];
        q[S_X] = P[S_X][X];
        q[S_Y] = P[S_Y][X];
        q[PSI] = P[PSI][X];
        q[SHOWN_PSI] = P[SHOWN_PSI][X];
        q[X] = P[X][X];
        q[Y] = P[X][Y];
        *spread = P[X][X];
        *known = change[X];
        break;
    }
    case 7: {
        q[B_X] = P[B_X][Y];
        q[B_Y] = P[B_Y][Y];
        q[B_Z] = P[B_Z][Y];
        q[DRIFT] = P[DRIFT][Y];
        q[A_X] = P[A_X][Y];
        q[A_Y] = P[A_Y][Y];
        q[G_X] = P[G_X][Y];
        q[G_Y] = P[G_Y][Y];
        q[S_X] = P[S_X][Y];
        q[S_Y] = P[S_Y][Y];
        q[PSI] = P[PSI][Y];
        q[SHOWN_PSI] = P[SHOWN_PSI][Y];
        q[X] = P[X][Y];
        q[Y] = P[Y][Y];
        *spread = P[Y][Y];
        *known = change[Y];
        break;
    }
    default: {
        q[B_X] = P[B_X][PSI];
        q[B_Y] = P[B_Y][PSI];
        q[B_Z] = P[B_Z][PSI];
        q[DRIFT] = P[DRIFT][PSI];
        q[A_X] = P[A_X][PSI];
        q[A_Y] = P[A_Y][PSI];
        q[G_X] = P[G_X][PSI];
        q[G_Y] = P[G_Y][PSI];
        q[S_X] = P[S_X][PSI];
        q[S_Y] = P[S_Y][PSI];
        q[PSI] = P[PSI][PSI];
        q[SHOWN_PSI] = P[PSI][SHOWN_PSI];
        q[X] = P[PSI][X];
        q[Y] = P[PSI][Y];
        *spread = P[PSI][PSI];
        *known = change[PSI];
        break;
    }
    }
}

#endif
