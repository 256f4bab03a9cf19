"""How a run is measured, and compared with the models with and without friction (chapter 4).

The validation is in closed loop, in open loop and by residuals. Closed loop goes over the whole run in one, as the
thesis's does, and restarted every few seconds from the measured state, as robot and model lose each other's phase.
"Without friction" there are two models: the exact equations, and the thesis's own formulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.spatial import KDTree

from ballbot.arrays import Floats
from ballbot.control.presets import nominal_controller
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.thesis.reproduce.recordings import ARRIVED, CHANGE, ModelOnGrid
from ballbot.validation.models import (
    Case,
    ModelPair,
    NamedModel,
    forecast,
    recoverable_lean,
    rows_after,
    thesis_error,
)
from ballbot.validation.residuals import predict
from ballbot.validation.statistics import Correlations, correlations
from ballbot.workflows.metrics import position_error, rms, true_place


def peak_after_arrival(log: Log) -> float:
    """Return the largest distance from the reference once it has been reached [m]."""
    return float(position_error(log)[log.t >= ARRIVED].max())


def distance_at(log: Log, t: float) -> float:
    """Return the distance from the reference at a time [s], in metres."""
    return float(position_error(log)[np.searchsorted(log.t, t - 1e-6)])


def steady_error(log: Log) -> float:
    """Return the mean distance from the reference over a run's last 5 s [m]."""
    return float(position_error(log)[log.t >= log.t[-1] - 5.0].mean())


def apart(first: Log, second: Log, name: str) -> float:
    """Return the RMS difference of a state between two runs over the first one's range of it."""
    count = min(len(first), len(second))
    return rms(first[name][:count] - second[name][:count]) / float(np.ptp(first[name]))


def largest_apart(first: Log, second: Log, names: Sequence[str] = STATE_NAMES) -> float:
    """Return the largest of those states' `apart`."""
    return max(apart(first, second, name) for name in names)


def way_apart(first: Log, second: Log) -> float:
    """Return the largest distance of the second run's place, on its way, from the first run's path [m]."""
    paths = [true_place(log) for log in (first, second)]
    along, points = (np.column_stack([path["x"], path["y"]])[path.t < ARRIVED] for path in paths)
    # a path's points lie millimetres apart, so that the nearest of them is as good as the path
    distances, _ = KDTree(along).query(points)
    return float(np.max(distances))


def above(values: Floats, sample_time: float, frequency: float) -> Floats:
    """Return what of columns (n, ...) lies above a frequency [Hz], by a Butterworth filter run both ways.

    Parameters
    ----------
    values : ndarray (n, ...)
        A row for each sample.
    sample_time : float
        [s]
    frequency : float
        [Hz]
    """
    sections = scipy.signal.butter(2, frequency, btype="highpass", fs=1.0 / sample_time, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0), np.float64)


#: time between restarts in closed loop, between starts in open loop, and how far those look [s]
RESTART, EVERY, AHEAD = 4.0, 1.0, 2.0
#: the models, in the order of every array here
MODELS = ("friction", "exact", "thesis")


@dataclass(frozen=True, kw_only=True, eq=False)
class Validated:
    """Errors (4.1) of a run, states in a log's order; models as in `MODELS`."""

    log: Log  #: as measured
    runs: dict[str, Log]  #: each model's closed loop over the whole run
    whole: Floats  #: (3, 10) their errors
    rmse: Floats  #: (3, 10) alike, by the root mean square
    restarted: Floats  #: (3, 10) mean errors over the restarted runs
    falls: Floats  #: (3,) median time until a model's lean is past recovery in open loop [s]
    #: (2, 2, 10) mean errors in open loop of friction and one model without, until the first of the two is past
    #: recovery, as Table 4.2
    open_loop: Floats
    #: an open-loop run, "measured" and each model until its own lean is past recovery
    example: dict[str, Log]
    correlations: Correlations  #: of the residuals of the model with friction


