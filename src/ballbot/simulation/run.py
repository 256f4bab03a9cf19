"""Running a plant with a controller: sample, decide, hold; the run becomes a `Log`."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import MOST_CELLS, format_duration, real_array
from ballbot.control.references import ReferenceLike, as_reference
from ballbot.control.safety import SafeController
from ballbot.control.source import ControllerLike, as_controller
from ballbot.errors import InputError
from ballbot.estimation.heading import Heading
from ballbot.log import Log
from ballbot.mechanics.model import Model, ModelLike, as_model
from ballbot.progress import Progress, ProgressCallback, in_notebook
from ballbot.simulation.batch_result import REFERENCES, column_names
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement, Plant

#: samples of a run, whose log has some 45 columns
_MOST = MOST_CELLS // 45
#: largest lean of a start [rad]
_MAX_INITIAL_LEAN = 0.02


def initial_state_of(seed: int) -> NDArray[np.float64]:
    """Return the default initial state (10,): at rest at the origin, leaning a little.

    theta and phi ~ U(-0.02, 0.02) rad. Exactly upright, a robot needs no controller.
    """
    state = np.zeros(10)
    state[2:4] = np.random.default_rng(seed).uniform(-_MAX_INITIAL_LEAN, _MAX_INITIAL_LEAN, 2)
    return state


def simulate(
    plant: Plant | ModelLike,
    controller: ControllerLike,
    reference: ReferenceLike,
    *,
    duration: float,
    initial_state: ArrayLike | None = None,
    seed: int = 0,
    progress: ProgressCallback = in_notebook,
) -> Log:
    """Run a plant in closed loop, as `ballbot.twin.run.simulate` does, without a scenario."""
    active = (
        plant if isinstance(plant, Plant) and not isinstance(plant, Model) else ModelPlant(as_model(plant))
    )
    controller, wanted_at = as_controller(controller, active.robot), as_reference(reference)
    samples = sample_count(duration, controller.sample_time)
    guarded = (
        controller if isinstance(controller, SafeController) else SafeController(controller, active.robot)
    )
    guarded.reset()
    start = initial_state_of(seed) if initial_state is None else initial_state
    measured = active.reset(start, seed=seed)
    names = column_names(active.robot.wheel_count, accelerometer=measured.acceleration is not None)
    table = np.empty((samples, len(names)))
    rows, ended, heading = 0, measured.ended, Heading()
    while rows < samples and ended is None:
        wanted = real_array(wanted_at(measured.t), (10,), f"The reference at t = {measured.t:g} s").copy()
        wanted[4] = heading.unwrapped(float(wanted[4]))
        torques = guarded.update(measured.t, measured.state, wanted, measured=measured.valid)
        if guarded.stop is not None:
            ended = guarded.stop.text.removesuffix(".")
            break
        table[rows] = _row(measured, torques, wanted)
        measured = active.step(torques, controller.sample_time)
        rows, ended = rows + 1, measured.ended
        if rows % 100 == 0 or rows == samples:
            progress(Progress(stage="simulating", done=rows, total=samples))
    if rows == 0:
        raise InputError(f"The run ends before its first sample: {ended}.")
    return Log(dict(zip(names, table[:rows].T, strict=True)), ended=ended)


def sample_count(duration: float, sample_time: float) -> int:
    """Return how many samples a duration has.

    InputError if it is not at least one, or more than a log can hold.
    """
    if not (np.isfinite(duration) and duration / sample_time > 0.5):
        raise InputError(
            f"The duration is {duration:g} s; it must be at least one sample time, {sample_time:g} s."
        )
    if duration / sample_time > _MOST:
        raise InputError(
            f"A run of {format_duration(duration)} has {duration / sample_time:.3g} samples of {sample_time:g} "
            f"s, and its log would not fit in memory. At most {format_duration(_MOST * sample_time)} is "
            "possible."
        )
    return round(duration / sample_time)


def _row(
    measured: Measurement, torques: NDArray[np.float64], reference: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.concatenate(
        [
            [measured.t],
            torques,
            measured.state,
            measured.wheel_angles,
            measured.wheel_speeds,
            measured.gyro,
            measured.acceleration if measured.acceleration is not None else (),
            reference[list(REFERENCES)],
            measured.truth,
        ]
    )
