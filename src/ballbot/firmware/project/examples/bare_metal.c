/* A main loop for a board without an operating system.
 *
 * The loop waits for the time of the next sample and never skips one: a sample that comes too late stops the robot, with
 * the reason "late". If the loop hangs, the last torques stay: let the board's watchdog disable the drivers.
 *
 * A byte 't' from the host begins the self-test, 'a' arms, any other disarms; replace this by the robot's own buttons.
 */
#include "ballbot_hardware.h"
#include "ballbot_parameters.h"
#include "robot.h"

/* Obey the last byte that came from the host. */
static void obey_host(struct robot *robot)
{
    uint8_t bytes[64];
    const size_t count = ballbot_receive(bytes, sizeof bytes);

    if (count == 0) {
        return;
    }
    const uint8_t byte = bytes[count - 1];

    if (byte == (uint8_t)'t') {
        robot_test(robot);
    } else if (byte == (uint8_t)'a') {
        (void)robot_arm(robot);
    } else {
        robot_disarm(robot);
    }
}

int main(void)
{
    static struct robot robot;
    const uint32_t period = (uint32_t)(1e6f * ballbot_parameters.sample_time + 0.5f);

    if (!robot_start(&robot)) {
        return 1;
    }
    uint32_t next = ballbot_read_time();

    for (;;) {
        while ((int32_t)(ballbot_read_time() - next) < 0) {
            /* a processor may sleep here until its timer's interrupt */
        }
        next += period;
        obey_host(&robot);
        robot_step(&robot);
    }
}
