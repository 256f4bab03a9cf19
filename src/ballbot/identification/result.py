"""The result of an identification: the identified robot, its parameters with their uncertainty, and findings.

It is usable if

- held-out windows are predicted better with friction than without: the 95 % interval of the gain over all logs and the
  states that count (`ballbot.fitting.model_selection`) is above zero, and the gain is positive for the lean, on which
  balancing depends, and on each log by itself;
- no b or c of a wheel is at the upper end of its usual range, which is not an estimate;
- the logs agree on the Coulomb friction: between logs it varies by less than half of its size, or within their errors.

A law is accepted if the interval of its gain on held-out windows is above zero over the simpler law within it and, if
that one was not accepted, over the largest accepted law within it. The best law is the accepted one with the least
error. A law is rejected if an interval lies below a useful gain; otherwise it is undecided.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats, Ints
from ballbot.errors import every
from ballbot.findings import Finding, by_severity
from ballbot.fitting.fit import OtherOptimum
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.model_selection import USEFUL_GAIN, Gain, gain_between, neighbours
from ballbot.identification.coulomb import CoulombEquivalent
from ballbot.identification.file_values import FileValue
from ballbot.identification.laws import Law
from ballbot.identification.odometry import WheelFrame
from ballbot.identification.prediction import Predictor, WindowErrors
from ballbot.identification.quantities import BY_NAME, FRICTION, Layout
from ballbot.identification.stated_uncertainty import ends_without_error
from ballbot.identification.variation import Variation
from ballbot.identification.windows import Span
from ballbot.log import STATE_NAMES
from ballbot.results import reported, to_results
from ballbot.robot import Robot
from ballbot.rounding import digits
from ballbot.summary import Reported, counted

#: logs disagree if the dry friction varies between them by more than this share of it (standard deviation)
WIDELY = 0.5
#: {b: [..], c: [..], s: [..], v_s, delta, C_rr, ..}; see `ballbot.identification.quantities`
ParameterTable = dict[str, list[float] | float]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identification(Reported):
    """The identified parameters of a robot, friction's 3 n + 3 first; `plot()` shows it over speed, with a band."""

    robot: Robot  #: with the friction found
    predictor: Predictor  #: predicts windows by any such parameters
    uncertainty: Uncertainty  #: of the estimate, including the variation between logs
    unknown: Bools  #: (p,), without influence on the logs, or not excited by them
    variation: Variation  #: between logs, and intervals of the estimate from another log
    coulomb: CoulombEquivalent  #: to compare logs and robots; see `ballbot.identification.coulomb`
    fit: WindowErrors  #: on the windows fitted
    held_out: WindowErrors  #: on the held-out windows
    file_share: Floats  #: (p,) of each variance, from the errors of the robot file; the rest is the logs'
    window: float  #: length of the windows [s]
    excluded_states: tuple[str, ...]  #: states whose errors did not count in the fit
    gauss_newton_cost: tuple[float, ...]  #: cost after each step, on all fitted windows
    findings: tuple[Finding, ...]  #: on the estimate
    file_values: tuple[FileValue, ...] = ()  #: of the robot file, beside the logs' own estimates of them
    contradicted: tuple[str, ...] = ()  #: errors on them that are not accepted
    wheels: WheelFrame | None = None  #: as odometry depends on them; None if the logs do not show it
    other: OtherOptimum | None = None
    log_findings: tuple[Finding, ...] = ()  #: of the checks of the logs
    selection: LawSelection | None = None  #: of the law, if it is "best"

    @property
    def layout(self) -> Layout:
        """Which parameters, in their order."""
        return self.predictor.layout

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the parameters (p,): b1 .. bn, c1 .. cn, s1 .. sn, v_s, delta, C_rr, then other quantities."""
        return self.layout.labels

    @property
    def values(self) -> Floats:
        """The parameters (p,), SI units."""
        return self.uncertainty.coordinates.physical(self.uncertainty.point)

    @property
    def errors(self) -> Floats:
        """Standard errors (p,), SI units; NaN if a parameter has none: no influence, at a bound, or held."""
        return self.uncertainty.standard_errors

    @property
    def parameters(self) -> ParameterTable:
        """The parameters by symbol, SI units; NaN if one has no influence."""
        return self.layout.by_symbol(np.where(self.unknown, np.nan, self.values))

    @property
    def standard_errors(self) -> ParameterTable:
        """`errors` by symbol."""
        return self.layout.by_symbol(self.errors)

    @property
    def bounds(self) -> Floats:
        """Lower and upper bounds (p, 2), SI units; equal for a parameter that is held."""
        return np.stack([self.uncertainty.coordinates.lower, self.uncertainty.coordinates.upper], axis=1)

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """95 % intervals by label; none for a parameter that is held, has no influence or is not excited."""
        return self.uncertainty.intervals

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of the parameters (p, p); NaN for parameters without a standard error."""
        return self.uncertainty.correlation

    @property
    def covariance(self) -> Floats:
        """Covariance (p, p), SI units, as in the robot's file; NaN for parameters without a standard error."""
        return self.correlation * np.outer(self.errors, self.errors)

    @property
    def assumed_covariance(self) -> Floats:
        """`covariance`, with the variance of a uniform distribution over the interval where there is no error."""
        assumed = np.nan_to_num(self.covariance)
        for index, (low, high) in ends_without_error(self.uncertainty).items():
            assumed[index, index] = (high - low) ** 2 / 12.0
        return assumed

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities of the layout, without those of friction that the law holds at zero."""
        zero = {name for name in FRICTION if not self.bounds[self.layout.columns(name)].any()}
        if "stribeck" in zero:
            zero |= {"stribeck_speed", "stribeck_exponent"}
        return tuple(name for name in self.layout.names if name not in zero)

    def stands_for(self, name: str) -> str | None:
        """Return what else a quantity stands for: "" if nothing, None if that is not known."""
        own = self.intervals.get(BY_NAME[name].symbol)
        if own and own.method == "momentum":
            return ""
        also = BY_NAME[name].stands_for
        if also is None or not self.robot.friction.roller_softness:
            return also
        return "play of the gears" if self.robot.drive.backlash > 0.0 else ""

    @property
    def robot_of_logs(self) -> Robot:
        """`robot` with the robot file's wheels, by which the logs' positions and velocities are computed."""
        wheels = self.predictor.robot.wheels
        return self.robot.replace({"wheels.radius": wheels.radius, "wheels.azimuths": wheels.azimuths})

    @property
    def counted(self) -> Bools:
        """Which states (10,) counted in the fit."""
        return ~np.isin(STATE_NAMES, self.excluded_states)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the identification is usable, and why."""
        names, values = np.array(self.uncertainty.coordinates.names), self.values
        lower, upper = self.bounds.T
        ended = (upper > lower) & (values >= upper * (1.0 - 1e-9)) & np.isin(names, ("viscous", "coulomb"))
        for name in dict.fromkeys(names[ended].tolist()):
            ended[names == name] &= upper[names == name] >= BY_NAME[name].limits(self.robot)[:, 1]
        dry = np.mean(values[np.isin(names, ("coulomb", "stribeck"))]) * 2.0
        varied = self.variation.deviations if self.variation.differ else {}
        verdict = verdict_of(
            self.held_out.squares_with[:, self.counted],
            self.held_out.squares_without[:, self.counted],
            self.held_out.spans,
            lean=np.isin(STATE_NAMES, ("theta", "phi"))[self.counted],
            at_end=[self.labels[i] for i in np.flatnonzero(ended).tolist()],
            disagree=[
                label
                for label, name in zip(self.labels, names, strict=True)
                if name == "coulomb" and varied.get(label, 0.0) > WIDELY * dry
            ],
        )
        return replace(verdict, reasons=(*verdict.reasons, *self.contradicted))

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        results = {
            "verdict": self.verdict,
            "parameters": self.parameters,
            "standard_errors": self.standard_errors,
            "intervals": self.intervals,
            "between_logs": self.variation,
            "identified_from": list(self.robot.identified_from),
            "correlation": {"labels": list(self.labels), "matrix": self.correlation},
            "coulomb_equivalent": self.coulomb,
            "robot_file": {
                "share_of_variance": self.layout.by_symbol(self.file_share),
                "values": self.file_values,
            },
            "wheels": self.wheels,
            "represents": {
                BY_NAME[name].symbol: {"kind": "effective" if also else "physical", "also": also}
                for name in self.layout.names
                if (also := self.stands_for(name)) is not None
            },
            "units": {BY_NAME[name].symbol: BY_NAME[name].unit for name in self.layout.names},
            "held_out": self.held_out,
            "fit": self.fit,
            "excluded_states": list(self.excluded_states),
            "cost": {"gauss_newton": list(self.gauss_newton_cost)},
            "other_optimum": self.other
            and {"parameters": self.layout.by_symbol(self.other.values), "rise_of_cost": self.other.rise},
            "windows": {"fit": self.fit.spans, "held_out": self.held_out.spans},
            "findings": by_severity([*self.log_findings, *self.findings]),
        }
        return to_results(results)


