"""Running a plant with a controller: sample, decide, hold; the run becomes a `Log`."""

from importlib import import_module
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import MOST_CELLS, format_duration, real_array
from ballbot.control.interface import estimator_of
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


class NamedScenario(Protocol):
    """A `ballbot.twin.Scenario`."""

    @property
    def name(self) -> str:
        """Its name."""
        ...


#: a scenario, the name of a ready-made one, or the path of a scenario file
ScenarioLike = NamedScenario | str | Path

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
    scenario: ScenarioLike | None = None,
    progress: ProgressCallback = in_notebook,
) -> Log:
    """Run a plant in closed loop from a start, sampled and held as the controller asks.

    Parameters
    ----------
    plant : Plant, Model, robot, preset or robot file
        A model, or the exact one of a robot, is run with perfect sensors (`ModelPlant`) unless there is a scenario.
    controller : Feedback, "nominal", "precise" or controller file
        A `Controller`, or any object with `sample_time`, `reset()` and `update(t, state, reference)`. It is run
        behind the safety layer, with the default limits unless it is a `SafeController` with its own.
    reference : callable, name or reference file
        f(t) -> (10,), t in [s], or a name such as "square"; see `ballbot.control.references`. A heading that begins
        again after a turn is unwrapped.
    duration : float
        [s]; a whole number of samples is run.
    initial_state : array_like (10,), optional
        True state at the start; `initial_state_of(seed)`, at rest and leaning a little, by default.
    seed : int
        The default start and all that is random in the plant follow from it.
    scenario : Scenario, name or scenario file, optional
        Whose sensors, delay, play, torque noise and floor a model gets, beside its own friction; the controller is
        given the state of the estimator that it is made for. See `ballbot.twin.Scenario`.
    progress : callable, optional
        Called with the progress from time to time; by default a notebook shows a line.

    Returns
    -------
    Log
        A row for each sample: what was measured at t, the torques held from there on, the reference, and the true
        state (`log.truth()`). If the run ended early, in a fall or because the safety layer stopped the motors, the
        rows end before it and `log.ended` gives the reason.

    Raises
    ------
    InputError
        If the duration or the initial state is invalid, the controller returns anything but n numbers, or a plant
        that is no model is given a scenario.

    Examples
    --------
    >>> log = simulate("alten", "nominal", "square", duration=1.0)
    >>> len(log), log.ended
    (200, None)
    """
    active = _active(plant, controller, scenario)
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


def _active(plant: Plant | ModelLike, controller: ControllerLike, scenario: ScenarioLike | None) -> Plant:
    """Return what is run: the plant itself, or a model behind perfect sensors or those of a scenario."""
    if isinstance(plant, Plant) and not isinstance(plant, Model):
        if scenario is not None:
            raise InputError(
                "A scenario is for a model or a robot; give a twin its own: Twin(robot, scenario)."
            )
        return plant
    model = as_model(plant)  # an object of any other kind is refused as a robot
    if scenario is None:
        return ModelPlant(model)
    # scenarios stand in a package that this one must not import
    sensed = import_module("ballbot.twin.imperfections").sensed
    return sensed(model, scenario, estimator=estimator_of(as_controller(controller, model.robot)))


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
