#include "attitude.h"

#include "ballbot_math.h"

struct ballbot_heading ballbot_heading_of(float psi)
{
    struct ballbot_heading heading;

    ballbot_sine_cosine(psi, &heading.sine, &heading.cosine);
    return heading;
}

struct ballbot_heading ballbot_heading_after(struct ballbot_heading heading, float turn)
{
    const struct ballbot_heading small = ballbot_heading_of(turn);
    const struct ballbot_heading after = {
        small.cosine * heading.sine + small.sine * heading.cosine,
        small.cosine * heading.cosine - small.sine * heading.sine,
    };

    return after;
}

struct ballbot_attitude ballbot_attitude_of(float theta, float phi, struct ballbot_heading heading)
{
    const float ss = heading.sine;
    const float cs = heading.cosine;
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
    a.heading = heading;
    return a;
}

void ballbot_body_rates(const struct ballbot_attitude *a, const float angle_rates[3], float w[3])
{
    const float t = angle_rates[0];
    const float p = angle_rates[1];

    w[0] = a->cos_phi * a->heading.cosine * t + a->heading.sine * p;
    w[1] = a->heading.cosine * p - a->cos_phi * a->heading.sine * t;
    w[2] = a->sin_phi * t + angle_rates[2];
}

void ballbot_rotate_back(const struct ballbot_attitude *a, const float v[3], float turned[3])
{
    for (int i = 0; i < 3; ++i) {
        turned[i] = a->R[0][i] * v[0] + a->R[1][i] * v[1] + a->R[2][i] * v[2];
    }
}
