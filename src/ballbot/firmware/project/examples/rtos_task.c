/* A task of an operating system. The functions of the first block are the system's; those of FreeRTOS are beside them.
 *
 * Give the task the highest priority below the drivers', and the stack that `ballbot export` reports with 512 bytes for the
 * application. `self_test`, `arm` and `disarm` may be called from other tasks and from interrupts: they leave a request, which
 * the task obeys before its next sample. If the task hangs, the last torques stay: let the board's watchdog disable the
 * drivers.
 */
#include "ballbot_hardware.h"
#include "ballbot_parameters.h"
#include "robot.h"

/* Wait until `period` [us] after the time `last`, and set that (vTaskDelayUntil). */
void rtos_wait_until(uint32_t *last, uint32_t period);

/* Return a number that is another one at each start: count up a register that a reset leaves as it is (on an STM32, RTC_BKP0R), or
 * a word of EEPROM. With the same number, and a gyro that gives the same bits, what was recorded on the link before a reset would
 * be obeyed after it.
 */
uint32_t count_starts(void);

void balance_task(void *unused);
void self_test(void);
void arm(void);
void disarm(void);

/* Requests, one byte each, so that none overwrites another. The task clears one before it obeys: if the same request comes
 * in between, it is being obeyed.
 */
static volatile bool test_requested = false;
static volatile bool arm_requested = false;
static volatile bool disarm_requested = false;

void self_test(void)
{
    test_requested = true;
}

void arm(void)
{
    arm_requested = true;
}

void disarm(void)
{
    disarm_requested = true;
}

/* Obey the requests; disarming comes last, so that it wins over the others. */
static void obey(struct robot *robot)
{
    if (test_requested) {
        test_requested = false;
        robot_test(robot);
    }
    if (arm_requested) {
        arm_requested = false;
        (void)robot_arm(robot);
    }
    if (disarm_requested) {
        disarm_requested = false;
        robot_disarm(robot);
    }
}

void balance_task(void *unused)
{
    static struct robot robot;
    const uint32_t period = (uint32_t)(1e6f * ballbot_parameters.sample_time + 0.5f);
    uint32_t last = ballbot_read_time();

    (void)unused;
    const bool started = robot_start(&robot, &ballbot_parameters, 0, count_starts());

    for (;;) {
        rtos_wait_until(&last, period);
        if (started) {
            obey(&robot);
            robot_step(&robot);
        }
    }
}
