"""The random numbers of compiled code: the published generator, and the normal distribution to its tail."""

import numpy as np
import pytest
from scipy import stats

from ballbot.learning.streams import fill_normal, next_word, stream_of, uniform
from ballbot.mechanics.engine.compiled import compiled

WORD = (1 << 64) - 1


def xoshiro(state):
    """Return the next word of xoshiro256++, as its authors' C code has it, and change the state."""

    def rotated(x, k):
        return ((x << k) | (x >> (64 - k))) & WORD

    word = (rotated((state[0] + state[3]) & WORD, 23) + state[0]) & WORD
    shifted = (state[1] << 17) & WORD
    state[2] ^= state[0]
    state[3] ^= state[1]
    state[1] ^= state[2]
    state[0] ^= state[3]
    state[2] ^= shifted
    state[3] = rotated(state[3], 45)
    return word


@compiled
def drawn(stream, words, uniforms, normals):
    for i in range(len(words)):
        words[i] = next_word(stream)
    for i in range(len(uniforms)):
        uniforms[i] = uniform(stream, -2.0, 3.0)
    fill_normal(stream, normals)


@pytest.fixture(scope="module")
def numbers():
    words, uniforms, normals = np.zeros(50, np.uint64), np.zeros(20_000), np.zeros(2_000_000)
    drawn(stream_of((3, 1)), words, uniforms, normals)
    return words, uniforms, normals


@pytest.mark.slow
def test_words_are_those_of_the_published_generator(numbers):
    state = [int(x) for x in stream_of((3, 1))]
    assert numbers[0].tolist() == [xoshiro(state) for _ in range(50)]


@pytest.mark.slow
def test_uniform_and_normal_numbers_have_their_distributions(numbers):
    """Of two million numbers, each verdict with a chance of 1e-3; about 516 are beyond the tail's begin."""
    _, uniforms, normals = numbers
    assert stats.kstest(uniforms, stats.uniform(-2.0, 5.0).cdf).pvalue > 1e-3
    assert stats.kstest(normals[:200_000], stats.norm.cdf).pvalue > 1e-3
    edges = np.concatenate([[-np.inf], np.linspace(-4.0, 4.0, 81), [np.inf]])
    expected = len(normals) * np.diff(stats.norm.cdf(edges))
    counts = np.histogram(normals, np.where(np.isinf(edges), np.sign(edges) * 99.0, edges))[0]
    assert stats.chisquare(counts, expected).pvalue > 1e-3
    begin = 3.6541528853610088
    beyond = np.abs(normals)[np.abs(normals) > begin]
    assert stats.kstest(beyond, lambda x: 1.0 - stats.norm.sf(x) / stats.norm.sf(begin)).pvalue > 1e-3
    assert np.unique(normals).size == normals.size
