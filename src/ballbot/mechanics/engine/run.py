"""The engine: many robots through many samples in one compiled call.

Robots are stepped in blocks of `LANES`, side by side, in loops that become vector instructions; a single robot is a
block of one. Where no contact is at rest, a step is first tried as RK4 with known signs of friction (`smooth`); robots
in which a sign may have changed take the convex step instead (`convex`).
The lanes are kept sorted, moving robots first, so that neither method is spent on the other's robots. But for
rounding, a robot's step depends on nothing but the robot.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import index_array, positive_number, real_array, whole_number
from ballbot.mechanics.engine.compiled import c_code, compiled, inlined
from ballbot.mechanics.engine.convex import convex_block
from ballbot.mechanics.engine.lanes import (
    GROUP,
    LANES,
    MARGIN,
    ROBOT,
    ROTOR,
    ROWS,
    SLIDES,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    entry,
    new_work,
    put,
    put_robot,
    restored,
    robot_in,
    state_like,
    stored,
    swap,
)
from ballbot.mechanics.engine.slip import mark_slips, slip_steps
from ballbot.mechanics.engine.smooth import SINES, SPEEDS, begin_steps, is_upright, smooth_block
from ballbot.mechanics.engine.tracing import both, lanes, outside, traced, where
from ballbot.mechanics.equations import attitude, rates_from_angles, rates_of_angles
from ballbot.mechanics.parameters import Exact, Pivoting, Thesis, row_size


@traced
def load_state(selected, work, lane):
    """Return a lane's state: ten numbers, and the spin where the ball pivots."""
    return restored(state_like(selected), work, STATE, lane)


@traced
def load_torques(selected, work, lane):
    """Return the wheel torques of one lane."""
    return restored(selected.wheels, work, TORQUE, lane)


def code_of(selected: Exact | Thesis | Pivoting, *, slips: bool = False) -> int:
    """Return the address of a kind of robot's code for `take_steps`; the first call compiles, or reads what is kept.

    With `slips` contacts slip beyond their grip.

    Within the loops that call it, it would be optimised and assembled again with every one of them.
    """
    return _code_of(selected, type(selected), slips)


@cache
def _code_of(selected: Exact | Thesis | Pivoting, kind: type, slips: bool) -> int:
    # tuples with the same numbers are equal, whatever their kind
    @c_code("void(CPointer(float64), int64, int64)")
    def address(work, width, steps):
        for _ in range(steps):
            begin_steps(selected, work, width)
            resting = _count_open(work, 0, width)
            if resting > 0:
                _sort(selected, work, width, SLIDES if slips else ROTOR)
            if resting < width:
                smooth_block(selected, work, _whole_groups(width - resting, width))
            for first in range(0, width, GROUP):
                last = min(first + GROUP, width)
                if _count_open(work, first, last) > 0:
                    convex_block(selected, work, first, last)
            if slips:
                mark_slips(selected, work, width)
            _accept(selected, work, width)
            if slips:
                slip_steps(selected, work, width)

    return address


@traced
def take_steps(code, work, width, steps):
    """Advance every lane of a block by `steps` steps with torques held."""
    outside(code, work, width, steps)


@inlined
def _count_open(work, first, last):
    count = 0.0
    for lane in range(first, last):
        count += _open(work, lane)
    return int(count)


@traced
def _open(work, lane):
    """Return 1 where a lane's step still has to be taken, else 0."""
    return where(both(entry(work, STEP, lane) != 0.0, ~(entry(work, MARGIN, lane) > 0.0)), 1.0, 0.0)


@inlined
def _is_open(work, lane):
    return _open(work, lane) > 0.0


@inlined
def _sort(selected, work, width, end):
    """Bring the open lanes to the end; a lane's rows from `TORQUE` to before `end` are its robot's."""
    last = width
    for lane in range(width):
        if lane < last and _is_open(work, lane):
            last -= 1
            while lane < last and _is_open(work, last):
                last -= 1
            if lane < last:
                _swap_lanes(selected, work, lane, last, end)


