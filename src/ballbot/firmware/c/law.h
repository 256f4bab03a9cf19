/* The control law.
 *
 *     u = K S(psi) (r_s - x) + parts' torques + friction compensation,  filtered and limited
 *
 * S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame.
 */
#ifndef BALLBOT_LAW_H
#define BALLBOT_LAW_H

#include <stdbool.h>

#include "ballbot_types.h"

/* Result of ballbot_control_law if the reference is allowed. */
#define BALLBOT_ALLOWED (-1)
/* A measured state that holds a larger number, or no number, is invalid. */
#define BALLBOT_LARGEST_STATE 1e6f

/* Return whether every number of a state (10) is possible for a robot; a NaN is not. */
bool ballbot_is_state(const float state[10]);

/* Return the first place of a reference (10) that is refused, else BALLBOT_ALLOWED: something impossible, or without
 * feed-forward a lean or a rate, for which A r is not 0.
 */
int32_t ballbot_refused_place(const struct ballbot_law *law, const float reference[10]);

/* Fill the torques of n wheels [N m].
 *
 * `memory` is all zeros at the start of a run. `measured` and `reference` are states (10); without feed-forward a reference
 * may ask for x, y and psi only. Returns ballbot_refused_place of the reference. If that is refused, and without a valid
 * state, the torques are zero and the memory stays as it is.
 */
int32_t ballbot_control_law(const struct ballbot_law *law, struct ballbot_memory *memory, const float measured[10],
                            const float reference[10], float torques[], int32_t n);

/* Fill the torques of n wheels for a state and a reference that are valid (decide.c). */
void ballbot_decide(const struct ballbot_law *law, struct ballbot_memory *memory, const float measured[10],
                    const float reference[10], float torques[], int32_t n);

#endif
