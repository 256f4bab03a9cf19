/* The on-board state by a Kalman filter; see kalman.h. */
#include "estimation/kalman.h"

#include "ballbot_math.h"
#include "compensated_sum.h"
#include "estimation/known.h"

/*
 * Where each state lies. Those that nothing drives come first and those that drive nothing come last: a row of the
 * covariance above the diagonal is short where its equation is long.
 */
enum {
    B_X,
    B_Y,
    B_Z,
    DRIFT,   /* r */
    G_X,
    G_Y,
    SHOWN_X, /* g + a */
    SHOWN_Y,
    S_X,
    S_Y,
    PSI,
    SHOWN_PSI, /* psi + d */
    X,
    Y,
    STATES,
    DRIVEN = G_X, /* the first that something drives */
    LEAN_AND_SPEED_END = PSI,
    HEADING_END = X
};

/* Values of `started`. */
enum { LOST = -1, NOT_STARTED = 0, RUNNING = 1 };

/* Largest sum of the magnitudes of all states and variances; beyond it the filter is lost. */
#define LARGEST 1.0e12f

/* Smallest fraction of a variance that a sample leaves; readings that no sensor gives could leave less */
#define LEAST_KEPT 1.0e-6f

/* Variance of psi [rad^2], x or y [m^2] above which all three no longer grow, and the factor by which a sample then reduces them */
#define FORGOTTEN_ABOVE 0.04f
#define REMEMBERED (1.0f - 0x1p-18f)

/* Largest count of samples without encoders; beyond it a float skips whole numbers */
#define MOST_MISSED 0x1000000

/* Numbers that are taken in at a time: three of the wheels and three of the AHRS, or those of a fix. */
enum { FROM_WHEELS = 0, FROM_AHRS = 3, SEEN = 6 };

/* Before a short loop: unrolled, it takes half as long. Other compilers decide by themselves. */
#if defined(__GNUC__)
#define UNROLLED _Pragma("GCC unroll 6")
#else
#define UNROLLED
#endif

/* square of a cosine, at least */
#define LEAST_UPRIGHT_SQUARED 1.0e-6f

/* The entries of the transition F, `advance` derived by the state to first order in h, that are not 0 or 1. */
struct transition {
    float x_psi, y_psi;         /* h d(v)/d(psi) */
    float cosine, sine;         /* h Rz(psi) */
    float x_b[3], y_b[3];       /* h Rz(psi) C */
    float psi_g[2], psi_b[2];
    float g_x[2], g_y[2];
    float pull[2][2];           /* h Lambda */
    float turn;                 /* h psi_dot */
    float g_z, lean[2], speed[2]; /* h g_z, h g, h s */
    float h, forgotten;
};

/* x and y of a vector. */
struct pair {
    float x;
    float y;
};

/* Return the cosine with this square; beyond 90 degrees, where only noise can take the lean, it is nearly zero. */
static float root_of(float square)
{
    return ballbot_square_root((square > LEAST_UPRIGHT_SQUARED) ? square : LEAST_UPRIGHT_SQUARED);
}

/* Return g_z. */
static float upright_part(float g_x, float g_y)
{
    return root_of((1.0f - g_x * g_x) - g_y * g_y);
}

/* Return psi_dot = w . (g + e_z) / (1 + g_z) [rad/s]. */
static float heading_rate(float g_x, float g_y, float g_z, const float w[3])
{
    return w[2] + (w[0] * g_x + w[1] * g_y) / (1.0f + g_z);
}

/* Return C w, component k [m/s]. */
static float lever_speed(const struct ballbot_kalman_record *record, int32_t k, const float w[3])
{
    return record->lever[k][0] * w[0] + record->lever[k][1] * w[1] + record->lever[k][2] * w[2];
}

/* Add to a state, and keep what rounding takes. */
static void move(struct ballbot_kalman_memory *memory, int32_t state, float value)
{
    ballbot_add(&memory->x[state], &memory->rest[state], value);
}

/* ---- the motion ---- */

/* Give F at the state and the sample's mean angular velocity w, without the gyro's bias [rad/s]. */
static void linearize(const struct ballbot_kalman_record *record, const struct ballbot_kalman_memory *memory,
                      const float w[3], struct transition *f)
{
    const float *const x = memory->x;
    const float h = record->sample_time;
    const float g_z = upright_part(x[G_X], x[G_Y]);
    const float by_psi = h / (1.0f + g_z);
    const float by_g = h / g_z;
    const float v_x = x[S_X] - lever_speed(record, 0, w);
    const float v_y = x[S_Y] - lever_speed(record, 1, w);
    f->h = h;
    f->forgotten = record->forgotten;
    f->cosine = h * memory->cosine;
    f->sine = h * memory->sine;
    f->x_psi = -(f->sine * v_x + f->cosine * v_y);
    f->y_psi = f->cosine * v_x - f->sine * v_y;
    for (int32_t k = 0; k < 3; ++k) {
        f->x_b[k] = f->cosine * record->lever[0][k] - f->sine * record->lever[1][k];
        f->y_b[k] = f->sine * record->lever[0][k] + f->cosine * record->lever[1][k];
    }
    f->psi_g[0] = by_psi * w[0];
    f->psi_g[1] = by_psi * w[1];
    f->psi_b[0] = -by_psi * x[G_X];
    f->psi_b[1] = -by_psi * x[G_Y];
    f->g_x[0] = by_g * w[1] * x[G_X];
    f->g_x[1] = h * w[2] + by_g * w[1] * x[G_Y];
    f->g_y[0] = -(h * w[2] + by_g * w[0] * x[G_X]);
    f->g_y[1] = -(by_g * w[0] * x[G_Y]);
    for (int32_t k = 0; k < 2; ++k) {
        f->pull[k][0] = h * record->pull[k][0];
        f->pull[k][1] = h * record->pull[k][1];
        f->lean[k] = h * x[G_X + k];
        f->speed[k] = h * x[S_X + k];
    }
    f->turn = h * heading_rate(x[G_X], x[G_Y], g_z, w);
    f->g_z = h * g_z;
}

