"""Margins of a sampled loop: how much stronger, weaker or later the torques may act before it is unstable.

The loop is that of a gain on the linear model, cut at the wheels, all of which change alike:

    x[k+1] = F x[k] + G u[k],      u = -g K x,      L(z) = K (z I - F)^-1 G,      z = exp(i w T)

A torque that acts d = (m + f) T late, 0 <= f < 1, is held over the sample in two parts:

    x[k+1] = F x[k] + G_0 u[k - m] + G_1 u[k - m - 1]
    G_0: the input over the last (1 - f) T of a sample      G_1: over the first f T

A margin is the first g or d at which an eigenvalue of the closed loop reaches the unit circle. It is found from these
eigenvalues themselves, so that no curve has to be followed. Parts besides the gain, friction and limits do not count.

Open-loop frequency responses are eigenvalues of L. A robot with equal wheels has two equal ones for its lean, with
the position beneath it, and one for its heading, in which all wheels push alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import held

#: from one gain to the next in the search of a margin, and the largest [1]; the smallest is one over it
_GAIN_STEP, _LARGEST_GAIN = 1.1, 1e3
#: largest delay tried, in samples; they are tried one by one
_MOST_SAMPLES = 100
#: halvings of a bracket, which leave 2e-5 of it
_HALVINGS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """A gain around a linear model, with the torques held over each sample."""

    A: NDArray[np.float64]  #: (m, m)
    B: NDArray[np.float64]  #: (m, n)
    K: NDArray[np.float64]  #: (n, m)
    sample_time: float  #: [s]

    @cached_property
    def sampled(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """F (m, m) and G (m, n)."""
        return held(self.A, self.B, self.sample_time)

    def closed(self, *, gain: float = 1.0, delay: float = 0.0) -> NDArray[np.float64]:
        """Return the closed loop's matrix, the torques still under way in its state.

        Parameters
        ----------
        gain : float
            g, the factor on every torque.
        delay : float
            d [s], zero or more.
        """
        T, (m, n) = self.sample_time, self.B.shape
        whole = math.floor(delay / T + 1e-9)
        late = max(0.0, delay - whole * T)
        F, G = self.sampled
        now, before = G, np.zeros_like(G)
        if late > 0.0:
            after, now = held(self.A, self.B, T - late)
            before = after @ held(self.A, self.B, late)[1]
        # the state is x[k], u[k-1], .., u[k-whole-1]
        held_back = whole + 1
        size = m + held_back * n
        closed = np.zeros((size, size))
        closed[:m, :m] = F
        command = np.zeros((n, size))
        command[:, :m] = -gain * self.K
        for places, part in ((whole, now), (whole + 1, before)):
            if places == 0:
                closed[:m] += part @ command
            else:
                columns = slice(m + (places - 1) * n, m + places * n)
                closed[:m, columns] += part
        closed[m : m + n] = command
        closed[m + n :, m : size - n] = np.eye(size - m - n)
        return closed

    def is_stable(self, *, gain: float = 1.0, delay: float = 0.0) -> bool:
        """Return whether every eigenvalue is within the unit circle; see `closed`."""
        return bool(np.abs(np.linalg.eigvals(self.closed(gain=gain, delay=delay))).max() < 1.0)

    @property
    def slowest(self) -> float:
        """The rate [rad/s] at which the slowest motion of the closed loop decays."""
        largest = np.abs(np.linalg.eigvals(self.closed())).max()
        return float(-np.log(largest) / self.sample_time)

    def responses(self, frequencies: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the open loop (k, 3) at frequencies (k,) [Hz]: of both leans, the larger first, and of the heading."""
        F, G = self.sampled
        z = np.exp(2j * np.pi * frequencies * self.sample_time)[:, None, None]
        L = self.K @ np.linalg.solve(z * np.eye(len(F)) - F, np.broadcast_to(G, (len(z), *G.shape)))
        values, vectors = np.linalg.eig(L)
        alike = np.abs(vectors.sum(axis=1))  # of unit vectors, largest where all wheels push alike
        heading = alike.argmax(axis=1)
        others = np.abs(values)
        others[np.arange(len(z)), heading] = -1.0
        places = np.concatenate([np.argsort(-others, axis=1)[:, :2], heading[:, None]], axis=1)
        return np.take_along_axis(values, places, axis=1)

    def step(
        self, state: int, size: float, duration: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return states (k, m) and torques (k, n) after the reference of one pose jumps, from rest.

        Any place and heading is an equilibrium of the model, so that the error decays as from an initial state.
        """
        count = int(duration / self.sample_time) + 1
        F = self.closed()[: len(self.A), : len(self.A)]
        reference = np.zeros(len(self.A))
        reference[state] = size
        errors = np.empty((count, len(self.A)))
        errors[0] = -reference
        for k in range(1, count):
            errors[k] = F @ errors[k - 1]
        return errors + reference, -errors @ self.K.T


@dataclass(frozen=True, kw_only=True)
class LoopMargins:
    """How much the torques of all wheels may change together."""

    least_gain: float  #: the loop is stable for factors above it; zero if it needs no torque
    greatest_gain: float  #: and below it; infinite beyond 1000
    delay: float  #: and for delays below it [s]; infinite beyond 100 samples


def loop_margins(loop: Loop) -> LoopMargins:
    """Return the margins of a stable loop."""
    T = loop.sample_time
    powers = np.arange(1, math.ceil(math.log(_LARGEST_GAIN) / math.log(_GAIN_STEP)) + 1)
    gains = _GAIN_STEP ** powers.astype(float)
    delays = np.arange(1.0, _MOST_SAMPLES + 1.0) * T
    return LoopMargins(
        least_gain=_first_unstable(lambda g: loop.is_stable(gain=g), 1.0, 1.0 / gains, otherwise=0.0),
        greatest_gain=_first_unstable(lambda g: loop.is_stable(gain=g), 1.0, gains, otherwise=math.inf),
        delay=_first_unstable(lambda d: loop.is_stable(delay=d), 0.0, delays, otherwise=math.inf),
    )


def _first_unstable(
    is_stable: Callable[[float], bool], start: float, tried: NDArray[np.float64], *, otherwise: float
) -> float:
    """Return the border between what is stable, from `start` on, and the first value tried that is not."""
    last = start
    for value in tried.tolist():
        if not is_stable(value):
            break
        last = value
    else:
        return otherwise
    stable, unstable = last, value
    for _ in range(_HALVINGS):
        middle = 0.5 * (stable + unstable)
        stable, unstable = (middle, unstable) if is_stable(middle) else (stable, middle)
    return 0.5 * (stable + unstable)
