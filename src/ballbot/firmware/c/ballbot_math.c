/*
 * Sine, cosine, exponential, power, hyperbolic tangent and arctangent in single precision; see ballbot_math.h.
 *
 * The range is reduced to a small one (W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980; for
 * angles M. H. Payne and R. N. Hanek, Radian Reduction for Trigonometric Functions, SIGNUM Newsletter 18, 1983). There
 * a polynomial, a Chebyshev fit, errs by less than rounding (`python -m campaigns.polynomials` prints them).
 */
#include "ballbot_math.h"

#include <stdint.h>

/* A float and its bits. */
union bits {
    float value;
    uint32_t bits;
};

/* Return the bits of a float. */
static uint32_t bits_of(float value)
{
    union bits number;
    number.value = value;
    return number.bits;
}

/* Return the float that has these bits. */
static float float_of(uint32_t bits)
{
    union bits number;
    number.bits = bits;
    return number.value;
}

#define MAGNITUDE_BITS 0x7FFFFFFFu
#define INFINITY_BITS 0x7F800000u
#define MANTISSA_BITS 0x007FFFFFu
#define MANTISSA_WIDTH 23u
#define EXPONENT_OF_ONE 127u

/* ---- sine and cosine ---- */

#define HALF_PI 1.57079633f
#define HALF_PI_LOW (-4.37113883e-8f) /* pi/2 less HALF_PI */
#define QUARTER_PI 0.785398163f
#define QUARTER_PI_LOW (-2.18556941e-8f) /* pi/4 less QUARTER_PI */

/* (sin r - r)/r^3 and (cos r - 1 + r^2/2)/r^4 in r^2, for |r| < pi/4 */
static const float SINE[3] = {-0.16666664f, 0.008332746f, -0.00019587387f};
static const float COSINE[3] = {0.041666664f, -0.00138883f, 2.4547437e-05f};

/* 2/pi = 0.A2F9836E 4E441529 ... in base 2^32, after a word of zeros */
static const uint32_t TWO_OVER_PI[8] = {
    0x00000000u, 0xA2F9836Eu, 0x4E441529u, 0xFC2757D1u, 0xF534DDC0u, 0xDB629599u, 0x3C439041u, 0xFE5163ABu,
};

/* Return 32 bits of 2/pi from a bit of a word on. */
static uint32_t window(uint32_t word, uint32_t bit)
{
    const uint64_t pair = ((uint64_t)TWO_OVER_PI[word] << 32) | TWO_OVER_PI[word + 1u];
    return (uint32_t)((pair << bit) >> 32);
}

/*
 * Return r = x - k pi/2, |r| <= pi/4, for a finite x >= pi/4, and k modulo 4.
 *
 * x = m 2^(e - 23) with a whole m below 2^24. Bits of 2/pi whose product with m is a multiple of 4 quarter turns are left
 * out: the window of 96 bits starts at bit e - 25, and m times it, modulo 2^96, is x 2/pi modulo 4 in units of
 * 2^-94. What lies beyond the window is below 2^-70 quarter turns.
 */
static float reduced(float x, uint32_t *quarter)
{
    const uint32_t bits = bits_of(x);
    const uint64_t m = (bits & MANTISSA_BITS) | (MANTISSA_BITS + 1u);
    const uint32_t start = (bits >> MANTISSA_WIDTH) - EXPONENT_OF_ONE + 7u; /* e - 25 + a word of zeros */
    const uint32_t word = start >> 5;
    const uint32_t bit = start & 31u;
    const uint64_t product = ((m * window(word, bit)) << 32) + m * window(word + 1u, bit)
                             + ((m * window(word + 2u, bit)) >> 32); /* in units of 2^-62 quarter turns */
    const uint64_t k = (product + ((uint64_t)1u << 61)) >> 62;
    const uint64_t rest = product - (k << 62);
    const uint32_t negative = (uint32_t)(rest >> 63);
    const uint64_t size = (negative != 0u) ? (0u - rest) : rest;
    /* the upper 24 bits are exact as a float, so that only the product and the sum are rounded */
    const float upper = (float)(uint32_t)(size >> 38) * 0x1p-24f;
    const float lower = (float)(uint32_t)((size >> 6) & 0xFFFFFFFFu) * 0x1p-56f;
    const float r = upper * HALF_PI + (upper * HALF_PI_LOW + lower * HALF_PI);
    *quarter = (uint32_t)k;
    return (negative != 0u) ? -r : r;
}