/* Return the lean's change in F c for a vector c: two elements of F c - c. */
static inline struct pair lean_change(const struct transition *f, const float c[STATES])
{
    const struct pair change = {
        (f->g_x[0] * c[G_X] + f->g_x[1] * c[G_Y]) + (f->g_z * c[B_Y] - f->lean[1] * c[B_Z]),
        (f->g_y[0] * c[G_X] + f->g_y[1] * c[G_Y]) + (f->lean[0] * c[B_Z] - f->g_z * c[B_X]),
    };
    return change;
}

/* Give the lean's elements of F c for a vector c; the result's elements lie `apart`. */
static inline void lean(const float c[STATES], struct pair change, float *result, int32_t apart)
{
    result[G_X * apart] = c[G_X] + change.x;
    result[G_Y * apart] = c[G_Y] + change.y;
}

/* Give the shown lean's elements of F c for a vector c. */
static inline void shown_lean(const struct transition *f, const float c[STATES], struct pair change, float *result,
                              int32_t apart)
{
    result[SHOWN_X * apart] = c[SHOWN_X] + (change.x - f->forgotten * (c[SHOWN_X] - c[G_X]));
    result[SHOWN_Y * apart] = c[SHOWN_Y] + (change.y - f->forgotten * (c[SHOWN_Y] - c[G_Y]));
}

/* Give the speed's elements of F c for a vector c. */
static inline void speed(const struct transition *f, const float c[STATES], float *result, int32_t apart)
{
    result[S_X * apart] = (c[S_X] - (f->pull[0][0] * c[G_X] + f->pull[0][1] * c[G_Y]))
                  + (f->turn * c[S_Y] - f->speed[1] * c[B_Z]);
    result[S_Y * apart] = (c[S_Y] - (f->pull[1][0] * c[G_X] + f->pull[1][1] * c[G_Y]))
                  - (f->turn * c[S_X] - f->speed[0] * c[B_Z]);
}

/* Give the heading's elements of F c for a vector c. */
static inline void heading(const struct transition *f, const float c[STATES], float *result, int32_t apart)
{
    const float by = (f->psi_g[0] * c[G_X] + f->psi_g[1] * c[G_Y])
                     + (f->psi_b[0] * c[B_X] + f->psi_b[1] * c[B_Y] - f->h * c[B_Z]);
    result[PSI * apart] = c[PSI] + by;
    result[SHOWN_PSI * apart] = c[SHOWN_PSI] + (by + f->h * c[DRIFT]);
}

/* Return the element x of F c for a vector c, whose elements lie `from` apart. */
static inline float place_x(const struct transition *f, const float *c, int32_t from)
{
    return (c[X * from] + f->x_psi * c[PSI * from]) + (f->cosine * c[S_X * from] - f->sine * c[S_Y * from])
           + (f->x_b[0] * c[B_X * from] + f->x_b[1] * c[B_Y * from] + f->x_b[2] * c[B_Z * from]);
}

/* Return the element y. */
static inline float place_y(const struct transition *f, const float *c, int32_t from)
{
    return (c[Y * from] + f->y_psi * c[PSI * from]) + (f->sine * c[S_X * from] + f->cosine * c[S_Y * from])
           + (f->y_b[0] * c[B_X * from] + f->y_b[1] * c[B_Y * from] + f->y_b[2] * c[B_Z * from]);
}

/*
 * Keep the variances of heading and place from growing without bound.
 *
 * Without a fix they would, until what a sample adds to them is lost in rounding and the covariance is none any more.
 * To multiply the rows and the columns of some states by a number leaves it positive.
 */
static void forget(float P[STATES][STATES])
{
    static const int32_t UNSEEN[3] = {PSI, X, Y};
    if ((P[PSI][PSI] > FORGOTTEN_ABOVE) || (P[X][X] > FORGOTTEN_ABOVE) || (P[Y][Y] > FORGOTTEN_ABOVE)) {
        for (int32_t k = 0; k < 3; ++k) {
            const int32_t state = UNSEEN[k];
            for (int32_t i = 0; i <= state; ++i) {
                P[i][state] *= REMEMBERED;
            }
            for (int32_t i = state; i < STATES; ++i) {
                P[state][i] *= REMEMBERED;
            }
        }
    }
}

