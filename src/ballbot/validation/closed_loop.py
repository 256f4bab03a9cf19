"""Closed-loop validation: both models from the measured state, driven by the controller that recorded the log.

Both models restart from the measured state every few seconds, before their phase drifts away from the robot's; whole
logs are compared by distributions (`ballbot.validation.whole_log`).

The controller is given, or its gain is recovered from the log: states, references and torques are in the log, and
u = K S(psi) (r - x) is linear in K. Least squares over the samples that are not clipped gives K, and the explained
share of the torques' variance shows whether the controller was of this kind.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.engine.run import simulate_one
from ballbot.mechanics.model import Model
from ballbot.summary import counted
from ballbot.validation.models import (
    Case,
    Comparison,
    ErrorPair,
    Trajectories,
    in_heading_frame,
    rows_after,
    started,
    window_starts,
)
from ballbot.validation.whole_log import WholeLog, compare_whole_log

#: torques above this fraction of the limit count as clipped
_CLIPPED = 0.999
#: smallest explained share of each wheel's torque; with compensated dry friction, for example, less is explained
LEAST_R_SQUARED = 0.98
#: smallest share explained by a given controller: its own limits and quantisation are not modelled, so less suffices
LEAST_EXPLAINED = 0.9
#: approximate length of a run [s]: the longest interval without a gap is divided into equal runs
_RESTART = 4.0
#: largest delay of a controller that is tried, in samples
_LARGEST_DELAY = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredGain:
    """A controller u[k] = K S(psi) (r - x) at row k - delay, estimated from a log."""

    gain: Floats  #: K (n, 10)
    delay: int  #: samples from a state to the row of the torque that answers it
    r_squared: Floats  #: (n,) share of each wheel's torque variance explained
    samples: int  #: rows used
    torque_limit: float | None  #: [N m] at which the log's torques were clipped; None if they were not


def recover_gain(log: Log) -> RecoveredGain:
    """Estimate gain and delay of the controller that recorded a log with states, torques and ref_x, ref_y, ref_psi.

    InputError if no linear law explains the torques.
    """
    errors, torques = in_heading_frame(log.reference - log.states, log.states[:, 4]), log.torques
    largest = float(np.abs(torques).max())
    # a largest torque that recurs exactly is a limit
    clipped = largest > 0.0 and np.count_nonzero(np.abs(torques) == largest) > 3
    limit = largest if clipped else None
    fits = [
        _fit_gain(errors, torques, delay, limit) for delay in range(min(_LARGEST_DELAY + 1, len(log) // 40))
    ]
    if not fits:
        raise InputError(
            f"A gain of ten numbers per wheel cannot be estimated from {len(log)} rows; at least 40 are needed."
        )
    unchanging = np.flatnonzero(np.ptp(torques, axis=0) == 0.0)
    if unchanging.size:
        raise InputError(
            f"u{unchanging[0] + 1} never changes in the log, so the gain that it comes from cannot be estimated."
        )
    best = max(fits, key=lambda fit: float(fit.r_squared.min()))
    worst = int(np.argmin(best.r_squared))
    if not best.r_squared[worst] >= LEAST_R_SQUARED:
        raise InputError(
            "The control law u = K S(psi) (r - x) explains only "
            f"{100 * best.r_squared[worst]:.1f} % of u{worst + 1} in the log; the estimate of its "
            f"gain needs {100 * LEAST_R_SQUARED:g} %. Give the controller that recorded the log."
        )
    return best


def delay_of(controller: Feedback, log: Log) -> int:
    """Return the delay in samples from a state to the torques that the controller answers with.

    InputError if the controller did not record the log, whatever the delay.
    """
    controller.reset()
    rows = zip(log.t.tolist(), log.states, log.reference, strict=True)
    answers, torques = np.array([controller.update(t, x, r) for t, x, r in rows]), log.torques
    explained = [
        explained_share(torques[delay:], torques[delay:] - answers[: len(answers) - delay]).min()
        for delay in range(min(_LARGEST_DELAY + 1, len(log)))
    ]
    best = int(np.argmax(explained))
    if not explained[best] >= LEAST_EXPLAINED:
        raise InputError(
            f"The controller explains only {max(0.0, 100 * explained[best]):.1f} % of the "
            "log's torques; closed-loop validation needs the controller that recorded the log."
        )
    return best


def explained_share(torques: Floats, unexplained: Floats) -> Floats:
    """Return R^2 (n,) of each wheel: one less the unexplained share of the torque's variance."""
    total = np.sum((torques - torques.mean(axis=0)) ** 2, axis=0)
    return 1.0 - np.sum(unexplained**2, axis=0) / np.where(total > 0.0, total, np.inf)


