/* Safety: the layer between the control law and the motors.
 *
 *     sample without a valid reading        up to `max_missing` in a row are bridged; one more stops
 *     lean beyond the limit                 stops at once
 *     torque that is not a finite number    stops at once
 *     late sample                           stops, if more than `max_interval` has passed since the last
 *     stuck sensor                          stops after `max_unchanged` samples: an IMU that repeats itself, or an
 *                                           encoder that does not count while its wheel must turn
 *     silent host                           the link calls ballbot_halt after BALLBOT_LINK_WATCHDOG
 *
 * A stop is latched: nothing but ballbot_safety_reset ends it. `stop` of the state has the reason, and `stop_wheel` the
 * number of its wheel, from 1; 0 if it concerns no wheel. A state of zeros is the start.
 */
#ifndef BALLBOT_SAFETY_H
#define BALLBOT_SAFETY_H

#include <stdbool.h>

#include "ballbot_types.h"

/* Why the torques are zero. */
enum ballbot_stop {
    BALLBOT_STOP_NONE = 0,
    BALLBOT_STOP_MISSING = 1,
    BALLBOT_STOP_LEAN = 2,
    BALLBOT_STOP_TORQUE = 3,
    BALLBOT_STOP_LATE = 4,
    BALLBOT_STOP_STUCK = 5,
    BALLBOT_STOP_LINK = 6 /* the host is silent; latched from outside */
};

/* Values of the IMU that are watched: gyro and attitude. */
#define BALLBOT_IMU_VALUES 6

/* Forget a stop and the past samples. */
void ballbot_safety_reset(struct ballbot_safety_state *state);

/* Stop for a reason and a wheel from 1, 0 for none; a stop that is latched stays. */
void ballbot_safety_latch(struct ballbot_safety_state *state, enum ballbot_stop reason, int32_t wheel);

/* Take what the sensors gave in a sample, before ballbot_safety_admit; stop if one of them is stuck.
 *
 * imu (BALLBOT_IMU_VALUES); counts (n) of the encoders, valid or not; torques (n) since the last sample [N m].
 */
void ballbot_safety_watch(const struct ballbot_safety_record *own, struct ballbot_safety_state *state, int32_t n,
                          const float imu[], const int32_t counts[], bool counts_valid, const float torques[]);

/* Take a sample; return whether torques may follow from it.
 *
 * interval: since the last sample [s], 0 at the first. measured: whether the sensors gave all that the state needs. known:
 * whether there is a state, measured or predicted. theta, phi: of that state [rad].
 */
bool ballbot_safety_admit(const struct ballbot_safety_record *own, struct ballbot_safety_state *state, float interval,
                          bool measured, bool known, float theta, float phi);

/* Stop and zero the torques (n) [N m] if one of them is not a finite number. */
void ballbot_safety_release(struct ballbot_safety_state *state, int32_t n, float torques[]);

#endif
