/* What may be given to the control law; decide.c has the law. */
#include "law.h"

#include "ballbot_math.h"

bool ballbot_is_state(const float state[10])
{
    for (int i = 0; i < 10; ++i) {
        if (!(ballbot_magnitude(state[i]) <= BALLBOT_LARGEST_STATE)) {
            return false;
        }
    }
    return true;
}

int32_t ballbot_refused_place(const struct ballbot_law *law, const float reference[10])
{
    for (int32_t i = 0; i < 10; ++i) {
        const bool allowed = i == 0 || i == 1 || i == 4 || law->feed_forward.on != 0;

        if (!(ballbot_magnitude(reference[i]) <= (allowed ? BALLBOT_LARGEST_STATE : 0.0f))) {
            return i;
        }
    }
    return BALLBOT_ALLOWED;
}

int32_t ballbot_control_law(const struct ballbot_law *law, struct ballbot_memory *memory, const float measured[10],
                            const float reference[10], float torques[], int32_t n)
{
    const int32_t refused = ballbot_refused_place(law, reference);

    if (refused != BALLBOT_ALLOWED || !ballbot_is_state(measured)) {
        for (int32_t i = 0; i < n; ++i) {
            torques[i] = 0.0f;
        }
        return refused;
    }
    ballbot_decide(law, memory, measured, reference, torques, n);
    return BALLBOT_ALLOWED;
}
