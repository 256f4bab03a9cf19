/* Integral action: a position or heading that stays wrong is corrected until it is right.
 *
 *     I' = e - I/T      e the error of x, y [m] and psi [rad], world frame; sampled, within its limits
 *     u += K_I S(psi) I
 *
 * Within the dead band the integrals rest. While a torque or the error is limited, or the reference accelerates, they may
 * shrink but not grow.
 */
#include "parts/parts.h"

/* acceleration of the reference beyond which errors come from the motion, not from a lasting disturbance [m/s^2] */
#define BRISK (0.25f)

void ballbot_integral_torque(const struct ballbot_law *law, const struct ballbot_memory *memory,
                             const struct ballbot_sample *now, float torques[], int32_t n)
{
    const struct ballbot_integral_record *own = &law->integral;
    const float *sums = memory->integral.sums;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair I = ballbot_to_heading(now->a, sums[0], sums[1]);

    for (int32_t i = 0; i < n; ++i) {
        const float *more = memory->tuning.integral[i];

        torques[i] += own->gain[i][0] * I.x + own->gain[i][1] * I.y + own->gain[i][2] * sums[2];
        if (law->tuning.others > 0) {
            torques[i] += more[0] * I.x + more[1] * I.y + more[2] * sums[2];
        }
    }
}

/* Return an integral after a sample. */
static float stepped(float value, float kept, float change, float limit, bool limited)
{
    const float after = ballbot_clipped(kept * value + change, limit);

    return (limited && ballbot_magnitude(after) > ballbot_magnitude(value)) ? value : after;
}

void ballbot_integral_learn(const struct ballbot_law *law, struct ballbot_memory *memory,
                            const struct ballbot_sample *now, bool limited)
{
    const struct ballbot_integral_record *own = &law->integral;
    float *sums = memory->integral.sums;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair e = ballbot_from_heading(now->a, now->e[0], now->e[1]);
    const float e_psi = now->e[4];

    limited = limited || now->x.second * now->x.second + now->y.second * now->y.second > BRISK * BRISK;
    if (e.x * e.x + e.y * e.y > own->dead_band * own->dead_band) {
        sums[0] = stepped(sums[0], own->kept, own->step * e.x, own->limit, limited);
        sums[1] = stepped(sums[1], own->kept, own->step * e.y, own->limit, limited);
    }
    if (ballbot_magnitude(e_psi) > own->dead_band) {
        sums[2] = stepped(sums[2], own->kept, own->step * e_psi, own->yaw_limit, limited);
    }
}