/*
 * Fill in T's columns of the states that nothing drives: rows of P, and what the gyro's noise adds to those of the bias.
 *
 * A sample's gyro noise does what a bias of one sample would: Q = F_b F_b^T gyro_variance + walk, F_b the bias's columns
 * of F, less the bias's own rows. It comes in with the second product, T F^T, if T is larger by gyro_variance F_b in it.
 */
static void driven_by_noise(const struct transition *f, float gyro_variance, float P[STATES][STATES],
                            float T[STATES][STATES])
{
    const float by_g_z = gyro_variance * f->g_z;
    const float by_lean[2] = {gyro_variance * f->lean[0], gyro_variance * f->lean[1]};
    for (int32_t state = G_X; state < S_X; state += 2) { /* the lean, and the shown one */
        T[state][B_X] = P[B_X][state];
        T[state][B_Y] = P[B_Y][state] + by_g_z;
        T[state][B_Z] = P[B_Z][state] - by_lean[1];
        T[state + 1][B_X] = P[B_X][state + 1] - by_g_z;
        T[state + 1][B_Y] = P[B_Y][state + 1];
        T[state + 1][B_Z] = P[B_Z][state + 1] + by_lean[0];
    }
    for (int32_t k = 0; k < 2; ++k) {
        T[S_X][B_X + k] = P[B_X + k][S_X];
        T[S_Y][B_X + k] = P[B_X + k][S_Y];
    }
    T[S_X][B_Z] = P[B_Z][S_X] - gyro_variance * f->speed[1];
    T[S_Y][B_Z] = P[B_Z][S_Y] + gyro_variance * f->speed[0];
    for (int32_t state = PSI; state < HEADING_END; ++state) {
        T[state][B_X] = P[B_X][state] + gyro_variance * f->psi_b[0];
        T[state][B_Y] = P[B_Y][state] + gyro_variance * f->psi_b[1];
        T[state][B_Z] = P[B_Z][state] - gyro_variance * f->h;
    }
    for (int32_t k = 0; k < 3; ++k) {
        T[X][B_X + k] = P[B_X + k][X] + gyro_variance * f->x_b[k];
        T[Y][B_X + k] = P[B_X + k][Y] + gyro_variance * f->y_b[k];
    }
    for (int32_t state = PSI; state < STATES; ++state) {
        T[state][DRIFT] = P[DRIFT][state];
    }
}

/*
 * Overwrite the covariance P by F P F^T + Q.
 *
 * F times each row of P is a column of T = F P; F times each row of that, a column of the result. Of T only what the
 * second product uses is made, of the result little more than what lies above the diagonal; `absorb` fills in the rest.
 * Rows of states that nothing drives are rows of the result already. Before it, P is whole but for its last two rows,
 * of which what lies below the diagonal is taken from above.
 */
static void propagate(const struct ballbot_kalman_record *record, const struct transition *f, float P[STATES][STATES])
{
    float T[STATES][STATES];
    for (int32_t i = HEADING_END; i < STATES; ++i) {
        T[X][i] = place_x(f, &P[0][i], STATES);
        T[Y][i] = place_y(f, &P[0][i], STATES);
    }
    for (int32_t i = 0; i < DRIVEN; ++i) {
        float c[STATES];
        for (int32_t j = 0; j < STATES; ++j) {
            c[j] = P[i][j];
        }
        const struct pair change = lean_change(f, c);
        lean(c, change, P[i], 1);
        shown_lean(f, c, change, P[i], 1);
        speed(f, c, P[i], 1);
        heading(f, c, P[i], 1);
        P[i][X] = place_x(f, c, 1);
        P[i][Y] = place_y(f, c, 1);
    }
    for (int32_t i = DRIVEN; i < LEAN_AND_SPEED_END; ++i) {
        const struct pair change = lean_change(f, P[i]);
        lean(P[i], change, &T[0][i], STATES);
        shown_lean(f, P[i], change, &T[0][i], STATES);
        speed(f, P[i], &T[0][i], STATES);
    }
    for (int32_t i = DRIVEN; i < HEADING_END; ++i) {
        heading(f, P[i], &T[0][i], STATES);
        T[X][i] = place_x(f, P[i], 1);
        T[Y][i] = place_y(f, P[i], 1);
    }
    driven_by_noise(f, record->gyro_variance, P, T);
    for (int32_t j = G_X; j < SHOWN_X; ++j) {
        lean(T[j], lean_change(f, T[j]), &P[0][j], STATES);
    }
    for (int32_t j = SHOWN_X; j < S_X; ++j) {
        const struct pair change = lean_change(f, T[j]);
        lean(T[j], change, &P[0][j], STATES);
        shown_lean(f, T[j], change, &P[0][j], STATES);
    }
    for (int32_t j = S_X; j < STATES; ++j) {
        const struct pair change = lean_change(f, T[j]);
        lean(T[j], change, &P[0][j], STATES);
        shown_lean(f, T[j], change, &P[0][j], STATES);
        speed(f, T[j], &P[0][j], STATES);
    }
    for (int32_t j = LEAN_AND_SPEED_END; j < STATES; ++j) {
        heading(f, T[j], &P[0][j], STATES);
    }
    P[X][X] = place_x(f, T[X], 1);
    P[X][Y] = place_x(f, T[Y], 1);
    P[Y][Y] = place_y(f, T[Y], 1);
    for (int32_t i = 0; i < STATES; ++i) {
        P[i][i] += record->walk[i];
    }
    forget(P);
}

