"""The body's inertia from a free swing, by fitting a pendulum to it.

    angle'' = -omega_n^2 sin(angle) - beta angle' - kappa sgn(angle')

A pendulum is an axis under gravity (`ballbot.identification.axis`): beta = b / I and kappa = c / I with the pivot's
viscous friction b [N m s/rad], its dry friction c [N m] and the inertia I about the pivot; omega_n^2 = m g r / I. The
period grows with the amplitude A: T = T_0 2 K(sin(A/2)) / pi, with the complete elliptic integral K (L. Landau and
E. Lifshitz, Mechanics, section 11), so that large swings distinguish radians from degrees.

The inertia follows from the frequency:

    I_pivot = m g r / omega_n^2        I_com = I_pivot - m r^2        J_0 = I_com + m l^2

m the hanging mass, r from the pivot to its centre of mass, l from the ball's centre to it (thesis, Appendix III, which
hung the body at the ball's centre, r = l). The errors of frequency, m, r and l count as independent.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy
from scipy.interpolate import CubicHermiteSpline
from scipy.special import ellipk, stdtrit

from ballbot.arrays import Floats, real_array
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, error, finding, note, warning
from ballbot.fitting.experiment import Residuals, residuals_without_states
from ballbot.fitting.fit import descend, fit
from ballbot.fitting.intervals import HALF_WIDTH
from ballbot.fitting.parameter import FitParameter
from ballbot.identification.axis.model import Axis
from ballbot.log import Log
from ballbot.results import reported, to_results
from ballbot.robot import Robot
from ballbot.rounding import plus_minus

Kind = Literal["angle", "rate"]

#: least number of swings in a recording, and of samples in a swing
_LEAST_SWINGS, _LEAST_SAMPLES = 4.0, 8.0
#: swings smaller than this share of the largest are left out, as a pivot almost at rest has other friction
_SMALLEST = 0.05
#: the largest swing is the first that reaches this share of the largest
_AS_LARGE = 0.97
#: largest angle of a pendulum; a larger one is in degrees [rad]
_LARGEST_ANGLE = 3.0
#: largest rate of a pendulum, over 2 pi / period: released at 2 rad, it has 2.3
_LARGEST_RATE = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Swing:
    """A free swing, from a pass through the middle on, untouched until the last row."""

    t: Floats  #: (n,) [s]
    values: Floats  #: (n,) [rad] or [rad/s], with any offset
    kind: Kind
    period: float  #: approximate [s]
    source: str  #: sensor or file, in words

    @property
    def swings(self) -> float:
        """How many times the body swung back and forth."""
        return float(self.t[-1] - self.t[0]) / self.period


def swing_in_log(log: Log) -> Swing:
    """Return the free swing in a log of the hanging body; InputError if the log has no swing.

    It is taken from the gyro about its main axis, or from the one of theta, phi and psi that swings most.
    """
    gyro = [name for name in ("gyro_x", "gyro_y", "gyro_z") if name in log]
    if gyro:
        log.require(*gyro)
        rates = np.column_stack([log[name] for name in gyro])
        rates = rates - np.median(rates, axis=0)
        axis = np.linalg.svd(rates, full_matrices=False)[2][0]
        return swing_of(log.t, rates @ axis, kind="rate", source="the gyro about its main axis")
    angles = [name for name in ("theta", "phi", "psi") if name in log]
    if not angles:
        raise InputError(
            "The log has neither gyro_x nor theta, phi or psi; give the swinging column one of these names."
        )
    log.require(*angles)
    most = max(angles, key=lambda name: float(np.std(np.unwrap(log[name]))))
    return swing_of(log.t, log[most], kind="angle", source=most)


def swing_of(t: Floats, values: Floats, *, kind: Kind, source: str) -> Swing:
    """Return the free swing within a recording, from the first pass through the middle after the largest swing.

    The values (n,) [rad] or [rad/s] may have an offset; the times (n,) [s] increase; `source` is the sensor in words.
    InputError if nothing swings, there are too few swings or samples, or the angle is too large for a pendulum.
    """
    t = real_array(t, ("n",), "The time of a swing")
    values = real_array(values, t.shape, "The row of a swing's values")
    values = np.unwrap(values) if kind == "angle" else values
    centred = values - np.median(values)
    if len(t) < 32 or float(np.ptp(centred)) == 0.0:
        raise InputError(f"{source} does not swing: it has {len(t)} rows and no motion.")
    period, h = _period(t, centred), float(np.median(np.diff(t)))
    if period < _LEAST_SAMPLES * h:
        raise InputError(
            f"{source} has fewer than {_LEAST_SAMPLES:g} samples in a swing of "
            f"{period:.2g} s; record faster, or check that it is the hanging body's motion."
        )
    # a running mean over an eighth of a swing
    width = max(1, int(period / 8.0 / h) | 1)
    smooth = np.convolve(centred, np.full(width, 1.0 / width), mode="same")
    size = np.abs(smooth)
    peaks, _ = scipy.signal.find_peaks(size, distance=max(1, int(0.35 * period / h)))
    largest, of_rate = float(size.max()), _LARGEST_RATE * 2.0 * np.pi / period
    most, unit = (_LARGEST_ANGLE, "rad") if kind == "angle" else (of_rate, "rad/s")
    if largest > most:
        raise InputError(
            f"{source} swings to {largest:.3g} {unit} in {period:.3g} s, more than a pendulum can; check whether it is "
            "in degrees (then multiply it by pi/180)."
        )
    top = int(np.argmax(size > _AS_LARGE * largest))
    crossings = np.flatnonzero(smooth[top:-1] * smooth[top + 1 :] <= 0.0)
    start = top + int(crossings[0]) if len(crossings) else top
    small = peaks[(peaks > start) & (size[peaks] < _SMALLEST * largest)]
    end = int(small[0]) if len(small) else len(t)
    swings = float(t[end - 1] - t[start]) / period
    if swings < _LEAST_SWINGS:
        raise InputError(
            f"{source} swings freely {max(swings, 0.0):.1f} times; frequency and damping need at least "
            f"{_LEAST_SWINGS:g} swings."
        )
    return Swing(t=t[start:end], values=values[start:end], kind=kind, period=period, source=source)


def _period(t: Floats, centred: Floats) -> float:
    """Return the period of the largest line in the spectrum [s]."""
    h = float(np.median(np.diff(t)))
    even = np.interp(np.arange(t[0], t[-1], h), t, centred)
    count = 8 * len(even)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), count))
    # fewer than two periods in the recording are a drift
    lowest = int(np.ceil(2.0 * count / len(even)))
    return count * h / float(lowest + np.argmax(power[lowest:]))


#: simulation step, in radians of phase
_STEP = 0.03


def pendulum_motion(p: Floats, t: Floats) -> tuple[Floats, Floats]:
    """Return angle [rad] and rate [rad/s] (n,) at times t (n,) of a pendulum.

    `p` begins with omega_n^2 [1/s^2], beta [1/s], kappa [1/s^2], and angle and rate at t_0. The axis's steps are of
    second order in gravity, and extrapolation with steps of half the length removes that term of the error (L. F.
    Richardson 1911).
    """
    stiffness, viscous, dry, angle, rate = p[:5].tolist()
    pendulum = Axis(values={"mass": 1.0, "gravity_sine": stiffness, "viscous": viscous, "coulomb": dry})
    span = float(t[-1] - t[0])
    rows = max(1, math.ceil(span * math.sqrt(max(abs(stiffness), 1e-12)) / _STEP))
    start, first = np.array([[angle, rate]]), np.array([0])

    def simulated(count: int) -> Floats:
        return pendulum.windows(np.zeros(count), span / count, first, np.array([count]), start)

    states = np.concatenate([start, (4.0 * simulated(2 * rows)[1::2] - simulated(rows)) / 3.0])
    motion = CubicHermiteSpline(t[0] + span / rows * np.arange(rows + 1), *states.T)
    return motion(t), motion(t, 1)


def pendulum_experiment(swing: Swing) -> tuple[Residuals, Floats]:
    """Return the experiment and start values (6,); friction may be below zero, so that intervals contain zero."""
    first = swing.values[swing.t - swing.t[0] <= swing.period]
    size, omega = 0.5 * float(np.ptp(first)), 2.0 * np.pi / swing.period
    zero, angular = float(first.min()) + size, swing.kind == "angle"
    amplitude = min(size if angular else size / omega, 2.5)
    omega *= 2.0 / math.pi * float(ellipk(math.sin(0.5 * amplitude) ** 2))  # of small swings
    # the recording starts in the middle of a swing, where the recorded angle or rate is zero
    direction = float(np.sign(np.sum(first[: len(first) // 4] - zero)))
    angle, rate = (0.0, direction * omega * amplitude) if angular else (-direction * amplitude, 0.0)
    # bounds: friction with which the least number of swings remain
    viscous = omega * math.log(1.0 / _SMALLEST) / (math.pi * _LEAST_SWINGS)
    dry = omega**2 * amplitude / (4.0 * _LEAST_SWINGS)
    parameters = (
        FitParameter.about("omega_n^2", omega**2, "1/s^2", factor=4.0),
        FitParameter.about("beta", 0.0, "1/s", within=viscous),
        FitParameter.about("kappa", 0.0, "1/s^2", within=dry),
        FitParameter.about("first angle", 0.0, "rad", within=4.0),
        FitParameter.about("first rate", 0.0, "rad/s", within=4.0 * omega),
        FitParameter.about("zero", 0.0, "rad" if angular else "rad/s", within=abs(zero) + 4.0 * size),
    )
    block = np.minimum((swing.t - swing.t[0]) // swing.period, swing.swings // 1.0 - 1.0).astype(np.int64)
    experiment = residuals_without_states(
        lambda p: _sensed(p, swing)[1] - swing.values, parameters=parameters, block=block
    )
    return experiment, np.array([omega**2, 0.0, 0.0, angle, rate, zero])


def _sensed(p: Floats, swing: Swing) -> tuple[Floats, Floats]:
    """Return the angle [rad] and the sensor's value, both (n,)."""
    angles, rates = pendulum_motion(p, swing.t)
    return angles, (angles if swing.kind == "angle" else rates) + p[5]


