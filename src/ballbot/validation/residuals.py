"""Prediction one step ahead (thesis 4.1, 4.2) and the analysis of its residuals; only significant results are stated.

    y_hat(k+1) = g(y(k), u(k))     (4.2)          eps(k) = y(k) - y_hat(k)     (4.3)

A row of a step has eps(k+1) and the measurements at k.

Correlation, whiteness and spectrum are in `ballbot.validation.statistics`. The residuals are also converted to wheel
torques: the additional torque for which the model would be right. In the heading frame and upright, an additional
torque du changes the rates by h M^-1 W^T du after a sample of h. With S the covariance of the rates' residuals e,
weighted least squares gives

    du = (J^T S^-1 J)^-1 J^T S^-1 e,      J = h M^-1 W^T

If du depends on a wheel's speed, the model's friction law is wrong at that speed. The noise of a measured sample is in
its residual, so the speed of some rows earlier is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.findings import Finding, note
from ballbot.fitting.least_squares import fit_linear
from ballbot.log import STATE_NAMES
from ballbot.log.columns import wheel_speed_names
from ballbot.results import to_results
from ballbot.validation.models import Case, Comparison, ErrorPair, by_state, in_heading_frame
from ballbot.validation.statistics import (
    LEAST_STEPS,
    Colour,
    Correlations,
    Spectrum,
    Whiteness,
    blocks_of,
    correlations,
    lagged,
    spectrum,
    whiteness,
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
    def whiteness(self) -> Whiteness | None:
        """The test of the residuals' whiteness; None if the log is too short."""
        return whiteness(self.residuals, self.segments)

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
        """Return the findings on correlations, whiteness, spectrum and friction, in this order."""
        sentences = (
            *_pair_findings(self.correlations),
            _whiteness_finding(self.whiteness),
            _peak_finding(self.spectrum),
            _speed_finding(self),
        )
        return tuple(note("residuals", sentence) for sentence in sentences)

    def results(self) -> dict[str, object]:
        white, spectrum = self.whiteness, self.spectrum
        return {
            "labels": self.labels,
            "correlation": self.correlations.matrix,
            "significant": self.correlations.significant,
            "effective_samples": self.correlations.counts,
            **self.errors.results(self.models),
            "whiteness": white
            and {
                "verdict": by_state(np.array(white.colours)),
                "p_value": by_state(white.p_value),
                "predicted_share": by_state(white.predicted_share),
                "autocorrelation": by_state(white.autocorrelation),
            },
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
    model = prediction.models.first.model
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
#: correlations from which significant pairs are named: expected and unexpected ones
_STRONG, _WEAK = 0.5, 0.15

#: pairs of residuals that are expected to correlate, with the reason
_ROLLING = (
    "the wheels carry the ball along with the leaning body, "
    "and its speed is computed from their speeds and the gyro's"
)
_INTEGRAL = "the on-board position is the integral of the speed, so it contains the error of the speed"
_EXPECTED = {
    frozenset({"e_x_dot", "e_phi_dot"}): _ROLLING,
    frozenset({"e_y_dot", "e_theta_dot"}): _ROLLING,
    frozenset({"e_x", "e_phi_dot"}): _ROLLING,
    frozenset({"e_y", "e_theta_dot"}): _ROLLING,
    frozenset({"e_x", "e_x_dot"}): _INTEGRAL,
    frozenset({"e_y", "e_y_dot"}): _INTEGRAL,
}
_COLOURS: dict[Colour, str] = {
    "white": "white",
    "nearly white": "not white by the test, but their past predicts less than 2 % of them",
    "noise of the start": "are correlated with the previous sample only: two successive residuals share the noise of "
    "one measured state, with opposite signs, so this is no error of the model",
    "coloured": "are correlated with their past: a lasting effect is not modelled, or a sensor is filtered",
}


def _pair_findings(correlation: Correlations) -> list[str]:
    """Return a sentence for each reason of strong correlations, and one on those without a reason."""
    labels, matrix = correlation.labels, correlation.matrix
    expected: dict[str, list[str]] = {}
    unexpected, marked = [], np.argwhere(np.triu(correlation.significant, 1)[: len(STATE_NAMES)]).tolist()
    for i, j in marked:
        reason = _EXPECTED.get(frozenset({labels[i], labels[j]}))
        pair = f"{labels[i]} with {labels[j]} ({matrix[i, j]:+.2f})"
        if reason and abs(matrix[i, j]) >= _STRONG:
            expected.setdefault(reason, []).append(pair)
        elif not reason and abs(matrix[i, j]) >= _WEAK:
            unexpected.append(pair)
    tested = len(labels) * len(STATE_NAMES) - len(STATE_NAMES) * (len(STATE_NAMES) + 1) // 2
    verb = "is" if len(marked) == 1 else "are"
    rest = f"except for the expected ones none reaches {_WEAK}: nothing unmodelled stands out."
    if unexpected:
        rest = f"unexpected are {', '.join(unexpected)}: something is not modelled."
    return [
        *(f"Residuals that are coupled: {', '.join(pairs)}; {reason}." for reason, pairs in expected.items()),
        f"{len(marked)} of the {tested} pairs of a residual with another or a torque {verb} significant; {rest}",
    ]


def _whiteness_finding(result: Whiteness | None) -> str:
    if result is None:
        return (
            f"There are fewer than {LEAST_STEPS} steps: the log is "
            "too short to test whether the residuals are white."
        )
    parts = []
    for colour, words in _COLOURS.items():
        states = [state for state, own in enumerate(result.colours) if own == colour]
        if not states:
            continue
        names = ", ".join(f"e_{STATE_NAMES[state]}" for state in states)
        share = ""
        if colour == "coloured":
            shares = result.predicted_share[states]
            ends = dict.fromkeys(f"{100 * end:.0f}" for end in (shares.min(), shares.max()))
            share = f" ({' to '.join(ends)} % of the variance)"
        parts.append(f"{names}: {words}{share}")
    return f"Whiteness. {'; '.join(parts)}."


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
