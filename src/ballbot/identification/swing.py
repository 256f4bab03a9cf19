"""The body's inertia from a free swing: the swing within a recording, the pendulum that moves as it, and what follows.

    angle'' = -omega_n^2 sin(angle) - beta angle' - kappa sgn(angle')

A pendulum is an axis under gravity (`ballbot.identification.axis`): beta = b / I and kappa = c / I with the pivot's
viscous friction b [N m s/rad], its dry friction c [N m] and the inertia I about the pivot; omega_n^2 = m g r / I. The
period grows with the amplitude A: T = T_0 2 K(sin(A/2)) / pi, with the complete elliptic integral K (L. Landau and
E. Lifshitz, Mechanics, section 11), so that the shape of large swings distinguishes radians from degrees.

Six numbers are fitted by output error: omega_n^2, beta, kappa, the first angle and rate, and the sensor's zero. The fit
begins on the first swings and grows over the whole recording, so that it cannot settle a whole swing off. Residuals of
neighbouring samples go together, so errors are clustered by swings. The inertia follows from the frequency:

    I_pivot = m g r / omega_n^2        I_com = I_pivot - m r^2        J_0 = I_com + m l^2

m the hanging mass, r from the pivot to its centre of mass, l from the ball's centre to it (thesis, Appendix III, which
hung the body at the ball's centre, r = l). The causes (frequency, m, r, l) count as independent; with the derivative
d_i of a result by each, its variance is the sum of (d_i s_i)^2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.special import ellipk

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, error, finding, note, warning
from ballbot.fitting.intervals import HALF_WIDTH
from ballbot.fitting.least_squares import central_differences, minimize_squares
from ballbot.fitting.uncertainty import covariance_in_time
from ballbot.identification.axis.model import Axis
from ballbot.log import Log
from ballbot.log.columns import unit_of
from ballbot.log.signals import longest_repeat
from ballbot.results import reported, to_results
from ballbot.robot import Robot
from ballbot.robot.derived import inertia_from_swing
from ballbot.rounding import plus_minus

Kind = Literal["angle", "rate"]

#: a recording's smallest count of whole swings, and of samples in a swing
_LEAST_SWINGS, _LEAST_SAMPLES = 4.0, 8.0
#: swings smaller than this share of the largest are left out: friction of a pivot almost at rest differs
_SMALLEST = 0.05
#: the largest swing is the first that reaches this share of the largest
_AS_LARGE = 0.97
#: a pendulum has no angle beyond this, or the angle is in degrees [rad]
_LARGEST_ANGLE = 3.0
#: a pendulum has no rate over 2 pi / period beyond this: let go at 2 rad, it has 2.3
_LARGEST_RATE = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Swing:
    """A free swing: the body let go and touched by nothing until the last row.

    InputError if times and values are not two rows of finite numbers of one length.
    """

    t: NDArray[np.float64]  #: (n,) [s]
    values: NDArray[np.float64]  #: (n,) [rad] or [rad/s], about no particular zero
    kind: Kind
    period: float  #: of the swings as they are, roughly [s]
    source: str  #: the sensor or file that it was measured with, in words

    def __post_init__(self) -> None:
        t = real_array(self.t, ("n",), "The time of a swing")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "values", real_array(self.values, t.shape, "The row of a swing's values"))

    @property
    def swings(self) -> float:
        """How many times the body swung forth and back."""
        return float(self.t[-1] - self.t[0]) / self.period


def swing_in_log(log: Log, *, column: str | None = None) -> Swing:
    """Return the free swing in a log of the hanging body, before, during and after it.

    It is in a column, an angle [rad] or a rate [rad/s] by its name; without one in the gyro about its main axis, or in
    that of theta, phi and psi that swings most. InputError if the log has none of these, or no free swing in it.
    """
    gyro = [name for name in ("gyro_x", "gyro_y", "gyro_z") if name in log]
    if column is None and gyro:
        log.require(*gyro)
        rates = np.column_stack([log[name] for name in gyro])
        rates = rates - np.median(rates, axis=0)
        axis = np.linalg.svd(rates, full_matrices=False)[2][0]
        return swing_of(log.t, rates @ axis, kind="rate", source="the gyro about its main axis")
    angles = [column] if column else [name for name in ("theta", "phi", "psi") if name in log]
    if not angles:
        raise InputError(
            "The log has neither gyro_x nor theta, phi or psi; name the swinging column with --swing-column."
        )
    log.require(*angles)
    most = max(angles, key=lambda name: float(np.std(np.unwrap(log[name]))))
    rate = unit_of(most) == "rad/s" or most.endswith("_dot")
    return swing_of(log.t, log[most], kind="rate" if rate else "angle", source=most)


def swing_of(t: NDArray[np.float64], values: NDArray[np.float64], *, kind: Kind, source: str) -> Swing:
    """Return the free swing within a recording: from the body's first way through the middle after its largest swing.

    Values (n,) [rad] or [rad/s], about any zero, at increasing times (n,) [s], measured with `source`, in words.
    InputError if nothing swings, swings or samples are too few, or no pendulum has such an angle.
    """
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
    if not len(peaks):
        raise InputError(f"{source} does not swing.")
    largest, of_rate = float(size[peaks].max()), _LARGEST_RATE * 2.0 * np.pi / period
    most, unit = (_LARGEST_ANGLE, "rad") if kind == "angle" else (of_rate, "rad/s")
    if largest > most:
        raise InputError(
            f"{source} swings to {largest:.3g} {unit} in {period:.3g} s, more than a pendulum can; check whether it is "
            "in degrees (then multiply it by pi/180)."
        )
    top = int(peaks[np.argmax(size[peaks] > _AS_LARGE * largest)])
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


def _period(t: NDArray[np.float64], centred: NDArray[np.float64]) -> float:
    """Return the period of the largest line in the spectrum [s]."""
    h = float(np.median(np.diff(t)))
    even = np.interp(np.arange(t[0], t[-1], h), t, centred)
    count = 8 * len(even)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), count))
    # a line below two swings in the whole recording is a drift
    lowest = int(np.ceil(2.0 * count / len(even)))
    return count * h / float(lowest + np.argmax(power[lowest:]))


def period_growth(amplitude: float) -> float:
    """Return by what factor the period of an amplitude [rad] is longer than a small swing's."""
    return 2.0 / math.pi * float(ellipk(math.sin(0.5 * amplitude) ** 2))


