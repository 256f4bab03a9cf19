/* A main loop for a board without an operating system.
 *
 * The loop waits for the time of the next sample and never skips one: a sample that comes too late stops the robot, with
 * the reason "late". If the loop hangs, the last torques stay: let the board's watchdog disable the drivers.
 *
 * The host arms over the link (`ballbot run`), and the robot obeys it in robot_step. For buttons of the robot's own call
 * robot_test, robot_arm and robot_disarm between two samples, and ballbot_link_confirm if arming from another computer
 * needs a button here.
 */
#include "ballbot_hardware.h"
#include "ballbot_parameters.h"
#include "robot.h"

/* Return a number that is another one at each start: count up a register that a reset leaves as it is (on an STM32, RTC_BKP0R), or
 * a word of EEPROM. With the same number, and a gyro that gives the same bits, what was recorded on the link before a reset would
 * be obeyed after it.
 */
uint32_t count_starts(void);

int main(void)
{
    static struct robot robot;
    const uint32_t period = (uint32_t)(1e6f * ballbot_parameters.sample_time + 0.5f);

    if (!robot_start(&robot, &ballbot_parameters, 0, count_starts())) {
        return 1;
    }
    uint32_t next = ballbot_read_time();

    for (;;) {
        while ((int32_t)(ballbot_read_time() - next) < 0) {
            /* a processor may sleep here until its timer's interrupt */
        }
        next += period;
        robot_step(&robot);
    }
}