/*
 * Move the state on by a sample and give the mean of v (2) [m/s] over it.
 *
 * The gyro before and now [rad/s] is that of the sample's start and end. Rates are taken at the sample's middle.
 */
static void advance(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                    const float gyro[3], float velocity[2])
{
    const float h = record->sample_time;
    float *const x = memory->x;
    float start[3];
    float end[3];
    float w[3];
    for (int32_t k = 0; k < 3; ++k) {
        start[k] = memory->gyro[k] - x[B_X + k];
        end[k] = gyro[k] - x[B_X + k];
        w[k] = 0.5f * (memory->gyro[k] + gyro[k]) - x[B_X + k];
    }
    const float before[2] = {x[S_X] - lever_speed(record, 0, start), x[S_Y] - lever_speed(record, 1, start)};
    const float shown[2] = {x[SHOWN_X] - x[G_X], x[SHOWN_Y] - x[G_Y]};
    const float g_z = upright_part(x[G_X], x[G_Y]);
    const float g_x = x[G_X] + 0.5f * h * (x[G_Y] * w[2] - g_z * w[1]);
    const float g_y = x[G_Y] + 0.5f * h * (g_z * w[0] - x[G_X] * w[2]);
    const float middle = upright_part(g_x, g_y);
    const float turning = heading_rate(g_x, g_y, middle, w);
    const float(*const pull)[2] = record->pull;
    const float s_x = x[S_X] + 0.5f * h * (turning * x[S_Y] - (pull[0][0] * x[G_X] + pull[0][1] * x[G_Y]));
    const float s_y = x[S_Y] - 0.5f * h * (turning * x[S_X] + (pull[1][0] * x[G_X] + pull[1][1] * x[G_Y]));
    const float leans[2] = {h * (g_y * w[2] - middle * w[1]), h * (middle * w[0] - g_x * w[2])};
    move(memory, S_X, h * (turning * s_y - (pull[0][0] * g_x + pull[0][1] * g_y)));
    move(memory, S_Y, -h * (turning * s_x + (pull[1][0] * g_x + pull[1][1] * g_y)));
    for (int32_t k = 0; k < 2; ++k) {
        move(memory, G_X + k, leans[k]);
        move(memory, SHOWN_X + k, leans[k] - record->forgotten * shown[k]);
        velocity[k] = 0.5f * (before[k] + x[S_X + k] - lever_speed(record, k, end));
    }
    float sine;
    float cosine;
    ballbot_sine_cosine(x[PSI] + 0.5f * h * turning, &sine, &cosine);
    move(memory, X, h * (cosine * velocity[0] - sine * velocity[1]));
    move(memory, Y, h * (sine * velocity[0] + cosine * velocity[1]));
    move(memory, PSI, h * turning);
    move(memory, SHOWN_PSI, h * (turning + x[DRIFT]));
}

/* ---- what is seen ---- */

/* Numbers that are seen at the same time. One that is missing has a row of zeros, no residual and the variance 1. */
struct seen {
    float Ph[STATES][SEEN]; /* P H^T: column m is P times the row h of number m */
    float hPh[SEEN][SEEN];  /* the lower triangle of H P H^T */
    float residual[SEEN];   /* seen less expected */
    float variance[SEEN];   /* of each number's own error */
};

/* Return the product of two vectors (SEEN). */
static inline float product(const float a[SEEN], const float b[SEEN])
{
    return ((a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])) + (a[4] * b[4] + a[5] * b[5]);
}

/* Take the products of two rows of gains and a row of V from two elements of P, one below the other; return what is left. */
static inline struct pair changed(float *element, float *below, const float gain[SEEN], const float gain_below[SEEN],
                                  const float V[SEEN])
{
    const struct pair after = {*element - product(gain, V), *below - product(gain_below, V)};
    *element = after.x;
    *below = after.y;
    return after;
}

/*
 * Take in numbers that were seen, changing the state and its covariance P.
 *
 * H P H^T + R = L D L^T, L with ones on its diagonal. Then P+ = P - V D^-1 V^T with V = P H^T L^-T. A column of V is
 * that P h which the numbers before have left: the same as to take them in one after the other, but P is read once.
 */
