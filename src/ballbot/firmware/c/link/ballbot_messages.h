/* What robot and host send each other.
 *
 * Generated from the messages of the Python package by `python -m tests.support.link_header`; do not edit.
 * A body has the bytes of its struct on a little-endian processor. A message without a struct has no body.
 * Units are SI and stand behind each member; [1] is a number without a unit.
 */
#ifndef BALLBOT_MESSAGES_H
#define BALLBOT_MESSAGES_H

#include "ballbot_types.h"

/* Version of the protocol, in every frame. */
#define BALLBOT_LINK_VERSION 1u
/* SHA-256 of types, names, order, lengths and units of all messages, as numbers of 31 bits. */
#define BALLBOT_MESSAGE_WORDS { 580939643, 1049930199, 595704149, 1334773361, 458370793, 1678788134, 895614518, 759129543 }
/* a2a06f7bbe94a9d72381b955cf8f06719b522ee964104626b561fe36ad3f65c7 */

/* Longest time without a valid frame [us]. */
#define BALLBOT_LINK_WATCHDOG 50000u
/* How long the number of the first step of arming is valid [us]. */
#define BALLBOT_LINK_CONFIRMATION 10000000u
/* Longest time between two states that a host can ask for [s]. */
#define BALLBOT_LINK_STATE_INTERVAL 0.02f
/* Longest ramp of the torque limit after arming [s]. */
#define BALLBOT_LINK_LONGEST_RAMP 60.0f
/* By how much the sum of a setting's weights may be off. */
#define BALLBOT_LINK_ROUNDING 1e-05f
/* Bytes of a payload without a body, of the longest payload, and of its frame without the zero. */
#define BALLBOT_FRAME_OVERHEAD 12u
#define BALLBOT_LONGEST_PAYLOAD 208u
#define BALLBOT_LONGEST_FRAME 209u
/* How many sequence numbers after the last are newer than it. */
#define BALLBOT_SEQUENCE_WINDOW 32767u
/* Words that one message of parameters carries. */
#define BALLBOT_PARAMETER_WORDS 32
/* Bytes of the body of each type that a host sends, from type 0 on; -1 is none. */
#define BALLBOT_BODY_LENGTHS { -1, 68, 0, 0, 12, 0, 40, 16, 8, 136, 4, 0, 16, 0 }
/* Checks of a frame that count what they refuse. */
#define BALLBOT_LAYERS 9

/* Types of messages. */
enum ballbot_message {
    BALLBOT_MESSAGE_HELLO = 1,
    BALLBOT_MESSAGE_KEEP = 2,
    BALLBOT_MESSAGE_SELF_TEST = 3,
    BALLBOT_MESSAGE_ARM = 4,
    BALLBOT_MESSAGE_DISARM = 5,
    BALLBOT_MESSAGE_REFERENCE = 6,
    BALLBOT_MESSAGE_TORQUES = 7,
    BALLBOT_MESSAGE_READ = 8,
    BALLBOT_MESSAGE_WRITE = 9,
    BALLBOT_MESSAGE_COMMIT = 10,
    BALLBOT_MESSAGE_ASK_COUNTS = 11,
    BALLBOT_MESSAGE_TUNE = 12,
    BALLBOT_MESSAGE_STEP_BACK = 13,
    BALLBOT_MESSAGE_WELCOME = 64,
    BALLBOT_MESSAGE_STATE = 65,
    BALLBOT_MESSAGE_ANSWER = 66,
    BALLBOT_MESSAGE_PARAMETERS = 67,
    BALLBOT_MESSAGE_COUNTS = 68
};

/* Checks that a frame must pass, in order. */
enum ballbot_layer {
    BALLBOT_LAYER_FRAMING = 0,
    BALLBOT_LAYER_LENGTH = 1,
    BALLBOT_LAYER_CHECKSUM = 2,
    BALLBOT_LAYER_VERSION = 3,
    BALLBOT_LAYER_TYPE = 4,
    BALLBOT_LAYER_BODY = 5,
    BALLBOT_LAYER_SESSION = 6,
    BALLBOT_LAYER_SEQUENCE = 7,
    BALLBOT_LAYER_VALUES = 8
};

/* Answers to a command. */
enum ballbot_result {
    BALLBOT_RESULT_OK = 0,
    BALLBOT_RESULT_CONFIRM = 1,
    BALLBOT_RESULT_SELF_TEST = 2,
    BALLBOT_RESULT_ACTIVE = 3,
    BALLBOT_RESULT_NONCE = 4,
    BALLBOT_RESULT_BUTTON = 5,
    BALLBOT_RESULT_RANGE = 6,
    BALLBOT_RESULT_CHECKSUM = 7,
    BALLBOT_RESULT_PARAMETERS = 8,
    BALLBOT_RESULT_VALUES = 9,
    BALLBOT_RESULT_DISARMED = 10,
    BALLBOT_RESULT_GAINS = 11,
    BALLBOT_RESULT_COMPENSATION = 12
};

/* Which controller an armed robot obeys: its own or the host's. */
enum ballbot_controller {
    BALLBOT_CONTROLLER_ROBOT = 0,
    BALLBOT_CONTROLLER_HOST = 1
};

