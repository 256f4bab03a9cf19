#include "link/cobs.h"

/* Bytes of the longest block, after which no zero follows. */
#define LONGEST 254u

size_t ballbot_cobs_encode(const uint8_t *bytes, size_t count, uint8_t *coded)
{
    size_t head = 0; /* of the block, where its length goes */
    size_t end = 1;
    bool open = true; /* whether a block has begun that must be written */

    for (size_t k = 0; k < count; ++k) {
        if (bytes[k] != 0u) {
            coded[end] = bytes[k];
            end += 1u;
            open = true;
        }
        if (bytes[k] == 0u || end - head == LONGEST + 1u) {
            coded[head] = (uint8_t)(end - head);
            head = end;
            end += 1u;
            open = bytes[k] == 0u;
        }
    }
    if (!open) {
        return head;
    }
    coded[head] = (uint8_t)(end - head);
    return end;
}

bool ballbot_cobs_decode(uint8_t *bytes, size_t *count)
{
    size_t from = 0;
    size_t to = 0;

    while (from < *count) {
        const size_t block = bytes[from];

        if (block == 0u || block > *count - from) {
            return false;
        }
        for (size_t k = 1; k < block; ++k) {
            if (bytes[from + k] == 0u) {
                return false;
            }
            bytes[to] = bytes[from + k];
            to += 1u;
        }
        from += block;
        if (block <= LONGEST && from < *count) {
            bytes[to] = 0u;
            to += 1u;
        }
    }
    *count = to;
    return true;
}
