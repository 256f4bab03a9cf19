/* Serial line: the first UART of the CMSDK peripherals, with a ring of bytes each way.
 *
 * Each ring has one writer and one reader, the main loop and an interrupt; each moves an index of its own.
 */
#include "board.h"

#define DATA (*(volatile uint32_t *)0x40004000u)
#define STATE (*(volatile uint32_t *)0x40004004u)
#define CONTROL (*(volatile uint32_t *)0x40004008u)
#define INTERRUPTS (*(volatile uint32_t *)0x4000400Cu)
#define DIVISOR (*(volatile uint32_t *)0x40004010u)

#define SENDS 1u
#define RECEIVES 2u
/* of STATE */
#define SEND_FULL 1u
#define RECEIVE_FULL 2u
/* of CONTROL: both directions, and their interrupts */
#define ALL_ON 0xFu
/* 921 600 baud from 25 MHz */
#define DIVIDE_BY 27u
#define RECEIVED_INTERRUPT 0u
#define SENT_INTERRUPT 1u

/* A power of two. */
#define ROOM 4096u

struct ring {
    uint8_t bytes[ROOM];
    volatile uint32_t written;
    volatile uint32_t taken;
};

static struct ring in;
static struct ring out;
static volatile uint32_t lost;
static volatile int sending;

void board_uart_start(void)
{
    DIVISOR = DIVIDE_BY;
    CONTROL = ALL_ON;
    board_enable_interrupt(RECEIVED_INTERRUPT);
    board_enable_interrupt(SENT_INTERRUPT);
}

void board_uart_received(void)
{
    INTERRUPTS = RECEIVES;
    while ((STATE & RECEIVE_FULL) != 0u) {
        const uint8_t byte = (uint8_t)DATA;

        if (in.written - in.taken < ROOM) {
            in.bytes[in.written % ROOM] = byte;
            in.written += 1u;
        } else {
            lost += 1u;
        }
    }
}

void board_uart_sent(void)
{
    INTERRUPTS = SENDS;
    if ((STATE & SEND_FULL) != 0u) {
        return;
    }
    if (out.taken == out.written) {
        sending = 0;
        return;
    }
    const uint8_t byte = out.bytes[out.taken % ROOM];

    out.taken += 1u;
    sending = 1;
    DATA = byte;
}

size_t board_uart_read(uint8_t *bytes, size_t most)
{
    size_t count = 0;

    while (count < most && in.taken != in.written) {
        bytes[count] = in.bytes[in.taken % ROOM];
        in.taken += 1u;
        count += 1u;
    }
    return count;
}

int board_uart_has_bytes(void)
{
    return in.taken != in.written;
}

int board_uart_write(const uint8_t *bytes, size_t count)
{
    if (count > ROOM - (out.written - out.taken)) {
        return 0;
    }
    for (size_t i = 0; i < count; ++i) {
        out.bytes[(out.written + (uint32_t)i) % ROOM] = bytes[i];
    }
    out.written += (uint32_t)count;
    __asm volatile("cpsid i" ::: "memory");
    if (!sending) {
        board_uart_sent();
    }
    __asm volatile("cpsie i" ::: "memory");
    return 1;
}

uint32_t board_uart_lost(void)
{
    return lost;
}