def _fit_gain(errors: Floats, torques: Floats, delay: int, limit: float | None) -> RecoveredGain:
    causes, effects = errors[: len(errors) - delay], torques[delay:]
    usable = np.abs(effects).max(axis=1) < (np.inf if limit is None else _CLIPPED * limit)
    causes, effects = causes[usable], effects[usable]
    transposed, *_ = np.linalg.lstsq(causes, effects, rcond=None)
    return RecoveredGain(
        gain=np.asarray(transposed.T, dtype=np.float64),
        delay=delay,
        r_squared=explained_share(effects, effects - causes @ transposed),
        samples=len(effects),
        torque_limit=limit,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop(Comparison):
    """Errors in closed loop with restarts every few seconds, and the distributions over whole logs."""

    restarted: ErrorPair
    restart_every: float  #: [s]
    recovered: RecoveredGain | None  #: the gain recovered from the log if no controller was given
    whole: tuple[WholeLog, ...]  #: of each log; empty with a user's controller or the thesis's equations

    def verdict(self) -> str:
        runs = f"restarted every {self.restart_every:.2g} s ({counted(self.restarted.runs, 'run')})"
        verdict = f"Closed loop, {runs}: {self.restarted.claim(self.models)}."
        return " ".join([verdict, *(comparison.verdict() for comparison in self.whole)])

    def shown(self) -> Iterator[tuple[str, ErrorPair | Trajectories | None]]:
        controller, recovered = "the controller that drove the robot", self.recovered
        if recovered is not None:
            late = f", {counted(recovered.delay, 'sample')} late" if recovered.delay else ""
            least = float(recovered.r_squared.min())
            controller = f"the gain recovered from the log (R² = {least:.4f}{late})"
        caption = (
            f"Closed-loop errors over {counted(self.restarted.runs, 'run')} under {controller}, restarted from the "
            f"measured state every {self.restart_every:.2g} s."
        )
        yield caption, self.restarted
        yield from ((comparison.verdict(), None) for comparison in self.whole)
        if self.whole:
            yield "The first seconds without a restart.", self.whole[0].example

    def results(self) -> dict[str, object]:
        return {
            **self.restarted.results(self.models),
            "restart_every": self.restart_every,
            "whole_logs": [comparison.results() for comparison in self.whole],
        }


def closed_loop(case: Case) -> ClosedLoop | str:
    """Compare both models with the log in closed loop, in runs that restart within the rows that count.

    Without the controller that recorded the log its gain is recovered; if that fails, the reason is returned.
    InputError if a given controller did not record the log.
    """
    models, log, recovered = case.models, case.log, None
    controller = copy.deepcopy(case.controller)  # several logs are validated in parallel
    if controller is None:
        try:
            recovered = recover_gain(log)
        except InputError as error:
            return str(error)
        robot, limit = models.first.model.robot, recovered.torque_limit
        controller = Controller(robot, recovered.gain, sample_time=log.sample_time, torque_limit=limit)
    delay = delay_of(controller, log) if recovered is None else recovered.delay
    if not np.isclose(controller.sample_time, log.sample_time, rtol=0.02):
        raise InputError(
            f"The controller's sample time is {controller.sample_time:g} s and the log's "
            f"{log.sample_time:g} s; closed-loop validation needs the controller that recorded the log."
        )
    longest = max(len(part) for part in case.parts) - 1
    # a whole number of runs in the longest interval, so that none of it is lost by a missing sample
    samples = longest // max(1, round(longest * log.sample_time / _RESTART))
    starts = window_starts(case.parts, samples=samples, every=samples)
    first, second = (
        [_run(model, log, int(start), samples, controller, delay) for start in starts]
        for model in models.both
    )
    measured = log.states[rows_after(starts, samples)]
    # the loop of the thesis's equations would take a minute to compile, for this comparison only
    exact = all(model.formulation == "exact" for model in models.both)
    whole = ()
    if exact and isinstance(controller, Controller):
        whole = (compare_whole_log(case, controller, delay=delay),)
    return ClosedLoop(
        models=models,
        restarted=ErrorPair.of_runs(list(measured), first, second),
        restart_every=samples * log.sample_time,
        recovered=recovered,
        whole=whole,
    )


def _run(model: Model, log: Log, start: int, samples: int, controller: Feedback, delay: int) -> Floats:
    """Return the states (samples, 10) of a model from the measured state in row `start` on."""
    states, asked = np.empty((samples, len(STATE_NAMES))), np.empty((samples, log.torques.shape[1]))
    measured, torques, references = log.states, log.torques, log.reference
    steps = model.steps_in(log.sample_time)
    (state,) = started(model, log, np.array([start]), measured[[start]])
    controller.reset()
    for k, row in enumerate(range(start, start + samples)):
        asked[k] = controller.update(float(log.t[row]), state[: len(STATE_NAMES)], references[row])
        # the measured torques act until the first delayed torque arrives
        held = asked[k - delay] if k >= delay else torques[row]
        state = simulate_one(
            model.selected, model.packed, state, held, sample_time=log.sample_time, steps=steps
        )
        states[k] = state[: len(STATE_NAMES)]
    return states
