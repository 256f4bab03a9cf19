"""Predictions of windows by many sets of parameters, in one batched call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.quantities import RIGID, Layout
from ballbot.identification.windows import (
    Span,
    Windows,
    acting_torques,
    ball_spin,
    cut_windows,
    samples_before,
    seen_late,
    sensor_offsets,
    state_delays,
)
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.parameters import (
    COLUMN_SPEED_SCALE,
    COLUMNS,
    Formulation,
    friction_columns,
    law_columns,
    pack,
    selector,
    term_columns,
)
from ballbot.robot import Robot

#: windows simulated in one call, which limits the memory and fixes the order of sums
CHUNK = 256


@dataclass(frozen=True, kw_only=True)
class Predictor:
    """A robot with variable parameters."""

    robot: Robot  #: its parameters that the layout has are not used
    formulation: Formulation
    step: float  #: longest integration step [s]
    #: which parameters vary; the ball pivots if "pivoting" is one of them
    layout: Layout = field(default_factory=lambda: Layout(wheel_count=3))
    back_emf: float = 0.0  #: b_e [N m s/rad], added to every wheel's b; see `ballbot.identification.windows`
    threads: int | None = None  #: None for all cores; the results do not depend on it

    def residuals(
        self,
        values: NDArray[np.float64],
        windows: Windows,
        *,
        every: int,
        starts: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return predicted less measured states (sets, w, m // every, 10), once `every` so many samples.

        `values` (sets, p) are in SI units, in the order of the layout; `starts` (sets, w, 10) replace the measured
        initial states of the windows.
        """
        sets, count = len(values), len(windows)
        torques, window_of = acting_torques(self.layout, values, windows), np.tile(np.arange(count), sets)
        lanes = Lanes(
            parameters=self._packed(values),
            parameter_of=np.repeat(np.arange(sets), count),
            initial=self._initial(values, windows, starts).reshape(sets * count, -1),
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
        times = windows.sample_time * every * np.arange(1, measured.shape[1] + 1)
        offsets = sensor_offsets(self.layout, values, measured, times)
        return states - measured if offsets is None else states - measured + offsets

    def in_chunks(
        self,
        values: NDArray[np.float64],
        windows: Windows,
        *,
        every: int = 1,
        starts: NDArray[np.float64] | None = None,
    ) -> Iterator[NDArray[np.float64]]:
        """Yield `residuals` of at most `CHUNK` windows at a time; starts (w, 10) are the same for all sets."""
        for first in range(0, len(windows), CHUNK):
            rows = np.arange(first, min(first + CHUNK, len(windows)))
            begin = None if starts is None else np.broadcast_to(starts[rows], (len(values), len(rows), 10))
            yield self.residuals(values, windows.take(rows), every=every, starts=begin)

    def square_sums(
        self, values: NDArray[np.float64], windows: Windows, *, every: int
    ) -> NDArray[np.float64]:
        """Return the residuals' sums of squares over windows and time, (sets, 10)."""
        sums = np.zeros((len(values), 10))
        for residuals in self.in_chunks(values, windows, every=every):
            sums += (residuals**2).sum(axis=(1, 2))
        return sums

    def _initial(
        self, values: NDArray[np.float64], windows: Windows, starts: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Return the true initial states (sets, w, 10 or 11)."""
        shape = (len(values), *windows.initial.shape)
        initial = np.broadcast_to(windows.initial, shape) if starts is None else starts
        offsets = sensor_offsets(self.layout, values, windows.initial[:, None], np.zeros(1))
        if offsets is not None:
            initial = initial - offsets[:, :, 0]
        if self._pivots:
            spin = np.broadcast_to(windows.spin[:, None], (*shape[:2], 1))
            initial = np.concatenate([initial, spin], axis=2)
        return initial

    def _seen_late(
        self, lanes: Lanes, late: NDArray[np.float64], *, sample_time: float
    ) -> NDArray[np.float64]:
        """Return the states (sets, w, m, 10) and initial states as sensors with delays (sets, 10) [s] show them."""
        names = len(STATE_NAMES)
        set_of, start = lanes.row_of[:, 0], lanes.initial.copy()
        first = replace(lanes, torques=lanes.torques[:, :1])
        ahead = self._simulate(first, sample_time=sample_time, every=1)[:, 0]
        start[:, :names] += late[set_of] * (ahead - start)[:, :names] / sample_time
        states = self._simulate(replace(lanes, initial=start), sample_time=sample_time, every=1)
        seen = np.concatenate([start[:, None], states], axis=1)[..., :names]
        return seen_late(seen.reshape(len(late), -1, *seen.shape[1:]), late, sample_time)

    def _simulate(self, lanes: Lanes, *, sample_time: float, every: int) -> NDArray[np.float64]:
        """Return the states (lanes, m // every, 10 or 11)."""
        law, wheels = self.robot.friction.own_law, self.robot.wheel_count
        return simulate_lanes(
            selector(self.formulation, wheels, pivoting=self._pivots, law=law),
            lanes,
            sample_time=sample_time,
            steps=max(1, int(np.ceil(sample_time / self.step - 1e-9))),
            every=every,
            threads=self.threads,
            lost_lanes=True,  # some parameters make a lane overflow
        ).states

    def _packed(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parameters as compiled code reads them (sets, size)."""
        robot, layout = self.robot, self.layout
        if set(RIGID) & set(layout.extra):
            rows = np.stack([pack(layout.with_rigid_body(robot, row), self.formulation) for row in values])
        else:
            rows = np.repeat(self._own[None], len(values), axis=0)
        n = robot.wheel_count
        columns = friction_columns(n)
        rows[:, columns] = values[:, : len(columns)]
        rows[:, columns[:n]] += self.back_emf
        rows[:, COLUMN_SPEED_SCALE] = 1.0 / layout.number("stribeck_speed", values)
        rows[:, COLUMNS["rolling_force"]] = robot.weight * layout.number("rolling", values)
        # a torque offset stands for the asymmetry of Coulomb friction
        of_term = (None, layout.part("stribeck_asymmetry", values), layout.part("load", values))
        law = robot.friction.own_law
        for columns, part in zip(term_columns(n), of_term, strict=True):
            rows[:, columns] = 0.0 if part is None else part
        if law:
            rows[:, term_columns(n)[2]] = 1.0  # see `ballbot.mechanics.friction.OwnWheel.factor`
            for index, name in enumerate(law.takes):
                part = layout.part(name, values)
                if part is not None:
                    rows[:, law_columns(n, index, law)] = part
        pivoting = layout.part("pivoting", values)
        if pivoting is not None:
            rows[:, COLUMNS["pivoting"]] = pivoting[:, 0]
        return rows

    @property
    def _pivots(self) -> bool:
        return "pivoting" in self.layout.extra

    @cached_property
    def _own(self) -> NDArray[np.float64]:
        """The robot's own parameters as compiled code reads them."""
        return pack(self.robot, self.formulation)


def windows_for(
    predictor: Predictor, upper: NDArray[np.float64], logs: Sequence[Log], *, duration: float
) -> Windows:
    """Cut logs into windows, with the torques before them and the spin that parameters up to `upper` (p,) need."""
    layout, pivots = predictor.layout, "pivoting" in predictor.layout.extra
    return cut_windows(
        logs,
        wheel_count=layout.wheel_count,
        duration=duration,
        before=lambda sample_time: samples_before(layout, upper, sample_time),
        spins=[ball_spin(log, predictor.robot) for log in logs] if pivots else None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowErrors:
    """Errors of open-loop predictions over windows."""

    spans: tuple[Span, ...]  #: (w,), the windows
    window_samples: int  #: samples compared in each window
    #: (w, 10), sums of squared errors in each window with friction
    squares_with: NDArray[np.float64]
    squares_without: NDArray[np.float64]  #: (w, 10), without friction

    @property
    def samples(self) -> int:
        """Number of samples compared, n."""
        return len(self.spans) * self.window_samples

    @property
    def rmse_with(self) -> NDArray[np.float64]:
        """Root mean square error of each state (10,) with friction."""
        return np.sqrt(self.squares_with.sum(axis=0) / max(self.samples, 1))

    @property
    def rmse_without(self) -> NDArray[np.float64]:
        """Root mean square error of each state (10,) without friction."""
        return np.sqrt(self.squares_without.sum(axis=0) / max(self.samples, 1))

    @property
    def with_over_without(self) -> dict[str, float]:
        """Error with friction over error without, for each state."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return _by_state(self.rmse_with / self.rmse_without)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; errors are by (4.1), |x - x_hat| / n, and root mean squares."""
        return {
            "windows": len(self.spans),
            "samples": self.samples,
            "with_friction": _by_state(self.rmse_with / np.sqrt(self.samples)),
            "without_friction": _by_state(self.rmse_without / np.sqrt(self.samples)),
            "rmse_with_friction": _by_state(self.rmse_with),
            "rmse_without_friction": _by_state(self.rmse_without),
        }


def _by_state(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))


def window_errors(predictor: Predictor, windows: Windows, values: NDArray[np.float64]) -> WindowErrors:
    """Return the errors of predictions by parameters (p,), with friction and without."""
    both = np.stack([values, predictor.layout.without_friction(values)])
    squares = [(residuals**2).sum(axis=2) for residuals in predictor.in_chunks(both, windows)]
    with_friction, without = np.concatenate([np.zeros((2, 0, len(STATE_NAMES))), *squares], axis=1)
    return WindowErrors(
        spans=windows.spans,
        window_samples=windows.samples,
        squares_with=with_friction,
        squares_without=without,
    )
