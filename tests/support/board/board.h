/* The board MPS2 with the image AN386 (Cortex-M4F, 25 MHz): serial line and timer, both with interrupts. */
#ifndef BOARD_H
#define BOARD_H

#include <stddef.h>
#include <stdint.h>

/* Enable an interrupt of the board; 0 to 31. */
void board_enable_interrupt(uint32_t number);

/* Sleep until the next interrupt, unless there is something to read. */
void board_wait(void);

/* Let the serial line receive and send. */
void board_uart_start(void);

/* Fill at most `most` bytes that have come; return how many. */
size_t board_uart_read(uint8_t *bytes, size_t most);

/* Return whether bytes have come that were not read. */
int board_uart_has_bytes(void);

/* Send bytes, all or none; return whether there was room. */
int board_uart_write(const uint8_t *bytes, size_t count);

/* Bytes that came when there was no room. */
uint32_t board_uart_lost(void);

/* Let the timer run from zero. */
void board_timer_start(void);

/* Return the time since the start [us], modulo 2^32. Only for the main loop, which reads it every two minutes at least. */
uint32_t board_timer_read(void);

/* Interrupts. */
void board_uart_received(void);
void board_uart_sent(void);
void board_timer_ticked(void);

int main(void);

#endif