#: swings that are fitted first, so that the fit to the complete recording is not a swing off
_FIRST_SWINGS = 3.0
#: largest relative residual of a fit that is accepted
_WORST = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class SwingFit:
    """A pendulum fitted to a swing."""

    swing: Swing
    values: Floats  #: (6,) omega_n^2, beta, kappa, first angle, first rate and zero
    half_widths: Floats  #: (6,) half widths of their 95 % intervals, clustered by swing
    predicted: Floats  #: (n,) the sensor's value by the fit [rad] or [rad/s]
    amplitudes: tuple[float, float]  #: largest angle in the first and in the last swing [rad]

    @property
    def frequency(self) -> float:
        """Angular frequency omega_n of small free swings [rad/s]."""
        return float(np.sqrt(self.values[0]))

    @property
    def frequency_half_width(self) -> float:
        """Half width of its 95 % interval [rad/s]."""
        return 0.5 * float(self.half_widths[0]) / self.frequency

    @property
    def residual(self) -> float:
        """Root mean square residual, relative to that of the recording."""
        values = self.swing.values - self.values[5]
        return float(np.sqrt(np.mean((self.swing.values - self.predicted) ** 2) / np.mean(values**2)))


def fit_swing(swing: Swing) -> SwingFit:
    """Fit a pendulum to a free swing.

    InputError if the residual exceeds 30 % of the motion, so that the recording is not that of a free pendulum.

    >>> t = 0.01 * np.arange(3000)
    >>> swing = swing_of(t, 0.2 * np.exp(-0.02 * t) * np.cos(4.0 * t), kind="angle", source="a camera")
    >>> round(fit_swing(swing).frequency, 2)  # [rad/s]
    4.01
    """
    result, unit = _fitted(swing), "rad" if swing.kind == "angle" else "rad/s"
    if not result.residual < _WORST:
        raise InputError(
            f"{swing.source} is not a free swing: a pendulum leaves {100.0 * result.residual:.0f} % of it unexplained; "
            f"cut the recording to where nothing touches the body, and check that it is in {unit}, not in degrees."
        )
    return result


