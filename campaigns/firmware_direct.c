/*
 * A direct translation of `ballbot.estimation.kalman_model.sample` into C, in single precision: the states, the dense
 * matrices and Joseph's form as they stand there. It is what the firmware's filter is measured against.
 */
#include "ballbot_math.h"

#include <stdint.h>

enum { X = 0, PSI = 2, G = 3, S = 5, BIAS = 7, HEADING_ERROR = 10, DRIFT = 11, LEAN_ERROR = 12, STATES = 14 };

/* As `FilterModel`. */
struct model {
    float sample_time, radius, lever[2][3], pull[2][2], memory, gyro_variance;
    float walk[STATES], wheel_variances[3], attitude_variances[3];
};

/* What `sample` takes. */
struct inputs {
    float ball_rate[3], gyro_before[3], gyro[3], lean[2], heading;
};

void direct_sample(const struct model *model, float x[STATES], float P[STATES][STATES], const struct inputs *given);

static float upright_part(const float lean[2])
{
    const float square = 1.0f - lean[0] * lean[0] - lean[1] * lean[1];
    return ballbot_square_root((square > 1.0e-6f) ? square : 1.0e-6f);
}

static void lean_rate(const float lean[2], const float w[3], float rate[2])
{
    const float g_z = upright_part(lean);
    rate[0] = lean[1] * w[2] - g_z * w[1];
    rate[1] = g_z * w[0] - lean[0] * w[2];
}

static float heading_rate(const float lean[2], const float w[3])
{
    return w[2] + (w[0] * lean[0] + w[1] * lean[1]) / (1.0f + upright_part(lean));
}

static void momentum_rate(const struct model *model, const float momentum[2], const float lean[2], float turning,
                          float rate[2])
{
    rate[0] = turning * momentum[1] - (model->pull[0][0] * lean[0] + model->pull[0][1] * lean[1]);
    rate[1] = -turning * momentum[0] - (model->pull[1][0] * lean[0] + model->pull[1][1] * lean[1]);
}

static float lever(const struct model *model, int32_t k, const float w[3])
{
    return model->lever[k][0] * w[0] + model->lever[k][1] * w[1] + model->lever[k][2] * w[2];
}

static void advance(float x[STATES], const struct model *model, const float before[3], const float gyro[3],
                    float velocity[2])
{
    const float h = model->sample_time;
    float w[3];
    float start[3];
    float end[3];
    for (int32_t k = 0; k < 3; ++k) {
        w[k] = 0.5f * (before[k] + gyro[k]) - x[BIAS + k];
        start[k] = before[k] - x[BIAS + k];
        end[k] = gyro[k] - x[BIAS + k];
    }
    const float from[2] = {x[S] - lever(model, 0, start), x[S + 1] - lever(model, 1, start)};
    float rate[2];
    lean_rate(&x[G], w, rate);
    const float lean[2] = {x[G] + 0.5f * h * rate[0], x[G + 1] + 0.5f * h * rate[1]};
    const float turning = heading_rate(lean, w);
    momentum_rate(model, &x[S], &x[G], turning, rate);
    const float momentum[2] = {x[S] + 0.5f * h * rate[0], x[S + 1] + 0.5f * h * rate[1]};
    lean_rate(lean, w, rate);
    x[G] += h * rate[0];
    x[G + 1] += h * rate[1];
    momentum_rate(model, momentum, lean, turning, rate);
    x[S] += h * rate[0];
    x[S + 1] += h * rate[1];
    velocity[0] = 0.5f * (from[0] + x[S] - lever(model, 0, end));
    velocity[1] = 0.5f * (from[1] + x[S + 1] - lever(model, 1, end));
    float s3;
    float c3;
    ballbot_sine_cosine(x[PSI] + 0.5f * h * turning, &s3, &c3);
    x[X] += h * (c3 * velocity[0] - s3 * velocity[1]);
    x[X + 1] += h * (s3 * velocity[0] + c3 * velocity[1]);
    x[PSI] += h * turning;
    x[HEADING_ERROR] += h * x[DRIFT];
    x[LEAN_ERROR] *= model->memory;
    x[LEAN_ERROR + 1] *= model->memory;
}

