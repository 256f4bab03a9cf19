"""Logs made by hand and controllers of one's own, for the tests of metrics and of the league."""

from collections.abc import Callable

import numpy as np

from ballbot import Log, Robot
from ballbot.arrays import Floats
from ballbot.control.interface import Feedback
from ballbot.log.columns import STATE_NAMES
from ballbot.workflows.candidates import parse_candidates

Column = Callable[[Floats], Floats] | float

#: a file of a user's own: a controller that works, ones that do not
OWN = '''\
import numpy as np
import ballbot
from ballbot.control.presets import design_gain


class Softer:
    """Four fifths of the nominal gain, and a memory that a run must not find again."""

    def __init__(self, robot):
        self.sample_time = robot.sensors.sample_time
        self._gain = 0.8 * design_gain(robot).gain
        self._updates = 0

    def reset(self):
        pass

    def update(self, t, state, reference):
        self._updates += 1
        assert self._updates <= 2000, "it remembers another run"
        return self._gain @ (reference - state)


class Limp:
    sample_time = 0.005

    def __init__(self, robot):
        self._wheels = robot.wheel_count

    def reset(self):
        pass

    def update(self, t, state, reference):
        return np.zeros(self._wheels)


class Late(Limp):
    def update(self, t, state, reference):
        if t > 0.5:
            raise ZeroDivisionError("no gain left")
        return super().update(t, state, reference)


class Odd(Limp):
    def update(self, t, state, reference):
        return "full speed"


class Timeless:
    def __init__(self, robot):
        self.sample_time = -1.0

    reset = update = print


def lazy(robot):
    return None


def broken(robot):
    return robot.no_such_thing


GAIN = 3
'''


def controllers_of(robot: Robot, *words: str) -> dict[str, Feedback]:
    """Return what these words of a command line name, by name."""
    return {one.name: one.controller(robot) for one in parse_candidates(words)}


def made_log(
    *, duration: float = 20.0, rate: float = 200.0, ended: str | None = None, **columns: Column
) -> Log:
    """Return a log whose columns are functions of time or constants; what is not given is zero."""
    t = np.arange(round(duration * rate)) / rate
    names = ["u1", "u2", "u3", *STATE_NAMES, "ref_x", "ref_y", "ref_psi", "wheel1", "wheel2", "wheel3"]
    made = {name: _column(columns.pop(name, 0.0), t) for name in names}
    return Log({"t": t} | made | {name: _column(one, t) for name, one in columns.items()}, ended=ended)


def _column(column: Column, t: Floats) -> Floats:
    return np.full(len(t), column) if isinstance(column, float) else column(t)
