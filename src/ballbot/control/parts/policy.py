"""A learned policy: a network of two layers of tanh units that gives torques in place of the linear law, or beside it.

    u = f K S(psi) (r - x) + s N(o)        f: 0 for a policy alone, 1 for one that is added

The observation o is that of `ballbot.learning.tasks`: errors in the heading frame over `SCALES`, then the policy's last
torques over their limit. The velocity asked for is the difference of two references. The policy decides every so many
samples, and its torques are held. Outside the lean and the speed at which it was trained the linear law acts alone.

Its weights stand behind the record in a controller's numbers (`Controller.packed`), each row's bias at its end.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import GetPydanticSchema

from ballbot.arrays import real_array
from ballbot.control.parts.part import LawSettings, Part, clipped, turned
from ballbot.errors import InputError
from ballbot.estimation.heading import TURN
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import Parameter, parameter

#: of what a policy observes and does, in controller files, contracts and environments: a change of it counts it up
VERSION = 0
#: decisions whose torques are observed
HISTORY = 3
#: entries of an observation before those torques
ERRORS = 10
#: sizes that count as 1: of position [m], lean, heading [rad], velocity [m/s], lean rate and turning rate [rad/s]
SCALES = (0.25, 0.25, 0.1, 0.1, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0)
#: entries are shown up to so many of these sizes; farther away than two only a place's direction matters
SHOWN = (2.0, 2.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0)
#: a reference that moves faster jumps: then no velocity is asked for [m/s, rad/s]
JUMP_RATE = 3.0


def observation_size(wheels: int) -> int:
    """Return the length of an observation of a robot with so many wheels."""
    return ERRORS + HISTORY * wheels


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyRecord:
    """A policy without its weights."""

    on: int = field(default=1, metadata=whole())
    feedback: float = field(metadata=number("1"))
    torque_scale: float = field(metadata=number("N m"))
    torque_limit: float = field(metadata=number("N m"))
    largest_lean: float = field(metadata=number("rad"))
    largest_speed: float = field(metadata=number("m/s"))
    rate: float = field(metadata=number("1/s"))
    period: int = field(metadata=whole())
    #: units of both hidden layers, and the number of wheels
    hidden: int = field(metadata=whole())
    wheels: int = field(metadata=whole())
    #: of the weights in single precision, so that firmware refuses numbers that belong to other ones
    checksum: int = field(metadata=whole())


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyState:
    """What a policy remembers from sample to sample."""

    started: int = field(metadata=whole())
    #: samples since the last decision
    waited: int = field(metadata=whole())
    #: x, y, psi of the last reference, psi without turns that were added
    asked: NDArray[np.float64] = field(metadata=number("m, m, rad", 3))
    #: torques of the last decisions, the newest first
    past: NDArray[np.float64] = field(metadata=number("N m", HISTORY, MAX_WHEELS))


@inlined
def _rate_asked(memory, i, value, rate):
    """Return the rate of a reference of x, y or psi, whose whole turns are no motion, and keep the reference."""
    own = memory.policy
    change = value - own.asked[i] if own.started == 1 else 0.0
    own.asked[i] = value
    asked = (change - TURN * math.floor(change / TURN + 0.5) if i == 2 else change) * rate
    return asked if abs(asked) <= JUMP_RATE else 0.0


@inlined
def _layer(weights, at, inputs, outputs, curved):
    """Fill the outputs of a layer whose rows of weights, each with its bias, begin at `at`; return where they end."""
    width = len(inputs)
    for k in range(len(outputs)):
        row = weights[at : at + width]
        total = 0.0
        for j in range(width):
            total += row[j] * inputs[j]
        total += weights[at + width]
        outputs[k] = math.tanh(total) if curved else total
        at += width + 1
    return at


@inlined
def act(law, memory, weights, a, seen, pose, wanted):
    """Let a policy decide where it is due, for the robot's pose and the one that is asked for."""
    own, kept = law.policy, memory.policy
    if own.on == 0:
        return
    n = own.wheels
    v_x, v_y = _rate_asked(memory, 0, wanted.x, own.rate), _rate_asked(memory, 1, wanted.y, own.rate)
    # as it was asked for: single precision rounds a heading of many turns by too much
    v_psi = _rate_asked(memory, 2, memory.reference_heading.last, own.rate)
    kept.waited = kept.waited + 1 if kept.started == 1 else own.period
    kept.started = 1
    if kept.waited < own.period:
        return
    kept.waited = 0
    o = np.empty(ERRORS + HISTORY * n)
    o[0], o[1] = turned(a, wanted.x - pose.x, wanted.y - pose.y)
    o[2], o[3] = turned(a, -seen.theta, -seen.phi)
    o[4], o[9] = wanted.psi - pose.psi, v_psi - seen.psi_dot
    o[5], o[6] = turned(a, v_x - seen.x_dot, v_y - seen.y_dot)
    o[7], o[8] = turned(a, -seen.theta_dot, -seen.phi_dot)
    for i in range(ERRORS):
        o[i] = clipped(o[i] / SCALES[i], SHOWN[i])
    for k in range(HISTORY):
        for i in range(n):
            o[ERRORS + k * n + i] = kept.past[k, i] / own.torque_limit
    first, second, torques = np.empty(own.hidden), np.empty(own.hidden), np.empty(n)
    at = _layer(weights, 0, o, first, True)
    at = _layer(weights, at, first, second, True)
    _layer(weights, at, second, torques, False)
    for k in range(HISTORY - 1, 0, -1):
        for i in range(n):
            kept.past[k, i] = kept.past[k - 1, i]
    for i in range(n):
        kept.past[0, i] = clipped(own.torque_scale * torques[i], own.torque_limit)