static void absorb(struct ballbot_kalman_memory *memory, struct seen *seen)
{
    float L[SEEN][SEEN];
    float inverse[SEEN]; /* of D */
    float step[SEEN];
    float kept = 1.0f; /* of a variance, at least: by Cauchy and Schwarz, each number leaves r / D of it */
    UNROLLED
    for (int32_t m = 0; m < SEEN; ++m) {
        float variance = seen->hPh[m][m] + seen->variance[m];
        float residual = seen->residual[m];
        float LD[SEEN];
        UNROLLED
        for (int32_t l = 0; l < m; ++l) {
            LD[l] = seen->hPh[m][l];
            UNROLLED
            for (int32_t n = 0; n < l; ++n) {
                LD[l] -= LD[n] * L[l][n];
            }
            L[m][l] = LD[l] * inverse[l];
            variance -= LD[l] * L[m][l];
            residual -= L[m][l] * seen->residual[l];
        }
        seen->residual[m] = residual;
        variance = (variance > seen->variance[m]) ? variance : seen->variance[m]; /* h P h is not negative */
        inverse[m] = 1.0f / variance;
        step[m] = residual * inverse[m];
        kept *= seen->variance[m] * inverse[m];
    }
    kept = (kept > LEAST_KEPT) ? kept : LEAST_KEPT;
    float smallest = LARGEST; /* variance */
    float size = 0.0f;        /* of all variances and states */
    for (int32_t i = 0; i < STATES; ++i) {
        float *const V = seen->Ph[i];
        float change = 0.0f;
        for (int32_t m = 0; m < SEEN; ++m) {
            for (int32_t l = 0; l < m; ++l) {
                V[m] -= L[m][l] * V[l];
            }
            change += V[m] * step[m];
        }
        move(memory, i, change);
        size += ballbot_magnitude(memory->x[i]);
    }
    for (int32_t i = 0; i < STATES; i += 2) { /* two rows at a time, which share what they read of V */
        float *const row[2] = {memory->P[i], memory->P[i + 1]};
        const float least[2] = {kept * row[0][i], kept * row[1][i + 1]};
        float gain[2][SEEN];
        for (int32_t m = 0; m < SEEN; ++m) {
            gain[0][m] = seen->Ph[i][m] * inverse[m];
            gain[1][m] = seen->Ph[i + 1][m] * inverse[m];
        }
        row[0][i] -= product(gain[0], seen->Ph[i]);
        row[0][i + 1] -= product(gain[0], seen->Ph[i + 1]);
        row[1][i] = row[0][i + 1];
        row[1][i + 1] -= product(gain[1], seen->Ph[i + 1]);
        for (int32_t j = i + 2; j < HEADING_END; ++j) {
            const struct pair after = changed(&row[0][j], &row[1][j], gain[0], gain[1], seen->Ph[j]);
            memory->P[j][i] = after.x;
            memory->P[j][i + 1] = after.y;
        }
        for (int32_t j = HEADING_END; (i < HEADING_END) && (j < STATES); ++j) { /* what lies below is not used */
            (void)changed(&row[0][j], &row[1][j], gain[0], gain[1], seen->Ph[j]);
        }
        for (int32_t k = 0; k < 2; ++k) {
            float *const variance = &row[k][i + k];
            *variance = (*variance > least[k]) ? *variance : least[k];
            smallest = (*variance < smallest) ? *variance : smallest;
            size += *variance;
        }
    }
    if (!(smallest > 0.0f) || !(size <= LARGEST)) {
        memory->started = LOST; /* by readings that no sensor gives */
    }
}

/* Fill in a number that is missing. */
static void see_nothing(struct seen *seen, int32_t m)
{
    for (int32_t i = 0; i < STATES; ++i) {
        seen->Ph[i][m] = 0.0f;
    }
    for (int32_t l = 0; l < SEEN; ++l) {
        seen->hPh[m][l] = 0.0f;
    }
    seen->residual[m] = 0.0f;
    seen->variance[m] = 1.0f;
}

/* Fill in a number that is a state itself. Those before it must be there already. */
static inline void see_state(const struct ballbot_kalman_memory *memory, struct seen *seen, int32_t m, int32_t state,
                             float residual, float variance)
{
    for (int32_t i = 0; i < state; ++i) {
        seen->Ph[i][m] = memory->P[i][state];
    }
    for (int32_t i = state; i < STATES; ++i) {
        seen->Ph[i][m] = memory->P[state][i];
    }
    for (int32_t l = 0; l <= m; ++l) {
        seen->hPh[m][l] = seen->Ph[state][l];
    }
    seen->residual[m] = residual;
    seen->variance[m] = variance;
}

/* Return the product of two vectors (3). */
static inline float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The wheels' rows of H: by the bias, by the lean g, and 1 by the speed s. */
struct wheel_rows {
    float by_bias[3][3];
    float by_lean;
    float z[2];
};

