"""Whether a robot that holds a spot goes to and fro about it: a limit cycle, told apart from drift."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ballbot.errors import InputError
from ballbot.log import Log

#: slower than this is drift [Hz]
_SLOWEST = 0.5
#: shortest time in which a cycle can be told [s]
_SHORTEST = 4.0


def cycle_amplitude(log: Log, *, settle: float = 6.0) -> float:
    """Return the amplitude of the strongest periodic motion along x or y [m], faster than 0.5 Hz.

    The true position counts where the log has it. A line's amplitude comes from the spectrum of the whole run from
    `settle` on under a Hann window, and so is that of a cycle which lasts.

    Raises
    ------
    InputError
        Where the run has less than 4 s from there on.
    """
    place = log.truth() if "true_x" in log else log
    late = log.t - log.t[0] >= settle
    if np.count_nonzero(late) * log.sample_time < _SHORTEST:
        raise InputError(
            f"The run has less than {_SHORTEST:g} s after the first {settle:g} s; that is too short to find "
            "a limit cycle."
        )
    high = butter(2, _SLOWEST, "high", fs=1.0 / log.sample_time, output="sos")
    window = np.hanning(np.count_nonzero(late))
    lines = [np.abs(np.fft.rfft(sosfiltfilt(high, place[name][late]) * window)) for name in "xy"]
    return float(2.0 * np.max(lines) / window.sum())