static void transition(const float x[STATES], const struct model *model, const float gyro[3], float F[STATES][STATES],
                       float Q[STATES][STATES])
{
    const float h = model->sample_time;
    const float w[3] = {gyro[0] - x[BIAS], gyro[1] - x[BIAS + 1], gyro[2] - x[BIAS + 2]};
    const float g_x = x[G];
    const float g_y = x[G + 1];
    const float g_z = upright_part(&x[G]);
    const float turning = heading_rate(&x[G], w);
    float s3;
    float c3;
    ballbot_sine_cosine(x[PSI], &s3, &c3);
    const float v_x = x[S] - lever(model, 0, w);
    const float v_y = x[S + 1] - lever(model, 1, w);
    for (int32_t i = 0; i < STATES; ++i) {
        for (int32_t j = 0; j < STATES; ++j) {
            F[i][j] = (i == j) ? 1.0f : 0.0f;
        }
    }
    F[X][PSI] = -h * (s3 * v_x + c3 * v_y);
    F[X + 1][PSI] = h * (c3 * v_x - s3 * v_y);
    const float turn[2][2] = {{h * c3, -h * s3}, {h * s3, h * c3}};
    for (int32_t i = 0; i < 2; ++i) {
        for (int32_t k = 0; k < 2; ++k) {
            F[X + i][S + k] = turn[i][k];
            F[S + i][G + k] = -h * model->pull[i][k];
        }
        for (int32_t k = 0; k < 3; ++k) {
            F[X + i][BIAS + k] = turn[i][0] * model->lever[0][k] + turn[i][1] * model->lever[1][k];
        }
    }
    F[PSI][G] = h * w[0] / (1.0f + g_z);
    F[PSI][G + 1] = h * w[1] / (1.0f + g_z);
    F[PSI][BIAS] = -h * g_x / (1.0f + g_z);
    F[PSI][BIAS + 1] = -h * g_y / (1.0f + g_z);
    F[PSI][BIAS + 2] = -h;
    F[G][G] += h * w[1] * g_x / g_z;
    F[G][G + 1] = h * (w[2] + w[1] * g_y / g_z);
    F[G + 1][G] = -h * (w[2] + w[0] * g_x / g_z);
    F[G + 1][G + 1] -= h * w[0] * g_y / g_z;
    F[G][BIAS + 1] = h * g_z;
    F[G][BIAS + 2] = -h * g_y;
    F[G + 1][BIAS] = -h * g_z;
    F[G + 1][BIAS + 2] = h * g_x;
    F[S][S + 1] = h * turning;
    F[S + 1][S] = -h * turning;
    F[S][BIAS + 2] = -h * x[S + 1];
    F[S + 1][BIAS + 2] = h * x[S];
    F[HEADING_ERROR][DRIFT] = h;
    F[LEAN_ERROR][LEAN_ERROR] = model->memory;
    F[LEAN_ERROR + 1][LEAN_ERROR + 1] = model->memory;
    for (int32_t i = 0; i < STATES; ++i) {
        for (int32_t j = 0; j < STATES; ++j) {
            Q[i][j] = 0.0f;
            for (int32_t k = 0; k < 3; ++k) {
                const float a = ((i >= BIAS) && (i < BIAS + 3)) ? 0.0f : F[i][BIAS + k];
                const float b = ((j >= BIAS) && (j < BIAS + 3)) ? 0.0f : F[j][BIAS + k];
                Q[i][j] += model->gyro_variance * a * b;
            }
        }
        Q[i][i] += model->walk[i];
    }
}

static void propagate(float P[STATES][STATES], float F[STATES][STATES], float Q[STATES][STATES])
{
    float FP[STATES][STATES];
    float spread[STATES][STATES];
    for (int32_t i = 0; i < STATES; ++i) {
        for (int32_t j = 0; j < STATES; ++j) {
            FP[i][j] = 0.0f;
            for (int32_t k = 0; k < STATES; ++k) {
                FP[i][j] += F[i][k] * P[k][j];
            }
        }
    }
    for (int32_t i = 0; i < STATES; ++i) {
        for (int32_t j = 0; j < STATES; ++j) {
            spread[i][j] = 0.0f;
            for (int32_t k = 0; k < STATES; ++k) {
                spread[i][j] += FP[i][k] * F[j][k];
            }
        }
    }
    for (int32_t i = 0; i < STATES; ++i) {
        for (int32_t j = 0; j <= i; ++j) {
            P[i][j] = 0.5f * (spread[i][j] + spread[j][i]) + Q[i][j];
            P[j][i] = P[i][j];
        }
    }
}