#: step of the simulation in radians of swing
_STEP = 0.03


def pendulum_motion(
    stiffness: float,
    viscous: float,
    dry: float,
    angle: float,
    rate: float,
    t: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angle [rad] and rate [rad/s] (n,) at times t (n,) of a pendulum from `angle` and `rate` at t_0.

    With omega_n^2 (`stiffness`) [1/s^2], beta [1/s] and kappa [1/s^2]. The axis's steps are of order two in gravity, so
    that the motion in steps half as long removes the error's first term (L. F. Richardson 1911).
    """
    pendulum = Axis(
        values={"mass": 1.0, "gravity_sine": stiffness, "viscous": viscous, "coulomb": dry, "stribeck": 0.0}
    )
    span = float(t[-1] - t[0])
    rows = max(1, math.ceil(span * math.sqrt(max(abs(stiffness), 1e-12)) / _STEP))
    start, first = np.array([[angle, rate]]), np.array([0])

    def followed(count: int) -> NDArray[np.float64]:
        return pendulum.windows(np.zeros(count), span / count, first, np.array([count]), start)

    states = np.concatenate([start, (4.0 * followed(2 * rows)[1::2] - followed(rows)) / 3.0])
    course = CubicHermiteSpline(t[0] + span / rows * np.arange(rows + 1), *states.T)
    return course(t), course(t, 1)


NAMES = ("omega_n^2", "beta", "kappa", "first angle", "first rate", "zero")
#: swings that the fit begins with
_FIRST_SWINGS = 3.0
#: derivatives are central differences over this share of each value's order of size
_DIFFERENCE = 1e-5
#: a fit that leaves more than this share of the swing is refused
_WORST = 0.3
#: one unit fits better than another if it leaves less than this share of the other's residual
_BETTER = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class SwingFit:
    """A pendulum fitted to a swing."""

    swing: Swing
    values: NDArray[np.float64]  #: (6,) in the order of `NAMES`
    half_widths: NDArray[np.float64]  #: (6,) half of their 95 % intervals, clustered by swings
    predicted: NDArray[np.float64]  #: (n,) the sensor's value by the fit [rad] or [rad/s]
    amplitudes: tuple[float, float]  #: largest angle in the first and in the last swing [rad]

    @property
    def frequency(self) -> float:
        """Angular frequency omega_n of small free swings [rad/s]."""
        return float(np.sqrt(self.values[0]))

    @property
    def frequency_half_width(self) -> float:
        """Half of its 95 % interval [rad/s]."""
        return 0.5 * float(self.half_widths[0]) / self.frequency

    @property
    def residual(self) -> float:
        """Root mean square of the fit's residual, as a share of the recording's."""
        values = self.swing.values - self.values[5]
        return float(np.sqrt(np.mean((self.swing.values - self.predicted) ** 2) / np.mean(values**2)))


def fit_swing(swing: Swing) -> SwingFit:
    """Fit a pendulum to a free swing.

    InputError if the recording is not that of a free pendulum: the residual of the fit is a third of the motion.
    """
    fit = _fitted(swing)
    if fit is not None and fit.residual < _WORST:
        return fit
    left = "" if fit is None else f": a pendulum leaves {100.0 * fit.residual:.0f} % of it unexplained"
    unit = "rad" if swing.kind == "angle" else "rad/s"
    raise InputError(
        f"{swing.source} is not a free swing{left}; cut the recording to where nothing touches the body, and check "
        f"that it is in {unit}, not in degrees."
    )


def _fitted(swing: Swing) -> SwingFit | None:
    """Return the pendulum that comes closest, or None if none does."""
    values, until = _guess(swing), _FIRST_SWINGS
    omega = float(np.sqrt(values[0]))
    amplitude = max(float(np.hypot(values[3], values[4] / omega)), 1e-9)
    # each value's order of size, also of one that is zero
    sizes = np.array([omega**2, omega, omega**2 * amplitude, amplitude, omega * amplitude, amplitude])
    while True:
        rows = int(np.searchsorted(swing.t, swing.t[0] + until * swing.period, side="right"))

        def misfit(p: NDArray[np.float64], rows: int = rows) -> NDArray[np.float64]:
            return _sensed(p, swing, rows)[1] - swing.values[:rows]

        found = minimize_squares(
            misfit,
            values,
            jacobian_of=lambda p, misfit=misfit: central_differences(misfit, p, _DIFFERENCE * sizes),
            scale=sizes,
            method="lm",
        )
        values = found.point
        if not (np.isfinite(values).all() and values[0] > 0.0):
            return None
        if rows == len(swing.t):
            break
        until *= 2.0
    angles, predicted = _sensed(values, swing, len(swing.t))
    block = ((swing.t - swing.t[0]) / swing.period).astype(np.int64)
    quantile = float(scipy.stats.t.ppf(0.975, max(int(block.max()) - 2, 1)))
    covariance = covariance_in_time(found.jacobian, found.residuals, block)
    ends = swing.t <= swing.t[0] + swing.period, swing.t >= swing.t[-1] - swing.period
    first, last = (float(np.abs(angles[rows]).max()) for rows in ends)
    return SwingFit(
        swing=swing,
        values=values,
        half_widths=quantile * np.sqrt(np.diag(covariance)),
        predicted=predicted,
        amplitudes=(first, last),
    )


def _guess(swing: Swing) -> NDArray[np.float64]:
    """Return where the fit starts: the spectrum's frequency, no friction, straight through the middle."""
    first = swing.t - swing.t[0] <= swing.period
    size = 0.5 * float(np.ptp(swing.values[first]))
    zero = float(swing.values[first].min()) + size
    omega = 2.0 * np.pi / swing.period
    amplitude = min(size if swing.kind == "angle" else size / omega, 2.5)
    # a sine fitted to the first swing has the first angle and rate
    phase = omega * (swing.t[first] - swing.t[0])
    basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    cosine, sine, _ = np.linalg.lstsq(basis, swing.values[first], rcond=None)[0]
    omega *= period_growth(amplitude)
    start = (cosine, omega * sine) if swing.kind == "angle" else (-sine / omega, cosine)
    return np.array([omega**2, 1e-3 * omega, 1e-4 * omega**2 * amplitude, *start, zero])


def _sensed(
    p: NDArray[np.float64], swing: Swing, rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angle [rad] and the sensor's value, both (rows,)."""
    stiffness, viscous, dry, angle, rate, zero = p.tolist()
    angles, rates = pendulum_motion(stiffness, viscous, dry, angle, rate, swing.t[:rows])
    return angles, (angles if swing.kind == "angle" else rates) + zero


_CHECK_UNITS = "Check the units of t [s] and of the distance to the pivot [m]."


@dataclass(frozen=True, kw_only=True)
class Pivot:
    """The pivot that the body hangs from."""

    distance: float  #: r, from the pivot to the centre of mass [m]
    deviation: float  #: its standard deviation [m]
    at_ball_center: bool  #: r is the robot's l itself

    @staticmethod
    def of(robot: Robot, *, distance: float | None = None, deviation: float | None = None) -> Pivot:
        """Return the pivot at a distance r [m] with its standard deviation, or where the ball's centre would be.

        There r is the robot's l, with the standard deviation that its file gives; elsewhere zero is the default.

        InputError if the distance is not above zero, or the deviation below it.
        """
        pivot = Pivot(
            distance=robot.body.center_of_mass if distance is None else distance,
            deviation=(_deviation(robot, "body.center_of_mass") if distance is None else 0.0)
            if deviation is None
            else deviation,
            at_ball_center=distance is None,
        )
        if not (math.isfinite(pivot.distance) and pivot.distance > 0.0):
            raise InputError(f"The distance to the pivot is {pivot.distance:g} m; it must be above zero.")
        if not (math.isfinite(pivot.deviation) and pivot.deviation >= 0.0):
            raise InputError(
                "The standard deviation of the distance to the pivot "
                f"is {pivot.deviation:g} m; it must be zero or more."
            )
        return pivot


@dataclass(frozen=True, kw_only=True)
class SwingEstimate:
    """A number with its standard deviation, and each cause's share of the variance."""

    value: float
    deviation: float
    shares: dict[str, float]

    @reported
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return HALF_WIDTH * self.deviation


@dataclass(frozen=True, kw_only=True)
class SwingInertia:
    """The body's inertia about the axis of its swing [kg m^2]."""

    about_pivot: SwingEstimate
    about_center_of_mass: SwingEstimate
    about_ball_center: SwingEstimate


def inertia_of_swing(fit: SwingFit, robot: Robot, pivot: Pivot) -> SwingInertia:
    """Return the inertia of the body that swung, with its uncertainty.

    The robot gives the hanging mass, l and g, and their standard deviations. InputError if the pivot's distance leaves
    nothing for the body about its own centre of mass.
    """
    g, omega = robot.gravity, fit.frequency
    point = np.array([omega, robot.body.mass, pivot.distance, robot.body.center_of_mass])

    def inertias(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        frequency, m, r, height = numbers.tolist()
        about = inertia_from_swing(mass=m, gravity=g, distance=r, angular_frequency=frequency)
        own = about - m * r**2
        return np.array([about, own, own + m * (r if pivot.at_ball_center else height) ** 2])

    values = inertias(point)
    if values[1] <= 0.0:
        raise InputError(
            f"With {robot.body.mass:g} kg at {pivot.distance:g} m, the swing of {omega:.4g} rad/s gives an inertia "
            f"of {values[1]:.3g} kg m^2 about the centre of mass, which no body has; the distance "
            f"must be below {g / omega**2:.4g} m. {_CHECK_UNITS}"
        )
    # change of each result by one standard deviation of each cause; if r is l they are one cause
    deviations = {
        "frequency": fit.frequency_half_width / HALF_WIDTH,
        "mass": _deviation(robot, "body.mass"),
        "pivot distance": pivot.deviation,
        "centre of mass": 0.0 if pivot.at_ball_center else _deviation(robot, "body.center_of_mass"),
    }
    steps = np.diag(list(deviations.values()))
    changes = np.array([0.5 * (inertias(point + step) - inertias(point - step)) for step in steps])
    estimates = []
    for value, change in zip(values.tolist(), changes.T, strict=True):
        variance = float(np.sum(change**2))
        shares = (change**2 / (variance or 1.0)).tolist()
        estimates.append(
            SwingEstimate(
                value=value,
                deviation=math.sqrt(variance),
                shares=dict(zip(deviations, shares, strict=True)),
            )
        )
    about_pivot, own, about_ball = estimates
    return SwingInertia(about_pivot=about_pivot, about_center_of_mass=own, about_ball_center=about_ball)


def _deviation(robot: Robot, name: str) -> float:
    deviation = robot.standard_deviations.get(name, 0.0)
    assert not isinstance(deviation, tuple)  # neither of the two is a list, which `check_deviations` sees to
    return float(deviation)


#: the radius of gyration over the distance from pivot to centre of mass, of bodies hung at the ball's centre or nearby
_USUAL, _POSSIBLE = (0.15, 1.3), (0.03, 3.0)
#: the shape of smaller swings does not distinguish radians from degrees [rad]
_LARGE = 0.25
#: a finding reports a file's inertia that is off by more than this factor
_LIKE_FILE = 1.25
#: a pendulum that leaves more of the motion than this is not the whole story
_MUCH_LEFT = 0.05
#: rows at the very largest value that make a sensor clipped, as a share; a sine with fine steps has next to none
_CLIPPED = 0.04
#: least steps of the sensor's resolution in a swing for which rows at the top mean clipping, not coarse steps
_FINE = 40
#: of a swing's period: a longer stretch of one and the same value is a sensor that repeats itself
_FROZEN = 0.2


def recording_findings(swing: Swing) -> tuple[Finding, ...]:
    """Return the faults of a recording, before a pendulum is fitted to it: a sensor that is clipped or that froze."""
    values, name, t = swing.values, swing.source, swing.t
    ends = ("least", values.min()), ("largest", values.max())
    share, side = max((float(np.mean(values == end)), side) for side, end in ends)
    if len(np.unique(values)) >= _FINE and share >= _CLIPPED:
        text = (
            f"{name} is clipped: {100.0 * share:.0f} % of its rows have its {side} "
            "value. Choose a larger range of the sensor, or let the body swing less far."
        )
        return (error("swing-clipped", text, name),)
    first, last = longest_repeat(values)
    # at the end of the recording, the body rests
    if last - first < 5 or last == len(t) - 1 or t[last] - t[first] < _FROZEN * swing.period:
        return ()
    text = (
        f"{name} repeats one value for {t[last] - t[first]:.2g} s from t = {t[first]:.4g} s on, in the middle of the "
        "swing: the sensor froze, or the body was held. Cut the recording to where it swings freely."
    )
    return (error("stuck", text, name, time=float(t[first])),)


def swing_findings(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> tuple[Finding, ...]:
    """Return the evidence against a swing's inertia, errors first."""
    return by_severity(_evidence(fit, found, robot, pivot))


def _evidence(fit: SwingFit, found: SwingInertia, robot: Robot, pivot: Pivot) -> Iterator[Finding]:
    name, first = fit.swing.source, fit.amplitudes[0]
    radians = _fitted(replace(fit.swing, values=np.radians(fit.swing.values))) if first > _LARGE else None
    if radians and radians.residual < min(_WORST, _BETTER * fit.residual):
        text = (
            f"{name} appears to be in degrees: read in radians, its swings of {math.degrees(first):.3g} degrees would "
            "slow down as they grow, and they do not. Multiply it by pi/180."
        )
        yield error("swing-unit", text, name)
    if fit.residual > _MUCH_LEFT:
        text = (
            f"A pendulum leaves {100.0 * fit.residual:.0f} % of {name} unexplained; "
            "look for a pivot that slides, a second mode or a hand that touched the body."
        )
        yield warning("swing-fit", text, name)
    gyration = math.sqrt(found.about_center_of_mass.value / robot.body.mass)
    share = gyration / pivot.distance
    if not _USUAL[0] <= share <= _USUAL[1]:
        text = (
            f"A period of {2.0 * math.pi / fit.frequency:.4g} s at {pivot.distance:.3g} m from the centre of "
            f"mass gives the body a radius of gyration of {gyration:.3g} m, {share:.2g} of that distance; "
            f"bodies have 0.3 to 0.9. {_CHECK_UNITS}"
        )
        severity = "warning" if _POSSIBLE[0] <= share <= _POSSIBLE[1] else "error"
        yield finding("swing-inertia", severity, text, "t")
    value = found.about_ball_center.value
    written = np.diag(robot.body.inertia_about_ball_center())[:2]
    nearest = float(written[int(np.argmin(np.abs(np.log(value / written))))])
    ratio = value / nearest
    if not 1.0 / _LIKE_FILE <= ratio <= _LIKE_FILE:
        text = (
            f"The swing's inertia about the ball's centre, {value:.4g} kg m^2, is {ratio:.3g} times the file's "
            f"{nearest:.4g}. The file's inertia is wrong, or body.mass ({robot.body.mass:.4g} kg), the distance to the "
            f"pivot, or the time of the recording; a clock {math.sqrt(ratio):.3g} times too slow would have the same "
            "effect."
        )
        yield warning("swing-inertia", text, name)


def inertia_findings(found: SwingInertia, robot: Robot) -> list[Finding]:
    """Return the results of a swing in sentences, the inertia first."""
    one = found.about_ball_center
    of_file = np.diag(robot.body.inertia_about_ball_center())[:2]
    cause, share = max(found.about_center_of_mass.shares.items(), key=lambda item: item[1])
    variance = (
        "The file has no standard_deviation of body.mass and body.center_of_mass: the intervals cover the swing only."
        if cause == "frequency" and share == 1.0
        else f"About the centre of mass, {100.0 * share:.0f} % of the variance comes from the {cause}."
    )
    sentences = (
        f"The body's inertia about the ball's centre is {plus_minus(one.value, one.half_width)} kg m^2 (95 %); the "
        f"file has {of_file[0]:.4g} about x and {of_file[1]:.4g} about y.",
        variance,
    )
    return [note("swing", sentence) for sentence in sentences]


def swing_results(fit: SwingFit, found: SwingInertia, pivot: Pivot) -> dict[str, object]:
    """Return the entries of results.json, SI units; half widths are of 95 %."""
    half, inertia = fit.half_widths, found.about_pivot.value
    results = {
        "source": fit.swing.source,
        "swings": fit.swing.swings,
        "amplitude_first": fit.amplitudes[0],
        "amplitude_last": fit.amplitudes[1],
        "frequency": fit.frequency,
        "frequency_half_width": fit.frequency_half_width,
        "viscous": float(fit.values[1]) * inertia,
        "viscous_half_width": float(half[1]) * inertia,
        "dry": float(fit.values[2]) * inertia,
        "dry_half_width": float(half[2]) * inertia,
        "residual_share": fit.residual,
        "pivot": pivot,
        "inertia_about_pivot": found.about_pivot,
        "inertia_about_center_of_mass": found.about_center_of_mass,
        "inertia_about_ball_center": found.about_ball_center,
    }
    return to_results(results)


def swing_rows(fit: SwingFit, found: SwingInertia) -> list[list[str]]:
    """Return the rows of the printed table: quantity, value with half width of 95 %, unit."""
    half, inertia = fit.half_widths, found.about_pivot.value
    period_half = 2.0 * np.pi * fit.frequency_half_width / fit.frequency**2
    ball, own = found.about_ball_center, found.about_center_of_mass
    rows = [
        ("small swings' frequency", fit.frequency, fit.frequency_half_width, "rad/s"),
        ("small swings' period", 2.0 * np.pi / fit.frequency, period_half, "s"),
        ("pivot's viscous friction", fit.values[1] * inertia, half[1] * inertia, "N m s/rad"),
        ("pivot's dry friction", fit.values[2] * inertia, half[2] * inertia, "N m"),
        ("inertia about the pivot", inertia, found.about_pivot.half_width, "kg m^2"),
        ("inertia about the centre of mass", own.value, own.half_width, "kg m^2"),
        ("inertia about the ball's centre", ball.value, ball.half_width, "kg m^2"),
    ]
    return [[name, plus_minus(value, width), unit] for name, value, width, unit in rows]
