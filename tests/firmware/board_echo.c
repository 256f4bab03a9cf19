/* A program for the emulated board: it returns each byte; its time for a byte 0xFF; and for a byte 0xFE how many of a million
 * readings of the time were before the reading before them.
 */
#include "board.h"

static void send(const uint8_t *bytes, size_t count)
{
    while (!board_uart_write(bytes, count)) {
        board_wait();
    }
}

static void send_number(uint32_t number)
{
    const uint8_t bytes[4] = { (uint8_t)number, (uint8_t)(number >> 8), (uint8_t)(number >> 16), (uint8_t)(number >> 24) };

    send(bytes, sizeof bytes);
}

static uint32_t backward_readings(void)
{
    uint32_t last = board_timer_read();
    uint32_t backward = 0u;

    for (int i = 0; i < 1000000; ++i) {
        const uint32_t now = board_timer_read();

        if (now - last >= 0x80000000u) {
            backward += 1u;
        }
        last = now;
    }
    return backward;
}

int main(void)
{
    uint8_t bytes[100];

    for (;;) {
        const size_t count = board_uart_read(bytes, sizeof bytes);

        if (count == 0u) {
            board_wait();
        }
        for (size_t i = 0; i < count; ++i) {
            if (bytes[i] == 0xFFu) {
                send_number(board_timer_read());
            } else if (bytes[i] == 0xFEu) {
                send_number(backward_readings());
            } else {
                send(&bytes[i], 1u);
            }
        }
    }
}