def validated(robot: Robot, identified: Robot, log: Log) -> Validated:
    """Compare the models with a run of the twin through the change of reference.

    Parameters
    ----------
    robot : Robot
        Without friction.
    identified : Robot
        With it.
    log : Log
        As measured, under the nominal controller without compensation.
    """
    models = (Model(identified), Model(robot), Model(robot, formulation="thesis"))
    runs = [_closed_run(model, log, 0, len(log)) for model in models]
    differences = [log.states[: len(run)] - run.states for run in runs]
    pair = ModelPair(
        first=NamedModel(name="with friction", model=models[0]),
        second=NamedModel(name="without friction", model=models[1]),
    )
    prediction = predict(Case(models=pair, log=log, parts=[range(len(log))]))
    falls, open_loop, example = _open_loop(models, log)
    return Validated(
        log=log,
        runs=dict(zip(MODELS, runs, strict=True)),
        whole=np.array([thesis_error(difference) for difference in differences]),
        rmse=np.array([np.sqrt(np.mean(difference**2, axis=0)) for difference in differences]),
        restarted=np.array([_restarted(model, log, round(RESTART / log.sample_time)) for model in models]),
        falls=falls,
        open_loop=open_loop,
        example=example,
        correlations=correlations(
            np.hstack([prediction.residuals, prediction.torques]), prediction.labels, prediction.segments
        ),
    )


def _closed_run(model: Model, log: Log, start: int, samples: int) -> Log:
    """Return a model's run from the measured state of a row on, under the controller that recorded the log."""
    begin = float(log.t[start])
    return simulate(
        ModelOnGrid(model),
        nominal_controller(model.robot),
        lambda t: CHANGE(begin + t),
        duration=samples * log.sample_time,
        initial_state=log.states[start],
    )


def _restarted(model: Model, log: Log, samples: int) -> Floats:
    errors = []
    for start in range(0, len(log) - samples + 1, samples):
        run = _closed_run(model, log, start, samples)
        errors.append(thesis_error(log.states[start : start + len(run)] - run.states))
    return np.mean(errors, axis=0)


def _open_loop(models: Sequence[Model], log: Log) -> tuple[Floats, Floats, dict[str, Log]]:
    """Return `falls`, `open_loop` and `example` of `Validated`, from starts that can be recovered from."""
    samples = round(AHEAD / log.sample_time)
    # the exact equations give the lean beyond which the motors no longer bring the body back up
    limit = recoverable_lean(models[1])
    starts = np.arange(0, len(log) - samples, round(EVERY / log.sample_time), dtype=np.int64)
    starts = starts[np.abs(log.states[starts, 2:4]).max(axis=1) < limit]
    states = forecast(models, log, starts, samples)  # (3, starts, samples, 10)
    past = ~(np.abs(states[..., 2:4]).max(axis=-1) < limit)
    lengths = np.where(past.any(axis=-1), np.maximum(past.argmax(axis=-1), 1), samples)
    off = log.states[rows_after(starts, samples)] - states

    def errors(model: int, other: int) -> Floats:
        shorter = np.minimum(lengths[0], lengths[other])
        return np.mean([thesis_error(off[model, k, :n]) for k, n in enumerate(shorter)], axis=0)

    # the example is the start at which the model with friction lasts as long as it does at the median start
    k = int(np.argsort(lengths[0], kind="stable")[len(starts) // 2])
    row = int(starts[k])
    example = {"measured": log.select(slice(row, row + int(lengths[:, k].max()) + 1))}
    for name, simulated, length in zip(MODELS, states[:, k], lengths[:, k], strict=True):
        run = np.vstack([log.states[row], simulated[:length]])
        times = log.t[row : row + length + 1]
        example[name] = Log({"t": times} | dict(zip(STATE_NAMES, run.T, strict=True)))
    return (
        np.median(lengths, axis=1) * log.sample_time,
        np.array([[errors(0, other), errors(other, other)] for other in (1, 2)]),
        example,
    )
