/* A task of an operating system. The functions of the first block are the system's; those of FreeRTOS are beside them.
 *
 * Give the task the highest priority but the drivers', and the stack that `ballbot export` reports with 512 bytes for the
 * application. `self_test`, `arm` and `disarm` may be called from other tasks: they leave a wish, which the task obeys.
 */
#include "ballbot_hardware.h"
#include "ballbot_parameters.h"
#include "robot.h"

/* Wait until `period` [us] after the time `last`, and set that (vTaskDelayUntil). */
void rtos_wait_until(uint32_t *last, uint32_t period);

void balance_task(void *unused);
void self_test(void);
void arm(void);
void disarm(void);

/* What other tasks wish; a byte is written at once. */
enum wish { NO_WISH = 0, WISH_ARM = 1, WISH_DISARM = 2, WISH_TEST = 3 };
static volatile uint8_t wish = NO_WISH;

void self_test(void)
{
    wish = WISH_TEST;
}

void arm(void)
{
    wish = WISH_ARM;
}

void disarm(void)
{
    wish = WISH_DISARM;
}

static void obey(struct robot *robot)
{
    const uint8_t wished = wish;

    wish = NO_WISH;
    if (wished == (uint8_t)WISH_TEST) {
        robot_test(robot);
    }
    if (wished == (uint8_t)WISH_ARM) {
        (void)robot_arm(robot);
    }
    if (wished == (uint8_t)WISH_DISARM) {
        robot_disarm(robot);
    }
}

void balance_task(void *unused)
{
    static struct robot robot;
    const uint32_t period = (uint32_t)(1e6f * ballbot_parameters.sample_time + 0.5f);
    uint32_t last = ballbot_read_time();

    (void)unused;
    const bool started = robot_start(&robot);

    for (;;) {
        rtos_wait_until(&last, period);
        if (started) {
            obey(&robot);
            robot_step(&robot);
        }
    }
}
