"""Predictions of windows by many sets of parameters at once, and the least-squares problem they make.

Predictions of windows by many sets of parameters in one batched call, and their errors.

The pieces that a cost and its derivatives are computed in, over threads or a cluster.

A piece is some sets of parameters on some windows; the problem fixes which, and sums are taken in the pieces' order.

The cost of a search: windows, a predictor of them, and the parameters as the search sees them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import Executor, Threads
from ballbot.identification.parameters import Coordinates
from ballbot.identification.quantities import RIGID, Layout, with_rigid_body
from ballbot.identification.windows import (
    Windows,
    acting_torques,
    seen_late,
    sensor_offsets,
    state_delays,
)
from ballbot.log import STATE_NAMES
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.parameters import (
    PLACE_SPEED_SCALE,
    PLACES,
    Formulation,
    friction_places,
    law_places,
    pack,
    selector,
    term_places,
)
from ballbot.robot import Robot

#: windows simulated in one call, which bounds the memory and fixes the order of every sum
CHUNK = 256


@dataclass(frozen=True, kw_only=True)
class Predictor:
    """A robot whose parameters vary.

    Parameters
    ----------
    robot : Robot
        Its friction is not used, nor any other parameter of the layout.
    formulation : {"exact", "thesis"}
    step : float
        Longest inner step [s].
    layout : Layout, optional
        Which parameters vary; friction's by default. The ball pivots where "pivoting" is one of them.
    back_emf : float
        b_e [N m s/rad], added to every wheel's b; see `ballbot.identification.windows`.
    threads : int, optional
        All cores by default; the results do not depend on it.
    """

    robot: Robot
    formulation: Formulation
    step: float
    layout: Layout = field(default_factory=lambda: Layout(wheel_count=3))
    back_emf: float = 0.0
    threads: int | None = None

    def residuals(
        self,
        values: NDArray[np.float64],
        windows: Windows,
        *,
        every: int,
        starts: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return predicted minus measured states (sets, w, m // every, 10), after every so many samples.

        Parameters
        ----------
        values : ndarray (sets, p)
            In SI units, in the order of the layout.
        starts : ndarray (sets, w, 10), optional
            States at the windows' starts, in place of those measured, as sensors without noise would see them.
        """
        sets, count = len(values), len(windows)
        torques = acting_torques(self.layout, values, windows)
        initial = self._initial(values, windows, starts)
        window_of = np.tile(np.arange(count), sets)
        lanes = Lanes(
            parameters=self._packed(values),
            parameter_of=np.repeat(np.arange(sets), count),
            initial=windows.initial if initial is None else initial.reshape(sets * count, -1),
            initial_of=window_of if initial is None else None,
            torques=windows.torques if torques is None else torques.reshape(-1, *torques.shape[2:]),
            torque_of=window_of if torques is None else None,
        )
        late = state_delays(self.layout, values)
        if late is None:
            states = self._simulate(lanes, sample_time=windows.sample_time, every=every)
            states = states.reshape(sets, count, -1, states.shape[-1])[..., : len(STATE_NAMES)]
        else:
            states = self._seen_late(lanes, late, sample_time=windows.sample_time)
            states = states[:, :, every - 1 :: every]
        measured = windows.measured[:, every - 1 :: every]
        residuals = states - measured
        times = windows.sample_time * every * np.arange(1, measured.shape[1] + 1)
        offsets = sensor_offsets(self.layout, values, measured, times)
        return residuals if offsets is None else residuals + offsets

    def square_sums(
        self, values: NDArray[np.float64], windows: Windows, *, every: int
    ) -> NDArray[np.float64]:
        """Return the residuals' sums of squares over windows and time, (sets, 10)."""
        sums = np.zeros((len(values), 10))
        for chunk in chunks(windows):
            sums += (self.residuals(values, chunk, every=every) ** 2).sum(axis=(1, 2))
        return sums

    def _initial(
        self, values: NDArray[np.float64], windows: Windows, starts: NDArray[np.float64] | None
    ) -> NDArray[np.float64] | None:
        """Return the true states at the starts (sets, w, 10 or 11); None if they are those measured."""
        offsets = sensor_offsets(self.layout, values, windows.initial[:, None], np.zeros(1))
        pivots = "pivoting" in self.layout.extra
        if offsets is None and starts is None and not pivots:
            return None
        shape = (len(values), *windows.initial.shape)
        initial = np.broadcast_to(windows.initial, shape) if starts is None else starts
        if offsets is not None:
            initial = initial - offsets[:, :, 0]
        if pivots:
            spin = np.broadcast_to(windows.spin[:, None], (*shape[:2], 1))
            initial = np.concatenate([initial, spin], axis=2)
        return initial

    def _seen_late(
        self, lanes: Lanes, late: NDArray[np.float64], *, sample_time: float
    ) -> NDArray[np.float64]:
        """Return the states (sets, w, m, 10) as sensors late by (sets, 10) [s] show them, the starts in `lanes` too."""
        names = len(STATE_NAMES)
        set_of, start_of, _ = lanes.row_of.T
        start = lanes.initial[start_of]
        first = replace(lanes, torques=lanes.torques[:, :1])
        ahead = self._simulate(first, sample_time=sample_time, every=1)[:, 0]
        start[:, :names] += late[set_of] * (ahead - start)[:, :names] / sample_time
        true = replace(lanes, initial=start, initial_of=None)
        states = self._simulate(true, sample_time=sample_time, every=1)
        whole = np.concatenate([start[:, None], states], axis=1)[..., :names]
        return seen_late(whole.reshape(len(late), -1, *whole.shape[1:]), late, sample_time)

    def _simulate(self, lanes: Lanes, *, sample_time: float, every: int) -> NDArray[np.float64]:
        """Return the states (lanes, m // every, 10 or 11)."""
        pivots = "pivoting" in self.layout.extra
        return simulate_lanes(
            selector(
                self.formulation, self.robot.wheel_count, pivoting=pivots, law=self.robot.friction.own_law
            ),
            lanes,
            sample_time=sample_time,
            steps=max(1, int(np.ceil(sample_time / self.step - 1e-9))),
            every=every,
            threads=self.threads,
            lost_lanes=True,  # parameters may be such that a lane overflows
        ).states

    def _packed(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rows of numbers (sets, size) that compiled code reads."""
        robot, layout = self.robot, self.layout
        if set(RIGID) & set(layout.extra):
            rows = np.stack([pack(self._with_rigid_body(one), self.formulation) for one in values])
        else:
            rows = np.repeat(self._own[None], len(values), axis=0)
        n = robot.wheel_count
        places = friction_places(n)
        rows[:, places] = values[:, : len(places)]
        rows[:, places[:n]] += self.back_emf
        rows[:, PLACE_SPEED_SCALE] = 1.0 / layout.number("stribeck_speed", values)
        rows[:, PLACES["rolling_force"]] = robot.weight * layout.number("rolling", values)
        # a torque offset stands for the asymmetry of Coulomb friction
        of_term = (None, layout.part("stribeck_asymmetry", values), layout.part("load", values))
        law = robot.friction.own_law
        for columns, part in zip(term_places(n), of_term, strict=True):
            rows[:, columns] = 0.0 if part is None else part
        if law:
            rows[:, term_places(n)[2]] = 1.0  # see `ballbot.mechanics.friction.OwnWheel.factor`
            for index, name in enumerate(law.takes):
                part = layout.part(name, values)
                if part is not None:
                    rows[:, law_places(n, index, law)] = part
        pivoting = layout.part("pivoting", values)
        if pivoting is not None:
            rows[:, PLACES["pivoting"]] = pivoting[:, 0]
        return rows

    @cached_property
    def _own(self) -> NDArray[np.float64]:
        """The robot's own row of numbers."""
        return pack(self.robot, self.formulation)

    def _with_rigid_body(self, values: NDArray[np.float64]) -> Robot:
        parts = {name: self.layout.part(name, values) for name in RIGID}
        return with_rigid_body(self.robot, {name: part for name, part in parts.items() if part is not None})


def chunks(windows: Windows) -> Iterator[Windows]:
    """Yield the windows `CHUNK` at a time."""
    for first in range(0, len(windows), CHUNK):
        yield windows.take(np.arange(first, min(first + CHUNK, len(windows))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Cost:
    """The cost that identification minimises: the mean over states of ln(error / error without friction).

    With squares summed over windows and time, its gradient is that of least squares in which each state weighs
    one over its residual's variance, so that no weights have to be chosen; exp(cost) is the geometric mean
    of the ten ratios. Below the resolution of the simulation, 1e-6 of the error without friction, it is level.
    """

    reference: NDArray[np.float64]  #: (10,), sums of squares without friction on the same windows
    counted: NDArray[np.bool_] = field(default_factory=lambda: np.ones(len(STATE_NAMES), dtype=bool))
    #: (10,), the states that it counts

    def __call__(self, square_sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cost (sets,) of sums of squares (sets, 10), infinite if a prediction has no value."""
        floor = self._floor()
        ratios = (square_sums + floor) / (self.reference + floor)
        cost = 0.5 * np.log(ratios[..., self.counted]).mean(axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def weights(self, square_sums: NDArray[np.float64], compared: int) -> NDArray[np.float64]:
        """Return the weight of each state's residuals (10,): one over their deviation; zero if excluded.

        Parameters
        ----------
        square_sums : ndarray (10,)
            Of the `compared` residuals of each state, where the weights are taken.
        """
        # the floor of the cost, and for a state that nothing moves any weight will do
        return np.where(self.counted, np.sqrt(compared / (square_sums + self._floor())), 0.0)

    def _floor(self) -> NDArray[np.float64]:
        return 1e-12 * self.reference + np.finfo(float).tiny


#: of a piece; derivatives take all sets at once
WINDOWS, SETS = 64, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """Inputs that all pieces share."""

    predictor: Predictor  #: of one thread
    windows: Windows

    def residuals(self, values: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the residuals (sets, rows, k, 10) at the k times of comparison, in this thread."""
        windows = self.windows.take(rows)
        return self.predictor.residuals(values, windows, every=windows.comparison_interval)

    @property
    def rows(self) -> list[NDArray[np.int64]]:
        """The windows' numbers, piece by piece."""
        count = len(self.windows)
        return [np.arange(first, min(first + WINDOWS, count)) for first in range(0, count, WINDOWS)]


def piecewise_square_sums(work: Work, values: NDArray[np.float64], executor: Executor) -> NDArray[np.float64]:
    """Return the residuals' sums of squares (sets, 10) over windows and times of comparison, from values (sets, p)."""
    groups = [slice(first, first + SETS) for first in range(0, len(values), SETS)]
    pieces = [(group, rows) for group in groups for rows in work.rows]
    found = executor(_squares, work, [(values[group], rows) for group, rows in pieces])
    sums = np.zeros((len(values), 10))
    for (group, _), part in zip(pieces, found, strict=True):
        sums[group] += part
    return sums


def _squares(work: Work, piece: tuple[NDArray[np.float64], NDArray[np.int64]]) -> NDArray[np.float64]:
    return (work.residuals(*piece) ** 2).sum(axis=(1, 2))


#: half the central difference, in the scaled coordinate; wide enough to average over single sticking steps
DIFFERENCE = 2e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Windows to fit and how. A point (p,) holds every parameter of `coordinates`, held ones too, scaled."""

    predictor: Predictor
    windows: Windows
    coordinates: Coordinates
    cost: Cost
    executor: Executor = field(default_factory=Threads)  #: where the work is done

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the costs (sets,) of scaled parameters (sets, p)."""
        return self.cost(self.square_sums(points))

    def square_sums(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums of squares (sets, 10) of scaled parameters (sets, p), over windows and time."""
        return piecewise_square_sums(self.work, self.coordinates.physical(points), self.executor)

    @cached_property
    def work(self) -> Work:
        """Inputs of all pieces."""
        return Work(predictor=replace(self.predictor, threads=1), windows=self.windows)