/* Give the wheels' rows times a vector: its bias, and its lean and speed, whose two elements lie some way apart. */
static inline void see_wheel_row(const struct wheel_rows *rows, const float bias[3], const float *lean, const float *speed,
                                 int32_t lean_apart, int32_t speed_apart, float result[3])
{
    const float lean_x = lean[0];
    const float lean_y = lean[lean_apart];
    const float s_x = speed[0];
    const float s_y = speed[speed_apart];
    result[0] = dot(rows->by_bias[0], bias) + (rows->by_lean * lean_y + s_x);
    result[1] = dot(rows->by_bias[1], bias) - (rows->by_lean * lean_x - s_y);
    result[2] = dot(rows->by_bias[2], bias) - (rows->z[0] * lean_x + rows->z[1] * lean_y);
}

/*
 * Fill in v_x - r_b Omega_y = 0, v_y + r_b Omega_x = 0 and Omega_z = 0, rows to first order in the lean.
 *
 * The ball's mean turning relative to the body and the gyro's mean over the sample are in the body's frame [rad/s], the
 * states' mean v in the heading frame [m/s]. Omega_z is left out while the ball pivots. Return it [rad/s].
 */
static float see_wheels(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                        struct seen *seen, const float ball_rate[3], const float gyro[3], const float velocity[2])
{
    const float *const x = memory->x;
    const float r_b = record->radius;
    const float g_x = x[G_X];
    const float g_y = x[G_Y];
    const float g_z = upright_part(g_x, g_y);
    const float share = 1.0f / (1.0f + g_z);
    const float M[3][3] = {
        {1.0f - share * g_x * g_x, -share * g_x * g_y, -g_x},
        {-share * g_x * g_y, 1.0f - share * g_y * g_y, -g_y},
        {g_x, g_y, g_z},
    };
    float z[3];
    float Omega[3];
    for (int32_t k = 0; k < 3; ++k) {
        z[k] = ball_rate[k] + (gyro[k] - x[B_X + k]);
    }
    struct wheel_rows rows = {.by_lean = r_b * z[2], .z = {z[0], z[1]}};
    for (int32_t k = 0; k < 3; ++k) {
        Omega[k] = M[k][0] * z[0] + M[k][1] * z[1] + M[k][2] * z[2];
        rows.by_bias[0][k] = record->lever[0][k] + r_b * M[1][k];
        rows.by_bias[1][k] = record->lever[1][k] - r_b * M[0][k];
        rows.by_bias[2][k] = M[2][k];
    }
    const float residuals[3] = {r_b * Omega[1] - velocity[0], -r_b * Omega[0] - velocity[1], Omega[2]};
    float(*const P)[STATES] = memory->P;
    P[G_Y][G_X] = P[G_X][G_Y]; /* above the diagonal P is whole */
    P[S_Y][S_X] = P[S_X][S_Y];
    for (int32_t i = 0; i < G_X; ++i) {
        const float bias[3] = {P[B_X][i], P[B_Y][i], P[B_Z][i]};
        see_wheel_row(&rows, bias, &P[i][G_X], &P[i][S_X], 1, 1, seen->Ph[i]);
    }
    for (int32_t i = G_X; i < S_X; ++i) {
        const float bias[3] = {P[B_X][i], P[B_Y][i], P[B_Z][i]};
        see_wheel_row(&rows, bias, &P[G_X][i], &P[i][S_X], STATES, 1, seen->Ph[i]);
    }
    for (int32_t i = S_X; i < STATES; ++i) {
        const float bias[3] = {P[B_X][i], P[B_Y][i], P[B_Z][i]};
        see_wheel_row(&rows, bias, &P[G_X][i], &P[S_X][i], STATES, STATES, seen->Ph[i]);
    }
    for (int32_t l = 0; l < 3; ++l) {
        const float bias[3] = {seen->Ph[B_X][l], seen->Ph[B_Y][l], seen->Ph[B_Z][l]};
        float hPh[3];
        see_wheel_row(&rows, bias, &seen->Ph[G_X][l], &seen->Ph[S_X][l], SEEN, SEEN, hPh);
        for (int32_t m = l; m < 3; ++m) {
            seen->hPh[m][l] = hPh[m];
        }
        seen->residual[l] = residuals[l];
        seen->variance[l] = record->wheel_variances[l];
    }
    if (ballbot_magnitude(memory->pivoting) > record->pivoting_limit) {
        see_nothing(seen, 2);
    }
    return Omega[2];
}

/* Take in what there is of a fix. */
static void see_fix(struct ballbot_kalman_memory *memory, const struct ballbot_reading_record *reading)
{
    const float *const x = memory->x;
    int32_t seen_x = ballbot_known(reading->fix_position[0]);
    int32_t seen_y = ballbot_known(reading->fix_position[1]);
    int32_t seen_psi = ballbot_known(reading->fix_heading);
    if ((seen_x | seen_y | seen_psi) == 0) {
        return;
    }
    const float position = reading->fix_position_deviation * reading->fix_position_deviation;
    const float heading_variance = reading->fix_heading_deviation * reading->fix_heading_deviation;
    seen_x &= (position > 0.0f) ? 1 : 0;
    seen_y &= (position > 0.0f) ? 1 : 0;
    seen_psi &= (heading_variance > 0.0f) ? 1 : 0;
    if ((seen_x | seen_y | seen_psi) != 0) {
        struct seen seen;
        for (int32_t m = 0; m < SEEN; ++m) {
            see_nothing(&seen, m);
        }
        if (seen_x != 0) {
            see_state(memory, &seen, 0, X, reading->fix_position[0] - x[X], position);
        }
        if (seen_y != 0) {
            see_state(memory, &seen, 1, Y, reading->fix_position[1] - x[Y], position);
        }
        if (seen_psi != 0) {
            const float residual = ballbot_within_half_turn(reading->fix_heading - x[PSI]);
            see_state(memory, &seen, 2, PSI, residual, heading_variance);
        }
        absorb(memory, &seen);
    }
}