@dataclass(frozen=True, kw_only=True, eq=False)
class LawCandidate:
    """A fitted law, and its gain on held-out windows."""

    law: Law
    found: Identification
    gain: Gain  #: over the simpler law within it
    over: str | None  #: the largest accepted law within it; None: no friction
    gain_over: Gain  #: over that one
    error: float  #: relative to the error without friction

    @property
    def accepted(self) -> bool:
        """Whether held-out windows support the law."""
        return self.gain.significant and self.gain_over.significant

    @property
    def decision(self) -> Literal["accepted", "rejected", "undecided"]:
        """Whether held-out windows support the law, exclude a useful gain, or leave it undecided."""
        if self.accepted:
            return "accepted"
        return "rejected" if min(self.gain.upper, self.gain_over.upper) < USEFUL_GAIN else "undecided"

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "law": self.law.name,
            "formula": self.law.formula,
            "within": self.law.within,
            "gain": self.gain.with_interval(),
            "highest_accepted_below": self.over,
            "gain_over_highest_accepted": self.gain_over.with_interval(),
            "accepted": self.accepted,
            "decision": self.decision,
            "error_over_no_friction": self.error,
            "parameters": self.found.parameters,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class LawSelection:
    """All fitted laws, and the best one."""

    candidates: tuple[LawCandidate, ...]

    @property
    def best(self) -> LawCandidate:
        """The accepted law with the least error; viscous friction if none is accepted."""
        accepted = [candidate for candidate in self.candidates if candidate.accepted]
        return min(accepted, key=lambda candidate: candidate.error, default=self.candidates[0])

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "candidates": self.candidates,
            "best": self.best.law.name,
        }


