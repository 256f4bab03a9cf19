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

/* Omega_z, which counts the less the more the ball pivots. */
enum { PIVOTING_SEEN = 2 };

/* Pairs of states that are known from the start only together. */
static const int32_t TOGETHER[4][2] = {{A_X, G_X}, {A_Y, G_Y}, {PSI, SHOWN_PSI}, {B_Z, DRIFT}};

/* Give what a sample adds to the state, and the mean of v (2) [m/s] over it. */
static inline void moved(const struct ballbot_kalman_record *record, const float x[STATES], const float gyro[3], float
        change[STATES], float velocity[2])
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
    const float t11 = x[S_X] - (((record->lever[0][0] * t0) + (record->lever[0][1] * t1)) + (record->lever[0][2] *
        t2));
    const float t12 = x[S_Y] - (((record->lever[1][0] * t0) + (record->lever[1][1] * t1)) + (record->lever[1][2] *
        t2));
    const float t13 = ballbot_square_root(((t11 * t11) + (t12 * t12)));
    const float t14 = record->rolling / ((t13 < 0.046875f) ? 0.046875f : t13);
    const float t15 = t11 * t14;
    const float t16 = t12 * t14;
    const float t17 = x[G_X] + t15;
    const float t18 = x[G_Y] + t16;
    const float t19 = -t10;
    const float t20 = t6 + t15;
    const float t21 = t7 + t16;
    const float t22 = ((t10 * (x[S_Y] + (t5 * ((t19 * x[S_X]) - ((record->pull[1][0] * t17) + (record->pull[1][1] *
        t18)))))) - ((record->pull[0][0] * t20) + (record->pull[0][1] * t21))) * record->sample_time;
    const float t23 = ((t19 * (x[S_X] + (t5 * ((t10 * x[S_Y]) - ((record->pull[0][0] * t17) + (record->pull[0][1] *
        t18)))))) - ((record->pull[1][0] * t20) + (record->pull[1][1] * t21))) * record->sample_time;
    const float t24 = t11 + (t22 * 0.5f);
    const float t25 = t12 + (t23 * 0.5f);
    const float t26 = -record->forgotten;
    const float t27 = record->sample_time * t10;
    float turn[2];
    ballbot_sine_cosine((x[PSI] + (0.5f * t27)), &turn[0], &turn[1]);
    change[B_X] = 0.0f;
    change[B_Y] = 0.0f;
    change[B_Z] = 0.0f;
    change[DRIFT] = 0.0f;
    change[A_X] = x[A_X] * t26;
    change[A_Y] = x[A_Y] * t26;
    change[G_X] = ((t7 * t2) - (t9 * t1)) * record->sample_time;
    change[G_Y] = ((t9 * t0) - (t6 * t2)) * record->sample_time;
    change[S_X] = t22;
    change[S_Y] = t23;
    change[PSI] = t27;
    change[SHOWN_PSI] = record->sample_time * (t10 + x[DRIFT]);
    change[X] = ((turn[1] * t24) - (turn[0] * t25)) * record->sample_time;
    change[Y] = ((turn[0] * t24) + (turn[1] * t25)) * record->sample_time;
    velocity[0] = t24;
    velocity[1] = t25;
}

