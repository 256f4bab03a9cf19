"""Closed-loop validation: both models from the measured start, driven by the controller that drove the robot.

Both models restart from the measured state every few seconds, before they and the robot lose each other's phase; whole
logs are compared by distributions (`ballbot.validation.whole_log`).

The controller is given, or its gain is recovered from the log. A robot that balances by u = K S(psi) (r - x) shows its
K: states, references and torques are all in the log, and the law is linear in K. Least squares over the samples that
no limit clipped gives it, and the share of the torques' variance that it explains shows whether the controller was of
this kind at all.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import Floats
from ballbot.mechanics.engine.run import simulate_one
from ballbot.summary import counted
from ballbot.validation.models import (
    Case,
    Comparison,
    ErrorPair,
    ModelPair,
    Trajectories,
    in_heading_frame,
    rows_after,
    window_starts,
)
from ballbot.validation.whole_log import WholeLog, compare_whole_log

#: torques this close to the limit count as clipped
_CLIPPED = 0.999
#: least share of each wheel's torque that the law must explain; dry friction compensated, for one, explains less
LEAST_R_SQUARED = 0.98
#: least share that a controller given must explain: its limits and quantised torques are its own, so less is asked
LEAST_EXPLAINED = 0.9
#: about the length of a run [s]: the longest stretch is divided into equal runs
_RESTART = 4.0
#: a controller may be late by up to so many samples
_LARGEST_DELAY = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredGain:
    """u[k] = K S(psi) (r - x) at row k - delay, as found in a log."""

    gain: Floats  #: K (n, 10)
    delay: int  #: samples from the state that a torque answers to the row that it stands in
    r_squared: Floats  #: (n,) share of each wheel's torque variance explained
    samples: int  #: rows used
    torque_limit: float | None  #: [N m] at which the log's torques were clipped, if they were


def recover_gain(log: Log) -> RecoveredGain:
    """Find the gain and the delay of the controller that recorded a log with states, torques and ref_x, ref_y, ref_psi.

    InputError if no linear law explains the torques.
    """
    errors, torques = heading_error(log.states, log.reference), log.torques
    limit = _clipping_limit(torques)
    fits = [
        _fit_gain(errors, torques, delay, limit) for delay in range(min(_LARGEST_DELAY + 1, len(log) // 40))
    ]
    if not fits:
        raise InputError(
            "A gain of ten numbers per wheel cannot be estimated "
            f"from {len(log)} rows; at least 40 are needed."
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
    """Return by how many samples the log's torques come after the states that the controller answers to.

    InputError if the controller is not the one that recorded the log, at any delay.
    """
    references, states = log.reference, log.states
    controller.reset()
    answers = np.array(
        [controller.update(float(t), x, r) for t, x, r in zip(log.t, states, references, strict=True)]
    )
    torques = log.torques
    delays = range(min(_LARGEST_DELAY + 1, len(log)))
    explained = [
        explained_share(torques[delay:], torques[delay:] - answers[: len(answers) - delay]).min()
        for delay in delays
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


def heading_error(states: Floats, references: Floats) -> Floats:
    """Return S(psi) (r - x) (N, 10)."""
    return in_heading_frame(references - states, states[:, 4])


def _clipping_limit(torques: Floats) -> float | None:
    """Return the largest torque where it recurs as only a limit makes it, else None."""
    largest = np.abs(torques).max()
    recurring = np.count_nonzero(np.abs(torques) == largest)
    return float(largest) if recurring > 3 and largest > 0.0 else None


def _fit_gain(errors: Floats, torques: Floats, delay: int, limit: float | None) -> RecoveredGain:
    causes, effects = errors[: len(errors) - delay], torques[delay:]
    usable = np.ones(len(effects), dtype=bool)
    if limit is not None:
        usable = np.abs(effects).max(axis=1) < _CLIPPED * limit
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
    """Errors in closed loop, restarted every few seconds, and the distributions over whole logs."""

    restarted: ErrorPair
    restart_every: float  #: [s]
    recovered: RecoveredGain | None  #: the log's own gain, where no controller was given
    whole: tuple[WholeLog, ...]  #: of each log; none with a user's controller or the thesis's equations

    def verdict(self) -> str:
        runs = f"restarted every {self.restart_every:.2g} s ({counted(self.restarted.runs, 'run')})"
        verdict = f"Closed loop, {runs}: {self.restarted.claim(self.models)}."
        return " ".join([verdict, *(one.verdict() for one in self.whole)])

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
        yield from ((one.verdict(), None) for one in self.whole)
        yield from (("The first seconds without a restart.", one.example) for one in self.whole[:1])

    def results(self) -> dict[str, object]:
        return {
            **self.restarted.results(self.models),
            "restart_every": self.restart_every,
            "whole_logs": [one.results() for one in self.whole],
        }


def closed_loop(case: Case) -> ClosedLoop | str:
    """Compare both models with the log in closed loop, in runs that restart within the rows that count.

    Without the controller that recorded the log its gain is recovered; the reason is returned if that fails. Every run
    has a copy of the controller of its own, as it ran on the robot. InputError if a controller that is given did not
    record the log.
    """
    models, log, controller, recovered = case.models, case.log, case.controller, None
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
    # a whole number of runs to the longest stretch, so that none of it is lost for want of a sample
    samples = longest // max(1, round(longest * log.sample_time / _RESTART))
    starts = window_starts(case.parts, samples=samples, every=samples)
    restarted = _run_models(models, log, starts, samples, controller, delay)
    measured = log.states[rows_after(starts, samples)]
    # the loop of the thesis's equations takes a minute to compile, for this alone
    exact = all(model.formulation == "exact" for model in models.both)
    whole = ()
    if exact and isinstance(controller, Controller):
        whole = (compare_whole_log(case, controller, delay=delay),)
    return ClosedLoop(
        models=models,
        restarted=ErrorPair.of_runs(list(measured), *map(list, restarted)),
        restart_every=samples * log.sample_time,
        recovered=recovered,
        whole=whole,
    )


def _run_models(
    models: ModelPair, log: Log, starts: NDArray[np.int64], samples: int, controller: Feedback, delay: int
) -> Floats:
    """Return the states (2, starts, samples, 10) of both models, every start of both stepped side by side."""
    measured, torques, references, t = log.states, log.torques, log.reference, log.t
    sample_time = log.sample_time
    begins, lanes_of = np.tile(starts, 2), [one for one in models.both for _ in starts]
    steps = [one.steps_in(sample_time) for one in lanes_of]
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
        for lane, model in enumerate(lanes_of):  # simulate_lanes would check its inputs anew at each sample
            out[lane, k] = simulate_one(
                model.selected,
                model.packed,
                states[lane],
                held[lane],
                sample_time=sample_time,
                steps=steps[lane],
            )
        states = out[:, k]
    return out.reshape(2, len(starts), samples, -1)