def _fitted(swing: Swing) -> SwingFit:
    experiment, start = pendulum_experiment(swing)
    space, until = experiment.coordinates, _FIRST_SWINGS
    point = space.scaled(start)
    while until < swing.swings:
        rows = swing.t - swing.t[0] <= until * swing.period
        part, _ = pendulum_experiment(replace(swing, t=swing.t[rows], values=swing.values[rows]))
        point = descend(part, point, free=space.free, most_steps=30, most_renewals=0).point
        until *= 2.0
    result = fit(experiment, point)
    angles, predicted = _sensed(result.values, swing)
    ends = swing.t <= swing.t[0] + swing.period, swing.t >= swing.t[-1] - swing.period
    first, last = (float(np.abs(angles[rows]).max()) for rows in ends)
    return SwingFit(
        swing=swing,
        values=result.values,
        # clustered by swing
        half_widths=stdtrit(len(experiment.block_log) - 1, 0.975) * result.errors,
        predicted=predicted,
        amplitudes=(first, last),
    )


_CHECK_UNITS = "Check the units of t [s] and of the distance to the pivot [m]."

#: smaller swings do not distinguish radians from degrees [rad]
_LARGE = 0.25
#: one unit fits better than another if its residual is below this share of the other's
_BETTER = 0.8
#: share of an inertia by which three digits in a file may round it; what exceeds that and the 95 % interval is reported
_ROUNDED = 0.005
#: an inertia in the file that is off by more than this factor has a wrong unit
_POSSIBLE = 10.0
#: a larger relative residual is reported
_MUCH_LEFT = 0.05


