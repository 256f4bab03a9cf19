"""Predictions of windows by many sets of parameters, in one batched call, with the motors and sensors of the log.

Torques. Over the sample that begins at row k, the torque that acts on wheel i is

    gain_i ((1 - f) u_i[k - m] + f u_i[k - m - 1]) + offset_i        delay = (m + f) sample times, 0 <= f < 1

A torque that is late by a fraction f of a sample has its old value in the first part of the sample. Here the weighted
mean of both values acts throughout, with the same impulse a sample.

Sensors. An IMU that is tilted by small angles (a, b) about the body's x and y axes reads R Rx(a) Ry(b) instead of
R = Rx(theta) Ry(phi) Rz(psi); a centre of mass off the axis has the same effect. To first order it reads

    theta + a cos psi - b sin psi        phi + a sin psi + b cos psi

and the gyro's bias (g_x, g_y, g_z) appears in the rates of the lean likewise. The bias about z adds to psi_dot, and a
heading that is the integral of psi_dot drifts by g_z times the time since the start.

Sensor delays are relative to x and y in the same row: an IMU's message waits for the next row, and velocities from
differenced encoder counts are means over the last sample. A sensor that is late by d shows state(t_k - d) in row k,
interpolated between samples. The initial state is seen late too: the true one is ahead by d times the slope of a first
sample, simulated from what was seen.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.identification.quantities import RIGID, Layout
from ballbot.identification.windows import Span, Windows, common_sample_time, cut_windows
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import wheel_speed_names
from ballbot.log.pose import ball_rates, measured_wheel_speeds
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.parameters import (
    COLUMN_SPEED_SCALE,
    COLUMNS,
    friction_columns,
    law_columns,
    pack,
    selector,
    term_columns,
)
from ballbot.robot import Robot

#: windows simulated in one call, which limits the memory and fixes the order of sums
CHUNK = 256
#: which states each quantity delays
_LATE = {
    "imu_delay": ("theta", "phi", "psi", "theta_dot", "phi_dot", "psi_dot"),
    "velocity_delay": ("x_dot", "y_dot"),
}


@dataclass(frozen=True, kw_only=True)
class Predictor:
    """A robot with variable parameters."""

    robot: Robot  #: its parameters that the layout has are not used
    step: float  #: longest integration step [s]
    #: which parameters vary; the ball pivots if "pivoting" is one of them
    layout: Layout = field(default_factory=lambda: Layout(wheel_count=3))
    back_emf: float = 0.0  #: b_e [N m s/rad], added to every wheel's b; see `ballbot.identification.windows`
    threads: int | None = None  #: None for all cores; the results do not depend on it

    def residuals(
        self, values: Floats, windows: Windows, *, every: int, starts: Floats | None = None
    ) -> Floats:
        """Return predicted less measured states (sets, w, m // every, 10), once `every` so many samples.

        `values` (sets, p) are in SI units, in the order of the layout; `starts` (sets, w, 10) replace the measured
        initial states of the windows.
        """
        sets, count = len(values), len(windows)
        torques, window_of = self._acting_torques(values, windows), np.tile(np.arange(count), sets)
        lanes = Lanes(
            parameters=self._packed(values),
            parameter_of=np.repeat(np.arange(sets), count),
            initial=self._initial(values, windows, starts).reshape(sets * count, -1),
            torques=windows.torques if torques is None else torques.reshape(-1, *torques.shape[2:]),
            torque_of=window_of if torques is None else None,
        )
        if set(_LATE) & set(self.layout.extra):
            states = self._seen_late(values, lanes, windows.sample_time)[:, :, every - 1 :: every]
        else:
            states = self._simulate(lanes, sample_time=windows.sample_time, every=every)
            states = states.reshape(sets, count, -1, states.shape[-1])[..., : len(STATE_NAMES)]
        measured = windows.measured[:, every - 1 :: every]
        times = windows.sample_time * every * np.arange(1, measured.shape[1] + 1)
        return states - measured + self._sensor_offsets(values, measured, times)

    def in_chunks(self, values: Floats, windows: Windows, *, every: int = 1) -> Iterator[Floats]:
        """Yield `residuals` of at most `CHUNK` windows at a time."""
        for first in range(0, len(windows), CHUNK):
            rows = np.arange(first, min(first + CHUNK, len(windows)))
            yield self.residuals(values, windows.take(rows), every=every)

    def _initial(self, values: Floats, windows: Windows, starts: Floats | None) -> Floats:
        """Return the true initial states (sets, w, 10 or 11)."""
        shape = (len(values), *windows.initial.shape)
        initial = np.broadcast_to(windows.initial, shape) if starts is None else starts
        offsets = self._sensor_offsets(values, windows.initial[:, None], np.zeros(1))
        initial = initial - np.broadcast_to(offsets, (*shape[:2], 1, shape[2]))[:, :, 0]
        if self._pivots:
            spin = np.broadcast_to(windows.spin[:, None], (*shape[:2], 1))
            initial = np.concatenate([initial, spin], axis=2)
        return initial

    def _acting_torques(self, values: Floats, windows: Windows) -> Floats | None:
        """Return the acting torques (sets, w, m, n); None if they are those logged."""
        part = self.layout.part
        gain, offset, delay = (part(name, values) for name in ("torque_gain", "torque_offset", "delay"))
        if gain is None and offset is None and delay is None:
            return None
        u = np.broadcast_to(windows.torques, (len(values), *windows.torques.shape))
        if delay is not None:
            record = np.concatenate([windows.earlier, windows.torques], axis=1)
            before, count = windows.earlier.shape[1], windows.samples
            samples = delay[:, 0] / windows.sample_time
            full = np.minimum(np.floor(samples).astype(np.int64), before - 1)
            u = np.empty(u.shape)
            for i, (m, f) in enumerate(zip(full, samples - full, strict=True)):
                first = before - m
                u[i] = (1.0 - f) * record[:, first : first + count]
                u[i] += f * record[:, first - 1 : first - 1 + count]
        u = u if gain is None else u * gain[:, None, None, :]
        return u if offset is None else u + offset[:, None, None, :]

    def _sensor_offsets(self, values: Floats, states: Floats, times: Floats) -> Floats:
        """Return the errors (sets, w, k, 10) of sensors with a bias at `times` (k,) [s]; (1,) without a bias."""
        lean, gyro = (self.layout.part(name, values) for name in ("lean_bias", "gyro_bias"))
        if lean is None and gyro is None:
            return np.zeros(1)
        offsets, psi = np.zeros((len(values), *states.shape)), STATE_NAMES.index("psi")
        cosine, sine = np.cos(states[..., psi]), np.sin(states[..., psi])
        for bias, first in ((lean, STATE_NAMES.index("theta")), (gyro, STATE_NAMES.index("theta_dot"))):
            if bias is not None:
                a, b = bias[:, 0, None, None], bias[:, 1, None, None]
                offsets[..., first], offsets[..., first + 1] = cosine * a - sine * b, sine * a + cosine * b
        if gyro is not None:
            about_z = gyro[:, 2, None, None]
            offsets[..., STATE_NAMES.index("psi_dot")] = about_z
            offsets[..., psi] = about_z * times
        return offsets

    def _seen_late(self, values: Floats, lanes: Lanes, sample_time: float) -> Floats:
        """Return the states (sets, w, m, 10) as sensors with delays show them; the first and last line are extended."""
        names, delays = len(STATE_NAMES), np.zeros((len(values), len(STATE_NAMES)))
        for name, late in _LATE.items():
            part = self.layout.part(name, values)
            if part is not None:
                delays[:, [STATE_NAMES.index(state) for state in late]] = part
        set_of, start = lanes.row_of[:, 0], lanes.initial.copy()
        first = replace(lanes, torques=lanes.torques[:, :1])
        ahead = self._simulate(first, sample_time=sample_time, every=1)[:, 0]
        start[:, :names] += delays[set_of] * (ahead - start)[:, :names] / sample_time
        states = self._simulate(replace(lanes, initial=start), sample_time=sample_time, every=1)
        states = np.concatenate([start[:, None], states], axis=1)[..., :names]
        states = states.reshape(len(values), -1, *states.shape[1:])
        m = states.shape[2] - 1
        sample = np.arange(1.0, m + 1.0)[:, None] - delays[:, None] / sample_time  # (sets, m, 10)
        before = np.clip(np.floor(sample), 0, m - 1).astype(np.int64)
        share = (sample - before)[:, None]
        earlier = np.take_along_axis(states, before[:, None], axis=2)
        later = np.take_along_axis(states, before[:, None] + 1, axis=2)
        return (1.0 - share) * earlier + share * later

    def _simulate(self, lanes: Lanes, *, sample_time: float, every: int) -> Floats:
        """Return the states (lanes, m // every, 10 or 11)."""
        law, wheels = self.robot.friction.own_law, self.robot.wheel_count
        return simulate_lanes(
            selector("exact", wheels, pivoting=self._pivots, law=law),
            lanes,
            sample_time=sample_time,
            steps=max(1, int(np.ceil(sample_time / self.step - 1e-9))),
            every=every,
            threads=self.threads,
            lost_lanes=True,  # some parameters make a lane overflow
        ).states

    def _packed(self, values: Floats) -> Floats:
        """Return the parameters as compiled code reads them (sets, size)."""
        robot, layout = self.robot, self.layout
        if set(RIGID) & set(layout.extra):
            rows = np.stack([pack(layout.with_rigid_body(robot, row), "exact") for row in values])
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
    def _own(self) -> Floats:
        """The robot's own parameters as compiled code reads them."""
        return pack(self.robot, "exact")


def windows_for(predictor: Predictor, upper: Floats, logs: Sequence[Log], *, duration: float) -> Windows:
    """Cut logs into windows, with the torques before them and the spin that parameters up to `upper` (p,) need."""
    layout, pivots = predictor.layout, "pivoting" in predictor.layout.extra
    sample_time, delay = common_sample_time(logs, duration=duration), layout.part("delay", upper)
    return cut_windows(
        logs,
        wheel_count=layout.wheel_count,
        duration=duration,
        history=0 if delay is None else int(np.floor(delay[0] / sample_time + 1e-9)) + 1,
        spins=[ball_spin(log, predictor.robot) for log in logs] if pivots else None,
    )


def ball_spin(log: Log, robot: Robot) -> Floats:
    """Return the ball's spin about the vertical (N,) [rad/s], from the encoders and the body's rates.

    InputError if the log has no wheel speeds.
    """
    names = wheel_speed_names(robot.wheel_count)
    if not all(name in log for name in names):
        raise InputError(
            f"To estimate pivoting, the log needs the wheel speeds {names[0]} .. {names[-1]}, "
            "which it does not have; exclude the heading from the cost instead."
        )
    return ball_rates(log, robot, measured_wheel_speeds(log, robot))[:, 2]


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowErrors:
    """Errors of open-loop predictions over windows."""

    spans: tuple[Span, ...]  #: (w,), the windows
    window_samples: int  #: samples compared in each window
    squares_with: Floats  #: (w, 10), sums of squared errors with friction
    squares_without: Floats  #: (w, 10), without friction

    @property
    def samples(self) -> int:
        """Number of samples compared, n."""
        return len(self.spans) * self.window_samples

    @property
    def rmse_with(self) -> Floats:
        """Root mean square error of each state (10,) with friction."""
        return np.sqrt(self.squares_with.sum(axis=0) / max(self.samples, 1))

    @property
    def rmse_without(self) -> Floats:
        """Root mean square error of each state (10,) without friction."""
        return np.sqrt(self.squares_without.sum(axis=0) / max(self.samples, 1))

    @property
    def with_over_without(self) -> dict[str, float]:
        """Error with friction over error without, for each state."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = self.rmse_with / self.rmse_without
        return dict(zip(STATE_NAMES, ratios.tolist(), strict=True))

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; errors are by (4.1), |x - x_hat| / n, and root mean squares."""
        root = np.sqrt(self.samples)
        errors = {
            "with_friction": self.rmse_with / root,
            "without_friction": self.rmse_without / root,
            "rmse_with_friction": self.rmse_with,
            "rmse_without_friction": self.rmse_without,
        }
        by_state = {
            name: dict(zip(STATE_NAMES, values.tolist(), strict=True)) for name, values in errors.items()
        }
        return {"windows": len(self.spans), "samples": self.samples, **by_state}


def window_errors(predictor: Predictor, windows: Windows, values: Floats) -> WindowErrors:
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
