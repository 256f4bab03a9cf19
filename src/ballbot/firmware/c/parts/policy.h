/* The steps of a policy, as `ballbot.control.parts.policy` has them. Written by hand: the size of its network is that of the weights. */
#ifndef BALLBOT_POLICY_H
#define BALLBOT_POLICY_H

#include "parts/part.h"

/* Return whether a policy, if there is one, is for n wheels and belongs to the weights of this library. */
bool ballbot_policy_is_known(const struct ballbot_policy_record *own, int32_t n);

/* Let a policy decide where it is due, for the robot's pose and the one that is asked for. */
void ballbot_act(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a,
                 const struct ballbot_robot_state *seen, struct ballbot_pose pose, struct ballbot_pose wanted);

/* Return whether a policy acts: the state is like those at which it was trained. */
bool ballbot_within_policy(const struct ballbot_law *law, const struct ballbot_robot_state *seen);

/* Return a wheel's torque of the linear law with that of a policy that acts. */
float ballbot_with_policy(const struct ballbot_law *law, const struct ballbot_memory *memory, float torque, int32_t i);

#endif
