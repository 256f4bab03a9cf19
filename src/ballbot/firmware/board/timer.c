/* Time: the first timer of the CMSDK peripherals, which interrupts each millisecond; and the interrupt controller. */
#include "board.h"

#define CONTROL (*(volatile uint32_t *)0x40000000u)
#define VALUE (*(volatile uint32_t *)0x40000004u)
#define RELOAD (*(volatile uint32_t *)0x40000008u)
#define INTERRUPTS (*(volatile uint32_t *)0x4000000Cu)

#define RUNS 1u
#define INTERRUPTS_ON 8u
#define TICKED 1u
#define TIMER_INTERRUPT 8u
/* Of the timer's clock, 25 MHz. */
#define COUNTS_PER_MICROSECOND 25u
#define MICROSECONDS_PER_TICK 1000u

/* Interrupt controller of the Cortex-M4. */
#define ENABLE (*(volatile uint32_t *)0xE000E100u)

static volatile uint32_t ticks;

void board_enable_interrupt(uint32_t number)
{
    ENABLE = 1u << number;
}

void board_timer_start(void)
{
    RELOAD = MICROSECONDS_PER_TICK * COUNTS_PER_MICROSECOND - 1u;
    VALUE = MICROSECONDS_PER_TICK * COUNTS_PER_MICROSECOND - 1u;
    CONTROL = RUNS | INTERRUPTS_ON;
    board_enable_interrupt(TIMER_INTERRUPT);
}

void board_timer_ticked(void)
{
    INTERRUPTS = TICKED;
    ticks += 1u;
}

uint32_t board_timer_read(void)
{
    uint32_t before;
    uint32_t counts;

    do { /* again if the timer ticked meanwhile */
        before = ticks;
        counts = VALUE;
    } while (before != ticks);
    return before * MICROSECONDS_PER_TICK + (MICROSECONDS_PER_TICK - 1u) - counts / COUNTS_PER_MICROSECOND;
}

void board_wait(void)
{
    __asm volatile("cpsid i" ::: "memory");
    if (!board_uart_has_bytes()) {
        __asm volatile("wfi" ::: "memory"); /* an interrupt ends it, and is served below */
    }
    __asm volatile("cpsie i" ::: "memory");
}
