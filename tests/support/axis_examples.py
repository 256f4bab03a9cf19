"""Records of a slide with known mass and friction, simulated apart from Ballbot."""

from functools import cache

from ballbot.identification.axis import AxisRecord
from tests.support.axis_machines import Logging, Machine, record_of

TRUTH = {"mass": 95.0, "viscous": 200.0, "coulomb": 20.0, "offset": -3.0}
SAMPLE_TIME = 1e-3


@cache
def simulated_record(*, duration: float = 9.0, noise: float = 0.0) -> AxisRecord:
    """Return the record of a slide that moves to and fro at several speeds, with that noise of its force [N]."""
    machine = Machine(kind="cart", inertia=95.0, viscous=200.0, coulomb=20.0, offset=-3.0)
    logging = Logging(
        duration=duration, rate=1.0 / SAMPLE_TIME, amplitude=0.2, slowest=0.3, fastest=1.4, force_noise=noise
    )
    return record_of(machine, logging, seed=0, name="simulated")