void ballbot_sine_cosine(float angle, float *sine, float *cosine)
{
    const float size = ballbot_magnitude(angle);
    uint32_t quarter = 0u;
    float r = size;
    if (bits_of(size) >= INFINITY_BITS) {
        r = size - size; /* NaN */
    } else if (size > QUARTER_PI) {
        r = reduced(size, &quarter);
    }
    const float r2 = r * r;
    const float s = r + (r * r2) * (SINE[0] + r2 * (SINE[1] + r2 * SINE[2]));
    const float c = 1.0f - (0.5f * r2 - (r2 * r2) * (COSINE[0] + r2 * (COSINE[1] + r2 * COSINE[2])));
    const float sine_size = ((quarter & 1u) != 0u) ? c : s;
    const float cosine_size = ((quarter & 1u) != 0u) ? s : c;
    const float upright = ((quarter & 2u) != 0u) ? -sine_size : sine_size;
    *sine = (bits_of(angle) > MAGNITUDE_BITS) ? -upright : upright;
    *cosine = (((quarter + 1u) & 2u) != 0u) ? -cosine_size : cosine_size;
}

/* ---- exponential and power ---- */

#define LOG2_E 1.44269504f
#define LN2 0.693147181f
#define LN2_HIGH 0.693359375f /* 9 bits: a whole number below 2^15 times it is exact */
#define LN2_LOW (-0.00021219444f)
#define SHIFT 12582912.0f /* 1.5 * 2^23: adding it leaves the nearest whole number in the low bits */
#define LARGEST_EXPONENT 87.0f /* of e */
#define LARGEST_POWER 125.0f   /* of 2 */

/* (e^r - 1 - r)/r^2 for |r| < ln(2)/2 */
static const float EXPONENTIAL[5] = {0.5f, 0.16666573f, 0.04166655f, 0.008363774f, 0.0013926927f};
/* (log2((1 + f)/(1 - f))/f - 2/ln 2)/f^2 in f^2, for |f| < (sqrt 2 - 1)/(sqrt 2 + 1) */
static const float LOGARITHM[3] = {0.96179694f, 0.5769128f, 0.42689803f};
#define TWO_OVER_LN2 2.88539008f
#define BITS_OF_ROOT_HALF 0x3F3504F3u

/* Return x, at least -limit and at most limit; NaN stays NaN. */
static float limited(float x, float limit)
{
    const float below = (x > limit) ? limit : x;
    return (below < -limit) ? -limit : below;
}

/* Return 2^k e^r for |r| < ln(2)/2 and `shifted` = k + SHIFT, k from -126 to 127. */
static float scaled(float shifted, float r)
{
    const float r2 = r * r;
    const float high = EXPONENTIAL[2] + r * (EXPONENTIAL[3] + r * EXPONENTIAL[4]);
    const float more = r + r2 * (EXPONENTIAL[0] + r * (EXPONENTIAL[1] + r * high));
    const float scale = float_of((bits_of(shifted) + EXPONENT_OF_ONE) << MANTISSA_WIDTH);
    return scale + scale * more;
}

float ballbot_exponential(float x)
{
    const float kept = limited(x, LARGEST_EXPONENT);
    const float shifted = kept * LOG2_E + SHIFT;
    const float k = shifted - SHIFT;
    return scaled(shifted, (kept - k * LN2_HIGH) - k * LN2_LOW);
}

/* Return log2 x for a normal positive x, or NaN. */
static float binary_logarithm(float x)
{
    /* x = m 2^k, m from sqrt(1/2) to sqrt(2); x / 2^-126 is at least 1, so that nothing is negative */
    const uint32_t above = bits_of(x) - BITS_OF_ROOT_HALF + (EXPONENT_OF_ONE << MANTISSA_WIDTH);
    const uint32_t k = above >> MANTISSA_WIDTH;
    const float m = float_of(bits_of(x) - (k << MANTISSA_WIDTH) + (EXPONENT_OF_ONE << MANTISSA_WIDTH));
    const float f = (m - 1.0f) / (m + 1.0f);
    const float f2 = f * f;
    const float rest = f * (TWO_OVER_LN2 + f2 * (LOGARITHM[0] + f2 * (LOGARITHM[1] + f2 * LOGARITHM[2])));
    return (float)((int32_t)k - (int32_t)EXPONENT_OF_ONE) + rest;
}

