/* Sums of many small steps in single precision: what rounding takes from one step is added with the next. */
#ifndef BALLBOT_COMPENSATED_SUM_H
#define BALLBOT_COMPENSATED_SUM_H

/* Add to a sum, and keep what rounding takes from it for the next time (Kahan, CACM 8, 1965, page 40). */
static inline void ballbot_add(float *sum, float *rest, float value)
{
    const float wanted = value + *rest;
    const float before = *sum;
    *sum = before + wanted;
    *rest = wanted - (*sum - before);
}

#endif
