"""An informative excitation: a multisine reference within limits, compared with the square of the same length.

    r(t) = w(t) sum_k A_k (sin(2 pi f_k t + p_k) - sin p_k)        for each of x, y, psi;  w fades in and out

A slow sine moves the robot about the floor; a fast one is a dither of the torques K r instead. A sine of unit amplitude
at f answers, in the linear closed loop x_dot = A x + B K (r - x), with

    G(f) = (2 pi i f I - A + B K)^-1 B K e        states         K (e - G(f))        torques

and the largest amplitude of that sine alone is the one that brings lean, place or torque to its limit. Every sine has
the same fraction of it, and the sum is scaled until the simulated run reaches the limits. Of a few ranges of
frequencies the best is kept, by the worst error times the geometric mean of all, because some parameters are hard to
identify with any run, as delta is if s is small.

The value of a run is the standard errors that identification would give on its log. With J_w the windows' derivatives
of predictions by scaled parameters z, over the deviations of states from their prediction, and the initial states
eliminated, H = sum_w J_w^T J_w and cov z >= H^-1. This linear bound (Cramer-Rao) is for comparing runs: with
independent noise, estimates of the Stribeck law scattered by 1.0 to 2.0 times as much (12 seeds). The deviations are
those of the compiled loop around the square, with known friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ballbot.arrays import Floats, positive_number
from ballbot.control.controller import Controller
from ballbot.control.references import Reference, sampled_reference, square
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.identification import Bounds
from ballbot.identification.balancing import Balancing
from ballbot.identification.identify import INNER_STEP, estimated_parameters
from ballbot.identification.prediction import Predictor, windows_for
from ballbot.identification.quantities import Coordinates, scale_between
from ballbot.identification.windows import cut_windows
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.progress import Progress, in_stage
from ballbot.results import left_out, to_results
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.robot.components import scaled_friction
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.run import sample_count
from ballbot.twin.scenario import Scenario
from ballbot.workflows.grid import Condition, LoopRobot, grid_runs, run_grid
from ballbot.workflows.metrics import lean_angle, true_place

#: the laws whose parameters an experiment can be designed for
Law = Literal["viscous", "coulomb", "stribeck"]

#: length of the windows that identification cuts a log into [s]
WINDOW = 0.25
#: the limits must hold with friction of so many times the assumed size
FRICTIONS = (1.0, 0.5, 1.5)
#: of the runs with sensors, with each friction
_SEEDS = (1, 2, 3)
#: the square that the design is compared with: its side [m], if the floor has room for it, and its period [s]
_SIDE, _PERIOD = 0.5, 32.0
#: a parameter assumed at a bound is taken so far within, scaled: s = 0 would hide v_s and delta
_INSIDE = 0.02
#: share of the limits that a fall counts as
_FALLS = 3.0

_UNITS = {"lean": "rad", "floor": "m", "torque": "N m"}


@dataclass(frozen=True, kw_only=True)
class Extent:
    """The extent of a run, of the worst of several, or the limits of it."""

    lean: float  #: of the axis from the vertical [rad]
    floor: float  #: distance from where the run begins [m]
    torque: float  #: of any wheel [N m]

    @staticmethod
    def of(states: Floats, torques: Floats) -> Extent:
        """Return that of states (N, 10) and torques (N, n), of a run that begins at the origin."""
        return Extent(
            lean=float(lean_angle(states[:, 2], states[:, 3]).max()),
            floor=float(np.hypot(states[:, 0], states[:, 1]).max()),
            torque=float(np.abs(torques).max()),
        )

    def used_of(self, limits: Extent) -> dict[str, float]:
        """Return the share of each limit that this uses; above 1 it is exceeded."""
        return {name: value / getattr(limits, name) for name, value in vars(self).items()}

    def exceeding(self, limits: Extent) -> list[str]:
        """Return the names of the limits that are exceeded."""
        return [name for name, share in self.used_of(limits).items() if share > 1.0]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExcitationTask:
    """A robot with nominal friction, its controller, limits, and parameters to estimate; made by `task`."""

    robot: Robot  #: with the assumed friction
    controller: Controller
    limits: Extent
    duration: float  #: [s]
    coordinates: Coordinates
    point: Floats  #: (p,), scaled, the assumed parameters
    deviations: Floats  #: (10,), of each state's prediction on the robot

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters to estimate."""
        return tuple(np.array(self.coordinates.labels)[self.coordinates.free].tolist())

    @property
    def assumed(self) -> Floats:
        """The assumed values of the parameters to estimate (f,), in SI units."""
        return self.coordinates.physical(self.point)[self.coordinates.free]

    def in_units(self, scaled: Floats) -> Floats:
        """Return standard errors (f,) in SI units, from scaled ones."""
        return scaled * self.coordinates.slopes(self.point)[self.coordinates.free]


