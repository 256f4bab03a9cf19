"""Alignment on measured data: a trial of BROAD, and the stand-in robot's motion capture."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ballbot.identification.turning import Clock
from ballbot.log import Log
from ballbot.validation.alignment import Alignment, align, alignment_findings

#: required accuracy
ONE_MILLISECOND, TENTH_OF_A_DEGREE = 1e-3, np.radians(0.1)
#: the trial's own lag, published as 1.2 samples of 1/285.714 s [s]
LAG = 4.2e-3


@cache
def broad(path: Path) -> tuple[Log, NDArray[np.float64], NDArray[np.bool_]]:
    """Return 40 s of the trial: gyro as a log, optical quaternions wxyz with NaN, and the movement's rows."""
    trial = scipy.io.loadmat(path)
    rate = float(trial["sampling_rate"][0, 0])
    part = slice(round(20.0 * rate), round(60.0 * rate))  # the body moves from 26 s on
    gyro = trial["imu_gyr"][part]
    log = Log(
        {"t": np.arange(len(gyro)) / rate} | {f"gyro_{axis}": gyro[:, i] for i, axis in enumerate("xyz")}
    )
    return log, trial["opt_quat"][part], trial["movement"][part, 0].astype(bool)


@pytest.fixture(scope="module")
def trial(shared_data: Path) -> tuple[Log, NDArray[np.float64], NDArray[np.bool_]]:
    path = shared_data / "broad" / "07_undisturbed_fast_rotation_B.mat"
    if not path.is_file():
        pytest.skip(f"no trial at {path}")
    return broad(path)


def film(
    t: NDArray[np.float64], wxyz: NDArray[np.float64], clock: Clock, world: Rotation, marker: Rotation
) -> Log:
    """Return the optical record on another clock and in other frames."""
    seen = np.isfinite(wxyz).all(axis=1)
    turned = np.full_like(wxyz, np.nan)
    turned[seen] = (world * Rotation.from_quat(wxyz[seen][:, [1, 2, 3, 0]]) * marker).as_quat()[
        :, [3, 0, 1, 2]
    ]
    return Log(
        {"t": clock.to_cameras(t)} | {name: turned[:, i] for i, name in enumerate(("qw", "qx", "qy", "qz"))}
    )


@pytest.fixture(scope="module")
def untouched(trial) -> Alignment:
    log, wxyz, _ = trial
    return align(
        log, film(log.t, wxyz, Clock(offset=0.0, rate=0.0), Rotation.identity(), Rotation.identity())
    )


@pytest.mark.slow
def test_broads_own_lag_is_found(untouched: Alignment):
    clock = untouched.motion.clock
    # to a fifth of a sample; the cameras' clock is the recorder's, and its markers were aligned before
    assert clock.offset == pytest.approx(-LAG, abs=0.7e-3)
    assert abs(clock.rate) < 5e-6
    assert untouched.motion.body_marker.magnitude() < 2.0 * TENTH_OF_A_DEGREE


@pytest.mark.slow
def test_errors_injected_into_broad_are_recovered(trial, untouched):
    log, wxyz, moving = trial
    # the log's own attitude: the optical one while the body moves, as late as the gyro is
    seen = np.isfinite(wxyz).all(axis=1)
    attitude = Slerp(log.t[seen], Rotation.from_quat(wxyz[seen][:, [1, 2, 3, 0]]))
    rows = np.flatnonzero(seen & moving)
    angles = np.full((len(log), 3), np.nan)
    angles[rows] = attitude(log.t[rows] - LAG).as_euler("XYZ")
    log = log.with_columns(dict(zip(("theta", "phi", "psi"), angles.T, strict=True)))
    injected, world = Clock(offset=-71.9, rate=-3e-3), Rotation.from_euler("XYZ", [3.0, 0.4, -0.7])
    body_marker = Rotation.from_euler("XYZ", [1.5, -0.4, 2.9])
    found = align(log, film(log.t, wxyz, injected, world, body_marker))
    # injected on top of the lag, which is the log's: at both ends
    ends = log.t[[0, -1]]
    expected = injected.to_cameras(ends - LAG)
    np.testing.assert_allclose(found.motion.clock.to_cameras(ends), expected, rtol=0.0, atol=ONE_MILLISECOND)
    true = untouched.motion.body_marker * body_marker
    assert (found.motion.body_marker.inv() * true).magnitude() < TENTH_OF_A_DEGREE
    assert found.frame is not None
    assert (found.frame.camera_world.inv() * world).magnitude() < TENTH_OF_A_DEGREE


def test_the_stand_ins_heading_drifts_and_its_position_follows(shared_data):
    folder = shared_data / "bbr"
    if not (folder / "hold_soft_mocap.csv").is_file():
        pytest.skip("no hold_soft_mocap.csv")
    found = align(Log.read(folder / "hold_soft.csv"), Log.read(folder / "hold_soft_mocap.csv"))
    assert found.sensors is not None
    position = found.sensors.position
    assert position is not None
    words = alignment_findings(found)[0].text
    drift = re.match(r"Heading drifts ([\d.]+) ± ", words)
    assert drift is not None
    assert float(drift[1]) == pytest.approx(4.0, abs=0.051)
    assert "position error follows it" in words
    assert position.by_heading > 0.8
    # as in the thesis: leans right to far better than a degree
    assert max(found.sensors.of[lean].largest for lean in ("theta", "phi")) < np.radians(0.3)
    assert found.motion.offset_half_width < ONE_MILLISECOND