static void absorb(float x[STATES], float P[STATES][STATES], int32_t count, const float residuals[3],
                   float rows[3][STATES], const float variances[3])
{
    float change[STATES] = {0.0f};
    for (int32_t n = 0; n < count; ++n) {
        const float *const h = rows[n];
        float Ph[STATES];
        float half[STATES][STATES];
        float half_h[STATES];
        float variance = variances[n];
        float residual = residuals[n];
        for (int32_t i = 0; i < STATES; ++i) {
            Ph[i] = 0.0f;
            for (int32_t j = 0; j < STATES; ++j) {
                Ph[i] += P[i][j] * h[j];
            }
            residual -= h[i] * change[i];
        }
        for (int32_t i = 0; i < STATES; ++i) {
            variance += h[i] * Ph[i];
        }
        for (int32_t i = 0; i < STATES; ++i) {
            half_h[i] = 0.0f;
            for (int32_t j = 0; j < STATES; ++j) {
                half[i][j] = P[i][j] - Ph[i] / variance * Ph[j];
                half_h[i] += half[i][j] * h[j];
            }
            change[i] += Ph[i] / variance * residual;
        }
        for (int32_t i = 0; i < STATES; ++i) {
            const float gain_i = Ph[i] / variance;
            for (int32_t j = 0; j <= i; ++j) {
                const float gain_j = Ph[j] / variance;
                P[i][j] = half[i][j] - half_h[i] * gain_j + gain_i * variances[n] * gain_j;
                P[j][i] = P[i][j];
            }
        }
    }
    for (int32_t i = 0; i < STATES; ++i) {
        x[i] += change[i];
    }
}

static void wheels_seen(const float x[STATES], const struct model *model, const float ball_rate[3],
                        const float gyro[3], const float velocity[2], float residuals[3], float rows[3][STATES])
{
    const float r_b = model->radius;
    const float g_x = x[G];
    const float g_y = x[G + 1];
    const float g_z = upright_part(&x[G]);
    const float share = 1.0f / (1.0f + g_z);
    const float M[3][3] = {
        {1.0f - share * g_x * g_x, -share * g_x * g_y, -g_x},
        {-share * g_x * g_y, 1.0f - share * g_y * g_y, -g_y},
        {g_x, g_y, g_z},
    };
    float z[3];
    float Omega[3] = {0.0f, 0.0f, 0.0f};
    for (int32_t k = 0; k < 3; ++k) {
        z[k] = ball_rate[k] + gyro[k] - x[BIAS + k];
    }
    for (int32_t i = 0; i < 3; ++i) {
        for (int32_t j = 0; j < STATES; ++j) {
            rows[i][j] = 0.0f;
        }
        for (int32_t k = 0; k < 3; ++k) {
            Omega[i] += M[i][k] * z[k];
        }
    }
    for (int32_t k = 0; k < 3; ++k) {
        rows[0][BIAS + k] = model->lever[0][k] + r_b * M[1][k];
        rows[1][BIAS + k] = model->lever[1][k] - r_b * M[0][k];
        rows[2][BIAS + k] = M[2][k];
    }
    rows[0][S] = 1.0f;
    rows[1][S + 1] = 1.0f;
    rows[0][G + 1] = r_b * z[2];
    rows[1][G] = -r_b * z[2];
    rows[2][G] = -z[0];
    rows[2][G + 1] = -z[1];
    residuals[0] = r_b * Omega[1] - velocity[0];
    residuals[1] = -r_b * Omega[0] - velocity[1];
    residuals[2] = Omega[2];
}

void direct_sample(const struct model *model, float x[STATES], float P[STATES][STATES], const struct inputs *given)
{
    float middle[3];
    float F[STATES][STATES];
    float Q[STATES][STATES];
    float velocity[2];
    float residuals[3];
    float rows[3][STATES];
    for (int32_t k = 0; k < 3; ++k) {
        middle[k] = 0.5f * (given->gyro_before[k] + given->gyro[k]);
    }
    transition(x, model, middle, F, Q);
    advance(x, model, given->gyro_before, given->gyro, velocity);
    propagate(P, F, Q);
    wheels_seen(x, model, given->ball_rate, middle, velocity, residuals, rows);
    absorb(x, P, 3, residuals, rows, model->wheel_variances);
    for (int32_t i = 0; i < 3; ++i) {
        for (int32_t j = 0; j < STATES; ++j) {
            rows[i][j] = 0.0f;
        }
    }
    rows[0][G] = rows[0][LEAN_ERROR] = 1.0f;
    rows[1][G + 1] = rows[1][LEAN_ERROR + 1] = 1.0f;
    rows[2][PSI] = rows[2][HEADING_ERROR] = 1.0f;
    residuals[0] = given->lean[0] - x[G] - x[LEAN_ERROR];
    residuals[1] = given->lean[1] - x[G + 1] - x[LEAN_ERROR + 1];
    residuals[2] = given->heading - x[PSI] - x[HEADING_ERROR];
    absorb(x, P, 3, residuals, rows, model->attitude_variances);
}
