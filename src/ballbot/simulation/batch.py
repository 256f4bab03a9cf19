"""Many robots in closed loop at once: the law and the mechanics in one compiled call, robots side by side.

The numbers are those of `simulate` on a `Model`, to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller, refusal
from ballbot.control.law import MEMORY, control_law
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.engine import over_threads
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.lanes import LANES, ROWS, STEP, TORQUE, robot_in
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import load, pack
from ballbot.mechanics.steps import load_state, load_torques, start_lane, take_steps, write_state
from ballbot.robot import Robot
from ballbot.simulation.floor import lift_off, sinking
from ballbot.simulation.model_plant import checked_states
from ballbot.simulation.run import sample_count


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopBatch:
    """What `simulate_batch` returns, a lane for each robot."""

    t: NDArray[np.float64]  #: (records,) [s]
    states: NDArray[np.float64]  #: (lanes, records, 10); a lane that ended stays where it was
    torques: NDArray[np.float64]  #: (lanes, records, n) held over the sample that ends at t [N m]
    ended: NDArray[np.float64]  #: (lanes,) time [s] at which a lane ended; infinity where it did not
    lifted: NDArray[np.bool_]  #: (lanes,) whether it ended because the floor would have had to pull

    @property
    def finals(self) -> NDArray[np.float64]:
        """The last states (lanes, 10)."""
        return self.states[:, -1]

    @property
    def survived(self) -> NDArray[np.bool_]:
        """Whether each lane (lanes,) ran to the end."""
        return np.isinf(self.ended)


def simulate_batch(
    model: Model,
    controller: Controller | Sequence[Controller],
    reference: Reference,
    *,
    duration: float,
    initial_states: NDArray[np.float64] | None = None,
    robots: Sequence[Robot] | None = None,
    every: int = 1,
    threads: int | None = None,
) -> ClosedLoopBatch:
    """Run many robots in closed loop, each from its own start, with its own parameters and controller.

    Parameters
    ----------
    model : Model
        Gives the formulation, the inner step and the pivoting friction, and the robot where `robots` does not.
        A ball that pivots starts without spin.
    controller : Controller or sequence of Controller
        One for all lanes or one for each; of one sample time.
    reference : callable
        f(t) -> (10,), the same for all lanes.
    duration : float
        [s]
    initial_states : array (10,) or (lanes, 10), optional
        Upright at rest at the origin where not given.
    robots : sequence of Robot, optional
        One for each lane; their controllers stay what they are.
    every : int
        Record every so many samples; 0 records the last only.
    threads : int, optional
        All cores by default. The result does not depend on it.

    Returns
    -------
    ClosedLoopBatch

    Raises
    ------
    InputError
        Where lanes, wheels or sample times disagree, or the reference asks for a lean or a rate.
    """
    controllers = [controller] if isinstance(controller, Controller) else list(controller)
    bodies = [model.robot] if robots is None else list(robots)
    initial = checked_states(np.zeros(10) if initial_states is None else initial_states)
    lanes = _lanes(len(initial), len(bodies), len(controllers))
    sample_time = _common_sample_time(controllers)
    n = _common_wheel_count(model, bodies, controllers)
    samples = sample_count(duration, sample_time)
    every = every or samples
    references = _sampled(reference, samples, sample_time)
    records = samples // every
    states, torques = np.empty((lanes, records, 10)), np.empty((lanes, records, n))
    ended, lifted = np.empty(lanes, np.int64), np.zeros(lanes, np.bool_)
    inputs = (
        np.stack([pack(robot, model.formulation, pivoting=model.pivoting or 0.0) for robot in bodies]),
        np.array([lift_off(robot) for robot in bodies]),
        np.stack([one.packed for one in controllers]),
        initial,
        references,
    )
    steps = model.steps_in(sample_time)

    def run(first: int) -> None:
        width = min(LANES, lanes - first)
        out = (states, torques, ended, lifted)
        run_closed_loop_block(model.selected, *inputs, first, width, sample_time / steps, steps, every, *out)

    over_threads(run, lanes, threads)
    return ClosedLoopBatch(
        t=np.arange(1.0, records + 1.0) * (every * sample_time),
        states=states,
        torques=torques,
        ended=np.where(ended < samples, ended * sample_time, np.inf),
        lifted=lifted,
    )


@compiled
def run_closed_loop_block(
    selected,
    parameters,
    lift_offs,
    laws,
    initial,
    references,
    first,
    width,
    h,
    steps,
    every,
    states,
    torques,
    ended,
    lifted,
):
    """Simulate lanes first .. first + width - 1 of `simulate_batch`; inputs of one row hold for every lane."""
    work = np.zeros(ROWS * LANES)
    state, held = np.empty(10), np.empty(torques.shape[2])
    memories = np.zeros((width, MEMORY))
    samples = len(references)
    for lane in range(width):
        _load_robot(work, lane, parameters[_row_of(parameters, first + lane)])
        start_lane(selected, work, lane, initial[_row_of(initial, first + lane)], h)
        ended[first + lane] = samples
    for sample in range(samples):
        for lane in range(width):
            robot = first + robot_in(work, lane)
            write_state(selected, work, lane, state)
            control_law(laws[_row_of(laws, robot)], memories[robot - first], state, references[sample], held)
            for i in range(len(held)):
                work[(TORQUE + i) * LANES + lane] = held[i]
        take_steps(selected, work, width, steps)
        for lane in range(width):
            robot = first + robot_in(work, lane)
            if ended[robot] == samples:
                limit = lift_offs[_row_of(lift_offs, robot)]
                _end_where_due(selected, work, lane, limit, sample + 1, ended, lifted, robot)
            if (sample + 1) % every == 0:
                record = (sample + 1) // every - 1
                write_state(selected, work, lane, states[robot, record])
                for i in range(len(held)):
                    torques[robot, record, i] = work[(TORQUE + i) * LANES + lane]


@inlined
def _row_of(rows, lane):
    """Return the lane's row, where one row may hold for every lane."""
    return lane if len(rows) > 1 else 0


