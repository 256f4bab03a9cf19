"""The parts of identification, each against an independent calculation; wheels that chatter within the play."""

import re

import numpy as np
import pytest

from ballbot import Log
from ballbot.errors import InputError
from ballbot.identification.excitation import chatter_findings, check_excitation
from ballbot.identification.quantities import read_bounds, scale_between
from ballbot.identification.windows import cut_windows
from ballbot.log.pose import wheel_speeds_of_states
from ballbot.mechanics.geometry import transforms
from tests.support.control_examples import alten
from tests.support.log_examples import smooth_log

FREE = ("friction", "pivoting")

# --- windows ---


def test_gaps_missing_values_and_falls_are_passed_over():
    log = smooth_log(rows=1001)
    columns = dict(log.columns)
    columns["t"] = log.t + np.where(np.arange(1001) >= 420, 0.3, 0.0)  # rows 419 to 420: a gap
    columns["u2"] = np.where(np.arange(1001) == 130, np.nan, log["u2"])
    columns["theta"] = np.where(np.arange(1001) >= 900, 1.0, log["theta"])  # fallen
    windows = cut_windows([Log(columns)], wheel_count=3, duration=0.25)
    starts = [int(np.searchsorted(columns["t"], span.start - 1e-9)) for span in windows.spans]
    expected = [0, 50, *range(131, 370, 50), *range(420, 850, 50)]
    assert starts == expected
    assert np.isfinite(windows.measured).all()
    assert np.isfinite(windows.torques).all()


def test_a_wheel_that_hardly_turns_is_named():
    # rolling straight ahead turns wheels 2 and 3; wheel 1, in front, is carried sideways on its rollers
    log = smooth_log(rows=4000)
    ahead = dict.fromkeys(("y", "theta", "psi", "y_dot", "theta_dot", "psi_dot"), np.zeros(len(log)))
    windows = cut_windows([log.with_columns(ahead)], wheel_count=3, duration=0.25)
    coordinates = scale_between(alten(), free=("friction", "torque_gain"))
    refused, findings = check_excitation(windows, alten(), coordinates)
    assert findings[0].text.startswith("Wheel 1 turns in only 0 of")
    assert np.array(coordinates.labels)[refused].tolist() == ["b1", "c1", "s1", "gain1"]


@pytest.mark.parametrize(("share", "known"), [(0.0, False), (0.1, False), (0.3, True), (-0.3, True)])
def test_pivoting_is_estimated_only_where_the_ball_pivots(share: float, known: bool):
    log, robot = smooth_log(rows=4000), alten()
    # the wheels of a ball that rolls, and of one that spins with or against the heading besides; play and rollers
    about_z = np.linalg.solve(transforms(robot).T_obw, [0.0, 0.0, 1.0])
    spin = share * log["psi_dot"] + 0.3 * np.random.default_rng(0).standard_normal(len(log))
    speeds = wheel_speeds_of_states(log.states, robot) + spin[:, None] * about_z
    log = log.with_columns({f"wheel{i + 1}_dot": speeds[:, i] for i in range(3)})
    windows, coordinates = cut_windows([log], wheel_count=3, duration=0.25), scale_between(robot, free=FREE)
    refused, findings = check_excitation(windows, robot, coordinates, logs=[log])
    assert bool(refused[coordinates.names.index("pivoting")]) is not known
    assert known or "The ball pivots by" in findings[-1].text


# --- bounds ---


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("coulom = [0, 1]", "'coulom' is not a quantity that can be identified; did you mean 'coulomb'?"),
        ("coulomb = 0.3", "coulomb is 0.3; write two numbers"),
        ("coulomb = [0.3, 0.1]", "the lower one must come first"),
        ("viscous = [-1, 1]", "lower bound of viscous is -1; it must be zero or more"),
    ],
)
def test_wrong_bounds_are_refused_with_the_file(tmp_path, text, sentence):
    path = tmp_path / "bounds.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"bounds\.toml.*{re.escape(sentence)}"):
        read_bounds(path)


PLAY = alten().drive.backlash


def log_of(angle: np.ndarray) -> Log:
    """Return a log at 200 Hz of three wheels at that angle."""
    speed = np.gradient(angle, 0.005)
    return Log({"t": 0.005 * np.arange(len(angle))} | {f"wheel{i}_dot": speed for i in (1, 2, 3)})


def test_swings_as_long_as_the_play_are_chatter():
    t = 0.005 * np.arange(2000)
    (finding,) = chatter_findings(log_of(0.5 * PLAY * np.sin(2 * np.pi * 10 * t)), alten(), "a log")
    # twenty samples a turn miss its ends by 1 %
    assert finding.text.startswith("In a log the wheels oscillate by 1.0 deg for 100 % of the time")
    # longer swings are motion
    assert chatter_findings(log_of(20.0 * PLAY * np.sin(2 * np.pi * t)), alten(), "a log") == []
