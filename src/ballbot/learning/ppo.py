"""Proximal policy optimisation (Schulman et al. 2017, arXiv:1707.06347) of a small network on robots side by side.

The actor sees what the robot's estimator shows, the critic the true state besides. Both are networks of two layers of
tanh units in single precision; the actor's outputs are torques over a scale, to which Gaussian noise is added while it
learns. Advantages are generalised ones (Schulman et al. 2016, arXiv:1506.02438). NumPy multiplies the matrices and the
compiled loop steps the robots, so that neither waits for Python.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.learning.lanes import SAME_STEP, TaskLanes

Singles = NDArray[np.float32]
Layers = list[Singles]  #: weights (inputs, outputs) and biases in turn

#: Adam's memories of the mean slope and of its square, and the largest slope of a step (as in CleanRL's PPO)
_MEMORY, _SQUARES, _LARGEST_SLOPE = 0.9, 0.999, 0.5
#: entries of the true state that the critic sees beside the observation, and what counts as 1 of them
_KNOWN_STATE, _KNOWN_SCALES = (2, 3, 5, 6, 7, 8, 9), np.array([0.1, 0.1, 1.0, 1.0, 1.0, 1.0, 1.0])
_MOST_KNOWN = 4.0
#: of a training that starts as a law: rate of the actor over the critic's, and `Training.spread`. With 0.3 and 0.1
#: Drive lost the law and fell ever after; with 0.1 and 0.2 Track held its place less well
_FROM_A_LAW = 0.03, 0.1


@dataclass(frozen=True, kw_only=True)
class Training:
    """The settings of a training.

    Found by trials of two seeds each: 200 robots for 128 decisions learn to balance from half the experience that 800
    robots for 32 need.
    """

    lanes: int = 200  #: robots side by side
    decisions: int = 128  #: of each robot between updates
    updates: int = 60
    epochs: int = 2  #: passes through the experience of an update
    batches: int = 16  #: steps of the descent in a pass
    discount: float = 0.995  #: of the reward, from a decision to the next: 2 s at 100 Hz
    trace: float = 0.97  #: lambda of the advantages
    clip: float = 0.2  #: largest change of a decision's probability that gains
    rate: float = 3e-3  #: of Adam at the start; it falls to a tenth
    spread: float = 0.6  #: standard deviation of the noise at the start, over the torque scale
    hidden: int = 64  #: units of a layer


@dataclass(frozen=True, kw_only=True)
class TrainingState:
    """The state of a training after an update."""

    actor: Layers
    reward: float  #: mean a second
    fallen: int  #: episodes that ended in a fall
    finished: int  #: episodes that ran their time
    length: float  #: mean of the episodes that ended [s]; NaN if none did


def new_layers(sizes: tuple[int, ...], random: np.random.Generator, *, last: float) -> Layers:
    """Return layers with small random weights; the last ones are smaller by a factor, so that it begins near zero."""
    layers: Layers = []
    for k, (a, b) in enumerate(pairwise(sizes)):
        size = (last if k == len(sizes) - 2 else 1.0) / np.sqrt(a)
        layers += [(size * random.standard_normal((a, b))).astype(np.float32), np.zeros(b, np.float32)]
    return layers


def forward(layers: Layers, x: Singles) -> tuple[Singles, list[Singles]]:
    """Return the output for inputs (m, inputs), and the inputs of each layer.

    Examples
    --------
    >>> layers = new_layers((19, 8, 3), np.random.default_rng(1), last=0.0)
    >>> forward(layers, np.ones((5, 19), np.float32))[0].shape
    (5, 3)
    """
    inputs = []
    for k in range(0, len(layers), 2):
        inputs.append(x)
        x = x @ layers[k]
        x += layers[k + 1]
        if k < len(layers) - 2:
            np.tanh(x, out=x)
    return x, inputs


def backward(layers: Layers, inputs: list[Singles], slope: Singles) -> Layers:
    """Return the slopes of weights and biases for one of the output (m, outputs), by the chain rule."""
    slopes: Layers = [np.empty(0, np.float32)] * len(layers)
    for k in range(len(layers) - 2, -1, -2):
        x = inputs[k // 2]
        slopes[k] = x.T @ slope
        slopes[k + 1] = slope.sum(axis=0)
        if k:
            slope = slope @ layers[k].T
            slope *= np.float32(1.0) - x * x
    return slopes


class Adam:
    """Adam (Kingma and Ba, arXiv:1412.6980) of some layers, which it changes in place; large slopes are shortened."""

    def __init__(self, layers: Layers) -> None:
        self._layers, self._steps = layers, 0
        self._means = [np.zeros_like(layer) for layer in layers]
        self._squares = [np.zeros_like(layer) for layer in layers]

    def step(self, slopes: Layers, rate: float) -> None:
        """Go a step down the slopes."""
        self._steps += 1
        size = np.sqrt(sum(float(np.vdot(slope, slope)) for slope in slopes))
        shorter = np.float32(min(1.0, _LARGEST_SLOPE / (size + 1e-9)))
        of_means, of_squares = 1.0 - _MEMORY**self._steps, 1.0 - _SQUARES**self._steps
        for layer, slope, mean, square in zip(self._layers, slopes, self._means, self._squares, strict=True):
            slope = slope * shorter
            mean += np.float32(1.0 - _MEMORY) * (slope - mean)
            square += np.float32(1.0 - _SQUARES) * (slope * slope - square)
            layer -= (
                np.float32(rate / of_means)
                * mean
                / (np.sqrt(square / np.float32(of_squares)) + np.float32(1e-7))
            )


def _known(seen: Singles, truths: NDArray[np.float64], references: NDArray[np.float64]) -> Singles:
    """Return what the critic sees of robots: observations, true states and the velocity asked for."""
    state = truths[:, _KNOWN_STATE] / _KNOWN_SCALES
    known = np.concatenate([seen, state, references[:, 5:7]], axis=1)
    return np.clip(known, -_MOST_KNOWN, _MOST_KNOWN).astype(np.float32)


def _known_now(lanes: TaskLanes) -> Singles:
    return _known(lanes.observations, lanes.truths, lanes.references)


class _Experience:
    """Arrays for the decisions of an update, (decisions, robots, ..)."""

    def __init__(self, training: Training, lanes: TaskLanes) -> None:
        T, N = training.decisions, lanes.lanes
        self.seen = np.empty((T, N, lanes.observations.shape[1]), np.float32)
        self.known = np.empty((T + 1, N, _known_now(lanes).shape[1]), np.float32)
        self.actions = np.empty((T, N, lanes.wheels), np.float32)
        self.ages = np.zeros(N, np.int64)  #: decisions since the start of each robot's episode
        self.chances, self.paid, self.going, self.after = np.empty((4, T, N), np.float32)


def random_of(seed: int) -> np.random.Generator:
    """Return the random numbers of a training: first those of `new_actor`."""
    return np.random.default_rng([seed, 1])


def new_actor(
    lanes: TaskLanes,
    training: Training,
    random: np.random.Generator,
    start: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> Layers:
    """Return the actor before its first update, whose torques are nearly zero, or those of a law.

    Of the law are weights into its units (ERRORS, units) and out of them (units, n).
    """
    sizes = (lanes.observations.shape[1], training.hidden, training.hidden, lanes.wheels)
    layers = new_layers(sizes, random, last=0.01)
    if start is not None:
        into, out = start
        layers[0][:, : len(out)], layers[0][: len(into), : len(out)] = 0.0, into
        layers[2][:, : len(out)] = np.eye(training.hidden, len(out))
        layers[4][: len(out)] = out
    return layers


def train(
    lanes: TaskLanes,
    training: Training,
    *,
    moving: NDArray[np.float64],
    torque_scale: float,
    seed: int,
    start: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> Iterator[TrainingState]:
    """Train a network, and yield it after each update; the same seed gives the same bits on one machine.

    It starts as the law `start`, see `new_actor`.

    The torques (n,) are projected by `moving` (n, n): what four wheels give against each other moves nothing, so that
    no reward teaches the network to leave it.
    """
    random, n = random_of(seed), lanes.wheels
    lanes.start()
    hidden = (training.hidden, training.hidden)
    actor = new_actor(lanes, training, random, start)
    critic = new_layers((_known_now(lanes).shape[1], *hidden, 1), random, last=0.1)
    slow, noise = (1.0, training.spread) if start is None else _FROM_A_LAW
    spread = np.full(n, np.log(noise), np.float32)
    descents = Adam([*actor, spread]), Adam(critic)
    experience = _Experience(training, lanes)
    for update in range(training.updates):
        counts = _gather(lanes, experience, actor, critic, spread, training, torque_scale, random)
        rate = training.rate * (1.0 - 0.9 * update / training.updates)
        _improve(experience, actor, critic, spread, descents, training, (slow * rate, rate), random)
        for layer in actor[-2:]:
            layer[:] = layer @ moving
        fallen, finished, seconds = counts
        yield TrainingState(
            actor=[layer.copy() for layer in actor],
            reward=float(experience.paid.mean()) / (1.0 - training.discount),
            fallen=fallen,
            finished=finished,
            length=seconds / (fallen + finished) if fallen + finished else np.nan,
        )


def _gather(
    lanes: TaskLanes,
    own: _Experience,
    actor: Layers,
    critic: Layers,
    spread: Singles,
    training: Training,
    torque_scale: float,
    random: np.random.Generator,
) -> tuple[int, int, float]:
    """Fill the experience; return how many episodes fell, ran their time, and their length together [s]."""
    N, n, period = lanes.lanes, lanes.wheels, lanes.sample_time * lanes.repeat
    fallen, finished, seconds = 0, 0, 0.0
    for t in range(training.decisions):
        own.seen[t], own.known[t] = lanes.observations, _known_now(lanes)
        noise = random.standard_normal((N, n), dtype=np.float32)
        own.actions[t] = forward(actor, own.seen[t])[0] + np.exp(spread) * noise
        own.chances[t] = -0.5 * (noise * noise).sum(axis=1) - spread.sum()
        own.ages += 1
        lanes.step(torque_scale * own.actions[t].astype(np.float64), ending=SAME_STEP)
        # a value is then at most 1
        own.paid[t] = lanes.rewards / period * (1.0 - training.discount)
        own.going[t], own.after[t] = ~lanes.ended, 0.0
        if lanes.ended.any():
            out = lanes.ended & ~lanes.fallen
            if out.any():  # of time: it would have gone on
                left = _known(
                    lanes.final_observations[out], lanes.final_truths[out], lanes.final_references[out]
                )
                own.after[t, out] = forward(critic, left)[0][:, 0]
            fallen, finished = fallen + int(lanes.fallen.sum()), finished + int(out.sum())
            seconds += period * float(own.ages[lanes.ended].sum())
            own.ages[lanes.ended] = 0
    own.known[training.decisions] = _known_now(lanes)
    return fallen, finished, seconds


def _advantages(own: _Experience, critic: Layers, training: Training) -> tuple[Singles, Singles]:
    """Return the advantages (T, N) and the values to be learned."""
    T, N = own.paid.shape
    values = forward(critic, own.known.reshape((T + 1) * N, -1))[0].reshape(T + 1, N)
    gains, gain = np.empty((T, N), np.float32), np.zeros(N, np.float32)
    for t in range(T - 1, -1, -1):
        ahead = training.discount * (own.going[t] * values[t + 1] + own.after[t])
        gain = own.paid[t] + ahead - values[t] + training.discount * training.trace * own.going[t] * gain
        gains[t] = gain
    return gains, gains + values[:-1]


def _improve(
    own: _Experience,
    actor: Layers,
    critic: Layers,
    spread: Singles,
    descents: tuple[Adam, Adam],
    training: Training,
    rates: tuple[float, float],
    random: np.random.Generator,
) -> None:
    """Improve actor and spread, and critic, by the experience; their rates are those of Adam."""
    gains, wanted = _advantages(own, critic, training)
    gains = ((gains - gains.mean()) / (gains.std() + 1e-8)).ravel()
    count = gains.size
    seen, known, actions = (a.reshape(count, -1) for a in (own.seen, own.known[:-1], own.actions))
    chances, wanted = own.chances.ravel(), wanted.reshape(count, 1)
    for _ in range(training.epochs):
        for batch in np.array_split(random.permutation(count), training.batches):
            mean, inputs = forward(actor, seen[batch])
            inverse = np.exp(-spread)
            z = (actions[batch] - mean) * inverse
            ratio = np.exp(-0.5 * (z * z).sum(axis=1) - spread.sum() - chances[batch])
            gain = gains[batch]
            # no slope where the probability has changed enough already
            enough = np.where(gain > 0.0, ratio > 1.0 + training.clip, ratio < 1.0 - training.clip)
            weight = (np.where(enough, 0.0, -gain * ratio) / len(batch)).astype(np.float32)[:, None]
            slopes = backward(actor, inputs, (weight * z * inverse).astype(np.float32))
            descents[0].step([*slopes, (weight * (z * z - 1.0)).sum(axis=0)], rates[0])
            value, inputs = forward(critic, known[batch])
            slope = ((value - wanted[batch]) * (2.0 / len(batch))).astype(np.float32)
            descents[1].step(backward(critic, inputs, slope), rates[1])
