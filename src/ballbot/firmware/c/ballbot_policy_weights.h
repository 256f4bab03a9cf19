/* The weights of a learned policy, in single precision; without a policy there are none.
 *
 * Written by `ballbot export`; do not edit. A line is a unit of the first hidden layer, the second, or the output of a
 * wheel: its weights, then its bias.
 */
#ifndef BALLBOT_POLICY_WEIGHTS_H
#define BALLBOT_POLICY_WEIGHTS_H

/* Units of each hidden layer. */
#define BALLBOT_POLICY_HIDDEN 0
/* Wheels of the robot. */
#define BALLBOT_POLICY_WHEELS 0
/* Weights and biases. */
#define BALLBOT_POLICY_SIZE 0
/* What parameters must hold that belong to these weights. */
#define BALLBOT_POLICY_CHECKSUM 0

#endif
