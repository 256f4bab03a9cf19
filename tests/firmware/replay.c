/* Reads a law, then a memory, a state and a reference for each update; writes the torques and the memory after it.
 *
 * Built with the sanitizers, which a shared library inside Python cannot have.
 */
#include <stdio.h>

#include "law.h"

int main(int count, char *words[])
{
    struct ballbot_law law;
    struct ballbot_memory memory;
    float measured[10];
    float reference[10];
    float torques[BALLBOT_MAX_WHEELS];
    const int32_t n = (count > 1) ? words[1][0] - '0' : 3;

    if (fread(&law, sizeof law, 1, stdin) != 1) {
        return 1;
    }
    while (fread(&memory, sizeof memory, 1, stdin) == 1) {
        if (fread(measured, sizeof measured, 1, stdin) != 1 || fread(reference, sizeof reference, 1, stdin) != 1) {
            return 1;
        }
        (void)ballbot_control_law(&law, &memory, n, measured, reference, torques);
        if (fwrite(torques, sizeof torques[0], (size_t)n, stdout) != (size_t)n ||
            fwrite(&memory, sizeof memory, 1, stdout) != 1) {
            return 1;
        }
    }
    return 0;
}
