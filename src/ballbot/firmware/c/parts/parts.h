/* The steps of all parts, by stage of the law. `i` is a wheel, `n` the number of wheels. */
#ifndef BALLBOT_PARTS_H
#define BALLBOT_PARTS_H

#include "parts/part.h"

/* first: move to the setting that is asked for */
void ballbot_tune(const struct ballbot_law *law, struct ballbot_memory *memory);

/* observe: evaluate the sample that has passed */
void ballbot_disturbance_observer_observe(const struct ballbot_law *law, struct ballbot_memory *memory,
                                          const struct ballbot_sample *now, int32_t n);

/* decide: let a policy decide its torques, by the measured state; return whether they act */
bool ballbot_policy_decide(const struct ballbot_law *law, struct ballbot_memory *memory, const struct ballbot_sample *now);

/* predict: replace the measured state by the one that is fed back */
void ballbot_prediction_predict(const struct ballbot_law *law, struct ballbot_memory *memory,
                                struct ballbot_sample *now, int32_t n);

/* shape: replace the reference by the one that is followed; a plan, a reference with leans or rates, is followed as it is,
 * and shaping goes on from its end
 */
void ballbot_shaping_shape(const struct ballbot_law *law, struct ballbot_memory *memory,
                           struct ballbot_sample *now);
void ballbot_shaping_restart(struct ballbot_memory *memory, const struct ballbot_sample *now);
bool ballbot_follows_plan(const struct ballbot_law *law, struct ballbot_memory *memory, const float reference[10]);
void ballbot_feed_forward_plan(const struct ballbot_law *law, const struct ballbot_memory *memory,
                               struct ballbot_sample *now);

/* error: change the error */
void ballbot_feed_forward_error(const struct ballbot_law *law, struct ballbot_sample *now);
void ballbot_lean_limit_error(const struct ballbot_law *law, const struct ballbot_memory *memory,
                              struct ballbot_sample *now);

/* then, if the error is limited: leave motions the least acceleration, for the robot needs its torque to catch itself */
void ballbot_shaping_slow(const struct ballbot_law *law, struct ballbot_memory *memory);

/* torque: add the part's summand to the feedback's torques [N m] */
void ballbot_feed_forward_torque(const struct ballbot_law *law, const struct ballbot_sample *now, float torques[],
                                 int32_t n);
void ballbot_integral_torque(const struct ballbot_law *law, const struct ballbot_memory *memory,
                             const struct ballbot_sample *now, float torques[], int32_t n);

/* between torque and filter: add the compensation of friction */
void ballbot_compensate(const struct ballbot_law *law, struct ballbot_memory *memory,
                        const struct ballbot_sample *now, float torques[], int32_t n);

/* filter: return the torque [N m] that is limited and then commanded */
float ballbot_disturbance_observer_filter(struct ballbot_memory *memory, float torque, int32_t i);
float ballbot_notch_filter(const struct ballbot_law *law, struct ballbot_memory *memory, float torque, int32_t i);
float ballbot_policy_filter(const struct ballbot_law *law, const struct ballbot_memory *memory, float torque, int32_t i);

/* learn: update slow states; `limited` if a torque or the error was at its limit */
void ballbot_integral_learn(const struct ballbot_law *law, struct ballbot_memory *memory,
                            const struct ballbot_sample *now, bool limited);

/* Return whether a policy, if there is one, is for n wheels and belongs to the weights of this library. */
bool ballbot_policy_is_known(const struct ballbot_policy_record *own, int32_t n);

/* Return a number of the torque history [ago][wheel] for the torques that acted over the last sample, their mean. */
float ballbot_over_last_sample(const struct ballbot_prediction_record *own,
                               const float values[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS], int32_t wheel);

#endif