/* ---- a sample ---- */

/*
 * Give x and y of the AHRS's upward direction g = R^T e_z and return its heading [rad], with the turns of psi.
 *
 * heading = psi + 2 atan(tan(theta/2) tan(phi/2))
 */
static float lean_and_heading(const float attitude[3], float lean[2])
{
    float s1, c1, s2, c2, s3, c3;
    ballbot_sine_cosine(attitude[0], &s1, &c1);
    ballbot_sine_cosine(attitude[1], &s2, &c2);
    ballbot_sine_cosine(attitude[2], &s3, &c3);
    const float forward = -c1 * s2; /* before the turn by psi */
    lean[0] = c3 * forward + s3 * s1;
    lean[1] = c3 * s1 - s3 * forward;
    return attitude[2] + 2.0f * ballbot_arctangent(s1 * s2, (1.0f + c1) * (1.0f + c2));
}

/* Begin at the first whole reading: its attitude, v = 0. */
static void start(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory, const float gyro[3],
                  const float lean[2], float psi)
{
    const float position[2] = {memory->x[X], memory->x[Y]};
    for (int32_t i = 0; i < STATES; ++i) {
        memory->x[i] = 0.0f;
        memory->rest[i] = 0.0f;
        for (int32_t j = 0; j < STATES; ++j) {
            memory->P[i][j] = 0.0f;
        }
        memory->P[i][i] = record->start_variances[i];
    }
    for (int32_t k = 0; k < 2; ++k) {
        memory->x[X + k] = position[k];
        memory->x[G_X + k] = lean[k];
        memory->x[SHOWN_X + k] = lean[k];
        memory->x[S_X + k] = lever_speed(record, k, gyro);
        memory->P[G_X + k][SHOWN_X + k] = record->start_covariances[k];
        memory->P[SHOWN_X + k][G_X + k] = record->start_covariances[k];
    }
    memory->x[PSI] = psi;
    memory->x[SHOWN_PSI] = psi;
    memory->P[PSI][SHOWN_PSI] = record->start_covariances[2];
    memory->P[SHOWN_PSI][PSI] = record->start_covariances[2];
    memory->pivoting = 0.0f;
    memory->missed = 0;
    memory->started = RUNNING;
}

/* Give the ball's mean turning relative to the body (3) [rad/s] since the encoders last had all counts. */
static void ball_rate_of(const struct ballbot_kalman_record *record, const struct ballbot_kalman_memory *memory,
                         int32_t wheel_count, const int32_t counts[BALLBOT_MAX_WHEELS], float ball_rate[3])
{
    const float time = record->sample_time * (float)(1 + memory->missed);
    float turns[3] = {0.0f, 0.0f, 0.0f};
    for (int32_t i = 0; i < wheel_count; ++i) {
        /* modulo 2^32, so that a counter may wrap around */
        const uint32_t forward = (uint32_t)counts[i] - (uint32_t)memory->wheel_counts[i];
        const uint32_t backward = (uint32_t)memory->wheel_counts[i] - (uint32_t)counts[i];
        const float turn = (forward < backward) ? (float)forward : -(float)backward;
        for (int32_t k = 0; k < 3; ++k) {
            turns[k] += record->ball_turn[k][i] * turn;
        }
    }
    for (int32_t k = 0; k < 3; ++k) {
        ball_rate[k] = turns[k] / time;
    }
}

/* An AHRS's reading as the filter takes it. */
struct shown {
    int32_t known;
    float lean[2]; /* x and y of g [-] */
    float psi;     /* [rad] */
};