@dataclass(frozen=True, kw_only=True)
class SwingQuantity:
    """A result of a swing with its standard deviation."""

    value: float
    deviation: float

    @reported
    def half_width(self) -> float:
        """Half width of the 95 % interval."""
        return HALF_WIDTH * self.deviation


@dataclass(frozen=True, kw_only=True, eq=False)
class SwingInertia:
    """The body's inertia about the axis of its swing [kg m^2], with its sources."""

    robot: Robot
    fit: SwingFit
    pivot: dict[str, float]  #: distance r [m], its deviation [m], and whether it is the ball's centre
    about_pivot: SwingQuantity
    about_center_of_mass: SwingQuantity
    about_ball_center: SwingQuantity
    log_findings: tuple[Finding, ...] = ()  #: of the recording

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """The findings of the recording and against the result, errors first."""
        return by_severity([*self.log_findings, *self._doubts()])

    def _doubts(self) -> Iterator[Finding]:
        swing, mass, (first, _) = self.fit.swing, self.robot.body.mass, self.fit.amplitudes
        name = swing.source
        if first > _LARGE:
            radians = _fitted(replace(swing, values=np.radians(swing.values))).residual
            if radians < min(_WORST, _BETTER * self.fit.residual):
                text = (
                    f"{name} appears to be in degrees: read in radians, its swings of {math.degrees(first):.3g} "
                    "degrees would slow down as they grow, and they do not. Multiply it by pi/180."
                )
                yield error("swing-unit", text, name)
        if self.fit.residual > _MUCH_LEFT:
            text = (
                f"A pendulum leaves {100.0 * self.fit.residual:.0f} % of {name} unexplained; look for a sensor that is "
                "clipped or froze, a pivot that slides, a second mode or a hand that touched the body."
            )
            yield warning("swing-fit", text, name)
        value = self.about_ball_center.value
        nearest = min(self._of_file, key=lambda inertia: abs(math.log(value / inertia)))
        ratio = value / nearest
        off, stated = max(ratio, 1.0 / ratio), self.robot.standard_deviations
        of_file = max(float(np.max(stated.get(f"body.inertia.{axis}", 0.0))) for axis in ("xx", "yy"))
        allowed = HALF_WIDTH * math.hypot(self.about_ball_center.deviation, of_file) + _ROUNDED * nearest
        if abs(value - nearest) > allowed:
            text = (
                f"A period of {2.0 * math.pi / self.fit.frequency:.4g} s gives an inertia about the ball's centre of "
                f"{plus_minus(value, self.about_ball_center.half_width)} kg m^2, {ratio:.3g} times the file's "
                f"{nearest:.4g}. The file's inertia is wrong, or body.mass ({mass:.4g} kg), the distance to the pivot, "
                f"or the time of the recording; a clock {math.sqrt(ratio):.3g} times too slow would have the same "
                f"effect. {_CHECK_UNITS}"
            )
            yield finding("swing-inertia", "error" if off > _POSSIBLE else "warning", text, "t")

    @property
    def _of_file(self) -> list[float]:
        """The file's inertia about the ball's centre, about x and about y."""
        return np.diag(self.robot.body.inertia_about_ball_center())[:2].tolist()

    def notes(self) -> list[Finding]:
        """Return the result in sentences, the inertia first."""
        inertia, (about_x, about_y) = self.about_ball_center, self._of_file
        text = (
            f"The body's inertia about the ball's centre is {plus_minus(inertia.value, inertia.half_width)} kg m^2 (95 "
            f"%); the file has {about_x:.4g} about x and {about_y:.4g} about y."
        )
        stated = self.pivot["deviation"] or self.robot.standard_deviations.keys() & {"body.mass"}
        alone = (
            "The intervals cover the swing only: mass and distance to the pivot have no standard deviation."
        )
        return [note("swing", text), *([] if stated else [note("swing", alone)])]

    @property
    def _numbers(self) -> dict[str, tuple[float, float]]:
        """Frequency [rad/s], viscous [N m s/rad] and dry friction [N m] of the pivot, with 95 % half widths."""
        fit, inertia = self.fit, self.about_pivot.value
        viscous, dry = (inertia * np.array([fit.values[1:3], fit.half_widths[1:3]]).T).tolist()
        frequency = (fit.frequency, fit.frequency_half_width)
        return {"frequency": frequency, "viscous": tuple(viscous), "dry": tuple(dry)}

    def rows(self) -> list[list[str]]:
        """Return the rows of the printed table: quantity, value with 95 % half width, unit."""
        (frequency, half), viscous, dry = self._numbers.values()
        period = 2.0 * np.pi / frequency
        rows = [
            ("small swings' frequency", (frequency, half), "rad/s"),
            ("small swings' period", (period, period * half / frequency), "s"),
            ("pivot's viscous friction", viscous, "N m s/rad"),
            ("pivot's dry friction", dry, "N m"),
        ]
        abouts = (self.about_pivot, self.about_center_of_mass, self.about_ball_center)
        for name, about in zip(("pivot", "centre of mass", "ball's centre"), abouts, strict=True):
            rows.append((f"inertia about the {name}", (about.value, about.half_width), "kg m^2"))
        return [[name, plus_minus(*number), unit] for name, number, unit in rows]

    def to_dict(self) -> dict[str, object]:
        """Return the entries of results.json, SI units; half widths are those of 95 % intervals."""
        fit, numbers = self.fit, self._numbers
        results = {
            "findings": by_severity([*self.findings, *self.notes()]),
            "source": fit.swing.source,
            "swings": fit.swing.swings,
            "amplitude_first": fit.amplitudes[0],
            "amplitude_last": fit.amplitudes[1],
            **{name: value for name, (value, _) in numbers.items()},
            **{f"{name}_half_width": half for name, (_, half) in numbers.items()},
            "residual_share": fit.residual,
            "pivot": self.pivot,
            "inertia_about_pivot": self.about_pivot,
            "inertia_about_center_of_mass": self.about_center_of_mass,
            "inertia_about_ball_center": self.about_ball_center,
        }
        return to_results(results)


