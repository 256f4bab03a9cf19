"""Changes while the robot balances: a mixture of gains, and less compensation.

A `Setting` is relative to the controller as it was made: weights of its own gain and of the others that it has, and
a share of its compensation. Its limits stay: a robot at speed could not be caught with lower ones. The law moves from
the setting in use to the one that is asked for along a straight line, at most 1/`CHANGE_TIME` a second in each number,
so that no torque jumps and every setting on the way is a mixture, too. The lean that errors command is mixed like the
gain; it is exact for each gain by itself.

In the memory every number is a difference from the controller as it was made, so that zeros are the start of a run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole

#: gains that may be mixed, with the controller's own
MAX_GAINS = 3
#: in which a weight or a share changes from 0 to 1 [s]
CHANGE_TIME = 1.0
#: by which rounding may move the sum of the weights from 1
ROUNDING = 1e-5
#: index in a setting, after the weights of the other gains
_COMPENSATION = MAX_GAINS - 1
_NUMBERS = MAX_GAINS


@dataclass(frozen=True, kw_only=True, eq=False)
class TuningRecord:
    """What may change while the robot balances: the differences of other gains from the law's own, and bounds."""

    #: other gains
    others: int = field(metadata=whole())
    #: largest change of a weight or a share in a sample
    step: float = field(metadata=number("1"))
    #: largest share of the compensation that can be asked for
    compensation: float = field(metadata=number("1"))
    gain: NDArray[np.float64] = field(metadata=number("N m per state", MAX_GAINS - 1, MAX_WHEELS, 10))
    integral: NDArray[np.float64] = field(metadata=number("N m/(m s)", MAX_GAINS - 1, MAX_WHEELS, 3))
    #: of the lean limit
    asked: NDArray[np.float64] = field(metadata=number("rad/m", MAX_GAINS - 1, 2, 4))
    turn_rate: NDArray[np.float64] = field(metadata=number("s", MAX_GAINS - 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class TuningState:
    """Weights of the other gains, and what the compensation is reduced by; zeros: nothing."""

    wanted: NDArray[np.float64] = field(metadata=number("1", _NUMBERS))
    #: the setting before the last change
    former: NDArray[np.float64] = field(metadata=number("1", _NUMBERS))
    now: NDArray[np.float64] = field(metadata=number("1", _NUMBERS))
    #: what is added to the law's own
    gain: NDArray[np.float64] = field(metadata=number("N m per state", MAX_WHEELS, 10))
    integral: NDArray[np.float64] = field(metadata=number("N m/(m s)", MAX_WHEELS, 3))
    asked: NDArray[np.float64] = field(metadata=number("rad/m", 2, 4))
    turn_rate: float = field(metadata=number("s"))


@inlined
def tune(law, memory):
    """Move the setting in use towards the one that is asked for."""
    own, state = law.tuning, memory.tuning
    largest = 0.0
    for k in range(_NUMBERS):
        largest = max(largest, abs(state.wanted[k] - state.now[k]))
    if largest == 0.0:
        return
    for k in range(_NUMBERS):
        if largest <= own.step:
            state.now[k] = state.wanted[k]
        else:
            state.now[k] += own.step / largest * (state.wanted[k] - state.now[k])
    if own.others == 0:
        return
    first, second = state.now[0], state.now[1]
    for i in range(MAX_WHEELS):
        for j in range(10):
            state.gain[i, j] = first * own.gain[0, i, j] + second * own.gain[1, i, j]
        for j in range(3):
            state.integral[i, j] = first * own.integral[0, i, j] + second * own.integral[1, i, j]
    for i in range(2):
        for j in range(4):
            state.asked[i, j] = first * own.asked[0, i, j] + second * own.asked[1, i, j]
    state.turn_rate = first * own.turn_rate[0] + second * own.turn_rate[1]


@inlined
def compensated_share(memory):
    """Return the share of the compensation in use: whatever a memory holds, none and no more than the law's own."""
    return max(0.0, min(1.0, 1.0 - memory.tuning.now[_COMPENSATION]))


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a controller can change to while the robot balances; by default, itself as it was made."""

    weights: tuple[float, ...] = (1.0,)  #: of its own gain and of the others, with a sum of 1
    compensation: float = 1.0  #: share of its compensation

    def words(self) -> str:
        """Return the setting as a clause."""
        weights = " ".join(f"{weight:.3g}" for weight in self.weights)
        return f"gain {weights}, compensation {self.compensation:.3g}"

    def numbers(self) -> list[float]:
        """Return the setting as `TuningState` has it."""
        others = [*self.weights[1:], *([0.0] * (MAX_GAINS - len(self.weights)))]
        return [*others, 1.0 - self.compensation]


def check_setting(own: np.void, setting: Setting) -> None:
    """Raise InputError unless a setting lies within the bounds of a law's record of `TuningRecord`."""
    weights, gains = setting.weights, int(own["others"]) + 1
    if len(weights) > gains:
        raise InputError(
            f"{len(weights)} weights are given; the controller has {gains} gain{'s'[: gains - 1]}. Export it with "
            "others (--with)."
        )
    outside = max(*(-weight for weight in weights), *(weight - 1.0 for weight in weights))
    if not outside <= 0.0 or not abs(sum(weights) - 1.0) <= ROUNDING:
        raise InputError(
            f"The gain {' '.join(f'{weight:.3g}' for weight in weights)} is no mixture of the exported gains: each "
            f"weight must be 0 to 1 and their sum 1; it is {max(outside, abs(sum(weights) - 1.0)):.2g} away."
        )
    most = float(own["compensation"])
    if not 0.0 <= setting.compensation <= most + ROUNDING:
        raise InputError(
            f"The share of the compensation is {setting.compensation:.3g}; it must be 0 to {most:.3g}, the certain one."
        )


def take_setting(own: np.void, state: np.void, setting: Setting | None) -> None:
    """Let a law move to a setting, or to the former one (None), by its records of `TuningRecord` and `TuningState`.

    The same setting again leaves the former one. InputError as `check_setting`.
    """
    wanted = state["former"].copy()
    if setting is not None:
        check_setting(own, setting)
        wanted[:] = setting.numbers()
        if (wanted != state["wanted"]).any():
            state["former"] = state["wanted"]
    wanted[_COMPENSATION] = max(wanted[_COMPENSATION], 1.0 - own["compensation"])
    state["wanted"] = wanted


def add_gains(law: NDArray[np.void], others: Sequence[NDArray[np.void]]) -> None:
    """Add the gains of other laws, which are records (1,) as this one, to those that it can mix."""
    own = law["tuning"]
    own["others"] = len(others)
    for k, other in enumerate(others):
        own["gain"][0, k] = (other["gain"] - law["gain"])[0]
        own["integral"][0, k] = (other["integral"]["gain"] - law["integral"]["gain"])[0]
        for name in ("asked", "turn_rate"):
            own[name][0, k] = (other["lean_limit"][name] - law["lean_limit"][name])[0]
