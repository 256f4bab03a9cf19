/* Time: two timers of the CMSDK peripherals, and the interrupt controller.
 *
 * The first interrupts each millisecond and wakes the processor. The second counts on without interrupts and gives the time:
 * an interrupt that is served late cannot set that back.
 */
#include "board.h"

#define TICK_CONTROL (*(volatile uint32_t *)0x40000000u)
#define TICK_VALUE (*(volatile uint32_t *)0x40000004u)
#define TICK_RELOAD (*(volatile uint32_t *)0x40000008u)
#define TICK_INTERRUPTS (*(volatile uint32_t *)0x4000000Cu)
#define CLOCK_CONTROL (*(volatile uint32_t *)0x40001000u)
#define CLOCK_VALUE (*(volatile uint32_t *)0x40001004u)
#define CLOCK_RELOAD (*(volatile uint32_t *)0x40001008u)

#define RUNS 1u
#define INTERRUPTS_ON 8u
#define TICKED 1u
#define TICK_INTERRUPT 8u
/* Of the timers' clock, 25 MHz. */
#define COUNTS_PER_MICROSECOND 25u
#define COUNTS_PER_TICK 25000u
#define LONGEST 0xFFFFFFFFu

/* Interrupt controller of the Cortex-M4. */
#define ENABLE (*(volatile uint32_t *)0xE000E100u)

/* The second timer's count at the last reading, the time then [us], and counts since then that were no microsecond. */
static uint32_t last_count = LONGEST;
static uint32_t time;
static uint32_t rest;

void board_enable_interrupt(uint32_t number)
{
    ENABLE = 1u << number;
}

void board_timer_start(void)
{
    CLOCK_RELOAD = LONGEST;
    CLOCK_VALUE = LONGEST;
    CLOCK_CONTROL = RUNS;
    TICK_RELOAD = COUNTS_PER_TICK - 1u;
    TICK_VALUE = COUNTS_PER_TICK - 1u;
    TICK_CONTROL = RUNS | INTERRUPTS_ON;
    board_enable_interrupt(TICK_INTERRUPT);
}

void board_timer_ticked(void)
{
    TICK_INTERRUPTS = TICKED;
}

uint32_t board_timer_read(void)
{
    const uint32_t count = CLOCK_VALUE; /* it counts down, and wraps around */
    const uint32_t passed = (last_count - count) + rest;

    last_count = count;
    time += passed / COUNTS_PER_MICROSECOND;
    rest = passed % COUNTS_PER_MICROSECOND;
    return time;
}

void board_wait(void)
{
    __asm volatile("cpsid i" ::: "memory");
    if (!board_uart_has_bytes()) {
        __asm volatile("wfi" ::: "memory"); /* an interrupt ends it, and is served below */
    }
    __asm volatile("cpsie i" ::: "memory");
}