def task(
    robot: Robot,
    controller: Controller,
    *,
    limits: Extent,
    duration: float,
    deviations: Floats,
    law: Law = "stribeck",
    bounds: Bounds | None = None,
) -> ExcitationTask:
    """Return what to design an experiment for, with each state's deviation (10,); other arguments as of `excite`."""
    coordinates = estimated_parameters(robot, free=("friction",), law=law, bounds=bounds or Bounds())
    scaled, friction = coordinates.scaled(coordinates.nominal), robot.friction
    if not any((*friction.viscous, *friction.coulomb, *friction.stribeck, friction.rolling)):
        scaled = np.where(coordinates.nonnegative, 0.25, 0.5)
    fixed = coordinates.scaled(coordinates.lower)
    point = np.where(coordinates.free, np.clip(scaled, _INSIDE, 1.0 - _INSIDE), fixed)
    return ExcitationTask(
        robot=coordinates.layout.robot_of(robot, coordinates.physical(point)),
        controller=controller,
        limits=limits,
        duration=duration,
        coordinates=coordinates,
        point=point,
        deviations=deviations,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceRuns:
    """Runs of a reference with each friction: one on the model, or one for each seed on the loop with sensors."""

    log: Log = field(metadata=left_out)  #: of the first run, with its truth
    peaks: Extent  #: the worst of all runs: true lean and place, torques as commanded
    ended: str | None  #: why a run ended early

    def used_of(self, limits: Extent) -> float:
        """Return the largest share of a limit that is used; a fall counts as `_FALLS`."""
        return _FALLS if self.ended else max(self.peaks.used_of(limits).values())


def _follow(
    reference: Reference,
    controller: Controller,
    plant_of: Callable[[float], LoopRobot],  # from the factor on the friction
    *,
    duration: float,
    seeds: Sequence[int] = (0,),
    start: Floats | None = None,
    run: Run = DEFAULT_RUN,
) -> ReferenceRuns:
    conditions = [
        Condition(plant=plant, reference=lambda: reference, duration=duration, seed=seed, start=start)
        for plant in map(plant_of, FRICTIONS)
        for seed in seeds
    ]
    logs = run_grid(grid_runs({"": controller}, conditions), lambda _, log: log, run=run).answers
    extents = [list(vars(Extent.of(true_place(log).states, log.torques)).values()) for log in logs]
    return ReferenceRuns(
        log=logs[0],
        peaks=Extent(**dict(zip(_UNITS, np.max(extents, axis=0).tolist(), strict=True))),
        ended=next((log.ended for log in logs if log.ended), None),
    )


def run_on_model(task: ExcitationTask, reference: Reference) -> ReferenceRuns:
    """Follow a reference on the model, from rest."""

    def plant_of(factor: float) -> LoopRobot:
        friction = scaled_friction(task.robot.friction, factor)
        model = Model(task.robot.replace(friction=friction), step=INNER_STEP)
        return LoopRobot(model=model, imperfections=Imperfections())

    return _follow(reference, task.controller, plant_of, duration=task.duration, start=np.zeros(10))


#: least information on a scaled parameter with the others known; below it the parameter has no influence
_MIN_INFORMATION = 1.0
#: relative to the largest; gives directions without information a large finite error
_RIDGE = 1e-13


def expected_errors(task: ExcitationTask, logs: Sequence[Log]) -> Floats:
    """Return the least standard errors (f,) to expect from logs without noise, in shares of the bounds' width."""
    coordinates = task.coordinates
    predictor = Predictor(robot=task.robot, step=INNER_STEP, layout=coordinates.layout, threads=1)
    windows = windows_for(predictor, coordinates.upper, logs, duration=WINDOW)
    # measurements off by exactly their deviations: identification takes its weights from the residuals
    off = replace(
        windows, initial=windows.initial + task.deviations, measured=windows.measured + task.deviations
    )
    experiment = Balancing(
        predictor=predictor,
        windows=off,
        coordinates=coordinates,
        reference=task.deviations**2,
        executor=Threads(count=1),
    )
    H = experiment.linearize_widely(task.point, windows.initial).equations.matrix
    H = H[np.ix_(coordinates.free, coordinates.free)]
    known = H.diagonal() > _MIN_INFORMATION
    errors = np.full(len(H), np.inf)
    if known.any():
        scale = 1.0 / np.sqrt(H.diagonal()[known])
        R = H[np.ix_(known, known)] * np.outer(scale, scale)
        inverse = np.linalg.inv(R + _RIDGE * np.eye(len(R)))
        errors[known] = scale * np.sqrt(np.maximum(inverse.diagonal(), 1.0))
    return errors


#: sines of each axis, from so many turns in the run (at least) and this frequency [Hz] on
SINES, MIN_TURNS, SLOWEST = 5, 2.0, 0.08
#: fastest frequencies that are tried [Hz]
FASTEST = (0.4, 0.6, 0.9, 1.3, 2.0, 3.0)
#: the axes' frequencies lie apart by this share, so that no two stay in step
_DETUNED = 0.07
#: the reference fades in and out over so long [s], a quarter of the run at most
_FADE = 2.0
#: no sine turns the reference's heading further than this [rad]
_MAX_TURN = 1.0
#: multiples of it, their whole part left out, spread evenly
_GOLDEN = 0.6180339887498949
#: places of x, y and psi in a state
_AXES = (0, 1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Multisine:
    """The sines of a reference."""

    times: Floats = field(metadata=left_out)  #: (N,), the controller's samples [s]
    frequencies: Floats  #: (3, k), of x, y and psi [Hz]
    amplitudes: Floats  #: (3, k) [m, m, rad]
    phases: Floats  #: (3, k) [rad]

    def poses(self) -> Floats:
        """Return x, y and psi at every sample (N, 3)."""
        phases, end = self.phases[..., None], float(self.times[-1])
        waves = np.sin(2.0 * np.pi * self.frequencies[..., None] * self.times + phases) - np.sin(phases)
        fade = max(min(_FADE, 0.25 * end), 1e-9)
        share = np.clip(np.minimum(self.times, end - self.times) / fade, 0.0, 1.0)
        return ((0.5 - 0.5 * np.cos(np.pi * share)) * (self.amplitudes[..., None] * waves).sum(axis=1)).T

    @property
    def reference(self) -> Reference:
        """The reference for the controller."""
        return sampled_reference(self.times, self.poses())


def largest_sines(
    robot: Robot, controller: Controller, *, limits: Extent, duration: float, fastest: float
) -> Multisine:
    """Return sines up to a frequency [Hz], each as large as it alone may be."""
    count = sample_count(duration, controller.sample_time)
    slowest = max(SLOWEST, MIN_TURNS / duration)
    fastest = min(max(fastest, 2.0 * slowest), 0.2 / controller.sample_time)
    detuned = 1.0 + _DETUNED * np.arange(len(_AXES))
    frequencies = detuned[:, None] * np.geomspace(slowest, fastest, SINES)
    linear = Model(robot.replace(friction=Friction.none(robot.wheel_count))).linearize()
    K, largest = controller.gain, np.empty(frequencies.shape)
    for (row, column), frequency in np.ndenumerate(frequencies):
        unit = np.eye(10)[_AXES[row]]
        loop = 2j * np.pi * frequency * np.eye(10) - linear.A + linear.B @ K
        G = np.linalg.solve(loop, linear.B @ (K @ unit))
        torque, size = np.abs(K @ (unit - G)).max(), np.abs(G)
        used = max(size[2:4].max() / limits.lean, size[:2].max() / limits.floor, torque / limits.torque, 1e-9)
        largest[row, column] = min(1.0 / used, _MAX_TURN) if _AXES[row] == 4 else 1.0 / used
    return Multisine(
        times=controller.sample_time * np.arange(count, dtype=np.float64),
        frequencies=frequencies,
        amplitudes=largest,
        # spread evenly over the turn
        phases=2.0 * np.pi * np.modf(_GOLDEN * np.arange(frequencies.size))[0].reshape(frequencies.shape),
    )


#: on the model the limits are this share of those given: noise, rollers and a wrongly assumed friction come on top
MARGIN = 0.85
#: levels tried for a reference, the share of the limits aimed at and the least that will do, and the highest level:
#: friction eats some of the motion, so that amplitudes may be some times what the linear loop without it allows
_LEVELS, _AIM, _CLOSE, _MAX_LEVEL = 4, 0.97, 0.92, 4.0
_MAX_ERROR = 1e9


def design(task: ExcitationTask) -> tuple[Multisine, ReferenceRuns, Floats]:
    """Return the most informative multisine that stays within the limits on the model, its runs and expected errors.

    InputError if none keeps within the limits, or none within them identifies every parameter.
    """
    limits = Extent(**{name: MARGIN * value for name, value in vars(task.limits).items()})
    tried = [_fitted(task, limits, fastest) for fastest in FASTEST]
    kept = [(sines, runs) for sines, runs in tried if runs.used_of(limits) <= 1.0]
    if not kept:
        _, gentlest = min(tried, key=lambda candidate: candidate[1].used_of(limits))
        if gentlest.ended:
            raise InputError(
                "With this controller the robot falls on every reference. Give a controller that balances the "
                "robot, or lower the lean limit."
            )
        name = gentlest.peaks.exceeding(limits)[0]
        raise InputError(
            f"No reference stays within {MARGIN:g} of the limits: the {name} reaches "
            f"{getattr(gentlest.peaks, name):.3g} of {getattr(limits, name):.3g} {_UNITS[name]}. Raise that limit."
        )
    sines, runs, errors = min(
        ((sines, runs, expected_errors(task, [runs.log])) for sines, runs in kept),
        key=lambda candidate: criterion(candidate[2]),
    )
    if unknown := [label for label, error in zip(task.labels, errors, strict=True) if np.isinf(error)]:
        raise InputError(
            f"Within {task.limits.lean:.3g} rad of lean, {task.limits.floor:.3g} m of floor and "
            f"{task.limits.torque:.3g} N m the robot hardly moves, and no reference makes {', '.join(unknown)} "
            "identifiable. Raise the limits or the duration."
        )
    return sines, runs, errors


def criterion(errors: Floats) -> float:
    """Return the design's objective for scaled errors (f,): the geometric mean of the worst and of their mean."""
    logs = np.log(np.clip(errors, 0.0, _MAX_ERROR))
    return float(np.exp(0.5 * (logs.max() + logs.mean())))


def _fitted(task: ExcitationTask, limits: Extent, fastest: float) -> tuple[Multisine, ReferenceRuns]:
    """Return sines at the highest level tried that keeps within limits, or at the gentlest if none does."""
    largest = largest_sines(
        task.robot, task.controller, limits=task.limits, duration=task.duration, fastest=fastest
    )
    level, tried = 1.0, list[tuple[float, Multisine, ReferenceRuns]]()
    for _ in range(_LEVELS):
        sines = replace(largest, amplitudes=level / largest.frequencies.size * largest.amplitudes)
        runs = run_on_model(task, sines.reference)
        used = runs.used_of(limits)
        tried.append((used, sines, runs))
        if _CLOSE <= used <= 1.0:
            break
        level = min(level * float(np.clip(_AIM / max(used, 1e-9), 0.4, 3.0)), _MAX_LEVEL)
    # within the limits the larger is better, beyond them the smaller
    _, sines, runs = max(tried, key=lambda candidate: candidate[0] if candidate[0] <= 1.0 else -candidate[0])
    return sines, runs


def deviations_in(log: Log, robot: Robot) -> Floats:
    """Return each state's deviation (10,) from its prediction over a log's windows; InputError if it has none."""
    coordinates = scale_between(robot)
    windows = cut_windows([log], wheel_count=robot.wheel_count, duration=WINDOW)
    if not len(windows):
        raise InputError(f"The run is shorter than one window of {WINDOW:g} s; make it longer.")
    predictor = Predictor(robot=robot, step=1e-3, layout=coordinates.layout)
    residuals = predictor.residuals(coordinates.nominal[None], windows, every=windows.comparison_interval)
    return np.sqrt((residuals**2).mean(axis=(0, 1, 2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """A designed experiment with its expected errors and its runs, beside a square."""

    task: ExcitationTask
    sines: Multisine
    peaks: Mapping[str, Extent]  #: of "square" and "designed" on the model
    errors: Mapping[str, Floats]  #: (f,) of each, expected, scaled; infinite without information
    on_loop: Mapping[str, ReferenceRuns]  #: of each, with sensors

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; SI units, and errors also in shares of the bounds' width ("scaled")."""
        task, designed = self.task, self.on_loop["designed"]

        def by_label(values: Floats) -> dict[str, float]:
            return dict(zip(task.labels, values.tolist(), strict=True))

        return {
            "limits": task.limits,
            "duration": task.duration,
            "assumed": by_label(task.assumed),
            "deviations": task.deviations,
            "expected": {
                name: {
                    "standard_errors": by_label(task.in_units(scaled)),
                    "scaled": by_label(scaled),
                    "worst": scaled.max(),
                }
                for name, scaled in self.errors.items()
            },
            "peaks_on_model": self.peaks,
            "on_loop": {
                name: to_results(runs) | {"exceeded": runs.peaks.exceeding(task.limits)}
                for name, runs in self.on_loop.items()
            },
            "limits_held_on_loop": designed.used_of(task.limits) <= 1.0,
            "sines": {"axes": ["x", "y", "psi"]} | to_results(self.sines),
        }


def excite(
    robot: RobotLike,
    controller: Controller,
    *,
    limits: Extent,
    duration: float,
    scenario: Scenario,
    law: Law = "stribeck",
    bounds: Bounds | None = None,
    run: Run = DEFAULT_RUN,
) -> Excitation:
    """Design an experiment, compare it with a square of the same length, and run both on the loop with sensors.

    Parameters
    ----------
    robot : Robot, preset or robot file
        With the friction assumed; without any, that from which identification's search begins.
    controller : Controller
        That the robot will be run with.
    limits : Extent
    duration : float
        [s]
    scenario : Scenario
        Of the loop, whose friction is the true one.
    law : {"stribeck", "coulomb", "viscous"}
        The law whose parameters are estimated.
    bounds : Bounds, optional
        Identification's; errors count in shares of their width.
    run : Run, optional
        Its progress is reported.

    Raises
    ------
    InputError
        If a limit is not positive, no level keeps within the limits, or none identifies every parameter.
    """
    robot = as_robot(robot)
    for name, value in vars(limits).items():
        positive_number(value, f"The {name} limit")
    if limits.lean >= 0.5 * math.pi:
        raise InputError(
            f"The lean limit is {math.degrees(limits.lean):.4g} degrees; it must be below 90 degrees."
        )

    def plant_of(factor: float) -> LoopRobot:
        friction = scaled_friction(scenario.friction, factor)
        return LoopRobot.of(robot.replace(friction=friction), scenario, known=robot)

    def on_loop(reference: Reference) -> ReferenceRuns:
        watched = replace(run, progress=in_stage(run.progress, "runs with sensors"))
        return _follow(reference, controller, plant_of, duration=duration, seeds=_SEEDS, run=watched)

    plain = square(side=min(_SIDE, limits.floor / math.sqrt(2.0)), period=min(_PERIOD, duration))
    along_square = on_loop(plain)
    true = robot.replace(friction=scenario.friction)
    deviations = deviations_in(along_square.log.without_truth(), true)
    asked = task(
        robot, controller, limits=limits, duration=duration, deviations=deviations, law=law, bounds=bounds
    )
    run.progress(Progress(stage="design"))
    (sines, designed, errors), driven = design(asked), run_on_model(asked, plain)
    return Excitation(
        task=asked,
        sines=sines,
        peaks={"square": driven.peaks, "designed": designed.peaks},
        errors={"square": expected_errors(asked, [driven.log]), "designed": errors},
        on_loop={"square": along_square, "designed": on_loop(sines.reference)},
    )
