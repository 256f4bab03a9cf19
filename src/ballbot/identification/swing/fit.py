"""Frequency and damping of a free swing, by output error: the pendulum that moves as the recording does.

Six numbers are fitted: omega_n^2, beta, kappa, the first angle and rate, and the sensor's zero. The fit begins on the
first swings and grows over the whole recording, so that it cannot settle a whole swing off. Residuals of neighbouring
samples go together, so errors are clustered by swings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import least_squares

from ballbot.errors import InputError
from ballbot.identification.axis.covariance import clustered_covariance
from ballbot.identification.swing.pendulum import follow_pendulum, period_growth
from ballbot.identification.swing.record import Swing

NAMES = ("omega_n^2", "beta", "kappa", "first angle", "first rate", "zero")
#: longest step of the simulation as a share of a radian of swing
_STEP = 0.05
#: swings that the fit begins with
_FIRST_SWINGS = 3.0
#: derivatives are central differences over this share of what each value is of the order of
_DIFFERENCE = 1e-5
#: a fit that leaves more than this share of the swing is none
_WORST = 0.3
#: one unit fits better than another if it leaves less than this share of what the other leaves
_BETTER = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class SwingFit:
    """A pendulum fitted to a swing."""

    swing: Swing
    values: NDArray[np.float64]  #: (6,) in the order of `NAMES`
    covariance: NDArray[np.float64]  #: (6, 6), clustered by swings
    quantile: float  #: Student's t for 95 %, with as many clusters
    predicted: NDArray[np.float64]  #: (n,) what the sensor would show [rad] or [rad/s]
    amplitudes: tuple[float, float]  #: largest angle in the first and in the last swing [rad]

    @property
    def frequency(self) -> float:
        """Angular frequency omega_n of small free swings [rad/s]."""
        return float(np.sqrt(self.values[0]))

    @property
    def frequency_half_width(self) -> float:
        """Half of its 95 % interval [rad/s]."""
        return 0.5 * self.half_widths[0] / self.frequency

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Half of the 95 % intervals of `values` (6,)."""
        return self.quantile * np.sqrt(np.diag(self.covariance))

    @property
    def residual(self) -> float:
        """Root mean square of what the fit leaves, as a share of the recording's."""
        values = self.swing.values - self.values[5]
        return float(np.sqrt(np.mean((self.swing.values - self.predicted) ** 2) / np.mean(values**2)))


def fit_swing(swing: Swing) -> SwingFit:
    """Fit a pendulum to a free swing.

    Raises
    ------
    InputError
        If the recording is not that of a free pendulum: what the fit leaves is a third of the motion.
    """
    fit = _fitted(swing)
    if fit is not None and fit.residual < _WORST:
        return fit
    if fits_better_in_degrees(swing, fit):
        largest = float(np.abs(swing.values - np.median(swing.values)).max())
        unit = "degrees" if swing.kind == "angle" else "degrees per second"
        raise InputError(
            f"{swing.source} is not a pendulum's swing in radians, but it "
            f"is in {unit}, up to {largest:.3g}; multiply it by pi/180."
        )
    left = "" if fit is None else f": a pendulum leaves {100.0 * fit.residual:.0f} % of it unexplained"
    raise InputError(
        f"{swing.source} is not a free swing{left}; cut the recording to where nothing touches the body."
    )


def fits_better_in_degrees(swing: Swing, fit: SwingFit | None) -> bool:
    """Return whether a pendulum fits the swing clearly better if its values are taken for degrees.

    Parameters
    ----------
    swing : Swing
    fit : SwingFit, optional
        What fits it in radians; None if nothing does.
    """
    other = _fitted(replace(swing, values=np.radians(swing.values)))
    if other is None or other.residual >= _WORST:
        return False
    return fit is None or other.residual < _BETTER * fit.residual


