/* ESCON 36/3 EC: the torque of a wheel as the duty of the set value's PWM.
 *
 *     current = torque / torque_per_ampere      duty = 0.5 + 0.4 current / current_range
 *
 * The driver is configured for current control, a set value by PWM, 10 % for -current_range and 90 % for +current_range.
 * It reports a fault outside 10 to 90 %, so that a broken wire does not drive a wheel.
 */
#ifndef BALLBOT_DRIVERS_ESCON_H
#define BALLBOT_DRIVERS_ESCON_H

struct ballbot_escon {
    float torque_per_ampere; /* at the wheel: torque constant, gear ratio and efficiency together [N m/A] */
    float current_range;     /* [A] */
};

/* Return the duty, 0.1 to 0.9, for a torque at the wheel [N m].
 *
 * It is 0.5, no current, if the torque is not a finite number or the driver's record is empty.
 */
float ballbot_escon_duty(const struct ballbot_escon *driver, float torque);

#endif
