"""A robot at a link that only sends states, for the tests of its monitor."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ballbot.errors import InputError
from ballbot.link.messages import MAX_WHEELS, State


def state(k: int, *, x: float = 0.0, valid: int = 1, armed: int = 1, stop: int = 0) -> State:
    """Return the state of sample k, 5 ms apart; the clock wraps around at sample 10."""
    estimate = np.zeros(10, np.float32)
    estimate[[0, 2]] = x, 0.02
    wheels = np.zeros(MAX_WHEELS, np.float32)
    return State(
        time=(2**32 - 50_000 + 5000 * k) % 2**32,
        sample=1 + k,
        armed=armed,
        stop=stop,
        stop_wheel=0,
        self_test=0,
        self_test_wheel=0,
        controller=0,
        imu_valid=1,
        encoders_valid=1,
        estimate_valid=valid,
        gyro=np.zeros(3, np.float32),
        attitude=np.array([0.01, -0.02, 0.3], np.float32),
        wheel_counts=np.full(MAX_WHEELS, 10 * k, np.int32),
        wheel_speeds=wheels + 1.0,
        estimate=estimate,
        reference=np.zeros(10, np.float32),
        torques=wheels + 0.5,
    )


@dataclass
class Link:
    """A robot that sends states, and keeps whatever else is done to it."""

    states: Iterable[State]
    wheel_count: int = 3
    encoder_step: float = 0.001
    calls: list[str] = field(default_factory=list)
    ending: str = ""

    def watch(self, show: Callable[[State], None], *, duration: float) -> None:
        assert duration == np.inf
        for one in self.states:
            show(one)
        if self.ending:
            raise InputError(self.ending)

    def __getattr__(self, name: str) -> Any:
        self.calls.append(name)
        raise AttributeError(name)
