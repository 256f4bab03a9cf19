#include "link/datagram.h"

#define BLOCK 64u
#define DIGEST 32u
#define ROUNDS 64u
/* Place of the length in the last block. */
#define LENGTH 56u

/* A digest that is being computed. */
struct sha256 {
    uint32_t state[8];
    uint8_t block[BLOCK];
    size_t filled;
    uint32_t count; /* bytes so far */
};

/* The first 32 bits of the fractions of the cube roots of the first 64 primes. */
static const uint32_t round_constants[ROUNDS] = {
    0x428A2F98u, 0x71374491u, 0xB5C0FBCFu, 0xE9B5DBA5u, 0x3956C25Bu, 0x59F111F1u, 0x923F82A4u, 0xAB1C5ED5u,
    0xD807AA98u, 0x12835B01u, 0x243185BEu, 0x550C7DC3u, 0x72BE5D74u, 0x80DEB1FEu, 0x9BDC06A7u, 0xC19BF174u,
    0xE49B69C1u, 0xEFBE4786u, 0x0FC19DC6u, 0x240CA1CCu, 0x2DE92C6Fu, 0x4A7484AAu, 0x5CB0A9DCu, 0x76F988DAu,
    0x983E5152u, 0xA831C66Du, 0xB00327C8u, 0xBF597FC7u, 0xC6E00BF3u, 0xD5A79147u, 0x06CA6351u, 0x14292967u,
    0x27B70A85u, 0x2E1B2138u, 0x4D2C6DFCu, 0x53380D13u, 0x650A7354u, 0x766A0ABBu, 0x81C2C92Eu, 0x92722C85u,
    0xA2BFE8A1u, 0xA81A664Bu, 0xC24B8B70u, 0xC76C51A3u, 0xD192E819u, 0xD6990624u, 0xF40E3585u, 0x106AA070u,
    0x19A4C116u, 0x1E376C08u, 0x2748774Cu, 0x34B0BCB5u, 0x391C0CB3u, 0x4ED8AA4Au, 0x5B9CCA4Fu, 0x682E6FF3u,
    0x748F82EEu, 0x78A5636Fu, 0x84C87814u, 0x8CC70208u, 0x90BEFFFAu, 0xA4506CEBu, 0xBEF9A3F7u, 0xC67178F2u,
};

static void start_digest(struct sha256 *sha)
{
    static const uint32_t first[8] = { 0x6A09E667u, 0xBB67AE85u, 0x3C6EF372u, 0xA54FF53Au,
                                       0x510E527Fu, 0x9B05688Cu, 0x1F83D9ABu, 0x5BE0CD19u };

    for (size_t k = 0; k < 8u; ++k) {
        sha->state[k] = first[k];
    }
    sha->filled = 0;
    sha->count = 0;
}

static uint32_t turned(uint32_t word, uint32_t bits)
{
    return (word >> bits) | (word << (32u - bits));
}

/* Mix a whole block into the state. */
static void mix_block(struct sha256 *sha)
{
    uint32_t words[ROUNDS];
    uint32_t s[8];

    for (size_t k = 0; k < 16u; ++k) {
        const uint8_t *bytes = &sha->block[4u * k];

        words[k] = ((uint32_t)bytes[0] << 24) | ((uint32_t)bytes[1] << 16) | ((uint32_t)bytes[2] << 8) | bytes[3];
    }
    for (size_t k = 16; k < ROUNDS; ++k) {
        const uint32_t early = words[k - 15u];
        const uint32_t late = words[k - 2u];

        words[k] = words[k - 16u] + (turned(early, 7) ^ turned(early, 18) ^ (early >> 3)) + words[k - 7u] +
                   (turned(late, 17) ^ turned(late, 19) ^ (late >> 10));
    }
    for (size_t k = 0; k < 8u; ++k) {
        s[k] = sha->state[k];
    }
    for (size_t k = 0; k < ROUNDS; ++k) {
        const uint32_t choice = (s[4] & s[5]) ^ (~s[4] & s[6]);
        const uint32_t majority = (s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]);
        const uint32_t one =
            s[7] + (turned(s[4], 6) ^ turned(s[4], 11) ^ turned(s[4], 25)) + choice + round_constants[k] + words[k];
        const uint32_t two = (turned(s[0], 2) ^ turned(s[0], 13) ^ turned(s[0], 22)) + majority;

        for (size_t j = 7; j > 0u; --j) {
            s[j] = s[j - 1u];
        }
        s[4] += one;
        s[0] = one + two;
    }
    for (size_t k = 0; k < 8u; ++k) {
        sha->state[k] += s[k];
    }
}

