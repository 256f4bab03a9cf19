/* Ballbot's firmware: estimator, control law and safety layer of a ball-balancing robot.
 *
 *     static struct ballbot_state state;
 *
 *     if (ballbot_init(&state, &ballbot_parameters)) { ... }       once
 *     ballbot_start_self_test(&state);                             held, before the first balance
 *     ballbot_arm(&state);                                         when that has passed, upright
 *     ballbot_update(&state, &ballbot_parameters, &reading, time, reference, torques);      each sample time
 *
 * The application owns the state; the library has no variables of its own, allocates no memory and calls no function of
 * the application. Call all functions of one state from one task or one interrupt: they lock nothing. Times are
 * microseconds of a counter of 32 bits that wraps around. The Python package has the same names and units.
 */
#ifndef BALLBOT_H
#define BALLBOT_H

#include <stdbool.h>

#include "ballbot_types.h"
#include "safety.h"
#include "self_test.h"

/* Numbers of `estimator` in the parameters. */
enum ballbot_estimator { BALLBOT_ONBOARD = 0, BALLBOT_KALMAN = 1 };

/* Return why parameters are refused (enum ballbot_refusal): another schema than this library's, a bound, or a policy whose
 * weights are not the library's; 0 if they are not.
 */
int32_t ballbot_refused(const struct ballbot_parameters *parameters);

/* Return whether the parameters are not refused. */
bool ballbot_are_allowed(const struct ballbot_parameters *parameters);

/* Start disarmed, at x = y = 0, and return ballbot_are_allowed of the parameters.
 *
 * If not, every update gives zero torques.
 */
bool ballbot_init(struct ballbot_state *state, const struct ballbot_parameters *parameters);

/* Let the next updates, disarmed, be the self-test; its result is in ballbot_self_test_of.
 *
 * The first test since the start is the check of the IMU's axes, for which the robot is moved by hand (imu_check.h). When that has
 * passed, call this again: motors and encoders are tested. New parameters keep the IMU's check.
 */
void ballbot_start_self_test(struct ballbot_state *state);

/* Return the result of the self-test; `self_test.wheel` of the state has the wheel, from 1. */
enum ballbot_self_test ballbot_self_test_of(const struct ballbot_state *state);

/* Count the self-test as passed: for a simulated robot, or one whose wiring is known to be right. */
void ballbot_skip_self_test(struct ballbot_state *state);

/* Count the IMU's axes as checked: for an emulated robot, or one on which nothing was changed since the last check. */
void ballbot_skip_imu_check(struct ballbot_state *state);

/* Forget a stop and what the law remembers, and give torques from the next update on; the estimate goes on.
 *
 * Returns false, and stays disarmed, unless the self-test has passed.
 */
bool ballbot_arm(struct ballbot_state *state);

/* Give no torques until armed again; end a self-test that is running. */
void ballbot_disarm(struct ballbot_state *state);

/* Return whether torques may come: armed without a stop, or a self-test runs. */
bool ballbot_is_active(const struct ballbot_state *state);

/* Stop for a reason outside the library if the robot is active. The stop is latched as any other. */
void ballbot_halt(struct ballbot_state *state, enum ballbot_stop reason);

/* Take one sample; fill the torques of all wheels [N m].
 *
 * reading: of the sensors; NaN for a value that is missing. time: of the sample [us]. reference: the state (10) to go to, of
 * which x, y and psi may differ from zero, or a row of a plan (`ballbot plan`) if the law has feed-forward. A reference that is
 * refused is ignored, and so is NULL; the last one then holds.
 * Returns whether torques may be given: armed, not stopped, and with a state to give them for.
 */
bool ballbot_update(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                    const struct ballbot_reading_record *reading, uint32_t time, const float reference[10],
                    float torques[BALLBOT_MAX_WHEELS]);

/* Take one sample as ballbot_update does, with the torques of another controller in place of the law's. They are limited, and
 * the safety layer checks the same.
 */
bool ballbot_relay(struct ballbot_state *state, const struct ballbot_parameters *parameters,
                   const struct ballbot_reading_record *reading, uint32_t time, const float given[BALLBOT_MAX_WHEELS],
                   float torques[BALLBOT_MAX_WHEELS]);

/* Return why the robot was stopped; BALLBOT_STOP_NONE if it was not. */
enum ballbot_stop ballbot_stop_of(const struct ballbot_state *state);

/* Return a word for a reason, as Python has it: "missing", "lean", "torque", "late", "stuck", "link"; "" for none. */
const char *ballbot_stop_word(enum ballbot_stop stop);

#endif
