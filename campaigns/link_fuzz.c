/* Fuzzed bytes through the robot's side of the link: how many frames each layer lets pass by chance.
 *
 * A robot at rest with an open session is given frames that are right up to one layer and random in that layer; what passes
 * it is refused by the session's number, which is wrong, so that the robot stays as it is. Random bytes, and frames that were
 * right and are changed, go through all layers.
 */
#include "law.h"
#include "link/cobs.h"
#include "link/crc32.h"
#include "link/link.h"

/* What is random; numbers of Python's `Kind`. */
enum kind {
    RANDOM_BYTES = 0, /* every byte */
    CHECKSUM = 1,     /* COBS of a payload of any bytes */
    VERSION = 2,      /* the version, under a CRC-32 that fits */
    TYPE = 3,
    BODY = 4,         /* the length */
    SESSION = 5,
    SEQUENCE = 6,
    CHANGED = 7       /* right frames with one to eight bytes changed, taken out or put in, or cut */
};

/* What was given, and what happened. */
struct outcome {
    uint64_t bytes;
    uint64_t frames;
    uint64_t accepted;
    uint64_t refused[BALLBOT_LAYERS];
    uint64_t segments;       /* of random bytes: those between zeros that a frame has room for */
    uint64_t too_long;       /* and those that are longer */
    uint64_t low_bits;       /* of the payloads: those whose CRC-32 fits in its low 16 bits */
    uint64_t false_accepts;  /* frames accepted that nobody had made */
    uint64_t same;           /* changed frames that came out as they were */
    uint64_t acted;          /* whether the robot moved, or its parameters changed */
};

/* Return the next number of xorshift64* (S. Vigna, ACM Transactions on Mathematical Software 42(4), 2016). */
static uint64_t next(uint64_t *random)
{
    *random ^= *random >> 12;
    *random ^= *random << 25;
    *random ^= *random >> 27;
    return (*random * 0x2545F4914F6CDD1Du) >> 32;
}

static void put(uint8_t *bytes, uint32_t value, size_t count)
{
    for (size_t k = 0; k < count; ++k) {
        bytes[k] = (uint8_t)(value >> (8u * k));
    }
}

/* Fill a payload's header. */
static void head(uint8_t *payload, uint32_t type, uint32_t session, uint32_t sequence)
{
    payload[0] = (uint8_t)BALLBOT_LINK_VERSION;
    payload[1] = (uint8_t)type;
    put(&payload[2], session, 4);
    put(&payload[6], sequence, 2);
}

/* Fill a payload with the CRC-32 that fits and encode it; return the length with its zero. */
static size_t sealed(uint8_t *payload, size_t length, uint8_t *coded)
{
    put(&payload[length], ballbot_crc32(payload, length), 4);
    const size_t count = ballbot_cobs_encode(payload, length + 4u, coded);

    coded[count] = 0u;
    return count + 1u;
}

/* Fill a frame that is random in one layer; return its length. */
static size_t made(enum kind kind, const struct ballbot_link *link, uint64_t *random, struct outcome *outcome,
                   uint8_t *coded)
{
    uint8_t payload[BALLBOT_LONGEST_PAYLOAD];
    const uint32_t next_sequence = link->last + 1u;
    const uint32_t other = link->session ^ 0x5A5A5A5Au;
    size_t length = 8;

    if (kind == RANDOM_BYTES) {
        coded[0] = (uint8_t)next(random);
        return 1;
    }
    if (kind == CHECKSUM) {
        length = BALLBOT_FRAME_OVERHEAD + next(random) % (BALLBOT_LONGEST_PAYLOAD - BALLBOT_FRAME_OVERHEAD + 1u);
        for (size_t k = 0; k < length; ++k) {
            payload[k] = (uint8_t)next(random);
        }
        const uint32_t crc = ballbot_crc32(payload, length - 4u);

        outcome->low_bits += (payload[length - 4u] == (crc & 0xFFu) && payload[length - 3u] == ((crc >> 8) & 0xFFu)) ? 1u : 0u;
        const size_t count = ballbot_cobs_encode(payload, length, coded);

        coded[count] = 0u;
        return count + 1u;
    }
    head(payload, BALLBOT_MESSAGE_KEEP, (kind == SEQUENCE) ? link->session : other, next_sequence);
    if (kind == VERSION) {
        payload[0] = (uint8_t)next(random);
    } else if (kind == TYPE) {
        payload[1] = (uint8_t)next(random);
    } else if (kind == BODY) {
        payload[1] = (uint8_t)BALLBOT_MESSAGE_REFERENCE;
        length += next(random) % (BALLBOT_LONGEST_PAYLOAD - BALLBOT_FRAME_OVERHEAD + 1u);
        for (size_t k = 8; k < length; ++k) {
            payload[k] = 0u;
        }
    } else if (kind == SESSION) {
        put(&payload[2], (uint32_t)next(random), 4);
    } else {
        put(&payload[6], (uint32_t)next(random) & 0xFFFFu, 2);
    }
    return sealed(payload, length, coded);
}

