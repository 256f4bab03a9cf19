/* Runs the campaign's fuzz of the link under the sanitizers: parameters on standard input, then each kind of bytes.
 *
 * Built with the sanitizers, which a shared library inside Python cannot have.
 */
#include <stdio.h>

#include "../../campaigns/link_fuzz.c"

#define KINDS 8

int main(void)
{
    static struct ballbot_parameters parameters;

    if (fread(&parameters, sizeof parameters, 1, stdin) != 1) {
        return 1;
    }
    for (int32_t kind = 0; kind < KINDS; ++kind) {
        struct outcome outcome = { .bytes = 0 };

        if (link_fuzz(kind, 1u, 200000u, &parameters, &outcome) != 0 || outcome.acted != 0u ||
            outcome.false_accepts != 0u) {
            return 2;
        }
    }
    return 0;
}
