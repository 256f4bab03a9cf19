"""The design of an excitation: a search over multisine references that makes standard errors small within limits.

    r(t) = w(t) sum_k A_k (sin(2 pi f_k t + p_k) - sin p_k)        for each of x, y, psi;  w fades in and out

A slow sine moves the robot about the floor. A fast one hardly moves it and is a dither of the torques instead: K's
columns of x, y and psi turn the reference r into torques K r, so that for three wheels any dither d is the reference
K^-1 d. One reference file is therefore all that a controller needs, and the same on a robot as on the twin.

A sine of unit amplitude at f answers, in the linear closed loop x_dot = A x + B K (r - x), with

    G(f) = (2 pi i f I - A + B K)^-1 B K e        states         K (e - G(f))        torques

and the largest amplitude of that sine alone is the one that brings lean, place or torque to its limit. A member of the
family is the fractions of these amplitudes that its sines have. Phases are fixed and spread over the turn, which
halves the number of parameters to search.

The search minimises the worst error times the geometric mean of all, each as a fraction of its parameter's bounds. The
worst alone is a poor guide if a parameter is hard to identify in any case, as delta is if s is small: a design for it
alone leaves the others hardly better known than a square does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import MOST_TRIALS
from ballbot.control.controller import Controller
from ballbot.control.references import Reference, sampled_reference
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import evolve
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.robot import Friction, Robot
from ballbot.simulation.run import sample_count
from ballbot.workflows.excitation_task import (
    PEAK_UNITS,
    ExcitationTask,
    ReferenceRun,
    RunLimits,
    RunPeaks,
    expected_errors,
    run_on_model,
)

#: sines of each axis, from so many turns in the run (at least) to the fastest frequency [Hz]
SINES, MIN_TURNS, SLOWEST, FASTEST = 5, 2.0, 0.08, 3.0
#: the axes' frequencies lie apart by this share, so that no two stay in step
_DETUNED = 0.07
#: the reference fades in and out over so long [s], a quarter of the run at most
_FADE = 2.0
#: no sine turns the reference's heading further than this [rad]
_MAX_TURN = 1.0

#: multiples of it, their whole part left out, spread evenly
_GOLDEN = 0.6180339887498949

_AXES = (0, 1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class MultisineFamily:
    """References that differ in the shares of their sines; a member is a point of the unit cube."""

    times: NDArray[np.float64]  #: (N,), the controller's samples [s]
    frequencies: NDArray[np.float64]  #: (3, k), of x, y and psi [Hz]
    largest: NDArray[np.float64]  #: (3, k), amplitudes of each sine alone [m, m, rad]

    @property
    def size(self) -> int:
        """Coordinates of a member: a share of each sine."""
        return self.frequencies.size

    def amplitudes(self, member: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return A (3, k) of a member (size,) [m, m, rad]."""
        shares = member**2  # squared, so that a search may all but leave sines out
        shares = shares / max(float(shares.sum()), 1e-12)
        return shares.reshape(self.frequencies.shape) * self.largest

    @property
    def phases(self) -> NDArray[np.float64]:
        """Phases p (3, k) [rad], spread evenly over the turn."""
        return (
            2.0
            * np.pi
            * np.modf(_GOLDEN * np.arange(self.frequencies.size))[0].reshape(self.frequencies.shape)
        )

    def poses(self, member: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return x, y and psi at every sample (N, 3) of a member (size,)."""
        amplitudes, phases = self.amplitudes(member), self.phases
        angles = 2.0 * np.pi * self.frequencies[..., None] * self.times + phases[..., None]
        waves = amplitudes[..., None] * (np.sin(angles) - np.sin(phases)[..., None])
        return (_fading(self.times) * waves.sum(axis=1)).T


def multisine_family(
    robot: Robot, controller: Controller, *, limits: RunLimits, duration: float
) -> MultisineFamily:
    """Return the references for a robot, its controller and a run's length.

    Parameters
    ----------
    robot : Robot
        Its friction is left out of the linear loop.
    controller : Controller
    limits : Limits
    duration : float
        [s]

    Raises
    ------
    InputError
        If the duration is not at least a sample.
    """
    count = sample_count(duration, controller.sample_time)
    slowest = max(SLOWEST, MIN_TURNS / duration)
    fastest = min(max(FASTEST, 2.0 * slowest), 0.2 / controller.sample_time)
    detuned = 1.0 + _DETUNED * np.arange(len(_AXES))
    frequencies = detuned[:, None] * np.geomspace(slowest, fastest, SINES)
    frictionless = Model(robot.replace(friction=Friction.none(robot.wheel_count)))
    return MultisineFamily(
        times=controller.sample_time * np.arange(count, dtype=np.float64),
        frequencies=frequencies,
        largest=_largest_amplitudes(frictionless, controller, frequencies, limits),
    )


def _largest_amplitudes(
    model: Model, controller: Controller, frequencies: NDArray[np.float64], limits: RunLimits
) -> NDArray[np.float64]:
    """Return the amplitudes (3, k) at which each sine alone brings the linear loop to a limit."""
    linear, K = model.linearize(), controller.gain
    result = np.empty(frequencies.shape)
    for row, axis in enumerate(_AXES):
        unit = np.eye(10)[axis]
        for column, frequency in enumerate(frequencies[row]):
            loop = 2j * np.pi * frequency * np.eye(10) - linear.A + linear.B @ K
            G = np.abs(state := np.linalg.solve(loop, linear.B @ (K @ unit)))
            torque = np.abs(K @ (unit - state)).max()
            answers = (G[2:4].max() / limits.lean, G[:2].max() / limits.floor, torque / limits.torque)
            largest = 1.0 / max(*answers, 1e-9)
            result[row, column] = min(largest, _MAX_TURN) if axis == 4 else largest
    return result


def _fading(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return w (N,): from 0 to 1 and back to 0 in halves of a cosine."""
    end = float(times[-1])
    fade = max(min(_FADE, 0.25 * end), 1e-9)
    share = np.clip(np.minimum(times, end - times) / fade, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * share)


#: on the model the limits are this share of those given: noise, rollers and a friction believed wrongly come on top
MARGIN = 0.85
#: levels tried for a reference, the share of the limits aimed at and the least that will do, and the highest level:
#: friction eats some of the motion, so that amplitudes may be some times what the linear loop without it allows
_LEVELS, _AIM, _CLOSE, _MAX_LEVEL = 4, 0.97, 0.92, 4.0
#: share of the limits that a fall counts as
_FALLS = 3.0
#: cost of a run that exceeds a limit, by however little; the log of a criterion is far below
_EXCEEDS = 100.0
_MAX_ERROR = 1e9


@dataclass(frozen=True, kw_only=True)
class DesignEffort:
    """How hard to search.

    Raises
    ------
    InputError
        If a count is too small.
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
class ExcitationDesign:
    """A reference and what is expected of it; errors are in shares of the width of each parameter's bounds."""

    times: NDArray[np.float64]  #: (N,) [s]
    poses: NDArray[np.float64]  #: (N, 3), x and y [m] and psi [rad] of the reference
    frequencies: NDArray[np.float64]  #: (3, k), of the sines in x, y and psi [Hz]
    amplitudes: NDArray[np.float64]  #: (3, k) [m, m, rad]
    phases: NDArray[np.float64]  #: (3, k) [rad]
    peaks: RunPeaks  #: on the model, the worst over less and more friction too
    errors: NDArray[np.float64]  #: (f,), expected of the parameters sought
    history: tuple[float, ...]  #: `criterion` of the best after each generation

    @property
    def reference(self) -> Reference:
        """What the controller is given."""
        return sampled_reference(self.times, self.poses)


def design(
    task: ExcitationTask,
    *,
    effort: DesignEffort | None = None,
    run: Run = DEFAULT_RUN,
) -> ExcitationDesign:
    """Find the reference whose log determines the parameters best, above all the worst determined one.

    Parameters
    ----------
    task : Task
    effort : Effort, optional
    run : Run, optional
        Its seed fixes the design bit for bit; the cost of its progress is the best `criterion` so far.

    Raises
    ------
    InputError
        If no reference keeps within the limits, or none within them identifies every parameter.
    """
    effort = effort or DesignEffort()
    choice = multisine_family(task.robot, task.controller, limits=task.limits, duration=task.duration)
    shared = (task, choice)

    def report(now: Progress) -> None:
        run.progress(replace(now, stage="design", cost=_criterion_of(now.cost)))

    evolved = evolve(
        lambda members: np.array(run.executor(_cost, shared, list(members))),
        size=choice.size,
        generations=effort.generations,
        population=effort.population,
        run=replace(run, progress=report),
    )
    best = _fitted(task, choice, evolved.best)
    _check_within(task, best)
    errors = expected_errors(task.question, [best.run.log])
    _check_identifiable(task, errors)
    return ExcitationDesign(
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
    logs = np.log(np.clip(errors, 0.0, _MAX_ERROR))
    return float(np.exp(0.5 * (logs.max() + logs.mean())))


def _criterion_of(cost: float) -> float:
    """Return the criterion that a cost stands for; infinite where none keeps within the limits."""
    return math.exp(cost) if cost < _EXCEEDS else math.inf


def _cost(shared: tuple[ExcitationTask, MultisineFamily], member: NDArray[np.float64]) -> float:
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
    run: ReferenceRun
    used: float  #: the largest share of a limit, of `MARGIN`, that it takes


def _fitted(task: ExcitationTask, choice: MultisineFamily, member: NDArray[np.float64]) -> _Fitted:
    """Return the member at the highest level tried that keeps within the limits, or at the gentlest where none does."""
    poses, limits = choice.poses(member), task.limits.scaled(MARGIN)
    level, best = 1.0, None
    for _ in range(_LEVELS):
        followed = run_on_model(task, sampled_reference(choice.times, level * poses))
        used = max(limits.used(followed.peaks).values()) if followed.lasted == 1.0 else _FALLS
        if best is None or _better(used, best.used):
            best = _Fitted(level=level, run=followed, used=used)
        if _CLOSE <= used <= 1.0:
            break
        level = min(level * float(np.clip(_AIM / max(used, 1e-9), 0.4, 3.0)), _MAX_LEVEL)
    assert best is not None
    return best


def _better(used: float, before: float) -> bool:
    """Return whether a run uses the limits better: within them the fuller, beyond them the gentler."""
    return before < used <= 1.0 or (before > 1.0 and used < before)


def _check_within(task: ExcitationTask, best: _Fitted) -> None:
    if best.run.lasted < 1.0:
        raise InputError(
            "With this controller the robot falls on every reference. Give a controller that balances the "
            "robot, or lower the lean limit."
        )
    limits = task.limits.scaled(MARGIN)
    for name in limits.exceeded(best.run.peaks):
        raise InputError(
            f"No reference stays within {MARGIN:g} of the limits: the {name} reaches "
            f"{getattr(best.run.peaks, name):.3g} of {getattr(limits, name):.3g} {PEAK_UNITS[name]}. Raise that "
            "limit."
        )


def _check_identifiable(task: ExcitationTask, errors: NDArray[np.float64]) -> None:
    unobservable = [
        label for label, error in zip(task.question.labels, errors, strict=True) if np.isinf(error)
    ]
    if unobservable:
        limits = task.limits
        raise InputError(
            f"Within {limits.lean:.3g} rad of lean, {limits.floor:.3g} m of floor and {limits.torque:.3g} N "
            f"m the robot hardly moves, and no reference makes {', '.join(unobservable)} identifiable. Raise the "
            "limits or the duration."
        )
