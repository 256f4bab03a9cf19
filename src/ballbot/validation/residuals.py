"""Prediction one step ahead (thesis 4.1, 4.2) and the analysis of its residuals; only significant results are stated.

    y_hat(k+1) = g(y(k), u(k))     (4.2)          eps(k) = y(k) - y_hat(k)     (4.3)

A row of a step has eps(k+1) and the measurements at k.

Correlation and spectrum are in `ballbot.validation.statistics`. The residuals are also converted to wheel
torques: the additional torque for which the model would be right. In the heading frame and upright, an additional
torque du changes the rates by h M^-1 W^T du after a sample of h. With S the covariance of the rates' residuals e,
weighted least squares gives

    du = (J^T S^-1 J)^-1 J^T S^-1 e,      J = h M^-1 W^T

If du depends on a wheel's speed, the model's friction law is wrong at that speed. The noise of a measured sample is in
its residual, so the speed of some rows earlier is used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.findings import Finding, note
from ballbot.fitting.least_squares import fit_linear
from ballbot.log import STATE_NAMES
from ballbot.log.columns import wheel_speed_names
from ballbot.results import to_results
from ballbot.validation.models import Case, Comparison, ErrorPair, in_heading_frame
from ballbot.validation.statistics import (
    Correlations,
    Spectrum,
    blocks_of,
    correlations,
    lagged,
    spectrum,
)

#: length of the clusters for standard errors [s]
_BLOCK = 0.25
#: fewer clusters give no result for the wheels
LEAST_BLOCKS = 80
#: rows after which the noise of a speed is independent of the residual
_EARLIER = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Comparison):
    """One-step residuals of both models, with the states and inputs of the steps."""

    residuals: Floats  #: (steps, 10) of the first model
    residuals_second: Floats  #: (steps, 10) of the second
    measured: Floats  #: (steps, 10) measured states after the steps
    torques: Floats  #: (steps, n)
    heading: Floats  #: (steps,) psi [rad] at the start of each step
    wheel_speeds: Floats | None  #: (steps, n) [rad/s] by the encoders; None if a log lacks them
    segments: tuple[int, ...]  #: numbers of consecutive steps without a gap
    sample_time: float  #: [s]

    @property
    def labels(self) -> tuple[str, ...]:
        """e_x .. e_psi_dot, u1 .. un: the rows and columns of the correlation matrix."""
        torques = (f"u{i}" for i in range(1, self.torques.shape[1] + 1))
        return (*(f"e_{name}" for name in STATE_NAMES), *torques)

    @property
    def errors(self) -> ErrorPair:
        """All steps as one run."""
        measured = self.measured
        return ErrorPair.of_runs([measured], [measured - self.residuals], [measured - self.residuals_second])

    @cached_property
    def correlations(self) -> Correlations:
        """The tested correlations of residuals and torques."""
        return correlations(np.hstack([self.residuals, self.torques]), self.labels, self.segments)

    @cached_property
    def spectrum(self) -> Spectrum | None:
        """The peaks of the residuals' spectrum; None if the log is too short."""
        return spectrum(self.residuals, self.segments, sample_time=self.sample_time)

    @property
    def no_wheels(self) -> str | None:
        """Why the dependence on the wheels' speed is not analysed; None if it is."""
        if self.wheel_speeds is None:
            return "the log lacks the encoder speeds"
        # a log of N rows has N - 1 steps, and a duration of N sample times
        seconds = (len(self.residuals) + len(self.segments)) * self.sample_time
        least = LEAST_BLOCKS * _BLOCK
        if seconds < least - 0.5 * self.sample_time:
            return f"{seconds:.4g} s are too short; at least {least:.0f} s are needed"
        return None

    @cached_property
    def by_speed(self) -> tuple[SpeedEffect, ...]:
        """The residual torque of each wheel against its speed; empty if it is not analysed."""
        if self.no_wheels or self.wheel_speeds is None:
            return ()
        blocks = blocks_of(self.segments, length=max(1, round(_BLOCK / self.sample_time)))
        earlier = lagged(self.wheel_speeds, self.segments, lag=_EARLIER)
        wheels = zip(wheel_torque_residuals(self).T, earlier.T, strict=True)
        return tuple(speed_effect(torque, speed, blocks) for torque, speed in wheels)

    def remarks(self) -> tuple[Finding, ...]:
        """Return the findings on spectrum and friction, in this order."""
        sentences = (_peak_finding(self.spectrum), _speed_finding(self))
        return tuple(note("residuals", sentence) for sentence in sentences)

    def results(self) -> dict[str, object]:
        spectrum = self.spectrum
        return {
            "labels": self.labels,
            "correlation": self.correlations.matrix,
            "significant": self.correlations.significant,
            "effective_samples": self.correlations.counts,
            **self.errors.results(self.models),
            "spectrum": spectrum
            and {
                "resolution": spectrum.resolution,
                "peaks": [to_results(peak) | {"state": STATE_NAMES[peak.state]} for peak in spectrum.peaks],
            },
            "wheels": {"refused": self.no_wheels, "by_speed": self.by_speed},
        }