/* Predict the state over a sample, and correct it by encoders and AHRS if they are there. */
static void sample(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                   int32_t wheel_count, const struct ballbot_reading_record *reading, const float gyro[3],
                   const struct shown *shown)
{
    float mean[3];
    float w[3];
    for (int32_t k = 0; k < 3; ++k) {
        mean[k] = 0.5f * (memory->gyro[k] + gyro[k]);
        w[k] = mean[k] - memory->x[B_X + k];
    }
    struct transition f;
    struct seen seen;
    float velocity[2];
    linearize(record, memory, w, &f);
    advance(record, memory, gyro, velocity);
    propagate(record, &f, memory->P);
    if (reading->encoders_valid != 0) {
        float ball_rate[3];
        ball_rate_of(record, memory, wheel_count, reading->wheel_counts, ball_rate);
        const float pivoting = see_wheels(record, memory, &seen, ball_rate, mean, velocity);
        memory->pivoting += record->pivoting_share * (pivoting - memory->pivoting);
    } else {
        for (int32_t k = 0; k < 3; ++k) {
            see_nothing(&seen, FROM_WHEELS + k);
        }
    }
    if (shown->known != 0) {
        const float *const x = memory->x;
        const float *const rest = memory->rest;
        const float *const variances = record->attitude_variances;
        see_state(memory, &seen, FROM_AHRS, SHOWN_X, (shown->lean[0] - x[SHOWN_X]) - rest[SHOWN_X], variances[0]);
        see_state(memory, &seen, FROM_AHRS + 1, SHOWN_Y, (shown->lean[1] - x[SHOWN_Y]) - rest[SHOWN_Y], variances[1]);
        see_state(memory, &seen, FROM_AHRS + 2, SHOWN_PSI, (shown->psi - x[SHOWN_PSI]) - rest[SHOWN_PSI],
                  variances[2]);
    } else {
        for (int32_t k = 0; k < 3; ++k) {
            see_nothing(&seen, FROM_AHRS + k);
        }
    }
    absorb(memory, &seen);
}

/* Give the state (10) that the robot is controlled by, and remember the heading's sine and cosine for the next sample. */
static void give(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory, float state[10])
{
    const float *const x = memory->x;
    float w[3];
    for (int32_t k = 0; k < 3; ++k) {
        w[k] = memory->gyro[k] - x[B_X + k];
    }
    const float g_x = x[G_X];
    const float g_y = x[G_Y];
    const float g_z = upright_part(g_x, g_y);
    const float share = 1.0f / (1.0f + g_z);
    const float v_x = x[S_X] - lever_speed(record, 0, w);
    const float v_y = x[S_Y] - lever_speed(record, 1, w);
    float s;
    float c;
    ballbot_sine_cosine(x[PSI], &s, &c);
    memory->sine = s;
    memory->cosine = c;
    /* of R = Rz(psi_s) M: its last column is (s2, -s1 c2, c1 c2), its first row (c2 c3, -c2 s3, s2) */
    const float s1_c2 = s * g_x + c * g_y;
    const float s2 = s * g_y - c * g_x;
    const float c2 = root_of((1.0f - s2) * (1.0f + s2));
    const float m_12 = -share * g_x * g_y;
    const float c2_c3 = c * (1.0f - share * g_x * g_x) - s * m_12;
    const float c2_s3 = s * (1.0f - share * g_y * g_y) - c * m_12;
    state[0] = x[X];
    state[1] = x[Y];
    state[2] = ballbot_arctangent(s1_c2, g_z);
    state[3] = ballbot_arctangent(s2, c2);
    state[4] = x[PSI] - 2.0f * ballbot_arctangent(s1_c2 * s2, (c2 + g_z) * (1.0f + c2));
    state[5] = c * v_x - s * v_y;
    state[6] = s * v_x + c * v_y;
    state[7] = (c2_c3 * w[0] - c2_s3 * w[1]) / (c2 * c2);
    state[8] = (c2_s3 * w[0] + c2_c3 * w[1]) / c2;
    state[9] = w[2] - s2 * state[7];
}

void ballbot_kalman_reset(struct ballbot_kalman_memory *memory, const float position[2])
{
    memory->started = NOT_STARTED;
    memory->x[X] = position[0];
    memory->x[Y] = position[1];
}

int32_t ballbot_kalman_update(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                              int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10])
{
    const int32_t leans = ballbot_all_known(reading->attitude, 3);
    const int32_t turned = (reading->encoders_valid != 0) ? 1 : 0;
    int32_t whole = leans & turned;
    float gyro[3];
    for (int32_t k = 0; k < 3; ++k) {
        const int32_t known = ballbot_known(reading->gyro[k]);
        gyro[k] = (known != 0) ? reading->gyro[k] : memory->gyro[k];
        whole &= known;
    }
    if ((memory->started == RUNNING) || ((memory->started == NOT_STARTED) && (whole != 0))) {
        struct shown shown = {.known = leans};
        if (leans != 0) {
            shown.psi = lean_and_heading(reading->attitude, shown.lean);
        }
        if (memory->started == RUNNING) {
            sample(record, memory, wheel_count, reading, gyro, &shown);
        } else {
            start(record, memory, gyro, shown.lean, shown.psi);
        }
        memory->missed = (turned != 0) ? 0 : (memory->missed + ((memory->missed < MOST_MISSED) ? 1 : 0));
        for (int32_t k = 0; k < 3; ++k) {
            memory->gyro[k] = gyro[k];
        }
        for (int32_t i = 0; (turned != 0) && (i < wheel_count); ++i) {
            memory->wheel_counts[i] = reading->wheel_counts[i];
        }
        see_fix(memory, reading);
    }
    if (memory->started == RUNNING) {
        give(record, memory, state);
    } else {
        for (int32_t k = 0; k < 10; ++k) {
            state[k] = ballbot_not_a_number();
        }
    }
    return whole;
}