/* Give the entries of F. */
static inline void linearized(const struct ballbot_kalman_record *record, const float x[STATES], const float gyro[3],
        float f[F_ENTRIES])
{
    float turn[2];
    ballbot_sine_cosine(x[PSI], &turn[0], &turn[1]);
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

/* Take from P what is forgotten of states' errors, and fill in what lies below its diagonal. */
static inline void faded(float forgotten, float P[STATES][STATES])
{
    const float t0 = (((P[PSI][PSI] > 0.04f) || (P[X][X] > 0.04f)) || (P[Y][Y] > 0.04f)) ? 0.9999962f : 1.0f;
    const float t1 = 1.0f - forgotten;
    P[B_X][A_X] = P[B_X][A_X] * t1;
    P[B_Y][A_X] = P[B_Y][A_X] * t1;
    P[B_Z][A_X] = P[B_Z][A_X] * t1;
    P[DRIFT][A_X] = P[DRIFT][A_X] * t1;
    P[A_X][A_X] = (P[A_X][A_X] * t1) * t1;
    P[B_X][A_Y] = P[B_X][A_Y] * t1;
    P[B_Y][A_Y] = P[B_Y][A_Y] * t1;
    P[B_Z][A_Y] = P[B_Z][A_Y] * t1;
    P[DRIFT][A_Y] = P[DRIFT][A_Y] * t1;
    P[A_X][A_Y] = (P[A_X][A_Y] * t1) * t1;
    P[A_Y][A_Y] = (P[A_Y][A_Y] * t1) * t1;
    P[A_X][G_X] = P[A_X][G_X] * t1;
    P[A_Y][G_X] = P[A_Y][G_X] * t1;
    P[A_X][G_Y] = P[A_X][G_Y] * t1;
    P[A_Y][G_Y] = P[A_Y][G_Y] * t1;
    P[A_X][S_X] = P[A_X][S_X] * t1;
    P[A_Y][S_X] = P[A_Y][S_X] * t1;
    P[A_X][S_Y] = P[A_X][S_Y] * t1;
    P[A_Y][S_Y] = P[A_Y][S_Y] * t1;
    P[B_X][PSI] = P[B_X][PSI] * t0;
    P[B_Y][PSI] = P[B_Y][PSI] * t0;
    P[B_Z][PSI] = P[B_Z][PSI] * t0;
    P[DRIFT][PSI] = P[DRIFT][PSI] * t0;
    P[A_X][PSI] = (P[A_X][PSI] * t0) * t1;
    P[A_Y][PSI] = (P[A_Y][PSI] * t0) * t1;
    P[G_X][PSI] = P[G_X][PSI] * t0;
    P[G_Y][PSI] = P[G_Y][PSI] * t0;
    P[S_X][PSI] = P[S_X][PSI] * t0;
    P[S_Y][PSI] = P[S_Y][PSI] * t0;
    P[PSI][PSI] = (P[PSI][PSI] * t0) * t0;
    P[A_X][SHOWN_PSI] = P[A_X][SHOWN_PSI] * t1;
    P[A_Y][SHOWN_PSI] = P[A_Y][SHOWN_PSI] * t1;
    P[PSI][SHOWN_PSI] = P[PSI][SHOWN_PSI] * t0;
    P[B_X][X] = P[B_X][X] * t0;
    P[B_Y][X] = P[B_Y][X] * t0;
    P[B_Z][X] = P[B_Z][X] * t0;
    P[DRIFT][X] = P[DRIFT][X] * t0;
    P[A_X][X] = (P[A_X][X] * t0) * t1;
    P[A_Y][X] = (P[A_Y][X] * t0) * t1;
    P[G_X][X] = P[G_X][X] * t0;
    P[G_Y][X] = P[G_Y][X] * t0;
    P[S_X][X] = P[S_X][X] * t0;
    P[S_Y][X] = P[S_Y][X] * t0;
    P[PSI][X] = (P[PSI][X] * t0) * t0;
    P[SHOWN_PSI][X] = P[SHOWN_PSI][X] * t0;
    P[X][X] = (P[X][X] * t0) * t0;
    P[B_X][Y] = P[B_X][Y] * t0;
    P[B_Y][Y] = P[B_Y][Y] * t0;
    P[B_Z][Y] = P[B_Z][Y] * t0;
    P[DRIFT][Y] = P[DRIFT][Y] * t0;
    P[A_X][Y] = (P[A_X][Y] * t0) * t1;
    P[A_Y][Y] = (P[A_Y][Y] * t0) * t1;
    P[G_X][Y] = P[G_X][Y] * t0;
    P[G_Y][Y] = P[G_Y][Y] * t0;
    P[S_X][Y] = P[S_X][Y] * t0;
    P[S_Y][Y] = P[S_Y][Y] * t0;
    P[PSI][Y] = (P[PSI][Y] * t0) * t0;
    P[SHOWN_PSI][Y] = P[SHOWN_PSI][Y] * t0;
    P[X][Y] = (P[X][Y] * t0) * t0;
    P[Y][Y] = (P[Y][Y] * t0) * t0;
    P[B_Y][B_X] = P[B_X][B_Y];
    P[B_Z][B_X] = P[B_X][B_Z];
    P[B_Z][B_Y] = P[B_Y][B_Z];
    P[DRIFT][B_X] = P[B_X][DRIFT];
    P[DRIFT][B_Y] = P[B_Y][DRIFT];
    P[DRIFT][B_Z] = P[B_Z][DRIFT];
    P[A_X][B_X] = P[B_X][A_X];
    P[A_X][B_Y] = P[B_Y][A_X];
    P[A_X][B_Z] = P[B_Z][A_X];
    P[A_X][DRIFT] = P[DRIFT][A_X];
    P[A_Y][B_X] = P[B_X][A_Y];
    P[A_Y][B_Y] = P[B_Y][A_Y];
    P[A_Y][B_Z] = P[B_Z][A_Y];
    P[A_Y][DRIFT] = P[DRIFT][A_Y];
    P[A_Y][A_X] = P[A_X][A_Y];
    P[G_X][B_X] = P[B_X][G_X];
    P[G_X][B_Y] = P[B_Y][G_X];
    P[G_X][B_Z] = P[B_Z][G_X];
    P[G_X][DRIFT] = P[DRIFT][G_X];
    P[G_X][A_X] = P[A_X][G_X];
    P[G_X][A_Y] = P[A_Y][G_X];
    P[G_Y][B_X] = P[B_X][G_Y];
    P[G_Y][B_Y] = P[B_Y][G_Y];
    P[G_Y][B_Z] = P[B_Z][G_Y];
    P[G_Y][DRIFT] = P[DRIFT][G_Y];
    P[G_Y][A_X] = P[A_X][G_Y];
    P[G_Y][A_Y] = P[A_Y][G_Y];
    P[G_Y][G_X] = P[G_X][G_Y];
    P[S_X][B_X] = P[B_X][S_X];
    P[S_X][B_Y] = P[B_Y][S_X];
    P[S_X][B_Z] = P[B_Z][S_X];
    P[S_X][DRIFT] = P[DRIFT][S_X];
    P[S_X][A_X] = P[A_X][S_X];
    P[S_X][A_Y] = P[A_Y][S_X];
    P[S_X][G_X] = P[G_X][S_X];
    P[S_X][G_Y] = P[G_Y][S_X];
    P[S_Y][B_X] = P[B_X][S_Y];
    P[S_Y][B_Y] = P[B_Y][S_Y];
    P[S_Y][B_Z] = P[B_Z][S_Y];
    P[S_Y][DRIFT] = P[DRIFT][S_Y];
    P[S_Y][A_X] = P[A_X][S_Y];
    P[S_Y][A_Y] = P[A_Y][S_Y];
    P[S_Y][G_X] = P[G_X][S_Y];
    P[S_Y][G_Y] = P[G_Y][S_Y];
    P[S_Y][S_X] = P[S_X][S_Y];
    P[PSI][B_X] = P[B_X][PSI];
    P[PSI][B_Y] = P[B_Y][PSI];
    P[PSI][B_Z] = P[B_Z][PSI];
    P[PSI][DRIFT] = P[DRIFT][PSI];
    P[PSI][A_X] = P[A_X][PSI];
    P[PSI][A_Y] = P[A_Y][PSI];
    P[PSI][G_X] = P[G_X][PSI];
    P[PSI][G_Y] = P[G_Y][PSI];
    P[PSI][S_X] = P[S_X][PSI];
    P[PSI][S_Y] = P[S_Y][PSI];
    P[SHOWN_PSI][B_X] = P[B_X][SHOWN_PSI];
    P[SHOWN_PSI][B_Y] = P[B_Y][SHOWN_PSI];
    P[SHOWN_PSI][B_Z] = P[B_Z][SHOWN_PSI];
    P[SHOWN_PSI][DRIFT] = P[DRIFT][SHOWN_PSI];
    P[SHOWN_PSI][A_X] = P[A_X][SHOWN_PSI];
    P[SHOWN_PSI][A_Y] = P[A_Y][SHOWN_PSI];
    P[SHOWN_PSI][G_X] = P[G_X][SHOWN_PSI];
    P[SHOWN_PSI][G_Y] = P[G_Y][SHOWN_PSI];
    P[SHOWN_PSI][S_X] = P[S_X][SHOWN_PSI];
    P[SHOWN_PSI][S_Y] = P[S_Y][SHOWN_PSI];
    P[SHOWN_PSI][PSI] = P[PSI][SHOWN_PSI];
    P[X][B_X] = P[B_X][X];
    P[X][B_Y] = P[B_Y][X];
    P[X][B_Z] = P[B_Z][X];
    P[X][DRIFT] = P[DRIFT][X];
    P[X][A_X] = P[A_X][X];
    P[X][A_Y] = P[A_Y][X];
    P[X][G_X] = P[G_X][X];
    P[X][G_Y] = P[G_Y][X];
    P[X][S_X] = P[S_X][X];
    P[X][S_Y] = P[S_Y][X];
    P[X][PSI] = P[PSI][X];
    P[X][SHOWN_PSI] = P[SHOWN_PSI][X];
    P[Y][B_X] = P[B_X][Y];
    P[Y][B_Y] = P[B_Y][Y];
    P[Y][B_Z] = P[B_Z][Y];
    P[Y][DRIFT] = P[DRIFT][Y];
    P[Y][A_X] = P[A_X][Y];
    P[Y][A_Y] = P[A_Y][Y];
    P[Y][G_X] = P[G_X][Y];
    P[Y][G_Y] = P[G_Y][Y];
    P[Y][S_X] = P[S_X][Y];
    P[Y][S_Y] = P[S_Y][Y];
    P[Y][PSI] = P[PSI][Y];
    P[Y][SHOWN_PSI] = P[SHOWN_PSI][Y];
    P[Y][X] = P[X][Y];
}

/* Give the elements from DRIVEN on of F times a column. */
static inline void carried(const float f[F_ENTRIES], const float column[STATES], float product[STATES])
{
    const float t0 = ((((f[16] * column[G_X]) + (f[17] * column[G_Y])) + (f[18] * column[B_X])) + (f[19] *
        column[B_Y])) + (f[20] * column[B_Z]);
    product[G_X] = column[G_X] + ((((f[0] * column[G_X]) + (f[1] * column[G_Y])) + (f[4] * column[B_Y])) + (f[5] *
        column[B_Z]));
    product[G_Y] = column[G_Y] + ((((f[2] * column[G_X]) + (f[3] * column[G_Y])) + (f[6] * column[B_X])) + (f[7] *
        column[B_Z]));
    product[S_X] = column[S_X] + ((((f[8] * column[S_Y]) + (f[9] * column[G_X])) + (f[10] * column[G_Y])) + (f[11] *
        column[B_Z]));
    product[S_Y] = column[S_Y] + ((((f[12] * column[S_X]) + (f[13] * column[G_X])) + (f[14] * column[G_Y])) + (f[15] *
        column[B_Z]));
    product[PSI] = column[PSI] + t0;
    product[SHOWN_PSI] = column[SHOWN_PSI] + (t0 + (f[21] * column[DRIFT]));
    product[X] = column[X] + ((((((f[22] * column[PSI]) + (f[23] * column[S_X])) + (f[24] * column[S_Y])) + (f[25] *
        column[B_X])) + (f[26] * column[B_Y])) + (f[27] * column[B_Z]));
    product[Y] = column[Y] + ((((((f[28] * column[PSI]) + (f[29] * column[S_X])) + (f[30] * column[S_Y])) + (f[31] *
        column[B_X])) + (f[32] * column[B_Y])) + (f[33] * column[B_Z]));
}

/* Overwrite P by F P F^T + Q, of the columns of F P; what lies below its diagonal is wrong after it. */
static inline void propagated(const struct ballbot_kalman_record *record, const float f[F_ENTRIES], float
        FP[STATES][STATES], float P[STATES][STATES])
{
    const float t0 = FP[B_Z][G_Y] + (record->gyro_variance * f[7]);
    const float t1 = FP[B_Z][S_X] + (record->gyro_variance * f[11]);
    const float t2 = FP[B_Z][S_Y] + (record->gyro_variance * f[15]);
    const float t3 = record->gyro_variance * f[18];
    const float t4 = FP[B_X][PSI] + t3;
    const float t5 = record->gyro_variance * f[19];
    const float t6 = FP[B_Y][PSI] + t5;
    const float t7 = record->gyro_variance * f[20];
    const float t8 = FP[B_Z][PSI] + t7;
    const float t9 = FP[B_X][SHOWN_PSI] + t3;
    const float t10 = FP[B_Y][SHOWN_PSI] + t5;
    const float t11 = FP[B_Z][SHOWN_PSI] + t7;
    const float t12 = ((((f[16] * FP[G_X][SHOWN_PSI]) + (f[17] * FP[G_Y][SHOWN_PSI])) + (f[18] * t9)) + (f[19] * t10))
        + (f[20] * t11);
    const float t13 = FP[B_X][X] + (record->gyro_variance * f[25]);
    const float t14 = FP[B_Y][X] + (record->gyro_variance * f[26]);
    const float t15 = FP[B_Z][X] + (record->gyro_variance * f[27]);
    const float t16 = ((((f[16] * FP[G_X][X]) + (f[17] * FP[G_Y][X])) + (f[18] * t13)) + (f[19] * t14)) + (f[20] *
        t15);
    const float t17 = FP[B_X][Y] + (record->gyro_variance * f[31]);
    const float t18 = FP[B_Y][Y] + (record->gyro_variance * f[32]);
    const float t19 = FP[B_Z][Y] + (record->gyro_variance * f[33]);
    const float t20 = ((((f[16] * FP[G_X][Y]) + (f[17] * FP[G_Y][Y])) + (f[18] * t17)) + (f[19] * t18)) + (f[20] *
        t19);
    P[B_X][B_X] = P[B_X][B_X] + record->walk[0];
    P[B_Y][B_Y] = P[B_Y][B_Y] + record->walk[1];
    P[B_Z][B_Z] = P[B_Z][B_Z] + record->walk[2];
    P[DRIFT][DRIFT] = P[DRIFT][DRIFT] + record->walk[3];
    P[A_X][A_X] = P[A_X][A_X] + record->walk[4];
    P[A_Y][A_Y] = P[A_Y][A_Y] + record->walk[5];
    P[B_X][G_X] = FP[B_X][G_X];
    P[B_Y][G_X] = FP[B_Y][G_X];
    P[B_Z][G_X] = FP[B_Z][G_X];
    P[DRIFT][G_X] = FP[DRIFT][G_X];
    P[A_X][G_X] = FP[A_X][G_X];
    P[A_Y][G_X] = FP[A_Y][G_X];
    P[G_X][G_X] = (FP[G_X][G_X] + ((((f[0] * FP[G_X][G_X]) + (f[1] * FP[G_Y][G_X])) + (f[4] * (FP[B_Y][G_X] +
        (record->gyro_variance * f[4])))) + (f[5] * (FP[B_Z][G_X] + (record->gyro_variance * f[5]))))) +
        record->walk[6];
    P[B_X][G_Y] = FP[B_X][G_Y];
    P[B_Y][G_Y] = FP[B_Y][G_Y];
    P[B_Z][G_Y] = FP[B_Z][G_Y];
    P[DRIFT][G_Y] = FP[DRIFT][G_Y];
    P[A_X][G_Y] = FP[A_X][G_Y];
    P[A_Y][G_Y] = FP[A_Y][G_Y];
    P[G_X][G_Y] = FP[G_X][G_Y] + ((((f[0] * FP[G_X][G_Y]) + (f[1] * FP[G_Y][G_Y])) + (f[4] * FP[B_Y][G_Y])) + (f[5] *
        t0));
    P[G_Y][G_Y] = (FP[G_Y][G_Y] + ((((f[2] * FP[G_X][G_Y]) + (f[3] * FP[G_Y][G_Y])) + (f[6] * (FP[B_X][G_Y] +
        (record->gyro_variance * f[6])))) + (f[7] * t0))) + record->walk[7];
    P[B_X][S_X] = FP[B_X][S_X];
    P[B_Y][S_X] = FP[B_Y][S_X];
    P[B_Z][S_X] = FP[B_Z][S_X];
    P[DRIFT][S_X] = FP[DRIFT][S_X];
    P[A_X][S_X] = FP[A_X][S_X];
    P[A_Y][S_X] = FP[A_Y][S_X];
    P[G_X][S_X] = FP[G_X][S_X] + ((((f[0] * FP[G_X][S_X]) + (f[1] * FP[G_Y][S_X])) + (f[4] * FP[B_Y][S_X])) + (f[5] *
        t1));
    P[G_Y][S_X] = FP[G_Y][S_X] + ((((f[2] * FP[G_X][S_X]) + (f[3] * FP[G_Y][S_X])) + (f[6] * FP[B_X][S_X])) + (f[7] *
        t1));
    P[S_X][S_X] = (FP[S_X][S_X] + ((((f[8] * FP[S_Y][S_X]) + (f[9] * FP[G_X][S_X])) + (f[10] * FP[G_Y][S_X])) + (f[11]
        * t1))) + record->walk[8];
    P[B_X][S_Y] = FP[B_X][S_Y];
    P[B_Y][S_Y] = FP[B_Y][S_Y];
    P[B_Z][S_Y] = FP[B_Z][S_Y];
    P[DRIFT][S_Y] = FP[DRIFT][S_Y];
    P[A_X][S_Y] = FP[A_X][S_Y];
    P[A_Y][S_Y] = FP[A_Y][S_Y];
    P[G_X][S_Y] = FP[G_X][S_Y] + ((((f[0] * FP[G_X][S_Y]) + (f[1] * FP[G_Y][S_Y])) + (f[4] * FP[B_Y][S_Y])) + (f[5] *
        t2));
    P[G_Y][S_Y] = FP[G_Y][S_Y] + ((((f[2] * FP[G_X][S_Y]) + (f[3] * FP[G_Y][S_Y])) + (f[6] * FP[B_X][S_Y])) + (f[7] *
        t2));
    P[S_X][S_Y] = FP[S_X][S_Y] + ((((f[8] * FP[S_Y][S_Y]) + (f[9] * FP[G_X][S_Y])) + (f[10] * FP[G_Y][S_Y])) + (f[11]
        * t2));
    P[S_Y][S_Y] = (FP[S_Y][S_Y] + ((((f[12] * FP[S_X][S_Y]) + (f[13] * FP[G_X][S_Y])) + (f[14] * FP[G_Y][S_Y])) +
        (f[15] * t2))) + record->walk[9];
    P[B_X][PSI] = FP[B_X][PSI];
    P[B_Y][PSI] = FP[B_Y][PSI];
    P[B_Z][PSI] = FP[B_Z][PSI];
    P[DRIFT][PSI] = FP[DRIFT][PSI];
    P[A_X][PSI] = FP[A_X][PSI];
    P[A_Y][PSI] = FP[A_Y][PSI];
    P[G_X][PSI] = FP[G_X][PSI] + ((((f[0] * FP[G_X][PSI]) + (f[1] * FP[G_Y][PSI])) + (f[4] * t6)) + (f[5] * t8));
    P[G_Y][PSI] = FP[G_Y][PSI] + ((((f[2] * FP[G_X][PSI]) + (f[3] * FP[G_Y][PSI])) + (f[6] * t4)) + (f[7] * t8));
    P[S_X][PSI] = FP[S_X][PSI] + ((((f[8] * FP[S_Y][PSI]) + (f[9] * FP[G_X][PSI])) + (f[10] * FP[G_Y][PSI])) + (f[11]
        * t8));
    P[S_Y][PSI] = FP[S_Y][PSI] + ((((f[12] * FP[S_X][PSI]) + (f[13] * FP[G_X][PSI])) + (f[14] * FP[G_Y][PSI])) +
        (f[15] * t8));
    P[PSI][PSI] = (FP[PSI][PSI] + (((((f[16] * FP[G_X][PSI]) + (f[17] * FP[G_Y][PSI])) + (f[18] * t4)) + (f[19] * t6))
        + (f[20] * t8))) + record->walk[10];
    P[B_X][SHOWN_PSI] = FP[B_X][SHOWN_PSI];
    P[B_Y][SHOWN_PSI] = FP[B_Y][SHOWN_PSI];
    P[B_Z][SHOWN_PSI] = FP[B_Z][SHOWN_PSI];
    P[DRIFT][SHOWN_PSI] = FP[DRIFT][SHOWN_PSI];
    P[A_X][SHOWN_PSI] = FP[A_X][SHOWN_PSI];
    P[A_Y][SHOWN_PSI] = FP[A_Y][SHOWN_PSI];
    P[G_X][SHOWN_PSI] = FP[G_X][SHOWN_PSI] + ((((f[0] * FP[G_X][SHOWN_PSI]) + (f[1] * FP[G_Y][SHOWN_PSI])) + (f[4] *
        t10)) + (f[5] * t11));
    P[G_Y][SHOWN_PSI] = FP[G_Y][SHOWN_PSI] + ((((f[2] * FP[G_X][SHOWN_PSI]) + (f[3] * FP[G_Y][SHOWN_PSI])) + (f[6] *
        t9)) + (f[7] * t11));
    P[S_X][SHOWN_PSI] = FP[S_X][SHOWN_PSI] + ((((f[8] * FP[S_Y][SHOWN_PSI]) + (f[9] * FP[G_X][SHOWN_PSI])) + (f[10] *
        FP[G_Y][SHOWN_PSI])) + (f[11] * t11));
    P[S_Y][SHOWN_PSI] = FP[S_Y][SHOWN_PSI] + ((((f[12] * FP[S_X][SHOWN_PSI]) + (f[13] * FP[G_X][SHOWN_PSI])) + (f[14]
        * FP[G_Y][SHOWN_PSI])) + (f[15] * t11));
    P[PSI][SHOWN_PSI] = FP[PSI][SHOWN_PSI] + t12;
    P[SHOWN_PSI][SHOWN_PSI] = (FP[SHOWN_PSI][SHOWN_PSI] + (t12 + (f[21] * FP[DRIFT][SHOWN_PSI]))) + record->walk[11];
    P[B_X][X] = FP[B_X][X];
    P[B_Y][X] = FP[B_Y][X];
    P[B_Z][X] = FP[B_Z][X];
    P[DRIFT][X] = FP[DRIFT][X];
    P[A_X][X] = FP[A_X][X];
    P[A_Y][X] = FP[A_Y][X];
    P[G_X][X] = FP[G_X][X] + ((((f[0] * FP[G_X][X]) + (f[1] * FP[G_Y][X])) + (f[4] * t14)) + (f[5] * t15));
    P[G_Y][X] = FP[G_Y][X] + ((((f[2] * FP[G_X][X]) + (f[3] * FP[G_Y][X])) + (f[6] * t13)) + (f[7] * t15));
    P[S_X][X] = FP[S_X][X] + ((((f[8] * FP[S_Y][X]) + (f[9] * FP[G_X][X])) + (f[10] * FP[G_Y][X])) + (f[11] * t15));
    P[S_Y][X] = FP[S_Y][X] + ((((f[12] * FP[S_X][X]) + (f[13] * FP[G_X][X])) + (f[14] * FP[G_Y][X])) + (f[15] * t15));
    P[PSI][X] = FP[PSI][X] + t16;
    P[SHOWN_PSI][X] = FP[SHOWN_PSI][X] + (t16 + (f[21] * FP[DRIFT][X]));
    P[X][X] = (FP[X][X] + ((((((f[22] * FP[PSI][X]) + (f[23] * FP[S_X][X])) + (f[24] * FP[S_Y][X])) + (f[25] * t13)) +
        (f[26] * t14)) + (f[27] * t15))) + record->walk[12];
    P[B_X][Y] = FP[B_X][Y];
    P[B_Y][Y] = FP[B_Y][Y];
    P[B_Z][Y] = FP[B_Z][Y];
    P[DRIFT][Y] = FP[DRIFT][Y];
    P[A_X][Y] = FP[A_X][Y];
    P[A_Y][Y] = FP[A_Y][Y];
    P[G_X][Y] = FP[G_X][Y] + ((((f[0] * FP[G_X][Y]) + (f[1] * FP[G_Y][Y])) + (f[4] * t18)) + (f[5] * t19));
    P[G_Y][Y] = FP[G_Y][Y] + ((((f[2] * FP[G_X][Y]) + (f[3] * FP[G_Y][Y])) + (f[6] * t17)) + (f[7] * t19));
    P[S_X][Y] = FP[S_X][Y] + ((((f[8] * FP[S_Y][Y]) + (f[9] * FP[G_X][Y])) + (f[10] * FP[G_Y][Y])) + (f[11] * t19));
    P[S_Y][Y] = FP[S_Y][Y] + ((((f[12] * FP[S_X][Y]) + (f[13] * FP[G_X][Y])) + (f[14] * FP[G_Y][Y])) + (f[15] * t19));
    P[PSI][Y] = FP[PSI][Y] + t20;
    P[SHOWN_PSI][Y] = FP[SHOWN_PSI][Y] + (t20 + (f[21] * FP[DRIFT][Y]));
    P[X][Y] = FP[X][Y] + ((((((f[22] * FP[PSI][Y]) + (f[23] * FP[S_X][Y])) + (f[24] * FP[S_Y][Y])) + (f[25] * t17)) +
        (f[26] * t18)) + (f[27] * t19));
    P[Y][Y] = (FP[Y][Y] + ((((((f[28] * FP[PSI][Y]) + (f[29] * FP[S_X][Y])) + (f[30] * FP[S_Y][Y])) + (f[31] * t17)) +
        (f[32] * t18)) + (f[33] * t19))) + record->walk[13];
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

/* Overwrite P by P - q q^T / s, and the changes of the state; `inverse` is 1 / s. */
static inline void corrected(const float q[STATES], float residual, float inverse, float P[STATES][STATES], float
        change[STATES])
{
    const float t0 = q[B_X] * inverse;
    const float t1 = q[B_Y] * inverse;
    const float t2 = q[B_Z] * inverse;
    const float t3 = q[DRIFT] * inverse;
    const float t4 = q[A_X] * inverse;
    const float t5 = q[A_Y] * inverse;
    const float t6 = q[G_X] * inverse;
    const float t7 = q[G_Y] * inverse;
    const float t8 = q[S_X] * inverse;
    const float t9 = q[S_Y] * inverse;
    const float t10 = q[PSI] * inverse;
    const float t11 = q[SHOWN_PSI] * inverse;
    const float t12 = q[X] * inverse;
    const float t13 = q[Y] * inverse;
    P[B_X][B_X] = P[B_X][B_X] - (t0 * q[B_X]);
    P[B_X][B_Y] = P[B_X][B_Y] - (t1 * q[B_X]);
    P[B_Y][B_Y] = P[B_Y][B_Y] - (t1 * q[B_Y]);
    P[B_X][B_Z] = P[B_X][B_Z] - (t2 * q[B_X]);
    P[B_Y][B_Z] = P[B_Y][B_Z] - (t2 * q[B_Y]);
    P[B_Z][B_Z] = P[B_Z][B_Z] - (t2 * q[B_Z]);
    P[B_X][DRIFT] = P[B_X][DRIFT] - (t3 * q[B_X]);
    P[B_Y][DRIFT] = P[B_Y][DRIFT] - (t3 * q[B_Y]);
    P[B_Z][DRIFT] = P[B_Z][DRIFT] - (t3 * q[B_Z]);
    P[DRIFT][DRIFT] = P[DRIFT][DRIFT] - (t3 * q[DRIFT]);
    P[B_X][A_X] = P[B_X][A_X] - (t4 * q[B_X]);
    P[B_Y][A_X] = P[B_Y][A_X] - (t4 * q[B_Y]);
    P[B_Z][A_X] = P[B_Z][A_X] - (t4 * q[B_Z]);
    P[DRIFT][A_X] = P[DRIFT][A_X] - (t4 * q[DRIFT]);
    P[A_X][A_X] = P[A_X][A_X] - (t4 * q[A_X]);
    P[B_X][A_Y] = P[B_X][A_Y] - (t5 * q[B_X]);
    P[B_Y][A_Y] = P[B_Y][A_Y] - (t5 * q[B_Y]);
    P[B_Z][A_Y] = P[B_Z][A_Y] - (t5 * q[B_Z]);
    P[DRIFT][A_Y] = P[DRIFT][A_Y] - (t5 * q[DRIFT]);
    P[A_X][A_Y] = P[A_X][A_Y] - (t5 * q[A_X]);
    P[A_Y][A_Y] = P[A_Y][A_Y] - (t5 * q[A_Y]);
    P[B_X][G_X] = P[B_X][G_X] - (t6 * q[B_X]);
    P[B_Y][G_X] = P[B_Y][G_X] - (t6 * q[B_Y]);
    P[B_Z][G_X] = P[B_Z][G_X] - (t6 * q[B_Z]);
    P[DRIFT][G_X] = P[DRIFT][G_X] - (t6 * q[DRIFT]);
    P[A_X][G_X] = P[A_X][G_X] - (t6 * q[A_X]);
    P[A_Y][G_X] = P[A_Y][G_X] - (t6 * q[A_Y]);
    P[G_X][G_X] = P[G_X][G_X] - (t6 * q[G_X]);
    P[B_X][G_Y] = P[B_X][G_Y] - (t7 * q[B_X]);
    P[B_Y][G_Y] = P[B_Y][G_Y] - (t7 * q[B_Y]);
    P[B_Z][G_Y] = P[B_Z][G_Y] - (t7 * q[B_Z]);
    P[DRIFT][G_Y] = P[DRIFT][G_Y] - (t7 * q[DRIFT]);
    P[A_X][G_Y] = P[A_X][G_Y] - (t7 * q[A_X]);
    P[A_Y][G_Y] = P[A_Y][G_Y] - (t7 * q[A_Y]);
    P[G_X][G_Y] = P[G_X][G_Y] - (t7 * q[G_X]);
    P[G_Y][G_Y] = P[G_Y][G_Y] - (t7 * q[G_Y]);
    P[B_X][S_X] = P[B_X][S_X] - (t8 * q[B_X]);
    P[B_Y][S_X] = P[B_Y][S_X] - (t8 * q[B_Y]);
    P[B_Z][S_X] = P[B_Z][S_X] - (t8 * q[B_Z]);
    P[DRIFT][S_X] = P[DRIFT][S_X] - (t8 * q[DRIFT]);
    P[A_X][S_X] = P[A_X][S_X] - (t8 * q[A_X]);
    P[A_Y][S_X] = P[A_Y][S_X] - (t8 * q[A_Y]);
    P[G_X][S_X] = P[G_X][S_X] - (t8 * q[G_X]);
    P[G_Y][S_X] = P[G_Y][S_X] - (t8 * q[G_Y]);
    P[S_X][S_X] = P[S_X][S_X] - (t8 * q[S_X]);
    P[B_X][S_Y] = P[B_X][S_Y] - (t9 * q[B_X]);
    P[B_Y][S_Y] = P[B_Y][S_Y] - (t9 * q[B_Y]);
    P[B_Z][S_Y] = P[B_Z][S_Y] - (t9 * q[B_Z]);
    P[DRIFT][S_Y] = P[DRIFT][S_Y] - (t9 * q[DRIFT]);
    P[A_X][S_Y] = P[A_X][S_Y] - (t9 * q[A_X]);
    P[A_Y][S_Y] = P[A_Y][S_Y] - (t9 * q[A_Y]);
    P[G_X][S_Y] = P[G_X][S_Y] - (t9 * q[G_X]);
    P[G_Y][S_Y] = P[G_Y][S_Y] - (t9 * q[G_Y]);
    P[S_X][S_Y] = P[S_X][S_Y] - (t9 * q[S_X]);
    P[S_Y][S_Y] = P[S_Y][S_Y] - (t9 * q[S_Y]);
    P[B_X][PSI] = P[B_X][PSI] - (t10 * q[B_X]);
    P[B_Y][PSI] = P[B_Y][PSI] - (t10 * q[B_Y]);
    P[B_Z][PSI] = P[B_Z][PSI] - (t10 * q[B_Z]);
    P[DRIFT][PSI] = P[DRIFT][PSI] - (t10 * q[DRIFT]);
    P[A_X][PSI] = P[A_X][PSI] - (t10 * q[A_X]);
    P[A_Y][PSI] = P[A_Y][PSI] - (t10 * q[A_Y]);
    P[G_X][PSI] = P[G_X][PSI] - (t10 * q[G_X]);
    P[G_Y][PSI] = P[G_Y][PSI] - (t10 * q[G_Y]);
    P[S_X][PSI] = P[S_X][PSI] - (t10 * q[S_X]);
    P[S_Y][PSI] = P[S_Y][PSI] - (t10 * q[S_Y]);
    P[PSI][PSI] = P[PSI][PSI] - (t10 * q[PSI]);
    P[B_X][SHOWN_PSI] = P[B_X][SHOWN_PSI] - (t11 * q[B_X]);
    P[B_Y][SHOWN_PSI] = P[B_Y][SHOWN_PSI] - (t11 * q[B_Y]);
    P[B_Z][SHOWN_PSI] = P[B_Z][SHOWN_PSI] - (t11 * q[B_Z]);
    P[DRIFT][SHOWN_PSI] = P[DRIFT][SHOWN_PSI] - (t11 * q[DRIFT]);
    P[A_X][SHOWN_PSI] = P[A_X][SHOWN_PSI] - (t11 * q[A_X]);
    P[A_Y][SHOWN_PSI] = P[A_Y][SHOWN_PSI] - (t11 * q[A_Y]);
    P[G_X][SHOWN_PSI] = P[G_X][SHOWN_PSI] - (t11 * q[G_X]);
    P[G_Y][SHOWN_PSI] = P[G_Y][SHOWN_PSI] - (t11 * q[G_Y]);
    P[S_X][SHOWN_PSI] = P[S_X][SHOWN_PSI] - (t11 * q[S_X]);
    P[S_Y][SHOWN_PSI] = P[S_Y][SHOWN_PSI] - (t11 * q[S_Y]);
    P[PSI][SHOWN_PSI] = P[PSI][SHOWN_PSI] - (t11 * q[PSI]);
    P[SHOWN_PSI][SHOWN_PSI] = P[SHOWN_PSI][SHOWN_PSI] - (t11 * q[SHOWN_PSI]);
    P[B_X][X] = P[B_X][X] - (t12 * q[B_X]);
    P[B_Y][X] = P[B_Y][X] - (t12 * q[B_Y]);
    P[B_Z][X] = P[B_Z][X] - (t12 * q[B_Z]);
    P[DRIFT][X] = P[DRIFT][X] - (t12 * q[DRIFT]);
    P[A_X][X] = P[A_X][X] - (t12 * q[A_X]);
    P[A_Y][X] = P[A_Y][X] - (t12 * q[A_Y]);
    P[G_X][X] = P[G_X][X] - (t12 * q[G_X]);
    P[G_Y][X] = P[G_Y][X] - (t12 * q[G_Y]);
    P[S_X][X] = P[S_X][X] - (t12 * q[S_X]);
    P[S_Y][X] = P[S_Y][X] - (t12 * q[S_Y]);
    P[PSI][X] = P[PSI][X] - (t12 * q[PSI]);
    P[SHOWN_PSI][X] = P[SHOWN_PSI][X] - (t12 * q[SHOWN_PSI]);
    P[X][X] = P[X][X] - (t12 * q[X]);
    P[B_X][Y] = P[B_X][Y] - (t13 * q[B_X]);
    P[B_Y][Y] = P[B_Y][Y] - (t13 * q[B_Y]);
    P[B_Z][Y] = P[B_Z][Y] - (t13 * q[B_Z]);
    P[DRIFT][Y] = P[DRIFT][Y] - (t13 * q[DRIFT]);
    P[A_X][Y] = P[A_X][Y] - (t13 * q[A_X]);
    P[A_Y][Y] = P[A_Y][Y] - (t13 * q[A_Y]);
    P[G_X][Y] = P[G_X][Y] - (t13 * q[G_X]);
    P[G_Y][Y] = P[G_Y][Y] - (t13 * q[G_Y]);
    P[S_X][Y] = P[S_X][Y] - (t13 * q[S_X]);
    P[S_Y][Y] = P[S_Y][Y] - (t13 * q[S_Y]);
    P[PSI][Y] = P[PSI][Y] - (t13 * q[PSI]);
    P[SHOWN_PSI][Y] = P[SHOWN_PSI][Y] - (t13 * q[SHOWN_PSI]);
    P[X][Y] = P[X][Y] - (t13 * q[X]);
    P[Y][Y] = P[Y][Y] - (t13 * q[Y]);
    change[B_X] = change[B_X] + (t0 * residual);
    change[B_Y] = change[B_Y] + (t1 * residual);
    change[B_Z] = change[B_Z] + (t2 * residual);
    change[DRIFT] = change[DRIFT] + (t3 * residual);
    change[A_X] = change[A_X] + (t4 * residual);
    change[A_Y] = change[A_Y] + (t5 * residual);
    change[G_X] = change[G_X] + (t6 * residual);
    change[G_Y] = change[G_Y] + (t7 * residual);
    change[S_X] = change[S_X] + (t8 * residual);
    change[S_Y] = change[S_Y] + (t9 * residual);
    change[PSI] = change[PSI] + (t10 * residual);
    change[SHOWN_PSI] = change[SHOWN_PSI] + (t11 * residual);
    change[X] = change[X] + (t12 * residual);
    change[Y] = change[Y] + (t13 * residual);
}

#endif