/* Bits of a robot's capabilities. */
enum ballbot_capability {
    BALLBOT_CAPABILITY_EMULATED = 1,
    BALLBOT_CAPABILITY_BUTTON = 2
};

/* Open a session. The frame's session is a random number of the host; the robot's answer has the session. */
struct ballbot_message_hello {
    int32_t firmware[8];
    int32_t messages[8];
    int32_t state_every;
};
typedef char ballbot_message_hello_has_no_padding[(sizeof(struct ballbot_message_hello) == 17u * sizeof(float)) ? 1 : -1];

/* Arm in two steps: ask with the number 0, then return the number that the robot answered. */
struct ballbot_message_arm {
    int32_t nonce;
    int32_t controller;
    float ramp; /* [s] */
};
typedef char ballbot_message_arm_has_no_padding[(sizeof(struct ballbot_message_arm) == 3u * sizeof(float)) ? 1 : -1];

/* Give the controller on the robot a reference; it holds until the next one. */
struct ballbot_message_reference {
    float reference[10]; /* [state] */
};
typedef char ballbot_message_reference_has_no_padding[(sizeof(struct ballbot_message_reference) == 10u * sizeof(float)) ? 1 : -1];

/* Give the torques of a controller on the host; they pass the robot's safety layer. */
struct ballbot_message_torques {
    float torques[BALLBOT_MAX_WHEELS]; /* [N m] */
};
typedef char ballbot_message_torques_has_no_padding[(sizeof(struct ballbot_message_torques) == 4u * sizeof(float)) ? 1 : -1];

/* Ask for a part of the parameters. */
struct ballbot_message_read {
    int32_t offset;
    int32_t count;
};
typedef char ballbot_message_read_has_no_padding[(sizeof(struct ballbot_message_read) == 2u * sizeof(float)) ? 1 : -1];

/* Write a part of the parameters into a copy that is not in use; only while disarmed. */
struct ballbot_message_write {
    int32_t offset;
    int32_t count;
    int32_t words[BALLBOT_PARAMETER_WORDS];
};
typedef char ballbot_message_write_has_no_padding[(sizeof(struct ballbot_message_write) == 34u * sizeof(float)) ? 1 : -1];

/* Use the parameters that were written, if their CRC-32 is this one and they are allowed. */
struct ballbot_message_commit {
    int32_t crc;
};
typedef char ballbot_message_commit_has_no_padding[(sizeof(struct ballbot_message_commit) == 1u * sizeof(float)) ? 1 : -1];

/* Change the controller on the robot while it balances; it moves there at a limited rate. */
struct ballbot_message_tune {
    float weights[BALLBOT_MAX_GAINS]; /* [1] */
    float compensation; /* [1] */
};
typedef char ballbot_message_tune_has_no_padding[(sizeof(struct ballbot_message_tune) == 4u * sizeof(float)) ? 1 : -1];

/* Answer a `Hello`; the frame repeats its random number. */
struct ballbot_message_welcome {
    int32_t session;
    int32_t firmware[8];
    int32_t messages[8];
    int32_t wheel_count;
    float sample_time; /* [s] */
    int32_t capabilities;
};
typedef char ballbot_message_welcome_has_no_padding[(sizeof(struct ballbot_message_welcome) == 20u * sizeof(float)) ? 1 : -1];

/* A sample: sensors, estimate, torques, and whether the robot is armed or why it is stopped. */
struct ballbot_message_state {
    int32_t time;
    int32_t sample;
    int32_t armed;
    int32_t stop;
    int32_t stop_wheel;
    int32_t self_test;
    int32_t self_test_wheel;
    int32_t controller;
    int32_t imu_valid;
    int32_t encoders_valid;
    int32_t estimate_valid;
    float gyro[3]; /* [rad/s] */
    float attitude[3]; /* [rad] */
    int32_t wheel_counts[BALLBOT_MAX_WHEELS];
    float wheel_speeds[BALLBOT_MAX_WHEELS]; /* [rad/s] */
    float estimate[10]; /* [state] */
    float reference[10]; /* [state] */
    float torques[BALLBOT_MAX_WHEELS]; /* [N m] */
};
typedef char ballbot_message_state_has_no_padding[(sizeof(struct ballbot_message_state) == 49u * sizeof(float)) ? 1 : -1];

/* Answer a command. */
struct ballbot_message_answer {
    int32_t command;
    int32_t sequence;
    int32_t result;
    int32_t value;
};
typedef char ballbot_message_answer_has_no_padding[(sizeof(struct ballbot_message_answer) == 4u * sizeof(float)) ? 1 : -1];

/* A part of the parameters that are in use. */
struct ballbot_message_parameters {
    int32_t offset;
    int32_t count;
    int32_t words[BALLBOT_PARAMETER_WORDS];
};
typedef char ballbot_message_parameters_has_no_padding[(sizeof(struct ballbot_message_parameters) == 34u * sizeof(float)) ? 1 : -1];

/* How many frames the robot accepted, how many each layer refused, and how many of its own found no room. */
struct ballbot_message_counts {
    int32_t accepted;
    int32_t refused[BALLBOT_LAYERS];
    int32_t dropped;
};
typedef char ballbot_message_counts_has_no_padding[(sizeof(struct ballbot_message_counts) == 11u * sizeof(float)) ? 1 : -1];

#endif
