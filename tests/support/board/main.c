/* Main loop of the emulated board: one sample of the sensors comes over the serial line, one step of the robot follows.
 *
 * The robot's clock is the time in the samples. The board's timer wakes the loop, and disarms the robot if no sample comes
 * for BALLBOT_SILENCE [us]: a board without sensors must not drive its motors.
 */
#include "ballbot_parameters.h"
#include "board.h"
#include "emulated_robot.h"

static struct emulated_robot emulated;

/* Send what waits; what finds no room is lost, as on any serial line. */
static void send_waiting(void)
{
    uint8_t bytes[64];
    size_t count = emulated_robot_take(&emulated, bytes, sizeof bytes);

    while (count > 0u) {
        (void)board_uart_write(bytes, count);
        count = emulated_robot_take(&emulated, bytes, sizeof bytes);
    }
}

int main(void)
{
    uint8_t bytes[64];

    if (!emulated_robot_start(&emulated, &ballbot_parameters, BALLBOT_CAPABILITY_EMULATED, 0u)) {
        return 1;
    }
#ifdef BALLBOT_WIRING_IS_KNOWN
    ballbot_skip_self_test(&emulated.robot.state);
#endif
    uint32_t last = board_timer_read();

    for (;;) {
        const uint16_t samples = emulated.hardware.sequence;
        const size_t count = board_uart_read(bytes, sizeof bytes);

        if (count == 0u) {
            board_wait();
        }
        if (board_timer_read() - last > BALLBOT_SILENCE) { /* before a sample that comes now is obeyed */
            robot_disarm(&emulated.robot);
            last = board_timer_read();
        }
        emulated_robot_put(&emulated, bytes, count);
        send_waiting();
        if (emulated.hardware.sequence != samples) {
            last = board_timer_read();
        }
    }
}