static void add_byte(struct sha256 *sha, uint8_t byte)
{
    sha->block[sha->filled] = byte;
    sha->filled += 1u;
    sha->count += 1u;
    if (sha->filled == BLOCK) {
        mix_block(sha);
        sha->filled = 0;
    }
}

/* Fill the digest of all bytes so far. */
static void finish(struct sha256 *sha, uint8_t digest[DIGEST])
{
    const uint32_t bits = 8u * sha->count;

    add_byte(sha, 0x80u);
    while (sha->filled != LENGTH) {
        add_byte(sha, 0u);
    }
    for (size_t k = 0; k < 4u; ++k) { /* messages are far shorter than 2^32 bits */
        add_byte(sha, 0u);
    }
    for (size_t k = 0; k < 4u; ++k) {
        add_byte(sha, (uint8_t)((bits >> (24u - 8u * k)) & 0xFFu));
    }
    for (size_t k = 0; k < DIGEST; ++k) {
        digest[k] = (uint8_t)((sha->state[k / 4u] >> (24u - 8u * (k % 4u))) & 0xFFu);
    }
}

/* Begin a digest with the key, each byte changed by a pattern. */
static void start_with_key(struct sha256 *sha, const struct ballbot_key *key, uint8_t pattern)
{
    start_digest(sha);
    for (size_t k = 0; k < BLOCK; ++k) {
        const uint8_t byte = (k < key->count) ? key->bytes[k] : 0u;

        add_byte(sha, (uint8_t)(byte ^ pattern));
    }
}

/* Fill the HMAC of a direction and a frame. */
static void authenticate(const struct ballbot_key *key, uint8_t direction, const uint8_t *frame, size_t count,
                         uint8_t digest[DIGEST])
{
    struct sha256 sha;

    start_with_key(&sha, key, 0x36u);
    add_byte(&sha, direction);
    for (size_t k = 0; k < count; ++k) {
        add_byte(&sha, frame[k]);
    }
    finish(&sha, digest);
    start_with_key(&sha, key, 0x5Cu);
    for (size_t k = 0; k < DIGEST; ++k) {
        add_byte(&sha, digest[k]);
    }
    finish(&sha, digest);
}

size_t ballbot_datagram_seal(const struct ballbot_key *key, uint8_t direction, uint8_t *datagram, size_t count)
{
    uint8_t digest[DIGEST];

    authenticate(key, direction, datagram, count, digest);
    for (size_t k = 0; k < BALLBOT_TAG; ++k) {
        datagram[count + k] = digest[k];
    }
    return count + BALLBOT_TAG;
}

size_t ballbot_datagram_open(const struct ballbot_key *key, uint8_t direction, const uint8_t *datagram, size_t count)
{
    uint8_t digest[DIGEST];
    uint32_t different = 0;

    if (count <= BALLBOT_TAG) {
        return 0;
    }
    const size_t length = count - BALLBOT_TAG;

    authenticate(key, direction, datagram, length, digest);
    for (size_t k = 0; k < BALLBOT_TAG; ++k) { /* as long for a good tag as for a bad one */
        different |= (uint32_t)(datagram[length + k] ^ digest[k]);
    }
    return (different == 0u) ? length : 0u;
}