#: neighbouring windows drawn together: 1 s of motion
BLOCK = 4


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether an identification is usable, and why."""

    gain: Gain  #: of the prediction with friction over that without, on held-out windows
    windows: int  #: number of held-out windows
    reasons: tuple[str, ...]  #: why it is not usable; empty if it is

    @reported
    def usable(self) -> bool:
        """Whether there is no reason against it."""
        return not self.reasons

    @reported
    def sentence(self) -> str:
        """The verdict: usable and how much better the prediction is, or not usable and why."""
        if self.reasons:
            return f"Not usable: {'; '.join(self.reasons)}."
        gain = self.gain
        return (
            f"Usable: on {counted(self.windows, 'window')} that the fit did not see, the error with this friction is "
            f"{digits(1.0 - gain.share, 2)} times that without (95 % interval {digits(1.0 - gain.upper, 2)} to "
            f"{digits(1.0 - gain.lower, 2)})."
        )


def verdict_of(
    squares: Floats,
    without: Floats,
    spans: Sequence[Span],
    *,
    lean: Bools | None = None,
    at_end: Sequence[str] = (),
    disagree: Sequence[str] = (),
) -> Verdict:
    """Return the verdict from held-out windows.

    `squares` and `without` (w, k) are sums of squared errors of each window and state that counts, with friction and
    without; `lean` (k,) marks the states of the lean; `at_end` are labels of friction at the end of its usual range,
    `disagree` those on which the logs disagree.
    """
    logs = np.array([span.log for span in spans])

    def gain_on(rows: NDArray[np.intp], states: Bools | slice = slice(None)) -> Gain:
        blocks = window_blocks([spans[row] for row in rows.tolist()])
        return gain_between(squares[rows][:, states], without[rows][:, states], blocks)

    everywhere = np.arange(len(spans))
    overall = gain_on(everywhere)
    of_lean = overall if lean is None or not lean.any() else gain_on(everywhere, lean)
    by_log = {int(log): gain_on(np.flatnonzero(logs == log)) for log in np.unique(logs)}
    worse = [f"log {log + 1} ({_times(gain)})" for log, gain in by_log.items() if not gain.share > 0.0]
    seen = f"on {counted(len(spans), 'window')} that the fit did not see"
    reasons = []
    if not overall.lower > 0.0:
        reasons.append(
            f"{seen}, the prediction is no better with friction than without ({_times(overall)}, 95 % interval "
            f"{digits(1.0 - overall.upper, 2)} to {digits(1.0 - overall.lower, 2)})"
        )
    elif not of_lean.share > 0.0:
        reasons.append(
            f"{seen}, the lean is predicted no better with friction than without ({_times(of_lean)})"
        )
    elif worse and len(by_log) > 1:
        reasons.append(f"the logs disagree: {every(worse)} is predicted no better with friction than without")
    if at_end:
        reasons.append(f"{every(at_end)} {'is' if len(at_end) == 1 else 'are'} at the end of the usual range")
    if disagree:
        reasons.append(f"the logs disagree on {every(disagree)}, by half of the friction or more")
    return Verdict(gain=overall, windows=len(spans), reasons=tuple(reasons))


def window_blocks(spans: Sequence[Span]) -> list[Ints]:
    """Return the rows of windows in blocks of `BLOCK` neighbours of one log."""
    groups = []
    for log in sorted({span.log for span in spans}):
        rows = [row for row, span in enumerate(spans) if span.log == log]
        rows.sort(key=lambda row: spans[row].start)
        groups += neighbours(rows, block=BLOCK)
    return groups


def _times(gain: Gain) -> str:
    return f"{digits(1.0 - gain.share, 2)} times the error"