@inlined
def _load_robot(work, lane, row):
    for i in range(len(row)):
        work[i * LANES + lane] = row[i]


@inlined
def _end_where_due(selected, work, lane, limit, sample, ended, lifted, robot):
    """Stop a lane that has fallen within the sample or would lift off at its end."""
    state = load_state(selected, work, lane)
    fallen = work[STEP * LANES + lane] == 0.0 or not max(abs(state[2]), abs(state[3])) <= LARGEST_LEAN
    lifts = False
    if not fallen:
        P, u = load(selected, work, lane), load_torques(selected, work, lane)
        lifts = not sinking(selected, P, state, u) < limit
    if fallen or lifts:
        ended[robot] = sample
        lifted[robot] = lifts
        work[STEP * LANES + lane] = 0.0  # the lane stays where it is


def _lanes(*counts: int) -> int:
    lanes = max(counts)
    if any(count not in (1, lanes) for count in counts):
        starts, robots, controllers = counts
        raise InputError(
            f"There are {starts} initial states, {robots} robots and {controllers} controllers; each must be one, or "
            "as many as there are lanes."
        )
    return lanes


def _common_sample_time(controllers: Sequence[Controller]) -> float:
    times = {one.sample_time for one in controllers}
    if len(times) != 1:
        raise InputError(
            f"The controllers' sample times are {sorted(times)} s; one batch needs a single one."
        )
    return times.pop()


def _common_wheel_count(model: Model, robots: Sequence[Robot], controllers: Sequence[Controller]) -> int:
    counts = {model.robot.wheel_count, *(r.wheel_count for r in robots), *(len(c.gain) for c in controllers)}
    if len(counts) != 1:
        raise InputError(
            f"Robots and controllers are for {sorted(counts)} wheels; one batch needs a single number."
        )
    return counts.pop()


def _sampled(reference: Reference, samples: int, sample_time: float) -> NDArray[np.float64]:
    """Return the reference at every sample (samples, 10)."""
    references = np.array([reference(k * sample_time) for k in range(samples)], dtype=np.float64)
    if references.shape != (samples, 10):
        raise InputError(
            f"The reference returns arrays of the shape {references.shape[1:]}; each must be ten numbers."
        )
    if not np.isfinite(references).all():
        raise InputError("The reference returns a value that is not finite; all ten must be numbers.")
    forbidden = np.argwhere(references[:, [2, 3, 5, 6, 7, 8, 9]] != 0.0)
    if len(forbidden):
        row, column = forbidden[0]
        place = (2, 3, 5, 6, 7, 8, 9)[column]
        raise InputError(refusal(place, float(references[row, place])))
    return references
