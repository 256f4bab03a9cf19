"""Records of an axis with known mass and friction, for tests of its identification."""

import numpy as np

from ballbot.identification.axis import AXIS_LAWS, AxisRecord, PositionVelocityLoop
from ballbot.identification.axis.model import Axis

TRUTH = {"mass": 95.0, "viscous": 200.0, "coulomb": 20.0, "offset": -3.0}
LOOP = PositionVelocityLoop(position_gain=160.0, velocity_gain=243.0, force_per_input=35.0, limit=10.0)
SAMPLE_TIME = 1e-3


def reference(duration: float) -> np.ndarray:
    """Return a smooth to and fro at several speeds [m]."""
    t = np.arange(round(duration / SAMPLE_TIME)) * SAMPLE_TIME
    return 0.1 * (1.0 - np.cos(2.0 * np.pi * t / 3.0)) + 0.02 * np.sin(2.0 * np.pi * t / 0.7)


def simulated_record(
    *,
    law: str = "coulomb",
    values: dict[str, float] | None = None,
    duration: float = 12.0,
    noise: float = 0.0,
    seed: int = 0,
    wanted: np.ndarray | None = None,
) -> AxisRecord:
    """Return the record of an axis that its loop moves along `wanted`, by default `reference`.

    Noise [N] acts on it and is not recorded.
    """
    wanted = reference(duration) if wanted is None else wanted
    empty = AxisRecord(
        name="simulated",
        sample_time=SAMPLE_TIME,
        force=np.zeros(len(wanted)),
        position=wanted,
        reference=wanted,
        loop=LOOP,
    )
    axis = Axis(law=AXIS_LAWS[law], values=values or TRUTH)
    positions, forces = axis.closed_loop(empty, speed=float((wanted[1] - wanted[0]) / SAMPLE_TIME))
    random = np.random.default_rng(seed)
    # a disturbance of 50 ms, so that its effect is no white noise
    steps = np.repeat(random.standard_normal(len(wanted) // 50 + 1), 50)[: len(wanted)]
    return AxisRecord(
        name="simulated",
        sample_time=SAMPLE_TIME,
        force=forces + noise * steps,
        position=positions,
        reference=wanted,
        loop=LOOP,
    )
