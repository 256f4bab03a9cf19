"""Comparing controllers on one plant and one reference, whatever they are; the league has many of both."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import Feedback
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.experiments.metrics import SETTLE
from ballbot.experiments.score import Score, score
from ballbot.mechanics.model import Model
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate

#: largest lean of a start [rad]
_START_LEAN = 0.02


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A controller's scores over all seeds: means over the runs that did not end early, NaN where all did."""

    peak_position_error: float  #: [m]
    worst_position_error: float  #: the largest peak of any run that did not end early [m]
    rms_position_error: float  #: [m]
    rms_torque: float  #: [N m]
    rms_torque_change: float  #: [N m]
    falls: int  #: runs that ended early
    runs: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What `compare` returns."""

    seeds: tuple[int, ...]
    scores: Mapping[str, tuple[Score, ...]]  #: by controller, in the order of the seeds

    def summary(self, name: str) -> Summary:
        """Return one controller's scores over all seeds."""
        scores = self.scores[name]
        stood = [score for score in scores if score.ended is None]
        return Summary(
            peak_position_error=_mean([score.peak_position_error for score in stood]),
            worst_position_error=max((score.peak_position_error for score in stood), default=np.nan),
            rms_position_error=_mean([score.rms_position_error for score in stood]),
            rms_torque=_mean([score.rms_torque for score in stood]),
            rms_torque_change=_mean([score.rms_torque_change for score in stood]),
            falls=len(scores) - len(stood),
            runs=len(scores),
        )


def compare(
    plant_factory: Callable[[], Plant | Model],
    controllers: Mapping[str, Feedback],
    reference: Reference,
    *,
    duration: float,
    seeds: Sequence[int],
    settle: float = SETTLE,
    threads: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Run every controller with every seed and score the runs.

    A seed gives all that is random in the plant, and a start at rest at the origin with a lean of up to 0.02 rad,
    so that a plant without noise is tried more than once, too.

    Parameters
    ----------
    plant_factory : callable
        Makes a plant; each thread makes one of its own.
    controllers : mapping of str to Feedback
        By name; every run gets a copy.
    reference : callable
        f(t) -> (10,)
    duration : float
        Of a run [s].
    seeds : sequence of int
    settle : float
        See `ballbot.experiments.metrics.settled` [s].
    threads : int
        Runs at a time. Plants whose work is compiled gain from it.
    progress : callable, optional
        Called with the share that is done, from 0 to 1.

    Raises
    ------
    InputError
        Where there is nothing to run, or a run cannot be scored.
    """
    if not controllers or not seeds:
        raise InputError("There is nothing to compare: at least one controller and one seed are needed.")
    own = threading.local()
    runs = list(product(controllers, seeds))

    def run(job: tuple[str, int]) -> Score:
        name, seed = job
        if not hasattr(own, "plant"):
            own.plant = plant_factory()
        log = simulate(
            own.plant,
            copy.deepcopy(controllers[name]),
            reference,
            duration=duration,
            initial_state=start(seed),
            seed=seed,
        )
        return score(log, settle=settle)

    scores: dict[str, list[Score]] = {name: [] for name in controllers}
    with ThreadPoolExecutor(threads) as pool:
        for done, ((name, _), result) in enumerate(zip(runs, pool.map(run, runs), strict=True), start=1):
            scores[name].append(result)
            if progress:
                progress(done / len(runs))
    return Comparison(seeds=tuple(seeds), scores={name: tuple(found) for name, found in scores.items()})


def start(seed: int) -> NDArray[np.float64]:
    """Return a start (10,) at rest at the origin: theta and phi ~ U(-0.02, 0.02) rad."""
    state = np.zeros(10)
    state[2:4] = np.random.default_rng(seed).uniform(-_START_LEAN, _START_LEAN, 2)
    return state


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
