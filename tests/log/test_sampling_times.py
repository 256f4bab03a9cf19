"""When rows were sampled, by the encoders: synthetic logs with known times, and the course robots' own."""

import numpy as np
import pytest

from ballbot.log.formats import read_foreign_table
from ballbot.log.signals import sampling_times, speed_noise

COUNT = 2.0 * np.pi / 4480.0  #: [rad], one encoder count of the course robots' wheels


def wheels(t: np.ndarray) -> np.ndarray:
    """Return three wheels' angles (N, 3) [rad], fast most of the time."""
    return np.column_stack([4.0 * np.sin(1.3 * t), 3.0 * np.cos(1.7 * t), 2.5 * np.sin(2.1 * t + 1.0)])


def latest_messages(*, period: float, poll: float, seconds: float = 40.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the host's times and the times of the latest message at each, as a host that polls would log them."""
    rng = np.random.default_rng(5)
    host = np.cumsum(poll * (1.0 + 0.02 * rng.standard_normal(round(seconds / poll))))
    return host, period * np.floor(host / period)


@pytest.mark.parametrize(("period", "poll"), [(0.005, 0.0115), (0.01, 0.0115)])
def test_times_of_messages_are_found(period, poll):
    host, sent = latest_messages(period=period, poll=poll)
    angles = COUNT * np.round(wheels(sent) / COUNT)
    found = sampling_times(host, angles)
    fast = np.abs(wheels(sent + 1e-3) - wheels(sent)).max(axis=1)[1:] / 1e-3 > 3.0
    fast[:50] = fast[-50:] = False
    # intervals, as the times have a constant and a slow drift that no wheel shows; a count at 3 rad/s lasts 0.5 ms
    assert (np.diff(found) - np.diff(sent))[fast].std() < 5e-4
    # what was off: the host's clock against the messages'
    assert (np.diff(host) - np.diff(sent)).std() > 0.6e-3
    assert speed_noise(found, angles) < 0.3 * speed_noise(host, angles)


def test_correct_times_are_left_unchanged():
    t = 0.01 * np.arange(3000)
    angles = COUNT * np.round(wheels(t) / COUNT)
    # a count at 3 rad/s lasts 0.5 ms; the repair must not add more than that
    assert (sampling_times(t, angles) - t).std() < 3e-4


@pytest.mark.sample
@pytest.mark.parametrize(
    ("name", "columns", "scale"),
    [
        ("main_control_1", ("psi_1", "psi_2", "psi_3"), 1.0),
        ("main_control_autotune_1", ("psi_1", "psi_2", "psi_3"), 1.0),
        ("lab10_data_trial_408", ("psi_1", "psi_2", "psi_3"), COUNT),
        ("Test-Results_test_motors_1", ("enc_1", "enc_2", "enc_3"), COUNT),
    ],
)
def test_the_course_robots_noise_is_repaired(shared_data, name, columns, scale):
    table = read_foreign_table(shared_data / "rob311" / f"{name}.txt").columns
    t, angles = table["t_now"], scale * np.column_stack([table[column] for column in columns])
    assert speed_noise(t, angles) > 0.8
    # 0.25 rad/s is required; of the three wheels' errors the times take up one
    assert speed_noise(sampling_times(t, angles), angles) <= 0.25 * np.sqrt(2.0 / 3.0)
