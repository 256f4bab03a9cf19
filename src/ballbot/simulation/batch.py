"""Many robots in closed loop at once: the law and the mechanics in one compiled call, robots side by side.

The numbers are those of `simulate` on a `Model`, to rounding, at the same instants. A lane may have sensors, late
torques or a sloping floor (`Imperfections`), and may be left once it is lost (`OutcomeBounds`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import real_array, whole_number
from ballbot.control.controller import Controller, refusal
from ballbot.control.interface import Feedback, estimator_of
from ballbot.control.references import Reference, ReferenceLike, as_reference
from ballbot.control.source import ControllerLike, as_controller
from ballbot.errors import InputError
from ballbot.estimation.heading import JUMP, Heading
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.run import over_threads
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model, ModelLike, as_model
from ballbot.robot import Robot
from ballbot.simulation.batch_result import ClosedLoopBatch
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.inputs import (
    change_samples,
    draws_of,
    empty_outcome,
    inputs_of,
    new_commands,
    rows_of,
)
from ballbot.simulation.loop import (
    ADVANCED,
    CHANGED,
    LEFT,
    Commands,
    Draws,
    Inputs,
    LoopMemory,
    Outcome,
    Sampling,
    new_memory,
    run_block,
)
from ballbot.simulation.model_plant import checked_states
from ballbot.simulation.run import initial_state_of, sample_count

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class OutcomeBounds:
    """Bounds beyond which a lane is lost and its run stops."""

    lost: float = math.inf  #: a lane that leans farther, and outward, cannot recover [rad]
    grip: float = math.inf  #: friction coefficient of wheels on ball; a lane that needs more ends

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0.0:
                raise InputError(f"{name} of the verdict is {value!r}; it must be above zero.")


def _models(source: ModelLike | Sequence[ModelLike]) -> list[Model]:
    """Return the models; one compiled call steps them all."""
    models = [as_model(given) for given in _listed(source)]
    if not models:
        raise InputError("The sequence of models is empty; give one model, or one for each lane.")
    kinds = {(model.formulation, model.step, model.pivots) for model in models}
    if len(kinds) != 1:
        raise InputError(
            f"The models are of {len(kinds)} kinds; all models of a batch must have the same formulation and inner "
            "step, and all or none a pivoting ball."
        )
    return models


def simulate_batch(
    model: ModelLike | Sequence[ModelLike],
    controller: ControllerLike | Sequence[ControllerLike],
    reference: ReferenceLike,
    *,
    duration: float,
    initial_states: ArrayLike | None = None,
    imperfections: Imperfections | Sequence[Imperfections] | None = None,
    verdict: OutcomeBounds = OutcomeBounds(),
    every: int = 1,
    threads: int | None = None,
) -> ClosedLoopBatch:
    """Run many robots in closed loop, each from its own start, with its own model and controller.

    Parameters
    ----------
    model : Model, robot, preset or robot file, or a sequence of them
        One for all lanes or one for each; of one formulation and inner step, and a pivoting ball in all or in none.
        A ball that pivots starts without spin.
    controller : Controller, "nominal", "precise", controller file or your own, or a sequence of them
        One for all lanes or one for each; of one sample time. A name stands for that of the first model's robot. If
        one is written in Python, all lanes run one after another, one period at a time; no safety layer is around it.
    reference : callable, name or reference file
        f(t) -> (10,), the same for all lanes.
    duration : float
        [s]
    initial_states : array_like (10,) or (lanes, 10), optional
        The default start of `simulate`, that of seed 0, by default.
    imperfections : Imperfections, or a sequence of them, optional
        One for all lanes or one for each: sensors, delay, noise, play, floor. By default the controllers see the true
        state, and drives have no limits but the controllers' own. The state is that of the estimator that each
        controller is made for. If there is one for all lanes, its seed is that of the first, and the others' follow it.
    verdict : OutcomeBounds, optional
        Stops each lane as soon as it is lost; by default all run to the end.
    every : int
        Record every `every`-th sample, beginning with the first; 0 records the first only, and `finals`.
    threads : int, optional
        All cores by default. The result does not depend on it.

    Returns
    -------
    ClosedLoopBatch

    Raises
    ------
    InputError
        If lanes, models, wheels or sample times disagree, the reference asks for a lean or a rate, or a controller
        returns anything but n finite numbers.

    Examples
    --------
    >>> starts = [[0.0, 0.0, lean, *7 * [0.0]] for lean in (0.02, 0.9)]
    >>> simulate_batch("alten", "nominal", "hold", duration=3.0, initial_states=starts).survived.tolist()
    [True, False]
    """
    models = _models(model)
    robots = [prepared.robot for prepared in models]
    controllers = [as_controller(given, robots[0]) for given in _listed(controller)]
    initial = checked_states(initial_state_of(0) if initial_states is None else initial_states)
    by_lane = _listed(imperfections)
    lanes = _lanes(
        {
            "initial states": len(initial),
            "models": len(models),
            "controllers": len(controllers),
            "imperfections": max(len(by_lane), 1),
        }
    )
    sample_time = _common_sample_time(controllers)
    _check_imperfections(by_lane, models[0], sample_time)
    samples = sample_count(duration, sample_time)
    laws = [law for law in controllers if isinstance(law, Controller)]
    plans = all(law.follows_plans for law in laws)  # a controller of the user's may do with it as it likes
    sampling = Sampling(
        references=_sampled(as_reference(reference), samples, sample_time, plans=plans),
        sample_time=sample_time,
        steps=models[0].steps_in(sample_time),
        every=whole_number(every, "every", least=0) or samples,
        lost_lean=verdict.lost,
        grip=verdict.grip,
    )
    out = _run_lanes(lanes, models, controllers, initial, by_lane, sampling, threads)
    leans = np.array([lane.fallen_lean for lane in by_lane] or [LARGEST_LEAN])
    return _result(out, sampling, leans)


def _run_lanes(
    lanes: int,
    models: Sequence[Model],
    controllers: Sequence[Feedback],
    initial: NDArray[np.float64],
    by_lane: Sequence[Imperfections],
    sampling: Sampling,
    threads: int | None,
) -> Outcome:
    """Run lanes side by side if their laws are compiled, else one after another."""
    laws = [law for law in controllers if isinstance(law, Controller)]
    by_python = len(laws) < len(controllers)
    robots, sample_time = [model.robot for model in models], sampling.sample_time
    n = _common_wheel_count([*robots, *(lane.known for lane in by_lane if lane.known)], laws)
    samples = len(sampling.references)
    out = empty_outcome(lanes, -(-samples // sampling.every), samples, n)
    changes = list(_changes(models, by_lane, samples, sample_time))
    stages = [
        inputs_of(
            models,
            imperfections,
            sample_time=sample_time,
            laws=() if by_python else laws,
            estimators=[estimator_of(controller) for controller in controllers],
            initial=initial,
        )
        for _, models, imperfections in changes
    ]
    spans = list(pairwise([*(begin for begin, *_ in changes), samples]))
    alone = len(by_lane) == 1

    def run(first: int) -> None:
        rows = slice(first, min(first + (1 if by_python else LANES), lanes))
        width = rows.stop - first
        runs = range(first, rows.stop) if by_lane else ()
        which = [(by_lane[0], by_lane[0].seed + k) if alone else (by_lane[k], by_lane[k].seed) for k in runs]
        draws = draws_of(which, width, n=n, samples=samples, sample_time=sample_time)
        memory = new_memory(stages[0].loops, width, n, filtering=len(stages[0].filters) > 0)
        commands = new_commands(width, n if by_python else 0)
        for inputs, span in zip(stages, spans, strict=True):
            own = rows_of(inputs, rows), draws, sampling, memory, commands, rows_of(out, rows)
            if by_python:
                _run_asking(controllers[first % len(controllers)], models[0], own, span)
            else:
                run_block(models[0].selected, *own, span)
            commands.todo[commands.todo == ADVANCED] = CHANGED

    if by_python:
        for lane in range(lanes):
            run(lane)
    else:
        over_threads(run, lanes, threads)
    return out


def _run_asking(
    controller: Feedback,
    model: Model,
    own: tuple[Inputs, Draws, Sampling, LoopMemory, Commands, Outcome],
    span: tuple[int, int],
) -> None:
    """Take one robot from a sample to another, by the torques of a controller that is written in Python.

    As a law, it gives none in a sample without a state.
    """
    _, _, sampling, memory, commands, _ = own
    if span[0] == 0:
        controller.reset()
        run_block(model.selected, *own, (0, 0))  # to the start
    for sample in range(*span):
        seen, torques = memory.states[0].copy(), commands.torques[0]
        torques[:] = 0.0
        if commands.todo[0] != LEFT and np.isfinite(seen).all():
            t = round(sample * sampling.sample_time, 9)
            answer = controller.update(t, seen, sampling.references[sample].copy())
            torques[:] = real_array(answer, torques.shape, f"What the controller returned at t = {t:g} s")
        run_block(model.selected, *own, (sample, sample + 1))


def _result(out: Outcome, sampling: Sampling, fallen_leans: NDArray[np.float64]) -> ClosedLoopBatch:
    """Return an outcome as the batch that users see."""
    _, records, n = out.torques.shape
    samples, sample_time = len(sampling.references), sampling.sample_time
    return ClosedLoopBatch(
        t=np.round(np.arange(records) * (sampling.every * sample_time), 9),
        states=out.states,
        finals=out.finals,
        torques=out.torques,
        seen=out.seen,
        commanded=out.commanded,
        wheel_angles=out.encoders[:, :, :n],
        wheel_speeds=out.encoders[:, :, n:],
        gyro=out.gyro,
        references=sampling.references,
        sample_time=sample_time,
        fallen_leans=fallen_leans,
        ended=np.where(out.ended < samples, out.ended * sample_time, np.inf),
        lifted=out.lifted,
        slipped=out.slipped,
        torque_change=np.sqrt(out.changes / (n * np.maximum(out.ended - 1, 1))),
    )


def _listed(values: T | Sequence[T] | None) -> list[T]:
    """Return the values of a sequence, the only value, or none."""
    if values is None:
        return []
    return list(values) if isinstance(values, Sequence) and not isinstance(values, str) else [values]  # pyright: ignore[reportReturnType]


def _lanes(counts: Mapping[str, int]) -> int:
    lanes = max(counts.values())
    if any(count not in (1, lanes) for count in counts.values()):
        raise InputError(
            f"There are {', '.join(f'{count} {name}' for name, count in counts.items())}; each number must be one or "
            "the number of lanes."
        )
    return lanes


def _check_imperfections(by_lane: Sequence[Imperfections], model: Model, sample_time: float) -> None:
    for lane in by_lane:
        if lane.sensors is not None and abs(lane.sensors.sample_time - sample_time) > 1e-9 * sample_time:
            raise InputError(
                f"The sensors are sampled every {lane.sensors.sample_time:g} s and the controllers every "
                f"{sample_time:g} s; in a batch both must be the same."
            )
        if lane.fix is not None:
            raise InputError(
                "A batch has no fixes from outside; run the robot with `simulate` on a `SensedPlant`."
            )
        needs = lane.sensors is not None or lane.backlash > 0.0 or lane.contacts is not None
        needs = (
            needs
            or lane.grip is not None
            or lane.load_dependence > 0.0
            or any(lane.slope)
            or any(lane.imbalance)
        )
        if needs and model.formulation != "exact":
            raise InputError(
                "Sensors, play, rollers, slip, slopes and masses off the axis need the formulation 'exact': the wheel "
                "speeds of 'thesis' are not those that encoders see."
            )
    if len({lane.backlash > 0.0 for lane in by_lane}) > 1:
        raise InputError("Either all lanes of a batch have play or none.")


def _changes(
    models: Sequence[Model], by_lane: Sequence[Imperfections], samples: int, sample_time: float
) -> Iterator[tuple[int, Sequence[Model], Sequence[Imperfections]]]:
    """Yield 0 and the sample of each change within the run, and the models and imperfections from there on."""
    yield 0, models, by_lane
    begins = {tuple(change_samples(lane, sample_time)) for lane in by_lane}
    if len(begins) > 1:
        raise InputError(
            "The robots of a batch change at different times; all of a batch must at the same ones."
        )
    for k, begin in enumerate(begins.pop() if begins else ()):
        if begin < samples:
            changed = [
                replace(
                    lane,
                    imbalance=lane.later[k].imbalance,
                    known=lane.known or models[place % len(models)].robot,
                )
                for place, lane in enumerate(by_lane)
            ]
            yield begin, [lane.later[k].model for lane in by_lane], changed


def _common_sample_time(controllers: Sequence[Feedback]) -> float:
    times = {controller.sample_time for controller in controllers}
    if len(times) != 1:
        raise InputError(
            f"The controllers' sample times are {sorted(times)} s; all controllers of a batch must have the "
            "same."
        )
    return times.pop()


def _common_wheel_count(robots: Sequence[Robot], controllers: Sequence[Controller]) -> int:
    counts = {*(robot.wheel_count for robot in robots), *(len(controller.gain) for controller in controllers)}
    if len(counts) != 1:
        raise InputError(
            f"Robots and controllers have {sorted(counts)} wheels; all of a batch must have the same number."
        )
    return counts.pop()


def _sampled(reference: Reference, samples: int, sample_time: float, *, plans: bool) -> NDArray[np.float64]:
    """Return the reference at every sample (samples, 10); `plans` says whether it may have leans and rates."""
    references = np.empty((samples, 10))
    times = np.round(np.arange(samples) * sample_time, 9)  # whole nanoseconds, as `simulate` asks
    last = None
    for k, t in enumerate(times.tolist()):
        wanted = reference(t)
        # a check of each sample would take longer than its simulation
        if wanted is not last:
            plain = type(wanted) is np.ndarray and wanted.dtype == np.float64 and wanted.shape == (10,)
            last = wanted if plain else real_array(wanted, (10,), "The reference")
        references[k] = last
    real_array(references, (samples, 10), "The reference")
    if np.abs(np.diff(references[:, 4])).max(initial=0.0) > JUMP:
        heading = Heading()
        references[:, 4] = [heading.unwrapped(psi) for psi in references[:, 4].tolist()]
    forbidden = np.argwhere(references[:, [2, 3, 5, 6, 7, 8, 9]] != 0.0)
    if len(forbidden) and not plans:
        row, column = forbidden[0]
        index = (2, 3, 5, 6, 7, 8, 9)[column]
        raise InputError(refusal(index, float(references[row, index])))
    return references
