/* A program for the emulated board: it returns each byte, and its time after a byte 0xFF. */
#include "board.h"

static void send(const uint8_t *bytes, size_t count)
{
    while (!board_uart_write(bytes, count)) {
        board_wait();
    }
}

static void send_time(void)
{
    const uint32_t time = board_timer_read();
    const uint8_t bytes[4] = { (uint8_t)time, (uint8_t)(time >> 8), (uint8_t)(time >> 16), (uint8_t)(time >> 24) };

    send(bytes, sizeof bytes);
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
                send_time();
            } else {
                send(&bytes[i], 1u);
            }
        }
    }
}
