/* Floor adaptation: the drag of the floor is separated from the pull of a slope, and turns with the motion.
 *
 *     G = b + kappa d + noise      G the integral action's sum (x, y), world frame [m s]; d the direction of motion
 *     I = G - kappa d              what stays in the integral's place
 *
 * b and kappa are random walks, which a Kalman filter of three states separates, one axis after the other:
 *
 *     p = P phi     (b, kappa) += p (G_i - phi.(b, kappa)) / (R + phi.p)     P -= p p^T / (R + phi.p)
 *
 * with phi = (1, 0, d_x) or (0, 1, d_y). P is kept less its start, so that zeros are the start.
 */
#include "parts/parts.h"

/* |d|^2 below which nothing is asked to move: a shaped motion never ends altogether. */
#define MOVES 1e-2f
/* In place of a speed of zero [m/s], which has no direction. */
#define NO_SPEED 1e-30f

struct ballbot_pair ballbot_direction(const struct ballbot_floor_record *own, float v_x, float v_y)
{
    const float speed = ballbot_square_root(v_x * v_x + v_y * v_y);
    const float share = ballbot_smaller(1.0f, speed * own->steepness) / ballbot_larger(speed, NO_SPEED);
    const struct ballbot_pair d = { share * v_x, share * v_y };

    return d;
}

/* Covariance of b_x, b_y and kappa, in this order. */
struct covariance {
    float xx;
    float yy;
    float kk;
    float xy;
    float xk;
    float yk;
};

/* Return the covariance after a random walk over a sample, never above the start. */
static struct covariance walked(const struct ballbot_floor_record *own, const struct ballbot_floor_state *state,
                                bool moves)
{
    const float drag_walk = moves ? own->drag_walk : 0.0f;
    const struct covariance P = {
        own->slope_start + ballbot_smaller(0.0f, state->P_xx + own->slope_walk),
        own->slope_start + ballbot_smaller(0.0f, state->P_yy + own->slope_walk),
        own->drag_start + ballbot_smaller(0.0f, state->P_kk + drag_walk),
        state->P_xy,
        state->P_xk,
        state->P_yk,
    };

    return P;
}

/* Take in one axis's sum `miss` beyond the expected one: p = P phi is its covariance with the three, `size` its own. */
static void take_in(struct ballbot_floor_state *state, struct covariance *P, const float p[3], float size,
                    float miss, bool moves)
{
    state->slope[0] += p[0] * miss / size;
    state->slope[1] += p[1] * miss / size;
    state->drag += moves ? p[2] * miss / size : 0.0f;
    P->xx -= p[0] * p[0] / size;
    P->yy -= p[1] * p[1] / size;
    P->kk -= p[2] * p[2] / size;
    P->xy -= p[0] * p[1] / size;
    P->xk -= p[0] * p[2] / size;
    P->yk -= p[1] * p[2] / size;
}

/* Step the filter by a sample; `sums` are the integrals of x and y. */
static void separate(const struct ballbot_floor_record *own, struct ballbot_floor_state *state, float sums[3],
                     struct ballbot_pair d)
{
    const float G_x = sums[0] + state->drag * d.x;
    const float G_y = sums[1] + state->drag * d.y;
    const bool moves = d.x * d.x + d.y * d.y > MOVES;
    struct covariance P = walked(own, state, moves);
    const float by_x[3] = { P.xx + P.xk * d.x, P.xy + P.yk * d.x, P.xk + P.kk * d.x };

    take_in(state, &P, by_x, own->noise + by_x[0] + d.x * by_x[2], G_x - state->slope[0] - state->drag * d.x, moves);
    const float by_y[3] = { P.xy + P.xk * d.y, P.yy + P.yk * d.y, P.yk + P.kk * d.y };

    take_in(state, &P, by_y, own->noise + by_y[1] + d.y * by_y[2], G_y - state->slope[1] - state->drag * d.y, moves);
    state->drag = ballbot_clipped(state->drag, own->highest);
    state->P_xx = P.xx - own->slope_start;
    state->P_yy = P.yy - own->slope_start;
    state->P_kk = P.kk - own->drag_start;
    state->P_xy = P.xy;
    state->P_xk = P.xk;
    state->P_yk = P.yk;
    sums[0] = G_x - state->drag * d.x;
    sums[1] = G_y - state->drag * d.y;
}

void ballbot_floor_adaptation_learn(const struct ballbot_law *law, struct ballbot_memory *memory,
                                    const struct ballbot_sample *now, bool limited)
{
    const struct ballbot_floor_record *own = &law->floor_adaptation;

    if (own->on != 0 && !limited) {
        separate(own, &memory->floor_adaptation, memory->integral.sums,
                 ballbot_direction(own, now->x.rate, now->y.rate));
    }
}
