/* The control law.
 *
 *     u = K S(psi) (r_s - x) + parts' torques + friction compensation,  filtered and limited
 *
 * S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame.
 */
#ifndef BALLBOT_LAW_H
#define BALLBOT_LAW_H

#include "ballbot_types.h"

/* Result of ballbot_control_law if the reference is allowed. */
#define BALLBOT_ALLOWED (-1)
/* A measured state that holds a larger number, or no number, is invalid. */
#define BALLBOT_LARGEST_STATE 1e6f

/* Fill the torques of n wheels [N m].
 *
 * `memory` is all zeros at the start of a run. `measured` and `reference` are states (10); a reference may ask for x, y
 * and psi only. Returns BALLBOT_ALLOWED, or the place in the reference that asks for a lean or a rate or holds an
 * impossible number. Then, and without a valid state, the torques are zero and the memory stays as it is.
 */
int32_t ballbot_control_law(const struct ballbot_law *law, struct ballbot_memory *memory, int32_t n,
                            const float measured[10], const float reference[10], float torques[]);

#endif