/* Fill a right frame of random torques, and change it; return its length. */
static size_t changed(const struct ballbot_link *link, uint64_t *random, uint8_t *whole, size_t *whole_length,
                      uint8_t *coded)
{
    uint8_t payload[BALLBOT_LONGEST_PAYLOAD];
    const size_t body = sizeof(struct ballbot_message_torques);
    const uint64_t changes = 1u + next(random) % 8u;

    head(payload, BALLBOT_MESSAGE_TORQUES, link->session, link->last + 1u);
    for (size_t k = 0; k < body; ++k) { /* finite: no exponent of ones */
        payload[8u + k] = (uint8_t)(next(random) & 0x3Fu);
    }
    size_t length = sealed(payload, 8u + body, coded);

    *whole_length = length;
    for (size_t k = 0; k < length; ++k) {
        whole[k] = coded[k];
    }
    for (uint64_t k = 0; k < changes && length > 2u; ++k) {
        const size_t place = next(random) % (length - 1u); /* the last zero stays */
        const uint64_t way = next(random) % 8u;

        if (way < 3u) {
            coded[place] ^= (uint8_t)(1u << (next(random) % 8u));
        } else if (way < 6u) {
            coded[place] = (uint8_t)next(random);
        } else if (way == 6u) {
            for (size_t j = place; j + 1u < length; ++j) {
                coded[j] = coded[j + 1u];
            }
            length -= 1u;
        } else {
            for (size_t j = length; j > place; --j) {
                coded[j] = coded[j - 1u];
            }
            coded[place] = (uint8_t)next(random);
            length += 1u;
        }
    }
    return length;
}

/* Count where random bytes end a segment; `run` has the bytes since the last zero. */
static void count_segment(struct outcome *outcome, uint64_t *run, uint8_t byte)
{
    if (byte != 0u) {
        *run += 1u;
        return;
    }
    outcome->segments += (*run >= 1u && *run <= BALLBOT_LONGEST_FRAME) ? 1u : 0u;
    outcome->too_long += (*run > BALLBOT_LONGEST_FRAME) ? 1u : 0u;
    *run = 0u;
}

/* Return whether two frames are the same after the zeros at their start. */
static bool are_alike(const uint8_t *a, size_t a_length, const uint8_t *b, size_t b_length)
{
    size_t skipped = 0;

    while (skipped < a_length && a[skipped] == 0u) {
        skipped += 1u;
    }
    if (a_length - skipped != b_length) {
        return false;
    }
    for (size_t k = 0; k < b_length; ++k) {
        if (a[skipped + k] != b[k]) {
            return false;
        }
    }
    return true;
}

/* Return whether a changed frame has the whole one in it, between zeros. */
static bool holds(const uint8_t *coded, size_t length, const uint8_t *whole, size_t whole_length)
{
    size_t start = 0;

    for (size_t k = 0; k < length; ++k) {
        if (coded[k] == 0u) {
            if (are_alike(&coded[start], k + 1u - start, whole, whole_length)) {
                return true;
            }
            start = k + 1u;
        }
    }
    return false;
}

/* Open a session; return whether that went well. */
static bool open_session(struct ballbot_link *link, struct ballbot_state *state, struct ballbot_parameters *parameters)
{
    static const int32_t firmware[] = BALLBOT_SCHEMA_WORDS;
    static const int32_t messages[] = BALLBOT_MESSAGE_WORDS;
    struct ballbot_message_hello hello = { .state_every = 1 };
    uint8_t coded[BALLBOT_FRAME_ROOM];

    for (size_t k = 0; k < 8u; ++k) {
        hello.firmware[k] = firmware[k];
        hello.messages[k] = messages[k];
    }
    const size_t length = ballbot_frame_encode(BALLBOT_MESSAGE_HELLO, 12345u, 1u, &hello, sizeof hello, coded);

    ballbot_link_init(link, parameters, 0, 0u);
    ballbot_link_receive(link, state, parameters, coded, length, 1000u);
    return link->session != 0u && link->accepted == 1u;
}

/* Give a robot at least `bytes` bytes of a kind; fill what happened. Returns 0, or 1 if the parameters are not allowed. */
int32_t link_fuzz(int32_t kind, uint64_t seed, uint64_t bytes, const struct ballbot_parameters *given,
                  struct outcome *outcome);

int32_t link_fuzz(int32_t kind, uint64_t seed, uint64_t bytes, const struct ballbot_parameters *given,
                  struct outcome *outcome)
{
    static struct ballbot_link link;
    static struct ballbot_state state;
    static struct ballbot_parameters parameters;
    const uint8_t *before = (const uint8_t *)given;
    const uint8_t *after = (const uint8_t *)&parameters;
    uint64_t since_zero = 0;
    uint64_t random = seed * 0x9E3779B97F4A7C15u + 1u;

    parameters = *given;
    if (!ballbot_init(&state, &parameters) || !open_session(&link, &state, &parameters)) {
        return 1;
    }
    while (outcome->bytes < bytes) {
        uint8_t coded[2u * BALLBOT_FRAME_ROOM];
        uint8_t whole[BALLBOT_FRAME_ROOM];
        size_t whole_length = 0;
        const uint32_t accepted = link.accepted;
        const size_t length = (kind == (int32_t)CHANGED)
                                  ? changed(&link, &random, whole, &whole_length, coded)
                                  : made((enum kind)kind, &link, &random, outcome, coded);

        ballbot_link_receive(&link, &state, &parameters, coded, length, 1000u);
        link.out_count = 0;
        if (kind == (int32_t)RANDOM_BYTES) {
            count_segment(outcome, &since_zero, coded[0]);
        }
        if (kind == (int32_t)CHANGED && link.accepted != accepted) {
            const bool same = holds(coded, length, whole, whole_length);

            outcome->same += same ? 1u : 0u;
            outcome->false_accepts += same ? 0u : 1u;
        }
        outcome->bytes += length;
        outcome->frames += 1u;
        outcome->acted += ballbot_is_active(&state) ? 1u : 0u;
    }
    outcome->accepted = link.accepted - 1u; /* without the handshake */
    for (size_t k = 0; k < BALLBOT_LAYERS; ++k) {
        outcome->refused[k] = link.refused[k];
    }
    for (size_t k = 0; k < sizeof parameters; ++k) {
        outcome->acted += (before[k] != after[k]) ? 1u : 0u;
    }
    return 0;
}
