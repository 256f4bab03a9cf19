#include "hardware.h"

#include "ballbot_hardware.h"

/* Whose functions those of ballbot_hardware.h are. */
static struct emulated_hardware *selected;

void emulated_start(struct emulated_hardware *hardware)
{
    uint8_t *bytes = (uint8_t *)hardware;

    for (size_t k = 0; k < sizeof *hardware; ++k) {
        bytes[k] = 0u;
    }
}

void emulated_select(struct emulated_hardware *hardware)
{
    selected = hardware;
}

/* Append bytes to those that wait; without room they are lost. */
static void append(struct emulated_bytes *waiting, const uint8_t *bytes, size_t count)
{
    for (size_t k = 0; k < count && waiting->count < EMULATED_ROOM; ++k) {
        waiting->bytes[(waiting->first + waiting->count) % EMULATED_ROOM] = bytes[k];
        waiting->count += 1u;
    }
}

/* Take at most so many of the bytes that wait. */
static size_t removed(struct emulated_bytes *waiting, uint8_t *bytes, size_t most)
{
    const size_t count = (waiting->count < most) ? waiting->count : most;

    for (size_t k = 0; k < count; ++k) {
        bytes[k] = waiting->bytes[waiting->first];
        waiting->first = (waiting->first + 1u) % EMULATED_ROOM;
    }
    waiting->count -= count;
    return count;
}

/* Return whether a frame is the next sample of the sensors. */
static bool is_sample(const struct emulated_hardware *hardware, const struct ballbot_frame *frame)
{
    return frame->type == (uint8_t)BALLBOT_MESSAGE_SENSORS && frame->session == 0u &&
           frame->length == sizeof hardware->sensors &&
           (!hardware->started || ballbot_is_newer(frame->sequence, hardware->last));
}

bool emulated_put(struct emulated_hardware *hardware, uint8_t byte)
{
    struct ballbot_frame frame;
    enum ballbot_layer layer = BALLBOT_LAYER_FRAMING;
    const enum ballbot_received received = ballbot_receiver_take(&hardware->receiver, byte, &frame, &layer);

    if (received == BALLBOT_RECEIVED_FRAME && is_sample(hardware, &frame)) {
        ballbot_copy_bytes(&hardware->sensors, frame.body, sizeof hardware->sensors);
        hardware->last = frame.sequence;
        hardware->started = true;
        hardware->raw_count = 0;
        return true;
    }
    if (hardware->raw_count == sizeof hardware->raw) { /* longer than a frame: no sample */
        append(&hardware->to_robot, hardware->raw, hardware->raw_count);
        hardware->raw_count = 0;
    }
    hardware->raw[hardware->raw_count] = byte;
    hardware->raw_count += 1u;
    if (byte == 0u) {
        append(&hardware->to_robot, hardware->raw, hardware->raw_count);
        hardware->raw_count = 0;
    }
    return false;
}

void emulated_finish(struct emulated_hardware *hardware, bool armed)
{
    struct ballbot_message_motors body = { .time = hardware->sensors.time,
                                           .enabled = hardware->enabled ? 1 : 0,
                                           .armed = armed ? 1 : 0 };
    uint8_t frame[BALLBOT_FRAME_ROOM];

    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        body.torques[i] = hardware->enabled ? hardware->torques[i] : 0.0f;
    }
    hardware->sequence = (uint16_t)((hardware->sequence + 1u) & 0xFFFFu);
    const size_t count =
        ballbot_frame_encode(BALLBOT_MESSAGE_MOTORS, 0u, hardware->sequence, &body, sizeof body, frame);

    append(&hardware->to_line, frame, count);
}

size_t emulated_take(struct emulated_hardware *hardware, uint8_t *bytes, size_t most)
{
    return removed(&hardware->to_line, bytes, most);
}

bool ballbot_read_imu(float gyro[3], float attitude[3])
{
    for (int i = 0; i < 3; ++i) {
        gyro[i] = selected->sensors.gyro[i];
        attitude[i] = selected->sensors.attitude[i];
    }
    return selected->sensors.imu_valid != 0;
}

bool ballbot_read_encoders(int32_t counts[BALLBOT_MAX_WHEELS])
{
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        counts[i] = selected->sensors.wheel_counts[i];
    }
    return selected->sensors.encoders_valid != 0;
}

uint32_t ballbot_read_time(void)
{
    return (uint32_t)selected->sensors.time;
}

void ballbot_set_torques(const float torques[BALLBOT_MAX_WHEELS])
{
    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        selected->torques[i] = torques[i];
    }
}

void ballbot_set_enable(bool enabled)
{
    selected->enabled = enabled;
}

void ballbot_send(const uint8_t *bytes, size_t count)
{
    append(&selected->to_line, bytes, count);
}

size_t ballbot_receive(uint8_t *bytes, size_t most)
{
    return removed(&selected->to_robot, bytes, most);
}
