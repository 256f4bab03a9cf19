"""A closed-loop run in numbers: every metric of `ballbot.experiments.metrics`, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.experiments.metrics import (
    BAND,
    HIGH_FREQUENCY,
    SETTLE,
    energies,
    heading_error,
    high_frequency_torque,
    position_error,
    rms,
    rms_torque,
    rms_torque_change,
    settled,
    settling_time,
)
from ballbot.log import Log


@dataclass(frozen=True, kw_only=True)
class Score:
    """How well a run went. Errors are NaN where the run ended before it had settled once."""

    peak_position_error: float  #: largest horizontal distance from the reference once settled [m]
    rms_position_error: float  #: its root mean square [m]
    peak_heading_error: float  #: once settled [rad]
    rms_heading_error: float  #: [rad]
    settling_time: float  #: the longest of the run; see `metrics.settling_time` [s]
    arrived: (
        bool  #: whether it always was within the band at last; where not, the settling time is a lower bound
    )
    rms_torque: float  #: over the whole run and all wheels [N m]
    rms_torque_change: float  #: from sample to sample [N m]
    high_frequency_torque: float  #: root mean square above 10 Hz [N m]; NaN where sampled at 20 Hz or less
    energy: float  #: integral of |u w| over all wheels [J]
    driving_energy: float  #: of that, what the motors gave [J]
    ended: str | None  #: why the run stopped early, as in a fall

    def to_dict(self) -> dict[str, float | str | None]:
        """Return what results.json holds; of a run that never settled, only the least time that settling takes."""
        values = asdict(self)
        if not self.arrived:
            values |= {"settling_time": None, "settling_time_at_least": self.settling_time}
        return values

    def to_arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return its numbers, and the codes of why the run ended, as a checkpoint keeps them."""
        *numbers, ended = astuple(self)
        codes = np.frombuffer((ended or "").encode(), dtype=np.uint8)
        return np.array(numbers, dtype=np.float64), codes.astype(np.float64)

    @staticmethod
    def from_arrays(numbers: NDArray[np.float64], codes: NDArray[np.float64]) -> Score:
        """Return the score that `to_arrays` made these of."""
        names = [field.name for field in fields(Score) if field.name != "ended"]
        values = dict(zip(names, numbers.tolist(), strict=True))
        ended = bytes(codes.astype(np.uint8)).decode() or None
        return Score(**values | {"arrived": bool(values["arrived"])}, ended=ended)


def score(log: Log, *, settle: float = SETTLE, band: float = BAND, disturbed: Sequence[float] = ()) -> Score:
    """Score a run by how far it was from the reference once it had settled, and by what that took.

    Parameters
    ----------
    log : Log
        With reference, torques and wheel angles; the true position counts where the log has it.
    settle : float
        See `ballbot.experiments.metrics.settled` [s].
    band, disturbed
        See `ballbot.experiments.metrics.settling_time`.

    Raises
    ------
    InputError
        Where a run that did not end early has no row that counts.
    """
    counted = settled(log, settle)
    if not counted.any() and log.ended is None:
        raise InputError(
            f"No sample of the run is {settle:g} s after the start and after every jump of the reference. "
            "Use a longer run or a shorter settling time."
        )
    position, heading = position_error(log)[counted], heading_error(log)[counted]
    arriving, arrived = settling_time(log, band=band, disturbed=disturbed)
    energy, driving_energy = energies(log)
    return Score(
        peak_position_error=float(position.max()) if counted.any() else np.nan,
        rms_position_error=rms(position) if counted.any() else np.nan,
        peak_heading_error=float(heading.max()) if counted.any() else np.nan,
        rms_heading_error=rms(heading) if counted.any() else np.nan,
        settling_time=arriving,
        arrived=arrived and log.ended is None,
        rms_torque=rms_torque(log),
        rms_torque_change=rms_torque_change(log),
        high_frequency_torque=high_frequency_torque(log) if _holds_high_frequencies(log) else np.nan,
        energy=energy,
        driving_energy=driving_energy,
        ended=log.ended,
    )


def _holds_high_frequencies(log: Log) -> bool:
    return len(log) > 1 and 0.5 / log.sample_time > HIGH_FREQUENCY