def inertia_of_swing(
    fit: SwingFit, robot: Robot, *, distance: float | None = None, deviation: float | None = None
) -> SwingInertia:
    """Return the inertia of the body that swung, with its uncertainty; InputError if the pivot is not possible.

    Hanging mass, l and g with their standard deviations are those of the robot. The pivot is at `distance` r [m] from
    the centre of mass, with a standard `deviation` [m] of zero by default. Without a distance, the pivot is at the
    ball's centre, r = l, by default with the deviation in the robot's file.
    """
    stated, height, there = robot.standard_deviations, robot.body.center_of_mass, distance is None
    of_mass, of_height = (
        float(np.asarray(stated.get(f"body.{name}", 0.0))) for name in ("mass", "center_of_mass")
    )
    pivot = {
        "distance": height if distance is None else distance,
        "deviation": (of_height if there else 0.0) if deviation is None else deviation,
        "at_ball_center": there,
    }
    if not 0.0 < pivot["distance"] < math.inf or not 0.0 <= pivot["deviation"] < math.inf:
        raise InputError(
            f"The distance to the pivot is {pivot['distance']:g} m with a standard deviation of "
            f"{pivot['deviation']:g} m; the distance must be above zero, the deviation zero or more."
        )

    def inertias(omega: float, m: float, r: float, height: float) -> Floats:
        """Return the inertias about the pivot, the centre of mass and the ball's centre."""
        about = m * robot.gravity * r / omega**2  # (Appendix III)
        return about + m * np.array([0.0, -(r**2), height**2 - r**2])

    at = np.array([fit.frequency, robot.body.mass, pivot["distance"], height])
    values = inertias(*at)
    if values[1] <= 0.0:
        raise InputError(
            f"With {at[1]:g} kg at {at[2]:g} m, the swing of {at[0]:.4g} rad/s gives an inertia of {values[1]:.3g} "
            "kg m^2 about the centre of mass, which no body has; the distance must be below "
            f"{robot.gravity / at[0] ** 2:.4g} m. {_CHECK_UNITS}"
        )
    # one standard deviation of each source; r and l change together if they are the same
    sources = np.diag([fit.frequency_half_width / HALF_WIDTH, of_mass, pivot["deviation"], of_height])
    if there:
        sources[2:, 3] = pivot["deviation"], 0.0
    changes = [0.5 * (inertias(*(at + source)) - inertias(*(at - source))) for source in sources]
    names = ("about_pivot", "about_center_of_mass", "about_ball_center")
    numbers = zip(names, values.tolist(), np.linalg.norm(changes, axis=0).tolist(), strict=True)
    about: dict[str, Any] = {
        name: SwingQuantity(value=value, deviation=error) for name, value, error in numbers
    }
    return SwingInertia(robot=robot, fit=fit, pivot=pivot, **about)