float ballbot_power(float base, float exponent)
{
    float result;
    if ((base != base) || (exponent != exponent)) {
        result = base + exponent; /* NaN */
    } else if (exponent == 0.0f) {
        result = 1.0f;
    } else if (!(base >= 0x1p-126f)) {
        result = (exponent > 0.0f) ? 0.0f : 0x1p125f;
    } else {
        const float power = (bits_of(base) == INFINITY_BITS) ? 128.0f : binary_logarithm(base);
        const float kept = limited(exponent * power, LARGEST_POWER);
        const float shifted = kept + SHIFT;
        result = scaled(shifted, (kept - (shifted - SHIFT)) * LN2);
    }
    return result;
}

/* ---- hyperbolic tangent ---- */

#define SMALL_TANGENT 0.55f /* below it 1 - 2/(e^2x + 1) would lose bits */

/* (tanh a/a - 1)/a^2 in a^2, for |a| < SMALL_TANGENT */
static const float TANGENT[5] = {-0.3333333f, 0.13333112f, -0.053909108f, 0.021307413f, -0.0066065136f};

float ballbot_hyperbolic_tangent(float x)
{
    const float size = ballbot_magnitude(x);
    float result;
    if (size < SMALL_TANGENT) {
        const float x2 = size * size;
        const float high = TANGENT[2] + x2 * (TANGENT[3] + x2 * TANGENT[4]);
        result = size + (size * x2) * (TANGENT[0] + x2 * (TANGENT[1] + x2 * high));
    } else {
        result = 1.0f - 2.0f / (ballbot_exponential(2.0f * size) + 1.0f);
    }
    return (x < 0.0f) ? -result : result;
}

/* ---- arctangent ---- */

#define PI 3.14159265f
#define PI_LOW (-8.74227766e-8f) /* pi less PI */
#define TAN_EIGHTH_TURN 0.414213562f /* tan(pi/8) */

/* (atan(a)/a - 1)/a^2 in a^2, for |a| < tan(pi/8) */
static const float ARCTANGENT[5] = {-0.3333333f, 0.19999537f, -0.14263839f, 0.10742467f, -0.064477414f};

/* Return atan a for |a| <= tan(pi/8). */
static float arctangent_of(float a)
{
    const float a2 = a * a;
    const float high = ARCTANGENT[2] + a2 * (ARCTANGENT[3] + a2 * ARCTANGENT[4]);
    return a + (a * a2) * (ARCTANGENT[0] + a2 * (ARCTANGENT[1] + a2 * high));
}

float ballbot_arctangent(float y, float x)
{
    const float height = ballbot_magnitude(y);
    const float width = ballbot_magnitude(x);
    const int steep = height > width;
    const float large = (steep != 0) ? height : width;
    const float small = (steep != 0) ? width : height;
    float angle = 0.0f; /* from the nearer axis, then from the x axis to either side, then from its positive half */
    if (small > TAN_EIGHTH_TURN * large) {
        angle = QUARTER_PI + (QUARTER_PI_LOW + arctangent_of((small - large) / (small + large)));
    } else if ((small != 0.0f) || (large != 0.0f)) {
        angle = arctangent_of(small / large);
    }
    angle = (steep != 0) ? ((HALF_PI - angle) + HALF_PI_LOW) : angle;
    angle = (x < 0.0f) ? ((PI - angle) + PI_LOW) : angle;
    return (y < 0.0f) ? -angle : angle;
}

/* ---- angles within a turn ---- */

#define TURNS_OF_RADIAN 0.159154943f
#define TURN_HIGH 6.28125f /* 8 bits: a whole number below 2^16 times it is exact */
#define TURN_LOW 1.93530717e-3f

float ballbot_within_half_turn(float angle)
{
    const float turns = (angle * TURNS_OF_RADIAN + SHIFT) - SHIFT;
    return (angle - turns * TURN_HIGH) - turns * TURN_LOW;
}

/* ---- special values ---- */

float ballbot_not_a_number(void)
{
    return float_of(INFINITY_BITS | (INFINITY_BITS >> 1));
}