@inlined
def _swap_lanes(selected, work, first, second, end):
    for row in range(row_size(selected)):
        swap(work, row, first, second)
    for row in range(STATE, STATE + 11):
        swap(work, row, first, second)
    for row in range(TORQUE, end):
        swap(work, row, first, second)
    for row in range(SINES, SPEEDS + 4):
        swap(work, row, first, second)


@inlined
def _whole_groups(lanes, width):
    return min((lanes + GROUP - 1) // GROUP * GROUP, width)


@traced
def _accept(selected, work, width):
    """Make the trials the states; past the largest lean a lane takes steps of zero: it stays where it is."""
    for lane in lanes(0, width):
        h, trial = entry(work, STEP, lane), restored(state_like(selected), work, TRIAL, lane)
        end = where(h == 0.0, load_state(selected, work, lane), trial)
        stored(work, STATE, lane, end)
        put(work, STEP, lane, where(is_upright(end), h, 0.0))


@inlined
def start_lane(selected, work, lane, x, h):
    """Give a lane the robot of its number: state x (10,), (11,) where the ball pivots, with Euler rates, and step h."""
    put(work, STEP, lane, h)
    put(work, ROBOT, lane, float(lane))
    for i in range(len(x)):
        put(work, STATE + i, lane, x[i])
    w = rates_from_angles(selected, attitude((x[2], x[3], x[4])), (x[7], x[8], x[9]))
    for axis in range(3):
        put(work, STATE + 7 + axis, lane, w[axis])


@inlined
def write_state(selected, work, lane, out):
    """Write a lane's state, with Euler-angle rates, to `out`."""
    for i in range(len(out)):
        out[i] = entry(work, STATE + i, lane)
    rates = rates_of_angles(selected, attitude((out[2], out[3], out[4])), (out[7], out[8], out[9]))
    for axis in range(3):
        out[7 + axis] = rates[axis]


@compiled
def run_block(code, selected, tables, row_of, h, steps, every, out, ended):
    """Simulate a block of at most `LANES` lanes, and fill `out` and `ended` as the `states` and `ended` of a `Batch`.

    `tables` are the parameters, initial states and torques of `Lanes`, and row_of (lanes, 3) its rows of the block's
    lanes. The tables come as a plain tuple: a named one would make every call from Python slower.
    """
    parameters, initial, torques = tables
    work = new_work(ROWS)
    width, samples, n = len(row_of), torques.shape[1], torques.shape[2]
    for lane in range(width):
        put_robot(work, lane, parameters[row_of[lane, 0]])
        start_lane(selected, work, lane, initial[row_of[lane, 1]], h)
        ended[lane] = samples
    for sample in range(samples):
        for lane in range(width):
            held = torques[row_of[robot_in(work, lane), 2], sample]
            for i in range(n):
                work[(TORQUE + i) * LANES + lane] = held[i]
        take_steps(code, work, width, steps)
        for lane in range(width):
            robot = robot_in(work, lane)
            if work[STEP * LANES + lane] == 0.0 and ended[robot] == samples:
                ended[robot] = sample
            if (sample + 1) % every == 0:
                write_state(selected, work, lane, out[robot, (sample + 1) // every - 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """Robots to simulate side by side: three tables, and the row of each that a lane takes.

    Lanes share rows, so that a population of parameter sets runs over many windows of a log without copies of either.
    Without an index, lane i takes row i, or the only row.
    """

    parameters: NDArray[np.float64]  #: (sets, size), rows from `ballbot.mechanics.parameters.pack`
    #: (starts, 10), or (starts, 11) where the ball pivots: [x y theta phi psi and their rates], the ball's spin [rad/s]
    initial: NDArray[np.float64]
    torques: NDArray[np.float64]  #: (inputs, samples, n), held over each sample [N m]
    parameter_of: NDArray[np.int64] | None = None  #: (lanes,), each lane's row of `parameters`
    initial_of: NDArray[np.int64] | None = None  #: (lanes,), of `initial`
    torque_of: NDArray[np.int64] | None = None  #: (lanes,), of `torques`

    @property
    def row_of(self) -> NDArray[np.int64]:
        """Each lane's rows of the parameters, initial states and torques, (lanes, 3).

        InputError if the indices are not of one length, or one names no row.
        """
        counts = [len(self.parameters), len(self.initial), len(self.torques)]
        given = {name: getattr(self, name) for name in ("parameter_of", "initial_of", "torque_of")}
        lanes = max([np.size(index) for index in given.values() if index is not None] or counts)
        columns = []
        for count, (name, index) in zip(counts, given.items(), strict=True):
            default = np.zeros(lanes, np.int64) if count == 1 else np.arange(lanes)
            columns.append(index_array(default if index is None else index, name, count=count, length=lanes))
        return np.column_stack(columns)


@dataclass(frozen=True, kw_only=True)
class Batch:
    """The result of `simulate_lanes`."""

    states: NDArray[np.float64]  #: (lanes, samples // every, 10 or 11), after each recorded sample
    ended: NDArray[np.int64]  #: (lanes,), whole samples simulated before the lean passed `LARGEST_LEAN`


def simulate_lanes(
    selected: Exact | Thesis | Pivoting,
    lanes: Lanes,
    *,
    sample_time: float,
    steps: int,
    every: int = 1,
    threads: int | None = None,
    lost_lanes: bool = False,
) -> Batch:
    """Simulate many robots under torques held over each sample of `steps` inner steps; record every so many samples.

    All cores are used by default; the result does not depend on `threads`. With `lost_lanes` a lane may begin with
    values that are not finite, as after an earlier call in which it was lost: it stays lost, and its neighbours are
    not affected.

    InputError if shapes disagree, an index names no row, or a value is not one that it can be.
    """
    n = len(selected.wheels)
    size = 11 if isinstance(selected, Pivoting) else 10
    finite = not lost_lanes
    tables = (
        real_array(lanes.parameters, ("sets", row_size(selected)), "The array of parameters", finite=finite),
        real_array(lanes.initial, ("starts", size), "The array of initial states", finite=finite),
        real_array(lanes.torques, ("inputs", "samples", n), "The array of torques", finite=finite),
    )
    row_of = lanes.row_of
    h = positive_number(sample_time, "The sample time") / whole_number(steps, "The number of steps", least=1)
    every = whole_number(every, "every", least=1)
    out = np.empty((len(row_of), tables[2].shape[1] // every, size))
    ended = np.empty(len(row_of), np.int64)

    code = code_of(selected)

    def run(first: int) -> None:
        block = slice(first, first + LANES)
        run_block(code, selected, tables, row_of[block], h, steps, every, out[block], ended[block])

    over_threads(run, len(row_of), threads)
    return Batch(states=out, ended=ended)


_FIRST_ROWS = np.zeros((1, 3), np.int64)


def simulate_one(
    selected: Exact | Thesis | Pivoting,
    parameters: NDArray[np.float64],
    state: NDArray[np.float64],
    torques: NDArray[np.float64],
    *,
    sample_time: float,
    steps: int,
) -> NDArray[np.float64]:
    """Return one robot's state (10,), or (11,) where the ball pivots, after a sample of torques (n,) [N m].

    All that is given has been checked already.
    """
    out, ended = np.empty((1, 1, len(state))), np.empty(1, np.int64)
    tables = (parameters[None], state[None], torques[None, None])
    run_block(code_of(selected), selected, tables, _FIRST_ROWS, sample_time / steps, steps, 1, out, ended)
    return out[0, 0]


def over_threads(run: Callable[[int], None], lanes: int, threads: int | None) -> None:
    """Call run(first lane) for each block of lanes, over so many threads; all cores where `threads` is None."""
    blocks = range(0, lanes, LANES)
    workers = min(threads or os.cpu_count() or 1, len(blocks))
    if workers <= 1:
        list(map(run, blocks))
        return
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, blocks))
