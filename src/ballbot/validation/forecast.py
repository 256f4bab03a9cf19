"""Forecasts: a model started from the measured state and driven by the measured torques, from many starts at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.mechanics.engine import simulate_lanes
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model


def forecast(
    models: Sequence[Model],
    log: Log,
    starts: NDArray[np.int64],
    samples: int,
    *,
    initial: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Simulate each model from each start with the torques measured from there on.

    Row k of a log holds the state at t_k and the torques held from then on, so that the forecast from row k with
    the torques of rows k .. k + samples - 1 is of the states in rows k + 1 .. k + samples.

    Parameters
    ----------
    models : sequence of Model
        All with as many wheels as the log has torques.
    log : Log
    starts : array (starts,)
        Rows to start from.
    samples : int
        How far.
    initial : array (starts, 10), optional
        States to start from, in place of the measured ones.

    Returns
    -------
    array (models, starts, samples, 10)
        A forecast that passes the largest lean stays where it did.
    """
    return np.stack([_forecast_of(model, log, starts, samples, initial) for model in models])


def _forecast_of(
    model: Model, log: Log, starts: NDArray[np.int64], samples: int, initial: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return one model's states (starts, samples, 10)."""
    check_wheels(model, log)
    batch = simulate_lanes(
        model.selected,
        parameters=model.packed[None],
        initial=log.states[starts] if initial is None else initial,
        torques=log.torques[starts[:, None] + np.arange(samples)],
        sample_time=log.sample_time,
        steps=model.steps_in(log.sample_time),
        parameter_of=np.zeros(len(starts), dtype=np.int64),
    )
    return batch.states


def recoverable_lean(model: Model) -> float:
    """Return the lean [rad] from which, at rest, the wheels' largest torques no longer bring the body back up.

    For a lean theta about x, as well as phi about y, the acceleration is affine in the torques: the body's own
    fall plus at most |row of its torques|_1 times the torque limit against it. The answer is the smaller of the
    two leans at which these are equal, at most the lean at which a simulation ends.
    """
    leans = np.linspace(0.0, LARGEST_LEAN, 601)
    n, limit = model.robot.wheel_count, model.robot.drive.torque_limit
    smallest = LARGEST_LEAN
    for axis in (2, 3):
        q = np.zeros((len(leans), 5))
        q[:, axis] = leans
        rest = np.zeros_like(q)
        fall = model.acceleration(q, rest, np.zeros((len(q), n)))[:, axis]
        push = [model.acceleration(q, rest, np.tile(unit, (len(q), 1)))[:, axis] - fall for unit in np.eye(n)]
        lost = np.flatnonzero(fall > limit * np.abs(push).sum(axis=0))
        if lost.size:
            smallest = min(smallest, float(leans[lost[0]]))
    return smallest


def check_wheels(model: Model, log: Log) -> None:
    """Refuse a log whose torques are not those of the model's wheels.

    Raises
    ------
    InputError
        Naming both numbers.
    """
    have, need = log.torques.shape[1], model.robot.wheel_count
    if have != need:
        raise InputError(
            f"The log has the torques of {have} wheels, but the robot {model.robot.name} has {need} wheels."
        )
