/* What compilers call to copy and to clear records; on a robot the toolchain's own library has it. */
#include <stddef.h>
#include <stdint.h>

void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);
void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t size);
void __aeabi_memcpy4(void *restrict to, const void *restrict from, size_t size);
void __aeabi_memclr(void *to, size_t size);
void __aeabi_memclr4(void *to, size_t size);

void *memcpy(void *restrict to, const void *restrict from, size_t size)
{
    unsigned char *target = to;
    const unsigned char *source = from;
    for (size_t i = 0; i < size; ++i) {
        target[i] = source[i];
    }
    return to;
}

void *memset(void *to, int value, size_t size)
{
    unsigned char *target = to;
    for (size_t i = 0; i < size; ++i) {
        target[i] = (unsigned char)value;
    }
    return to;
}

/* words, as records are */
void __aeabi_memcpy4(void *restrict to, const void *restrict from, size_t size)
{
    uint32_t *target = to;
    const uint32_t *source = from;
    for (size_t i = 0; i < size / 4u; ++i) {
        target[i] = source[i];
    }
}

void __aeabi_memclr4(void *to, size_t size)
{
    uint32_t *target = to;
    for (size_t i = 0; i < size / 4u; ++i) {
        target[i] = 0u;
    }
}

void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t size)
{
    (void)memcpy(to, from, size);
}

void __aeabi_memclr(void *to, size_t size)
{
    (void)memset(to, 0, size);
}
