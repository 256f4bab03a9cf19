/* Included before all else: the law in double precision, with records of 8 bytes a number. */
#include <stdbool.h>
#include <stdint.h>
#define float double
#define int32_t int64_t
