/* CRC-32 as of Ethernet and zlib (ISO-HDLC): polynomial 0x04C11DB7 reflected, start and end inverted. */
#ifndef BALLBOT_CRC32_H
#define BALLBOT_CRC32_H

#include <stddef.h>
#include <stdint.h>

/* Return the CRC-32 of some bytes. */
uint32_t ballbot_crc32(const uint8_t *bytes, size_t count);

#endif
