"""Closed-loop validation: both models from the measured start, driven by the controller that drove the robot.

Over a whole log the model and the robot lose each other's phase, because friction makes both wander in a limit cycle
whose period the smallest difference shifts. So the comparison restarts from the measured state every few seconds,
and the run over the whole log stands beside it.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import Feedback
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.mechanics.engine import simulate_lanes
from ballbot.mechanics.model import Model
from ballbot.validation.contenders import ModelPair
from ballbot.validation.forecast import check_wheels
from ballbot.validation.state_errors import ErrorPair, join_pairs
from ballbot.validation.trajectories import Trajectories
from ballbot.validation.windows import rows_after, window_starts


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop:
    """Errors in closed loop: restarted every few seconds, and over the whole log in one go."""

    restarted: ErrorPair
    restart_every: float  #: [s]
    whole: ErrorPair  #: one run a log
    example: Trajectories  #: the beginning of the run over the whole log


def closed_loop(
    models: ModelPair,
    log: Log,
    parts: Sequence[range],
    controller: Feedback,
    *,
    delay: int = 0,
    restart_every: float = 4.0,
    example_time: float = 20.0,
) -> ClosedLoop:
    """Compare both models with the log in closed loop.

    Parameters
    ----------
    models : ModelPair
    log : Log
        With ref_x, ref_y, ref_psi.
    parts : sequence of range
        Rows within which runs restart.
    controller : Feedback
        As it ran on the robot; every run has a copy of its own.
    delay : int
        Samples by which the controller's torques come late.
    restart_every : float
        About the length of a run [s]: the longest stretch is divided into equal runs.
    example_time : float
        Length of the piece kept to look at [s].

    Raises
    ------
    InputError
        Where the controller's sample time is not the log's.
    """
    check_wheels(models.first.model, log)
    if not np.isclose(controller.sample_time, log.sample_time, rtol=0.02):
        raise InputError(
            f"The controller's sample time is {controller.sample_time:g} s and the log's "
            f"{log.sample_time:g} s; closed-loop validation needs the controller that recorded the log."
        )
    longest = max(len(part) for part in parts) - 1
    # a whole number of runs to the longest stretch, so that none of it is lost for want of a sample
    samples = longest // max(1, round(longest * log.sample_time / restart_every))
    starts = window_starts(parts, samples=samples, every=samples)
    restarted = _run(models, log, starts, samples, controller, delay)
    everything = len(log) - 1
    whole = _run(models, log, np.array([0]), everything, controller, delay)
    shown = min(everything, round(example_time / log.sample_time))
    return ClosedLoop(
        restarted=_errors(log, starts, restarted),
        restart_every=samples * log.sample_time,
        whole=_errors(log, np.array([0]), whole),
        example=Trajectories.beside(log, 0, whole[:, 0, :shown]),
    )


def join_closed_loops(parts: Sequence[ClosedLoop]) -> ClosedLoop:
    """Return the runs of all `parts` as one; the example is that of the first."""
    return ClosedLoop(
        restarted=join_pairs([part.restarted for part in parts]),
        restart_every=max(part.restart_every for part in parts),
        whole=join_pairs([part.whole for part in parts]),
        example=parts[0].example,
    )


def _errors(log: Log, starts: NDArray[np.int64], states: NDArray[np.float64]) -> ErrorPair:
    measured = log.states[rows_after(starts, states.shape[2])]
    return ErrorPair.of_runs(list(measured), list(states[0]), list(states[1]))


def _run(
    models: ModelPair, log: Log, starts: NDArray[np.int64], samples: int, controller: Feedback, delay: int
) -> NDArray[np.float64]:
    """Return the states (2, starts, samples, 10) of both models, every start of both stepped side by side."""
    measured, torques, references, t = log.states, log.torques, log.reference, log.t
    sample_time = log.sample_time
    begins = np.tile(starts, 2)
    controllers = [copy.deepcopy(controller) for _ in begins]
    for one in controllers:
        one.reset()
    states = measured[begins]
    out = np.empty((len(begins), samples, states.shape[1]))
    asked = np.empty((samples, len(begins), torques.shape[1]))
    for k in range(samples):
        for lane, (one, row) in enumerate(zip(controllers, begins + k, strict=True)):
            asked[k, lane] = one.update(float(t[row]), states[lane], references[row])
        # until the first late torque arrives, those measured act
        held = asked[k - delay] if k >= delay else torques[begins + k]
        halves = zip(models.both, np.split(states, 2), np.split(held, 2), strict=True)
        states = np.concatenate([_step(model, x, u, sample_time) for model, x, u in halves])
        out[:, k] = states
    return out.reshape(2, len(starts), samples, -1)


def _step(
    model: Model, states: NDArray[np.float64], torques: NDArray[np.float64], sample_time: float
) -> NDArray[np.float64]:
    """Advance all `states` (lanes, 10) of a model by one sample."""
    batch = simulate_lanes(
        model.selected,
        parameters=model.packed[None],
        initial=states,
        torques=torques[:, None],
        sample_time=sample_time,
        steps=model.steps_in(sample_time),
        parameter_of=np.zeros(len(states), dtype=np.int64),
        lost_lanes=True,  # those of the sample before
    )
    return batch.states[:, 0]
