"""Scores of runs."""

from ballbot.workflows.metrics import Score

_FIELDS = ("rms_position_error", "peak_heading_error", "settling_time", "rms_torque")


def score_of(peak: float, roughness: float = 0.05, ended: str | None = None) -> Score:
    """Return the score of a run of which only the peak error, the roughness and the end matter."""
    return Score(
        peak_position_error=peak,
        rms_torque_change=roughness,
        arrived=True,
        high_frequency_torque=0.1,
        energy=1.0,
        ended=ended,
        **dict.fromkeys(_FIELDS, 0.5 * peak),
    )
