"""The design of an experiment: an evolution over references that makes standard errors small within limits.

Made small is the worst error times the geometric mean of all, each in shares of its parameter's bounds. The worst alone
is a poor guide where a parameter is hard to tell whatever one does, as delta where s is small: a design for it alone
leaves the others hardly better known than a square does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.references import Reference, sampled_reference
from ballbot.errors import InputError
from ballbot.experiments.excite.information import expected_errors
from ballbot.experiments.excite.limits import UNITS, Peaks
from ballbot.experiments.excite.multisine import Family, family
from ballbot.experiments.excite.task import Run, Task, run
from ballbot.fitting.checkpoint import Memoize, no_checkpoint
from ballbot.fitting.run import Executor, Threads
from ballbot.fitting.search import evolve
from ballbot.sizes import MOST_TRIALS

#: on the model the limits are this share of those given: noise, rollers and a friction believed wrongly come on top
MARGIN = 0.85
#: levels tried for a reference, the share of the limits aimed at and the least that will do, and the highest level:
#: friction eats some of the motion, so that amplitudes may be some times what the linear loop without it allows
_LEVELS, _AIM, _CLOSE, _MOST_LEVEL = 4, 0.97, 0.92, 4.0
#: share of the limits that a fall counts as
_FALLS = 3.0
#: cost of a run that exceeds a limit, by however little; the log of a criterion is far below
_EXCEEDS = 100.0
_MOST_ERROR = 1e9


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How hard to search.

    Raises
    ------
    InputError
        Where a count is too small.
    """

    generations: int = 40  #: at most
    population: int = 16  #: references in each

    def __post_init__(self) -> None:
        for name, least in (("generations", 1), ("population", 4)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)!r}; it must be {least} or more.")
            if getattr(self, name) > MOST_TRIALS:
                raise InputError(f"{name} is {getattr(self, name)!r}; it must be {MOST_TRIALS} or less.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """A reference and what is expected of it; errors are in shares of the width of each parameter's bounds."""

    times: NDArray[np.float64]  #: (N,) [s]
    poses: NDArray[np.float64]  #: (N, 3), x and y [m] and psi [rad] that the robot is asked for
    frequencies: NDArray[np.float64]  #: (3, k), of the sines in x, y and psi [Hz]
    amplitudes: NDArray[np.float64]  #: (3, k) [m, m, rad]
    phases: NDArray[np.float64]  #: (3, k) [rad]
    peaks: Peaks  #: on the model, the worst over less and more friction too
    errors: NDArray[np.float64]  #: (f,), expected of the parameters sought
    history: tuple[float, ...]  #: `criterion` of the best after each generation

    @property
    def reference(self) -> Reference:
        """What the controller is given."""
        return sampled_reference(self.times, self.poses)


def design(
    task: Task,
    *,
    effort: Effort | None = None,
    seed: int = 0,
    spread: Executor | None = None,
    recall: Memoize = no_checkpoint,
    report: Callable[[float, float], None] | None = None,
) -> Design:
    """Find the reference whose log would tell the parameters best, that which it tells worst above all.

    Parameters
    ----------
    task : Task
    effort : Effort, optional
    seed : int
        The same seed gives the same design, bit for bit.
    spread : Spread, optional
        Where the work is done; by default a thread for each core.
    recall : Recall, optional
        A checkpoint's, for a design that can be resumed: it answers for each generation.
    report : callable, optional
        Told the share that is done and the best `criterion` so far, after each generation.

    Raises
    ------
    InputError
        Where no reference keeps within the limits, or none that does tells every parameter.
    """
    effort, spread = effort or Effort(), spread or Threads()
    choice = family(task.robot, task.controller, limits=task.limits, duration=task.duration)
    shared = (task, choice)
    evolved = evolve(
        lambda members: np.array(spread(_cost, shared, list(members))),
        size=choice.size,
        generations=effort.generations,
        population=effort.population,
        seed=seed,
        report=lambda done, cost: report(done / effort.generations, _criterion_of(cost)) if report else None,
        recall=recall,
    )
    best = _fitted(task, choice, evolved.best)
    _check_within(task, best)
    errors = expected_errors(task.question, [best.run.log])
    _check_told(task, errors)
    return Design(
        times=choice.times,
        poses=best.level * choice.poses(evolved.best),
        frequencies=choice.frequencies,
        amplitudes=best.level * choice.amplitudes(evolved.best),
        phases=choice.phases,
        peaks=best.run.peaks,
        errors=errors,
        history=tuple(_criterion_of(cost) for cost in evolved.history),
    )


def criterion(errors: NDArray[np.float64]) -> float:
    """Return what a design makes small, of scaled errors (f,): the geometric mean of the worst and of their mean."""
    logs = np.log(np.clip(errors, 0.0, _MOST_ERROR))
    return float(np.exp(0.5 * (logs.max() + logs.mean())))


def _criterion_of(cost: float) -> float:
    """Return the criterion that a cost stands for; infinite where none keeps within the limits."""
    return math.exp(cost) if cost < _EXCEEDS else math.inf


def _cost(shared: tuple[Task, Family], member: NDArray[np.float64]) -> float:
    """Return the log of the criterion; where no level keeps within the limits, more than any."""
    task, choice = shared
    fitted = _fitted(task, choice, member)
    if fitted.used > 1.0:
        return _EXCEEDS + min(fitted.used, _EXCEEDS)
    return math.log(criterion(expected_errors(task.question, [fitted.run.log])))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fitted:
    """A member of the family at the level at which it makes use of the limits."""

    level: float  #: what its amplitudes are multiplied by
    run: Run
    used: float  #: the largest share of a limit, of `MARGIN`, that it takes


def _fitted(task: Task, choice: Family, member: NDArray[np.float64]) -> _Fitted:
    """Return the member at the highest level tried that keeps within the limits, or at the gentlest where none does."""
    poses, limits = choice.poses(member), task.limits.scaled(MARGIN)
    level, best = 1.0, None
    for _ in range(_LEVELS):
        followed = run(task, sampled_reference(choice.times, level * poses))
        used = max(limits.used(followed.peaks).values()) if followed.lasted == 1.0 else _FALLS
        if best is None or _better(used, best.used):
            best = _Fitted(level=level, run=followed, used=used)
        if _CLOSE <= used <= 1.0:
            break
        level = min(level * float(np.clip(_AIM / max(used, 1e-9), 0.4, 3.0)), _MOST_LEVEL)
    assert best is not None
    return best


def _better(used: float, before: float) -> bool:
    """Return whether a run uses the limits better: within them the fuller, beyond them the gentler."""
    return before < used <= 1.0 or (before > 1.0 and used < before)


def _check_within(task: Task, best: _Fitted) -> None:
    if best.run.lasted < 1.0:
        raise InputError(
            "With this controller the robot falls on every reference. Give a controller that balances the "
            "robot, or lower the lean limit."
        )
    limits = task.limits.scaled(MARGIN)
    for name in limits.exceeded(best.run.peaks):
        raise InputError(
            f"No reference stays within {MARGIN:g} of the limits: the {name} reaches "
            f"{getattr(best.run.peaks, name):.3g} of {getattr(limits, name):.3g} {UNITS[name]}. Raise that "
            "limit."
        )


def _check_told(task: Task, errors: NDArray[np.float64]) -> None:
    untold = [label for label, error in zip(task.question.labels, errors, strict=True) if np.isinf(error)]
    if untold:
        limits = task.limits
        raise InputError(
            f"Within {limits.lean:.3g} rad of lean, {limits.floor:.3g} m of floor and {limits.torque:.3g} N "
            f"m the robot hardly moves, and no reference makes {', '.join(untold)} identifiable. Raise the "
            "limits or the duration."
        )
