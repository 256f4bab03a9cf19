"""Logs for tests: any that can be, and one made of sines, each rate its angle's exact derivative, without noise."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from ballbot.log import STATE_NAMES, Log
from ballbot.robot import Robot

#: amplitude [m, m, rad, rad, rad] and angular frequencies [rad/s] of x, y, theta, phi, psi
AMPLITUDES = (0.3, 0.2, 0.02, 0.03, 0.4)
FREQUENCIES = (1.1, 0.7, 2.3, 1.9, 0.9)
COLUMN_NAMES = st.text(st.characters(codec="utf-8", categories=["L", "N"]), min_size=1, max_size=12)


@st.composite
def any_logs(draw, column_names: st.SearchStrategy[str] = COLUMN_NAMES) -> Log:
    """Draw a log of uneven times with any values."""
    rows = draw(st.integers(1, 12))
    steps = draw(hnp.arrays(np.float64, rows, elements=st.floats(1e-6, 1e3)))
    names = draw(st.lists(column_names.filter(lambda name: name != "t"), max_size=4, unique=True))
    # every double there is, among them subnormal ones, infinities, NaN and minus zero
    values = hnp.arrays(np.float64, rows, elements=st.floats(allow_nan=True, allow_infinity=True, width=64))
    return Log({"t": draw(st.floats(-1e3, 1e3)) + np.cumsum(steps)} | {name: draw(values) for name in names})


def smooth_log(*, rows: int = 2000) -> Log:
    """Return a log with t, three torques and the ten states."""
    t = 0.005 * np.arange(rows)
    waves = list(zip(AMPLITUDES, FREQUENCIES, strict=True))
    states = [a * np.sin(f * t) for a, f in waves] + [a * f * np.cos(f * t) for a, f in waves]
    torques = {f"u{i}": 0.5 * np.sin((0.8 + 0.3 * i) * t) + 0.1 for i in (1, 2, 3)}
    return Log({"t": t, **torques, **dict(zip(STATE_NAMES, states, strict=True))})


def with_wheels(log: Log, robot: Robot) -> Log:
    """Return the log with the wheel speeds of its states, by another way than the toolkit's.

    The ball's surface under wheel i moves past the body, in the world's frame, at (Omega - w) x r_i; its part
    along the rolling direction over the wheel's radius is the speed that the encoder sees.
    """
    angles = np.column_stack([log["theta"], log["phi"], log["psi"]])
    turn = Rotation.from_euler("XYZ", angles)  # intrinsic: Rx Ry Rz
    dt = np.gradient(log.t)
    # the angular velocity from finite rotations, not from the rates' formula
    body_turning = (turn[:-2].inv() * turn[2:]).as_rotvec() / (2.0 * dt[1:-1, None])
    w = turn[1:-1].apply(body_turning)
    Omega = np.column_stack([-log["y_dot"], log["x_dot"], np.zeros(len(log))])[1:-1] / robot.ball.radius
    tilt, speeds = robot.wheels.tilt, {}
    for i, azimuth in enumerate(robot.wheels.azimuths, start=1):
        along = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        contact = np.array([np.cos(azimuth) * np.sin(tilt), np.sin(azimuth) * np.sin(tilt), np.cos(tilt)])
        r = robot.ball.radius * turn[1:-1].apply(contact)
        surface = np.cross(Omega - w, r)
        speeds[f"wheel{i}_dot"] = np.sum(surface * turn[1:-1].apply(along), axis=1) / robot.wheels.radius
    return log.select(slice(1, -1)).with_columns(speeds)
