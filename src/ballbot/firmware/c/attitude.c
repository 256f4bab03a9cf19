#include "attitude.h"

#include "ballbot_math.h"

/* Return R = Rx(theta) Ry(phi) Rz(psi), given sine and cosine of psi. */
static struct ballbot_attitude attitude(float theta, float phi, float ss, float cs)
{
    struct ballbot_attitude a;
    float st;
    float ct;
    float sp;
    float cp;

    ballbot_sine_cosine(theta, &st, &ct);
    ballbot_sine_cosine(phi, &sp, &cp);
    a.R[0][0] = cp * cs;
    a.R[0][1] = -cp * ss;
    a.R[0][2] = sp;
    a.R[1][0] = ct * ss + st * sp * cs;
    a.R[1][1] = ct * cs - st * sp * ss;
    a.R[1][2] = -st * cp;
    a.R[2][0] = st * ss - ct * sp * cs;
    a.R[2][1] = st * cs + ct * sp * ss;
    a.R[2][2] = ct * cp;
    a.sin_phi = sp;
    a.cos_phi = cp;
    a.sin_psi = ss;
    a.cos_psi = cs;
    return a;
}

struct ballbot_attitude ballbot_attitude_of(float theta, float phi, float psi)
{
    float ss;
    float cs;

    ballbot_sine_cosine(psi, &ss, &cs);
    return attitude(theta, phi, ss, cs);
}

struct ballbot_attitude ballbot_attitude_after(const struct ballbot_attitude *a, float theta, float phi, float turn)
{
    float s;
    float c;

    ballbot_sine_cosine(turn, &s, &c);
    return attitude(theta, phi, c * a->sin_psi + s * a->cos_psi, c * a->cos_psi - s * a->sin_psi);
}

void ballbot_body_rates(const struct ballbot_attitude *a, const float angle_rates[3], float w[3])
{
    const float t = angle_rates[0];
    const float p = angle_rates[1];

    w[0] = a->cos_phi * a->cos_psi * t + a->sin_psi * p;
    w[1] = a->cos_psi * p - a->cos_phi * a->sin_psi * t;
    w[2] = a->sin_phi * t + angle_rates[2];
}

void ballbot_rotate_back(const struct ballbot_attitude *a, const float v[3], float turned[3])
{
    for (int i = 0; i < 3; ++i) {
        turned[i] = a->R[0][i] * v[0] + a->R[1][i] * v[1] + a->R[2][i] * v[2];
    }
}

struct ballbot_pair ballbot_to_heading(const struct ballbot_attitude *a, float x, float y)
{
    const struct ballbot_pair turned = { a->cos_psi * x + a->sin_psi * y, a->cos_psi * y - a->sin_psi * x };

    return turned;
}

struct ballbot_pair ballbot_from_heading(const struct ballbot_attitude *a, float x, float y)
{
    const struct ballbot_pair turned = { a->cos_psi * x - a->sin_psi * y, a->sin_psi * x + a->cos_psi * y };

    return turned;
}
