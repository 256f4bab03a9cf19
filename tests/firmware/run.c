/* Reads parameters, then for each update whether to arm, the time, a reading and a reference; writes the torques.
 *
 * Built with the sanitizers, which a shared library inside Python cannot have.
 */
#include <stdio.h>

#include "ballbot.h"

/* What comes before each update. */
struct update {
    int32_t arm;
    uint32_t time;
    struct ballbot_reading_record reading;
    float reference[10];
};

int main(void)
{
    static struct ballbot_parameters parameters;
    static struct ballbot_state state;
    struct update update;
    float torques[BALLBOT_MAX_WHEELS];

    if (fread(&parameters, sizeof parameters, 1, stdin) != 1 || !ballbot_init(&state, &parameters)) {
        return 1;
    }
    ballbot_skip_self_test(&state);
    while (fread(&update, sizeof update, 1, stdin) == 1) {
        if (update.arm != 0) {
            (void)ballbot_arm(&state);
        }
        (void)ballbot_update(&state, &parameters, &update.reading, update.time, update.reference, torques);
        if (fwrite(torques, sizeof torques, 1, stdout) != 1) {
            return 1;
        }
    }
    return 0;
}