def _fitted(swing: Swing) -> SwingFit | None:
    """Return the pendulum that comes closest, or None if none does."""
    values, until = _guess(swing), _FIRST_SWINGS
    steps = _DIFFERENCE * _sizes(values)
    while True:
        rows = int(np.searchsorted(swing.t, swing.t[0] + until * swing.period, side="right"))
        found = least_squares(
            lambda p, rows=rows: _misfit(p, swing, rows),
            values,
            jac=lambda p, rows=rows: _slopes(p, swing, rows, steps),  # pyright: ignore[reportArgumentType]
            x_scale=_sizes(values),
            method="lm",
        )
        values = found.x
        if not (np.isfinite(values).all() and values[0] > 0.0):
            return None
        if rows == len(swing.t):
            break
        until *= 2.0
    angles, predicted = _motion(values, swing, len(swing.t))
    block = ((swing.t - swing.t[0]) / swing.period).astype(np.int64)
    clusters = int(block.max()) + 1
    return SwingFit(
        swing=swing,
        values=values,
        covariance=clustered_covariance(found.jac, found.fun, block),
        quantile=float(stats.t.ppf(0.975, max(clusters - 3, 1))),
        predicted=predicted,
        amplitudes=_amplitudes(angles, swing),
    )


def _guess(swing: Swing) -> NDArray[np.float64]:
    """Return where the fit starts: the spectrum's frequency, no friction, straight through the middle."""
    first = swing.t - swing.t[0] <= swing.period
    zero = 0.5 * float(swing.values[first].max() + swing.values[first].min())
    size = 0.5 * float(np.ptp(swing.values[first]))
    omega = 2.0 * np.pi / swing.period
    amplitude = min(size if swing.kind == "angle" else size / omega, 2.5)
    omega *= period_growth(amplitude)
    # a sine fitted to the first swing has the first angle and rate
    phase = 2.0 * np.pi / swing.period * (swing.t[first] - swing.t[0])
    basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    cosine, sine, _ = np.linalg.lstsq(basis, swing.values[first], rcond=None)[0]
    start = (cosine, omega * sine) if swing.kind == "angle" else (-sine / omega, cosine)
    return np.array([omega**2, 1e-3 * omega, 1e-4 * omega**2 * amplitude, *start, zero])


def _misfit(p: NDArray[np.float64], swing: Swing, rows: int) -> NDArray[np.float64]:
    return _motion(p, swing, rows)[1] - swing.values[:rows]


def _slopes(
    p: NDArray[np.float64], swing: Swing, rows: int, steps: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the derivatives of the misfit (rows, 6), by central differences."""
    columns = []
    for one, step in zip(np.eye(len(p)), steps, strict=True):
        ends = (_motion(p + step * one, swing, rows)[1], _motion(p - step * one, swing, rows)[1])
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.column_stack(columns)


def _sizes(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by what order of size each value matters (6,), also one that is zero."""
    omega = float(np.sqrt(values[0]))
    amplitude = max(float(np.hypot(values[3], values[4] / omega)), 1e-9)
    size = [omega**2, omega, omega**2 * amplitude, amplitude, omega * amplitude, amplitude]
    return np.array(size)


def _motion(
    p: NDArray[np.float64], swing: Swing, rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angle [rad] and what the sensor would show, (rows,) both."""
    stiffness, viscous, dry, angle, rate, zero = (float(one) for one in p)
    t = swing.t[:rows]
    angles, rates = np.empty_like(t), np.empty_like(t)
    step = _STEP / float(np.sqrt(max(abs(stiffness), 1e-12)))
    follow_pendulum(stiffness, viscous, dry, angle, rate, t, step, angles, rates)
    return angles, (angles if swing.kind == "angle" else rates) + zero


def _amplitudes(angles: NDArray[np.float64], swing: Swing) -> tuple[float, float]:
    first = swing.t <= swing.t[0] + swing.period
    last = swing.t >= swing.t[-1] - swing.period
    return float(np.abs(angles[first]).max()), float(np.abs(angles[last]).max())
