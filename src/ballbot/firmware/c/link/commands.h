/* What the commands of a host do, after every check; used by link.c. */
#ifndef BALLBOT_COMMANDS_H
#define BALLBOT_COMMANDS_H

#include "link/link.h"

/* Return a number that is not 0 and hard to foresee. */
uint32_t ballbot_link_new_number(struct ballbot_link *link, uint32_t time);

/* Append a frame to what is sent; without room it is dropped and counted. */
void ballbot_link_send(struct ballbot_link *link, enum ballbot_message type, uint32_t session, const void *body,
                       size_t length);

/* Append an answer to a frame. */
void ballbot_link_answer(struct ballbot_link *link, const struct ballbot_frame *frame, enum ballbot_result result,
                         uint32_t value);

/* Obey a frame that every layer has let pass. */
void ballbot_link_obey(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                       const struct ballbot_frame *frame, uint32_t time);

#endif
