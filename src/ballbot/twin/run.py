"""A run of any plant; a model or a robot may have the sensors and faults of a twin's scenario."""

from pathlib import Path

from numpy.typing import ArrayLike

from ballbot.control.interface import estimator_of
from ballbot.control.references import ReferenceLike
from ballbot.control.source import ControllerLike, as_controller
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.mechanics.model import Model, ModelLike, as_model
from ballbot.progress import ProgressCallback, in_notebook
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate as simulate_plant
from ballbot.twin.imperfections import sensed
from ballbot.twin.scenario import Scenario


def simulate(
    plant: Plant | ModelLike,
    controller: ControllerLike,
    reference: ReferenceLike,
    *,
    duration: float,
    initial_state: ArrayLike | None = None,
    seed: int = 0,
    scenario: Scenario | str | Path | None = None,
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
    if scenario is not None:
        if isinstance(plant, Plant) and not isinstance(plant, Model):
            raise InputError(
                "A scenario is for a model or a robot; give a twin its own: Twin(robot, scenario)."
            )
        model = as_model(plant)
        plant = sensed(model, scenario, estimator=estimator_of(as_controller(controller, model.robot)))
    return simulate_plant(
        plant,
        controller,
        reference,
        duration=duration,
        initial_state=initial_state,
        seed=seed,
        progress=progress,
    )