@inlined
def within_policy(law, seen):
    """Return whether a policy acts: the state is like those at which it was trained."""
    own = law.policy
    lean, speed = max(abs(seen.theta), abs(seen.phi)), math.hypot(seen.x_dot, seen.y_dot)
    return own.on == 1 and lean <= own.largest_lean and speed <= own.largest_speed


@inlined
def with_policy(law, memory, torque, i):
    """Return a wheel's torque of the linear law with that of a policy that acts."""
    return law.policy.feedback * torque + memory.policy.past[0, i]


#: schema of a matrix in a file
_ROWS = GetPydanticSchema(lambda _, schema_of: schema_of(tuple[tuple[float, ...], ...]))


def _matrix(meaning: str) -> dict[str, Parameter]:
    return {"matrix": Parameter(meaning)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Policy(Part):
    """Let a learned network decide the torques, alone or added to the linear law's; `ballbot learn` makes it.

    A row of weights belongs to a unit, its bias at the end. They are kept in single precision, as firmware has them.

    InputError if the layers do not fit each other, the robot's wheels or the observation, or a number is out of range.
    """

    label = "policy"
    comment = "A learned policy decides the torques; `feedback` is the part of the linear law's torque that is kept."
    record = PolicyRecord
    state = PolicyState

    version: int = parameter(
        "version of what it observes and does; a policy of another version is refused",
        least=0.0,
        default=0,
    )
    feedback: float = parameter(
        "part of the linear law's torque that is kept: 0 for a policy alone, 1 for one that is added",
        least=0.0,
        most=1.0,
    )
    torque_scale: float = parameter("torque for an output of 1", "N m")
    torque_limit: float = parameter(
        "largest torque of the policy, by which those in its observation are divided", "N m"
    )
    period: float = parameter("between two decisions", "s")
    largest_lean: float = parameter(
        "at which it was trained; beyond it the linear law acts alone", "rad", most=0.6
    )
    largest_speed: float = parameter("at which it was trained; beyond it the linear law acts alone", "m/s")
    first: Annotated[NDArray[np.float64], _ROWS] = field(
        metadata=_matrix("weights of the first hidden layer")
    )
    second: Annotated[NDArray[np.float64], _ROWS] = field(
        metadata=_matrix("weights of the second hidden layer")
    )
    last: Annotated[NDArray[np.float64], _ROWS] = field(
        metadata=_matrix("weights of the output, a row for each wheel")
    )

    def __post_init__(self) -> None:
        for name in ("first", "second", "last"):
            weights = real_array(
                getattr(self, name), ("units", "weights"), f"The array of {name} weights of the policy"
            )
            object.__setattr__(self, name, weights.astype(np.float32).astype(np.float64))
        super().__post_init__()
        if self.version != VERSION:
            raise InputError(
                f"The policy was learned with version {self.version} of what a policy observes and does; here it is "
                f"version {VERSION}. Learn one again: ballbot learn."
            )
        units, wheels = len(self.first), len(self.last)
        wanted = ((units, observation_size(wheels) + 1), (units, units + 1), (wheels, units + 1))
        found = (self.first.shape, self.second.shape, self.last.shape)
        if found != wanted:
            raise InputError(f"The policy's layers have the shapes {found}; they must be {wanted}.")

    @property
    def weights(self) -> NDArray[np.float64]:
        """All weights in one row, as the law reads them."""
        return np.concatenate([self.first.ravel(), self.second.ravel(), self.last.ravel()])

    def numbers(self, settings: LawSettings) -> PolicyRecord:
        """Return the numbers beside the weights."""
        wheels, period = len(settings.gain), self.period / settings.sample_time
        if len(self.last) != wheels:
            raise InputError(f"The policy is for {len(self.last)} wheels; this robot has {wheels} wheels.")
        if round(period) < 1 or abs(period - round(period)) > 1e-6:
            raise InputError(
                f"The policy decides every {self.period:g} s; that must be a whole number of the controller's sample "
                f"times of {settings.sample_time:g} s."
            )
        return PolicyRecord(
            feedback=self.feedback,
            torque_scale=self.torque_scale,
            torque_limit=self.torque_limit,
            largest_lean=self.largest_lean,
            largest_speed=self.largest_speed,
            rate=1.0 / settings.sample_time,
            period=round(period),
            hidden=len(self.first),
            wheels=wheels,
            checksum=checksum(self.weights),
        )


def checksum(weights: NDArray[np.float64]) -> int:
    """Return a number of 24 bits, which single precision holds, for weights in single precision."""
    words = weights.astype(np.float32).view(np.uint32).astype(np.uint64)
    places = np.arange(1, len(words) + 1, dtype=np.uint64)
    return int((words * (places & np.uint64(0xFFFF)) & np.uint64(0xFFFFFFFF)).sum() % np.uint64(0xFFFFFD))
