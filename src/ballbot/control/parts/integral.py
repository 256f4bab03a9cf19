"""Integral action: it removes lasting errors of position and heading.

    I' = e - I/T        e the error of x, y and psi, world frame; I is limited, does not grow while a wheel's
                        torque is at its limit (anti-windup) or the reference accelerates, and is constant while e
                        is in the dead band
    u += K_I S(psi) I

A tilted floor, an offset of the AHRS's lean and uncompensated friction all cause such an error. The leak 1/T lets I
decay; with it a constant push leaves the error e = I/T instead of zero. The dead band prevents hunting of a robot that
sticks within it: an integral that grows until a wheel breaks away ends in a limit cycle.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import GetPydanticSchema

from ballbot.arrays import real_array
from ballbot.control.parts.part import LawSettings, Part, clipped, turned, turned_back
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import Parameter, parameter

#: acceleration of the reference beyond which errors come from the motion, not from a lasting disturbance [m/s^2]
_BRISK = 0.125


@dataclass(frozen=True, kw_only=True, eq=False)
class IntegralRecord:
    """The sampled integral."""

    on: int = field(default=1, metadata=whole())
    step: float = field(metadata=number("s"))
    kept: float = field(metadata=number("1"))
    limit: float = field(metadata=number("m s"))
    yaw_limit: float = field(metadata=number("rad s"))
    dead_band: float = field(metadata=number("m"))
    gain: NDArray[np.float64] = field(metadata=number("N m/(m s)", MAX_WHEELS, 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class IntegralState:
    """The integrals of x, y [m s] and psi [rad s], world frame."""

    sums: NDArray[np.float64] = field(metadata=number("m s", 3))


@inlined
def add_integral(law, memory, now, torques, n):
    """Add the torques for the integrals."""
    own, tuned, sums = law.integral, memory.tuning, memory.integral.sums
    if own.on == 0:
        return
    I = turned(now.a, sums[0], sums[1])  # noqa: E741 (as in the formula above)
    for i in range(n):
        gain, more = own.gain[i], tuned.integral[i]
        torques[i] += gain[0] * I.x + gain[1] * I.y + gain[2] * sums[2]
        if law.tuning.others > 0:
            torques[i] += more[0] * I.x + more[1] * I.y + more[2] * sums[2]


@inlined
def learn_integral(law, memory, now, limited):
    """Step the integrals by a sample's error; while something is `limited` they may only shrink."""
    own, sums = law.integral, memory.integral.sums
    if own.on == 0:
        return
    e, e_psi = turned_back(now.a, now.e.x, now.e.y), now.e.psi
    still = limited or now.to.x.second * now.to.x.second + now.to.y.second * now.to.y.second > _BRISK * _BRISK
    if e.x * e.x + e.y * e.y > own.dead_band * own.dead_band:
        sums[0] = _stepped(sums[0], own.kept, own.step * e.x, own.limit, still)
        sums[1] = _stepped(sums[1], own.kept, own.step * e.y, own.limit, still)
    if abs(e_psi) > own.dead_band:
        sums[2] = _stepped(sums[2], own.kept, own.step * e_psi, own.yaw_limit, still)


@inlined
def _stepped(value, kept, change, limit, limited):
    """Return an integral after a sample."""
    after = clipped(kept * value + change, limit)
    return value if limited and abs(after) > abs(value) else after


#: schema of a matrix in a file
_ROWS = GetPydanticSchema(lambda _, schema_of: schema_of(tuple[tuple[float, ...], ...]))


@dataclass(frozen=True, kw_only=True, eq=False)
class IntegralAction(Part):
    """Feed back the integral of the error, to correct a lasting error of position or heading.

    Adds the torques K_I S(psi) I (n,) [N m]. I is the integral of r - x for x, y [m s] and psi [rad s] in the world
    frame, S(psi) turns it into the heading frame, and `gain` K_I (n, 3) has a row for each wheel. The integral is
    bounded, forgets over `memory`, and does not grow while a torque is at its limit.

    InputError if the gain is not finite, has not a row for each wheel of the robot, or a number is outside its range.
    """

    label = "integral action"
    comment = "The error's integral is fed back, a row of `gain` for each wheel [N m per m s, m s, rad s]."
    record = IntegralRecord
    state = IntegralState

    gain: Annotated[NDArray[np.float64], _ROWS] = field(
        metadata={"matrix": Parameter("K_I for the integrals of x, y and psi", "N m/(m s)")}
    )
    limit: float = parameter("of the integral of x, and of y", "m s", default=0.3)
    yaw_limit: float = parameter("of the integral of psi", "rad s", default=0.5)
    memory: float = parameter("time T over which it forgets", "s", default=60.0)
    dead_band: float = parameter(
        "error of x and y, and of psi, below which the integrals rest", "m, rad", default=0.0, least=0.0
    )

    def __post_init__(self) -> None:
        gain = real_array(self.gain, ("wheels", 3), "gain of the integral action")
        object.__setattr__(self, "gain", gain.copy())
        super().__post_init__()

    def numbers(self, settings: LawSettings) -> IntegralRecord:
        """Return the sampled integral."""
        wheels = len(settings.gain)
        if len(self.gain) != wheels:
            raise InputError(
                f"The integral action is for {len(self.gain)} wheels; this robot has {wheels} wheels."
            )
        return IntegralRecord(
            step=settings.sample_time,
            kept=math.exp(-settings.sample_time / self.memory),
            limit=self.limit,
            yaw_limit=self.yaw_limit,
            dead_band=self.dead_band,
            gain=self.gain,
        )