def predict(case: Case) -> Prediction:
    """Predict every row that is compared from the row before it."""
    log, (starts, predicted) = case.log, case.steps
    measured, speeds = log.states[starts + 1], wheel_speed_names(log.torques.shape[1])
    known = all(name in log and np.isfinite(log[name]).all() for name in speeds)
    return Prediction(
        models=case.models,
        residuals=measured - predicted[0],
        residuals_second=measured - predicted[1],
        measured=measured,
        torques=log.torques[starts],
        heading=log["psi"][starts],
        wheel_speeds=np.column_stack([log[name][starts] for name in speeds]) if known else None,
        segments=tuple(len(part) - 1 for part in case.parts),
        sample_time=log.sample_time,
    )


#: share added to the diagonal of a normalised covariance, so that it has an inverse
_LIFT = 1e-10


def wheel_torque_residuals(prediction: Prediction) -> Floats:
    """Return the residual torques (steps, n) [N m]."""
    model = replace(prediction.models.first.model, pivoting=None)
    rates = in_heading_frame(prediction.residuals, prediction.heading)[:, 5:]
    upright = np.zeros(5)
    J = prediction.sample_time * np.linalg.solve(model.mass_matrix(upright), model.wheel_jacobian(upright).T)
    scale = np.sqrt(np.mean(rates**2, axis=0)) + np.finfo(float).tiny
    S = np.cov(rates / scale, rowvar=False) + _LIFT * np.eye(len(scale))
    weighted = np.linalg.solve(S, J / scale[:, None])
    gain = np.linalg.solve(weighted.T @ (J / scale[:, None]), weighted.T)
    return (rates / scale) @ gain.T


_BINS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedEffect:
    """Mean residual torque of one wheel in bins of its speed with equal counts."""

    speeds: Floats  #: (b,) [rad/s] mean of each bin
    torques: Floats  #: (b,) [N m]
    half_widths: Floats  #: (b,) of the 95 % intervals
    p_value: float  #: of zero torque at all speeds; NaN if a speed is too rare


def speed_effect(torque: Floats, speed: Floats, blocks: Ints) -> SpeedEffect:
    """Return one wheel's mean residual torque (n,) against its earlier speed (n,), without rows of NaN."""
    known = np.isfinite(speed)
    torque, speed, blocks = torque[known], speed[known], blocks[known]
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 2:  # the wheel stood still
        edges = np.array([-np.inf, np.inf])
    bins = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    columns = (bins[:, None] == np.arange(len(edges) - 1)).astype(np.float64)
    fit = fit_linear(columns, torque, blocks)
    return SpeedEffect(
        speeds=columns.T @ speed / columns.sum(axis=0),
        torques=fit.values,
        half_widths=fit.half_widths,
        p_value=fit.p_value(range(columns.shape[1])),
    )


#: significance level of the tests of all wheels together
WHEEL_LEVEL = 0.01


def _peak_finding(result: Spectrum | None) -> str:
    if result is None:
        return "The log is too short for a spectrum of the residuals."
    if not result.peaks:
        return "The spectrum of the residuals has no distinct peak."
    at: dict[float, list[str]] = {}
    for peak in sorted(result.peaks, key=lambda other: -other.ratio):
        near = [other for other in at if abs(other - peak.frequency) <= result.resolution]
        at.setdefault(near[0] if near else peak.frequency, []).append(f"e_{STATE_NAMES[peak.state]}")
    peaks = "; ".join(f"{frequency:.1f} Hz in {', '.join(at[frequency])}" for frequency in sorted(at))
    return (
        f"Peaks of the residuals' spectrum, with a resolution of {result.resolution:.2g} Hz: {peaks}. The model lacks "
        "a resonance or the rollers' passing there, or a column of the log is renewed less often than its rows."
    )


def _speed_finding(prediction: Prediction) -> str:
    if prediction.no_wheels:
        return f"The residuals are not compared with the motion of the wheels: {prediction.no_wheels}."
    wheels = []
    for wheel, effect in enumerate(prediction.by_speed, start=1):
        if effect.p_value < WHEEL_LEVEL / len(prediction.by_speed):
            worst = int(np.argmax(np.abs(effect.torques) / effect.half_widths))
            wheels.append(
                f"wheel {wheel} ({effect.torques[worst]:+.3f} ± {effect.half_widths[worst]:.3f} N m at "
                f"{effect.speeds[worst]:+.2f} rad/s)"
            )
    if any(np.isnan(effect.p_value) for effect in prediction.by_speed):
        return "The wheels returned to the same speeds too seldom to show how the residual torque depends on them."
    if not wheels:
        return "The residual torque does not depend on the wheel speeds: the friction law fits at all speeds."
    return (
        f"The residual torque depends on the speed of {', '.join(wheels)}: the friction law is wrong "
        "there by as much. Torque along the motion means that there is less friction than in the model."
    )
