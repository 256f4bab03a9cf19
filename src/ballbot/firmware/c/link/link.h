/* The robot's side of the link to a host: handshake, watchdog, arming in two steps, parameters.
 *
 *     ballbot_link_init(&link, &parameters, 0, starts)                              once
 *     ballbot_link_receive(&link, &state, &parameters, bytes, count, time)          what came, before each sample
 *     ballbot_link_update(&link, &state, &parameters, &reading, time, torques)      each sample, in place of ballbot_update
 *     send link.out (link.out_count bytes), then link.out_count = 0
 *
 * A frame that fails any check is counted by its layer and not acted on. If the host armed the robot or began its self-test and
 * no valid frame comes for BALLBOT_LINK_WATCHDOG, the robot stops, latched, with the reason "link".
 *
 * The application owns the link, the state and the parameters; they lie in RAM, because a host may write new parameters
 * while the robot is disarmed. Times are microseconds of a counter of 32 bits that wraps around.
 */
#ifndef BALLBOT_LINK_H
#define BALLBOT_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "ballbot.h"
#include "link/frames.h"

/* Bytes that are sent after a sample at most: a state, and answers. */
#define BALLBOT_LINK_OUT 1024

struct ballbot_link {
    struct ballbot_receiver receiver;
    int32_t capabilities;                 /* bits of ballbot_capability */
    uint32_t session;                     /* of the frames; 0 before a handshake */
    uint32_t host;                        /* the host's random number, from which the session is made */
    uint16_t last;                        /* sequence number of the host's last frame */
    uint16_t sequence;                    /* of the last frame sent */
    uint32_t heard;                       /* when a frame was last accepted */
    bool governs;                         /* whether the host armed the robot or began its self-test */
    int32_t controller;                   /* a ballbot_controller */
    bool reference_new;
    float reference[10];
    uint32_t torques_time;                /* when torques last came from the host, or the robot was armed */
    float torques[BALLBOT_MAX_WHEELS];    /* of a controller on the host [N m] */
    uint32_t mixed;                       /* from which sessions and nonces are made */
    int32_t nonce;                        /* of the first step of arming; 0 for none */
    int32_t asked_controller;             /* in the first step */
    float asked_ramp;                     /* in the first step [s] */
    float ramp;                           /* over which the torque limit rises from zero; 0 once it has [s] */
    uint32_t armed_time;                  /* when the robot was armed */
    uint32_t asked;                       /* when */
    bool confirmed;                       /* whether the robot's button was pressed since */
    int32_t state_every;                  /* samples from one state to the next */
    int32_t state_due;                    /* samples until the next */
    uint32_t sample;
    uint32_t accepted;                    /* frames */
    uint32_t refused[BALLBOT_LAYERS];     /* frames, by the layer */
    uint32_t dropped;                     /* own frames for which there was no room */
    struct ballbot_parameters written;    /* what the host writes, before it is used */
    size_t out_count;
    uint8_t out[BALLBOT_LINK_OUT];
};

/* Start without a session.
 *
 * capabilities: bits of ballbot_capability; with BALLBOT_CAPABILITY_BUTTON arming needs ballbot_link_confirm as well. Set that if
 * the host may be on another computer. starts: a number that is another one at each start, so that sessions and the numbers of arming
 * are others after a reset: a counter in a backup register, EEPROM or flash, or a random number of the chip.
 */
void ballbot_link_init(struct ballbot_link *link, const struct ballbot_parameters *parameters, int32_t capabilities,
                       uint32_t starts);

/* Mix something unpredictable into the numbers of sessions and of arming, such as noise of an ADC; robot.c mixes in that of the gyro. */
void ballbot_link_mix(struct ballbot_link *link, uint32_t value);

/* The robot's own button was pressed: a host that has asked to arm may do so. */
void ballbot_link_confirm(struct ballbot_link *link);

/* The robot's own buttons arm it or begin its self-test: a silent host no longer stops it. */
void ballbot_link_release(struct ballbot_link *link);

/* Take bytes from the host and obey the frames in them. */
void ballbot_link_receive(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters,
                          const uint8_t *bytes, size_t count, uint32_t time);

/* Take one sample, as ballbot_update, by the controller that the host has chosen; append a state to what is sent.
 *
 * Returns whether torques may be given.
 */
bool ballbot_link_update(struct ballbot_link *link, struct ballbot_state *state,
                         const struct ballbot_parameters *parameters, const struct ballbot_reading_record *reading,
                         uint32_t time, float torques[BALLBOT_MAX_WHEELS]);

#endif
