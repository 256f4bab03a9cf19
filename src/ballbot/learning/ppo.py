"""Proximal policy optimisation (Schulman et al. 2017, arXiv:1707.06347) of a small network on robots side by side.

The actor sees what the robot's estimator shows, the critic the true state besides. Both are networks of two layers of
64 tanh units in single precision; the actor's output are torques over `Settings.torque_scale`, to which Gaussian noise
is added while it learns. Advantages are generalised ones (arXiv:1506.02438).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.learning.lanes import Lanes

Singles = NDArray[np.float32]
Layers = list[Singles]  #: weights and biases in turn

HIDDEN = 64


@dataclass(frozen=True, kw_only=True)
class Settings:
    lanes: int = 800
    samples: int = 32  #: of each lane between updates
    updates: int = 60
    epochs: int = 3
    batches: int = 4
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    rate: float = 1.5e-3
    spread: float = 0.4
    torque_scale: float = 0.5  #: of the torque limit


def new_layers(sizes: tuple[int, ...], random: np.random.Generator, *, last: float) -> Layers:
    layers: Layers = []
    for k, (a, b) in enumerate(zip(sizes[:-1], sizes[1:], strict=True)):
        size = last if k == len(sizes) - 2 else 1.0
        layers.append((random.standard_normal((a, b)) * size / np.sqrt(a)).astype(np.float32))
        layers.append(np.zeros(b, np.float32))
    return layers


def forward(layers: Layers, x: Singles) -> tuple[Singles, list[Singles]]:
    """Return the output and the inputs of each layer."""
    inputs = []
    for k in range(0, len(layers), 2):
        inputs.append(x)
        x = x @ layers[k]
        x += layers[k + 1]
        if k < len(layers) - 2:
            np.tanh(x, out=x)
    return x, inputs


def backward(layers: Layers, inputs: list[Singles], slope: Singles) -> Layers:
    """Return the slopes of the layers for one of the output."""
    slopes: Layers = [np.empty(0, np.float32)] * len(layers)
    for k in range(len(layers) - 2, -1, -2):
        x = inputs[k // 2]
        slopes[k], slopes[k + 1] = x.T @ slope, slope.sum(axis=0)
        if k:
            slope = slope @ layers[k].T
            slope *= 1.0 - x * x
    return slopes


class Adam:
    def __init__(self, layers: Layers) -> None:
        self._m = [np.zeros_like(a) for a in layers]
        self._v = [np.zeros_like(a) for a in layers]
        self._k = 0

    def step(self, layers: Layers, slopes: Layers, rate: float) -> None:
        self._k += 1
        size = np.sqrt(sum(float((g * g).sum()) for g in slopes))
        shrink = np.float32(min(1.0, 0.5 / (size + 1e-9)))
        a, b = 1.0 - 0.9**self._k, 1.0 - 0.999**self._k
        for p, g, m, v in zip(layers, slopes, self._m, self._v, strict=True):
            g = g * shrink
            m += 0.1 * (g - m)
            v += 0.001 * (g * g - v)
            p -= np.float32(rate / a) * m / (np.sqrt(v / b) + 1e-7)


def seen_by_critic(lanes: Lanes) -> Singles:
    truth = np.concatenate([lanes.observations, lanes.truths[:, 2:4] * 10.0, lanes.truths[:, 5:10], lanes.references[:, 5:7]], axis=1)
    return np.clip(truth, -4.0, 4.0).astype(np.float32)


def train(lanes: Lanes, settings: Settings, *, seed: int, told: Callable[[int, float, float], None] | None = None) -> Iterator[tuple[Layers, Singles]]:
    """Yield the actor and its spread after each update."""
    random = np.random.default_rng([seed, 1])
    n, N, T = lanes.wheels, lanes.lanes, settings.samples
    lanes.start()
    lanes.ages[:] = 0
    actor = new_layers((lanes.observations.shape[1], HIDDEN, HIDDEN, n), random, last=0.01)
    spread = np.full(n, np.log(settings.spread), np.float32)
    critic = new_layers((seen_by_critic(lanes).shape[1], HIDDEN, HIDDEN, 1), random, last=0.1)
    adam, adam_critic = Adam([*actor, spread]), Adam(critic)
    torque = settings.torque_scale * lanes.torque_limit
    obs = np.empty((T + 1, N, lanes.observations.shape[1]), np.float32)
    known = np.empty((T + 1, N, seen_by_critic(lanes).shape[1]), np.float32)
    acts, logs = np.empty((T, N, n), np.float32), np.empty((T, N), np.float32)
    pay, going = np.empty((T, N), np.float32), np.empty((T, N), np.float32)
    after = np.zeros((T, N), np.float32)  # value of the last state of an episode that only ran out of time
    h = lanes.sample_time
    for update in range(settings.updates):
        fallen = finished = 0
        lengths = 0.0
        for t in range(T):
            obs[t], known[t] = lanes.observations, seen_by_critic(lanes)
            mean, _ = forward(actor, obs[t])
            noise = random.standard_normal((N, n), dtype=np.float32)
            acts[t] = mean + np.exp(spread) * noise
            logs[t] = -0.5 * (noise**2).sum(axis=1) - spread.sum()
            lanes.step((torque * acts[t]).astype(np.float64))
            pay[t] = lanes.rewards / (h * lanes.repeat) * (1.0 - settings.discount)
            going[t] = ~lanes.ended
            after[t] = 0.0
            if lanes.ended.any():
                ran_out = lanes.ended & ~lanes.fallen
                if ran_out.any():
                    after[t, ran_out] = forward(critic, seen_by_critic(lanes)[ran_out])[0][:, 0]
                fallen += int(lanes.fallen.sum())
                finished += int(ran_out.sum())
                lengths += float(lanes.ages[lanes.ended].sum())
                lanes.start(lanes.ended.copy())
        obs[T], known[T] = lanes.observations, seen_by_critic(lanes)
        values = forward(critic, known.reshape((T + 1) * N, -1))[0].reshape(T + 1, N)
        gains = np.zeros((T, N), np.float32)
        gain = np.zeros(N, np.float32)
        for t in range(T - 1, -1, -1):
            error = pay[t] + settings.discount * (going[t] * values[t + 1] + after[t]) - values[t]
            gain = error + settings.discount * settings.trace * going[t] * gain
            gains[t] = gain
        targets = (gains + values[:T]).ravel()
        flat = (gains - gains.mean()) / (gains.std() + 1e-8)
        flat = flat.ravel()
        O, K, A, L = (a.reshape(T * N, -1) for a in (obs[:T], known[:T], acts, logs))
        rate = settings.rate * (1.0 - 0.9 * update / settings.updates)
        for _ in range(settings.epochs):
            order = random.permutation(T * N)
            for batch in np.array_split(order, settings.batches):
                m = len(batch)
                mean, inputs = forward(actor, O[batch])
                inverse = np.exp(-spread)
                z = (A[batch] - mean) * inverse
                ratio = np.exp(-0.5 * (z * z).sum(axis=1) - spread.sum() - L[batch, 0])
                good = flat[batch]
                free = ~(((good > 0) & (ratio > 1 + settings.clip)) | ((good < 0) & (ratio < 1 - settings.clip)))
                weight = (-good * ratio * free / m)[:, None]
                slopes = backward(actor, inputs, weight * z * inverse)
                slope_spread = (weight * (z * z - 1.0)).sum(axis=0)
                adam.step([*actor, spread], [*slopes, slope_spread], rate)
                value, inputs = forward(critic, K[batch])
                slope = (value - targets[batch][:, None]) * (2.0 / m)
                adam_critic.step(critic, backward(critic, inputs, slope.astype(np.float32)), rate)
        if told:
            told(update, float(pay.mean() / (1.0 - settings.discount)), fallen / max(1, fallen + finished), h * lengths / max(1, fallen + finished))
        yield actor, spread
