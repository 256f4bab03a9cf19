/* Vector table and reset of the board MPS2 with the image AN386. */
#include <stdint.h>

#include "board.h"

/* Coprocessor access control of the Cortex-M4: full access to the FPU. */
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define FPU_ACCESS (0xFu << 20)
/* Application interrupt and reset control: request a reset. */
#define AIRCR (*(volatile uint32_t *)0xE000ED0Cu)
#define RESET_REQUEST (0x05FA0000u | (1u << 2))

/* Of the linker script. */
extern uint32_t stack_top[];
extern uint32_t data_start[];
extern uint32_t data_end[];
extern const uint32_t data_values[];
extern uint32_t bss_start[];
extern uint32_t bss_end[];

void reset(void);

/* A fault starts the program anew: disarmed, motors disabled. */
static void fault(void)
{
    AIRCR = RESET_REQUEST;
    for (;;) {
        /* until the reset */
    }
}

static void unused(void)
{
    /* an interrupt that nobody enables */
}

typedef void (*handler)(void);

struct vectors {
    uint32_t *stack;
    handler core[15];
    handler interrupts[16];
};

__attribute__((section(".vectors"), used)) static const struct vectors vectors = {
    stack_top,
    { reset, fault, fault, fault, fault, fault, unused, unused, unused, unused, unused, unused, unused, unused, unused },
    { board_uart_received, board_uart_sent, unused, unused, unused, unused, unused, unused, board_timer_ticked, unused,
      unused, unused, unused, unused, unused, unused },
};

void reset(void)
{
    const uint32_t *value = data_values;

    CPACR |= FPU_ACCESS;
    __asm volatile("dsb\n\tisb" ::: "memory");
    for (uint32_t *word = data_start; word < data_end; ++word) {
        *word = *value;
        ++value;
    }
    for (uint32_t *word = bss_start; word < bss_end; ++word) {
        *word = 0u;
    }
    board_timer_start();
    board_uart_start();
    __asm volatile("cpsie i" ::: "memory");
    (void)main();
    fault();
}
