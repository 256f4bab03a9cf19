"""Logs of a ball on clamped wheels, cut into windows that lie end to end.

The plant is stable, so that windows may be long. A window starts from the camera's mean over the samples about its
first row, whose noise is then a third of a single sample's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.windows import COMPARISONS, LARGEST_JITTER, Span, common_sample_time
from ballbot.log import Log
from ballbot.log.columns import torque_names
from ballbot.log.spikes import spiked_rows

BALL_NAMES = ("ball_omega_x", "ball_omega_y", "ball_omega_z")

#: samples on either side of a window's first that its start is the mean of
NEIGHBOURS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class BallWindows:
    """w windows of m samples each."""

    initial: NDArray[np.float64]  #: (w, 3), Omega at the starts [rad/s]
    torques: NDArray[np.float64]  #: (w, m, n) [N m]
    measured: NDArray[np.float64]  #: (w, m, 3), Omega after each sample [rad/s]
    spans: tuple[Span, ...]  #: (w,)
    sample_time: float  #: [s]

    def __len__(self) -> int:
        return len(self.initial)

    @property
    def every(self) -> int:
        """Samples from one comparison of a fit to the next."""
        return max(1, self.torques.shape[1] // COMPARISONS)

    def take(self, rows: NDArray[np.int64]) -> BallWindows:
        """Return the windows of those numbers."""
        return BallWindows(
            initial=self.initial[rows],
            torques=self.torques[rows],
            measured=self.measured[rows],
            spans=tuple(self.spans[row] for row in rows),
            sample_time=self.sample_time,
        )


def cut_ball_windows(logs: Sequence[Log], *, wheel_count: int, duration: float) -> BallWindows:
    """Cut logs into windows; those with a gap or a missing value are left out.

    Parameters
    ----------
    logs : sequence of Log
        With u1 .. un and ball_omega_x, _y, _z, of one sample time.
    wheel_count : int
    duration : float
        Of a window [s].

    Raises
    ------
    InputError
        Where there is no log, a column is missing, the sample times differ, or the window is no length or longer
        than every log.
    """
    sample_time = common_sample_time(logs, duration=duration)
    samples = round(duration / sample_time)
    pieces = [_cut(number, log, wheel_count, samples) for number, log in enumerate(logs)]
    spans = tuple(span for piece in pieces for span in piece[3])
    if not spans:
        raise InputError(
            f"No log has {duration:g} s without a gap or a missing value; choose a shorter window."
        )
    return BallWindows(
        initial=np.concatenate([piece[0] for piece in pieces]),
        torques=np.concatenate([piece[1] for piece in pieces]),
        measured=np.concatenate([piece[2] for piece in pieces]),
        spans=spans,
        sample_time=sample_time,
    )


def _cut(
    number: int, log: Log, wheel_count: int, samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], list[Span]]:
    torques = np.column_stack([log[name] for name in torque_names(wheel_count)])
    omegas = np.column_stack([log[name] for name in BALL_NAMES])
    whole = np.asarray(np.isfinite(np.hstack([torques, omegas])).all(axis=1))
    whole &= ~spiked_rows(log, (*torque_names(wheel_count), *BALL_NAMES))
    even = np.asarray(np.abs(np.diff(log.t) - log.sample_time) <= LARGEST_JITTER * log.sample_time)
    starts = [
        k
        for k in range(NEIGHBOURS, len(log.t) - samples - NEIGHBOURS, samples)
        if whole[k - NEIGHBOURS : k + samples + 1].all() and even[k - NEIGHBOURS : k + samples].all()
    ]
    rows = np.array(starts, dtype=np.int64)
    near = omegas[rows[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)]
    held = rows[:, None] + np.arange(samples)
    spans = [Span(log=number, start=float(log.t[k]), end=float(log.t[k + samples])) for k in starts]
    return near.mean(axis=1), torques[held], omegas[held + 1], spans
