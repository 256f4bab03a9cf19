"""The result of an identification: its parameters, the identified robot with sources, and findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, finding_results
from ballbot.fitting.fit import OtherOptimum
from ballbot.fitting.intervals import Interval
from ballbot.identification.coulomb import CoulombEquivalent
from ballbot.identification.prediction import Predictor, WindowErrors
from ballbot.identification.quantities import (
    BY_NAME,
    FRICTION,
    OF_WHEELS,
    OWN,
    RIGID,
    TERMS,
    Layout,
)
from ballbot.identification.stated_uncertainty import ends_without_error, with_uncertainty
from ballbot.identification.variation import Variation
from ballbot.identification.verdict import Verdict, verdict_of
from ballbot.identification.windows import Span
from ballbot.log import STATE_NAMES
from ballbot.results import to_results
from ballbot.robot import Robot
from ballbot.summary import Summary, estimated, first_texts, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: logs disagree on the dry friction that varies between them by so large a share of it (standard deviation)
WIDELY = 0.5
#: {b: [..], c: [..], s: [..], v_s, delta, C_rr, ..}; see `ballbot.identification.quantities`
ParameterTable = dict[str, list[float] | float]


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """The identified parameters of a robot, friction's 3 n + 3 first."""

    #: the robot with the friction found; a parameter without influence is as it was before, where that predicts as well
    robot: Robot
    parameters: ParameterTable  #: SI units; NaN if a parameter has no influence
    #: alike, with the variation between logs; NaN if a parameter has none: no influence, at a bound, or held
    standard_errors: ParameterTable
    predictor: Predictor  #: predicts windows with any such parameters
    values: NDArray[np.float64]  #: (p,), those of the predictions on held-out windows, SI units
    #: (p, 2), the least and the greatest value allowed, equal where held; SI units
    bounds: NDArray[np.float64]
    #: of 95 %, by label; none for a parameter without influence, held or refused
    intervals: dict[str, Interval]
    variation: Variation  #: between logs, and intervals for the estimate from another one
    correlation: NDArray[np.float64]  #: (p, p); NaN for parameters without standard error
    coulomb: CoulombEquivalent  #: to compare logs and robots; see `ballbot.identification.coulomb`
    fit: WindowErrors  #: on the windows fitted
    held_out: WindowErrors  #: on the windows that were held out
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    window: float  #: length of the windows [s]
    excluded_states: tuple[str, ...]  #: states whose errors did not count in the fit
    #: best cost after each generation, on the windows drawn for the evolution
    evolution_cost: tuple[float, ...]
    gauss_newton_cost: tuple[float, ...]  #: cost after each step, on all windows fitted
    findings: tuple[Finding, ...]  #: of the numbers
    other: OtherOptimum | None = None
    log_findings: tuple[Finding, ...] = ()  #: of the checks of the logs

    @property
    def layout(self) -> Layout:
        """Which parameters, in their order."""
        return self.predictor.layout

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the correlation's rows (p,): b1 .. bn, c1 .. cn, s1 .. sn, v_s, delta, C_rr, then the other quantities."""
        return self.layout.labels

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities of the layout without those of friction that the law does not have: held at zero."""
        zero = {name for name in FRICTION if not self.bounds[self.layout.columns(name)].any()}
        if "stribeck" in zero:
            zero |= {"stribeck_speed", "stribeck_exponent"}
        return tuple(name for name in self.layout.names if name not in zero)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which states (10,) count."""
        return ~np.isin(STATE_NAMES, self.excluded_states)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether it is usable, and why not."""
        values = dict(zip(self.labels, self.values.tolist(), strict=True))
        bounds = dict(zip(self.labels, self.bounds.tolist(), strict=True))
        labels = {name: BY_NAME[name].labels(self.layout.wheel_count) for name in OF_WHEELS[:3]}
        at_end = [
            label
            for name in ("viscous", "coulomb")
            for label, (lower, upper) in ((one, bounds[one]) for one in labels[name])
            if upper > lower and upper >= BY_NAME[name].bounds[1] and values[label] >= upper * (1.0 - 1e-9)
        ]
        dry = np.mean([values[label] for label in (*labels["coulomb"], *labels["stribeck"])]) * 2.0
        varied = dict(zip(self.labels, self.variation.deviations.tolist(), strict=True))
        widely = [label for label in labels["coulomb"] if varied[label] > WIDELY * dry]
        return verdict_of(
            self.held_out.squares_with[:, self.counted],
            self.held_out.squares_without[:, self.counted],
            self.held_out_windows,
            lean=np.isin(STATE_NAMES, ("theta", "phi"))[self.counted],
            at_end=at_end,
            disagree=widely if self.variation.differ else (),
        )

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of all estimates (p, p), SI units; NaN for one without standard error. The robot's file states it."""
        errors = np.concatenate([np.atleast_1d(one) for one in self.standard_errors.values()])
        return self.correlation * np.outer(errors, errors)

    @property
    def assumed_covariance(self) -> NDArray[np.float64]:
        """As `covariance`, finite: with the variance of an even distribution over the interval of one without error."""
        errors = np.concatenate([np.atleast_1d(one) for one in self.standard_errors.values()])
        ends = ends_without_error(
            self.labels, self.values, errors, bounds=self.bounds, intervals=self.intervals
        )
        assumed = np.nan_to_num(self.covariance)
        for place, (low, high) in ends.items():
            assumed[place, place] = (high - low) ** 2 / 12.0
        return assumed

    @property
    def another_log(self) -> Mapping[str, Interval]:
        """The 95 % intervals for the estimate from another log, by label."""
        return self.variation.predictions

    def summary(self) -> Summary:
        """Return the verdict, each parameter with its standard error, the error on windows held out, and warnings."""
        rows = [("parameter", "value ± standard error, or 95 % interval")]
        for name, (symbol, value) in zip(self.layout.names, self.parameters.items(), strict=True):
            if name not in self.names:
                continue
            unit = "" if BY_NAME[name].unit == "1" else BY_NAME[name].unit
            known = map(self.intervals.get, BY_NAME[name].labels(self.layout.wheel_count))
            # the ends of a profile take the place of standard errors
            ends = [(one.lower, one.upper) if one and one.method == "profile" else None for one in known]
            rows.append((symbol, estimated(value, self.standard_errors[symbol], unit, intervals=ends)))
        ratios = np.array(list(self.held_out.with_over_without.values()))
        share = f"{np.nanmedian(ratios):.3g}" if np.isfinite(ratios).any() else "unknown"
        rows.append(
            ("prediction error", f"{share} of that without friction (median of the states, held out)")
        )
        rows.append(
            ("windows", f"{self.fit.windows} fitted, {self.held_out.windows} held out, {self.window:g} s")
        )
        return Summary(
            title=f"Identification of the robot {self.robot.name}. {self.verdict.sentence}",
            rows=tuple(rows),
            sentences=first_texts([*self.log_findings, *self.findings]),
        )

    def plot(self) -> Figure:
        """Return a figure of each wheel's identified friction over its speed, with a 95 % band."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        results = {
            "verdict": self.verdict,
            "parameters": self.parameters,
            "standard_errors": self.standard_errors,
            "intervals": self.intervals,
            "between_logs": self.variation.to_dict(self.labels),
            "identified_from": list(self.robot.identified_from),
            "correlation": {"labels": list(self.labels), "matrix": self.correlation},
            "coulomb_equivalent": self.coulomb,
            "represents": {
                BY_NAME[name].symbol: {"kind": "effective" if also else "physical", "also": also}
                for name in self.layout.names
                if (also := BY_NAME[name].stands_for) is not None
            },
            "units": {BY_NAME[name].symbol: BY_NAME[name].unit for name in self.layout.names},
            "held_out": self.held_out.to_dict(),
            "fit": self.fit.to_dict(),
            "excluded_states": list(self.excluded_states),
            "cost": {"evolution": list(self.evolution_cost), "gauss_newton": list(self.gauss_newton_cost)},
            "other_optimum": self.other
            and {"parameters": self.layout.by_symbol(self.other.values), "rise_of_cost": self.other.rise},
            "windows": {
                "fit": [[span.log, span.start, span.end] for span in self.fit_windows],
                "held_out": [[span.log, span.start, span.end] for span in self.held_out_windows],
            },
            "findings": finding_results([*self.log_findings, *self.findings]),
        }
        return to_results(results)


def represents_sentence(names: Sequence[str]) -> str:
    """Return which quantities stand for other effects than their own; empty if nobody looked."""
    by_effect: dict[str, list[str]] = {}
    for name in names:
        if also := BY_NAME[name].stands_for:
            by_effect.setdefault(also, []).append(BY_NAME[name].symbol)
    parts = [f"{', '.join(symbols)} ({also})" for also, symbols in by_effect.items()]
    return f"Effective parameters, and what else they stand for: {'; '.join(parts)}." if parts else ""


#: the lines of a robot file that a quantity of the rigid body stands in
_LINES = {
    "center_of_mass": ("body.center_of_mass",),
    "second_moment": tuple(f"body.inertia.{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
    "ball_inertia": ("ball.inertia",),
    "wheel_inertia": ("wheels.inertia",),
    "rotor_inertia": ("drive.motor_inertia", "drive.gear_inertia"),
}


def found_robot(
    robot: Robot,
    layout: Layout,
    values: NDArray[np.float64],
    standard_errors: NDArray[np.float64],
    *,
    covariance: NDArray[np.float64],
    ends: Mapping[int, tuple[float, float]],
    log_count: int,
    asymmetric: bool = False,
) -> Robot:
    """Return the robot with friction and rigid body out of parameters (p,); its sources state the standard errors (p,).

    Its standard deviations are those of the `covariance` (p, p); `ends` has the intervals of those without one.
    Gains, offsets, delays and biases belong to motors and sensors, of which a robot's description has no such
    numbers; they are in the result alone, and so is T_p. With the laws "asymmetric" and "directed" the offsets
    are friction.
    """
    rigid = {name: part for name in RIGID if (part := layout.part(name, values)) is not None}
    logs = "1 log" if log_count == 1 else f"{log_count} logs"
    lines = {name: (f"friction.{name}",) for name in FRICTION} | {name: _LINES[name] for name in rigid}
    lines |= {name: (f"friction.{name}",) for name in TERMS if name in layout.extra}
    lines |= {name: (f"{OWN}{name}",) for name in layout.own}
    if asymmetric:
        lines["torque_offset"] = ("friction.coulomb_asymmetry",)
    sources = {}
    for name, places in lines.items():
        part = layout.part(name, standard_errors)
        assert part is not None
        if name in FRICTION or np.isfinite(part).any():
            errors = ", ".join(f"{one:.2g}" if np.isfinite(one) else "none" for one in part)
            of = " of S_x, S_y, S_z" if name == "second_moment" else ""
            sources |= dict.fromkeys(places, f"identified: from {logs}, standard error{of} {errors}")
    moved = layout.robot_of(robot, values, asymmetric=asymmetric)
    return with_uncertainty(
        moved.annotated(sources={**robot.sources, **sources}),
        lambda parameters: layout.robot_of(robot, parameters, asymmetric=asymmetric),
        values,
        covariance,
        names=sources,
        ends=ends,
    )
