"""Errors of an axis's parameters by what the model lacks, from the residuals of the result.

A standard error contains what differs from block to block of a record, and nothing of an effect that is the same in
every block: a force that acts a part of a row later, a drive that yields, a play that is crossed at every reversal. The
fit hides such an effect in its parameters. Here it is given a way out, by one Gauss-Newton step each:

- a column of its own: the force later by part of a row; the position of the encoder against that of the centre of mass
  by an elastic drive, in proportion to the force that the drive transmits, or by play, with the sign of that force;
- windows with large errors count less (Tukey's biweight); or windows near reversals of speed or of the transmitted
  force, or those of the slower motion are left out, if their errors are several times the others', or if they show
  another friction, as they do if the law is wrong. It counts for parameters that the other windows determine.

If a way moves a parameter by d, with the standard error s of its own estimate, the model's error of that parameter has
the variance d^2 - s^2, or zero if that is negative. Where nothing is missing, d is seldom beyond s.

An elastic drive, play and a force that acts half a millisecond later are usual, and a change of the mass by some tenths
of a percent hides them from a test. Their sizes e have a prior, normal about zero with a usual size as its standard
deviation S. With the estimate e_0 of the residuals and its standard error s, e has the variance
V = 1 / (1 / s^2 + 1 / S^2) and the mean e_1 = V e_0 / s^2. A parameter that moves by D e if the others are fitted again
has the error variance D^2 (V + e_1^2). It adds little where the record excludes a usual size.

Another law of friction is a way as well (`with_another_law`): an asymmetric one that predicts held-out blocks better
and is not selected from one record, and a break-away force that the records do not exclude.

Of all ways the largest variance counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, note
from ballbot.fitting.least_squares import FitInTime, fit_in_time, fit_linear
from ballbot.identification.axis.force_timing import delay_column
from ballbot.identification.axis.laws import unit_for
from ballbot.identification.axis.output_error import OpenLoop, OutputErrorFit, Sighting, derivatives
from ballbot.identification.axis.play import of_both_directions
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.result import Estimate
from ballbot.identification.axis.selection import Blocks, problem_of, slow_rows, windows_with
from ballbot.identification.axis.structure import base_name
from ballbot.rounding import digits

#: a later force counts if chance explains it in less than this share of cases, or it explains more than this share of
#: the squared residuals, which a systematic effect can in few blocks
_CHANCE, _SHARE = 0.05, 0.1
#: usual sizes of drives with half the inertia behind them: the frequency [rad/s] of the two halves on their shaft, and
#: the play to either side of drives that turn [rad] and that slide [m]
_USUAL_NATURAL = 2.0 * np.pi * 25.0
_USUAL_PLAY = {"rad": 2e-3, "m": 5e-5}
#: usual delay of the force [s], half the period of a loop at 1 kHz, that is not in the rows
_USUAL_DELAY = 5e-4
#: no record shows such an effect better than to this share of a usual size, as the columns are first approximations;
#: it counts for the mass, whose own trace is close to theirs
_LEAST_ERROR = 0.15
#: windows whose error is so many times the median do not count at all
_FAR = 3.0
#: kinds of windows are left out whose mean square error is above so many times that of the others (medians), or whose
#: friction differs from that of the others with less than this p-value, if at least this share of the windows is left
_WORSE, _DIFFERENT, _LEAST_LEFT = 3.0, 0.01, 0.25
#: windows that are left with less than this share of a parameter's information say nothing of it: where rest is long,
#: those of the largest errors are all that move. Of useful kinds of windows the least is 0.1
_LEAST_INFORMATION = 0.02
_FRICTION = ("viscous", "viscous_plus", "viscous_minus", "coulomb", "coulomb_plus", "coulomb_minus")
#: usual time in which a drive crosses its play [s]
_CROSSING = 0.03
#: parameters that shape a law near rest, of which one linear step says little
_SHAPES = ("stiffness", "micro_damping", "stribeck", "stribeck_speed")
_WITHOUT_SLOW = "without windows near reversals of the speed"
_WITHOUT_TURNING = "without windows near reversals of the force that the drive transmits"
#: an error by what the model lacks is reported beyond so many standard errors, and beyond this share of the parameter
_REPORTED, _SHARE_REPORTED = 1.0, 0.02


@dataclass(frozen=True, kw_only=True)
class Discrepancy:
    """What the model lacks may make of the errors of parameters."""

    errors: Mapping[str, float]  #: standard deviations by label, of parameters that it moves
    causes: Mapping[str, str]  #: by label, what moves a parameter most
    #: what the residuals show of an elastic drive and of play, by cause: sizes over the usual one, and standard errors
    drive: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linear:
    """A fit, linear about its minimum."""

    problem: OpenLoop
    fit: OutputErrorFit
    labels: Sequence[str]  #: (p,), of the parameters that are not at a bound
    J: NDArray[np.float64]  #: (m, p), by these
    residuals: NDArray[np.float64]  #: (m,), at the minimum: recorded less simulated
    block: NDArray[np.int64]  #: (m,)

    def transmitted(self, number: int) -> NDArray[np.float64]:
        """Return the force (N,) that the drive transmits to one record's axis, over its mass [m/s^2].

        That of the simulated windows: the noise of a recorded position is in its acceleration as well, with the
        opposite sign, and would look like a drive of negative elasticity.
        """
        seen = self.problem.sightings[number]
        record, found = seen.record, np.zeros(len(seen.record))
        axis = self.fit.model.axis(self.fit.values, number)
        mass = axis.values["mass"] + record.known_load.inertia
        bends = axis.bends(seen.motion.position, seen.motion.speed)
        for own in (one for one in self.problem.windows if one.record == number):
            starts = np.column_stack([own.starts, bends[own.firsts]])
            moved = axis.windows(
                record, own.firsts, own.counts, starts, interpolated=self.fit.model.interpolated
            )
            ends = np.cumsum(own.counts)
            for first, end, count, start in zip(own.firsts, ends, own.counts, starts[:, 0], strict=True):
                rows = slice(first, first + count + 1)
                position = np.append(start, moved[end - count : end])
                force = axis.loading_force(record, position, _acceleration(record.t[rows], position))
                found[rows] = force / mass
        return found


def _acceleration(t: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the acceleration (n,) of a motion without noise; zero of fewer than three rows."""
    if len(t) < 3:
        return np.zeros(len(t))
    middle = 0.5 * (t[1:] + t[:-1])
    inner = np.diff(np.diff(position) / np.diff(t)) / np.diff(middle)
    return np.concatenate([inner[:1], inner, inner[-1:]])


def discrepancy_of(
    fit: OutputErrorFit, sightings: Sequence[Sighting], blocks: Blocks, horizon: float
) -> Discrepancy:
    """Return the errors of the parameters of a fit to windows of that length by what its model lacks."""
    problem = problem_of(fit.model, sightings, blocks, horizon)
    known = [label for label in fit.model.labels if np.isfinite(fit.standard_errors[label])]
    J = derivatives(fit.model, fit.values, problem)[:, [fit.model.labels.index(label) for label in known]]
    _, block = np.unique(problem.block, return_inverse=True)
    # a fit ends near its minimum only
    plain = fit_in_time(J, -problem.projection(fit.values)(problem.errors(fit.values)), block)
    if plain is None:
        return Discrepancy(errors={}, causes={})
    linear = _Linear(problem=problem, fit=fit, labels=known, J=J, residuals=plain.residuals, block=block)
    variances, causes = np.zeros(len(known)), [""] * len(known)
    straight = np.array([base_name(label) not in _SHAPES for label in known])
    least = np.array([_LEAST_ERROR if base_name(label) == "mass" else 0.0 for label in known])
    ways = [
        (cause, step.values[: len(known)] ** 2 - step.errors[: len(known)] ** 2)
        for cause, step in (*_by_delay(linear), *_by_weights(linear))
    ]
    effects = list(_drive_effects(linear))
    for cause, variance in (*ways, *((one.cause, one.variances(least)) for one in effects)):
        for i in np.flatnonzero(straight & (variance > variances)):
            variances[i], causes[i] = variance[i], cause
    moved = np.flatnonzero(variances > 0.0)
    return Discrepancy(
        errors={known[i]: float(np.sqrt(variances[i])) for i in moved},
        causes={known[i]: causes[i] for i in moved},
        drive={one.cause: (one.size, one.error) for one in effects},
    )


def with_another_law(
    found: Discrepancy, plain: OutputErrorFit, other: OutputErrorFit, cause: str
) -> Discrepancy:
    """Return a discrepancy with the errors by a friction that another law has.

    Parameters
    ----------
    found : Discrepancy
    plain, other : OutputErrorFit
        Fits of the law coulomb and of the other one. Parameters of either direction are compared by their means.
    cause : str
        What moves the parameters.
    """
    ours, theirs = of_both_directions(plain), of_both_directions(other)
    errors, causes = dict(found.errors), dict(found.causes)
    for label in (one for one in ours if one in theirs):
        (value, _), (another, error) = ours[label], theirs[label]
        variance = (value - another) ** 2 - error**2
        if variance > errors.get(label, 0.0) ** 2:
            errors[label], causes[label] = float(np.sqrt(variance)), cause
    return replace(found, errors=errors, causes=causes)


def _forces_move(linear: _Linear) -> bool:
    return any(np.ptp(one.record.force) > 0.0 for one in linear.problem.sightings)


def _by_delay(linear: _Linear) -> Iterator[tuple[str, FitInTime]]:
    """Give the step with a later force, if the residuals show it; a simulated loop has no delay."""
    problem = linear.problem
    if not _forces_move(linear) or any(one.record.loop is not None for one in problem.sightings):
        return
    column = delay_column(problem, linear.fit.values)
    step = fit_in_time(np.column_stack([linear.J, column]), linear.residuals, linear.block)
    if step is None:
        return
    total = max(float(linear.residuals @ linear.residuals), np.finfo(float).tiny)
    share = 1.0 - float(step.residuals @ step.residuals) / total
    if step.p_value(-1) < _CHANCE or share > _SHARE:
        yield "with a force that acts part of a row later or earlier", step


@dataclass(frozen=True, kw_only=True, eq=False)
class _DriveEffect:
    """An elastic drive, play or a late force, of a size over the usual one."""

    cause: str
    moved: NDArray[np.float64]  #: (p,), how far the usual size moves parameters
    size: float
    error: float  #: its standard error

    def variances(self, least: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the variances (p,) of parameters by it; `least` (p,) are the least errors of its size."""
        known = 1.0 / (1.0 + self.error**2 + least**2)
        return self.moved**2 * (1.0 - known + (known * self.size) ** 2)


def _drive_effects(linear: _Linear) -> Iterator[_DriveEffect]:
    """Give what a drive and the time of its force may do, with the sizes that the residuals show."""
    if not _forces_move(linear):
        return
    lengths = np.linalg.norm(linear.J, axis=0)
    for cause, column in (*_drive_columns(linear), *_late_force(linear)):
        moved = -np.linalg.lstsq(linear.J / lengths, column, rcond=1e-10)[0] / lengths
        step = fit_in_time(np.column_stack([linear.J, column]), linear.residuals, linear.block)
        size, error = (0.0, np.inf) if step is None else (float(step.values[-1]), float(step.errors[-1]))
        yield _DriveEffect(cause=cause, moved=moved, size=size, error=error)


def _drive_columns(linear: _Linear) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Give the derivatives (m,) of the errors by each effect of a drive over its usual size.

    With half the inertia behind it, the centre of mass is behind the encoder by half the twist: a / natural^2, and half
    the play. The part that other starts explain is left out.
    """
    problem = linear.problem
    project = problem.projection(linear.fit.values)
    forces = [linear.transmitted(number) for number in range(len(problem.sightings))]
    play = 0.5 * _USUAL_PLAY[problem.sightings[0].record.unit]
    for cause, shapes in (
        ("with an elastic drive", [one / _USUAL_NATURAL**2 for one in forces]),
        ("with play in the drive", [play * np.sign(one) for one in forces]),
    ):
        yield cause, project(np.concatenate([shapes[one.record][one.rows] for one in problem.windows]))


def _late_force(linear: _Linear) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Give the derivatives (m,) of the errors by the delay of the force over its usual size; a loop has none.

    A twentieth of a row is hardly seen, and changes the mass of an axis of much friction by percent.
    """
    problem = linear.problem
    if any(one.record.loop is not None for one in problem.sightings):
        return
    rows = _USUAL_DELAY / max(one.record.sample_time for one in problem.sightings)
    yield (
        "with a force that acts half a millisecond later or earlier",
        rows * delay_column(problem, linear.fit.values),
    )


def _by_weights(linear: _Linear) -> Iterator[tuple[str, FitInTime]]:
    """Give each reason to let some windows count less, and the step without them."""
    window = linear.problem.window
    squares = np.bincount(window, linear.residuals**2) / np.bincount(window)
    far = np.sqrt(squares) / (_FAR * max(float(np.sqrt(np.median(squares))), np.finfo(float).tiny))
    weights = {"without the windows of the largest errors": np.maximum(1.0 - far**2, 0.0)}
    for cause, left_out in _kinds_of_windows(linear):
        if not left_out.any() or np.mean(left_out) > 1.0 - _LEAST_LEFT:
            continue
        # medians, as one corrupted row is most of a mean
        worse = np.median(squares[left_out]) > _WORSE * np.median(squares[~left_out])
        if worse or _friction_differs(linear, left_out) < _DIFFERENT:
            weights[cause] = (~left_out).astype(float)
    for cause, weight in weights.items():
        kept = weight[window] > 0.0
        if len(np.unique(linear.block[kept])) <= linear.J.shape[1]:
            continue
        of_row = weight[window][kept]
        J = linear.J[kept] * of_row[:, None]
        step = fit_in_time(J, linear.residuals[kept] * of_row, linear.block[kept])
        if step is not None:
            informed = _information(J) > _LEAST_INFORMATION * _information(linear.J)
            yield cause, replace(step, values=np.where(informed, step.values, 0.0))


def _information(J: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse variance (p,) of each parameter by derivatives (m, p) of errors of variance one."""
    lengths = np.linalg.norm(J, axis=0)
    return lengths**2 / np.linalg.pinv((J / lengths).T @ (J / lengths)).diagonal()


def _kinds_of_windows(linear: _Linear) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Give each kind of windows that may be left out, and which they are (w,)."""
    problem = linear.problem
    slow = [slow_rows(seen) for seen in problem.sightings]
    turning = [
        _near_reversals(linear.transmitted(number), seen.record)
        for number, seen in enumerate(problem.sightings)
    ]
    for cause, rows in ((_WITHOUT_SLOW, slow), (_WITHOUT_TURNING, turning)):
        yield cause, np.concatenate([windows_with(rows[one.record], one) for one in problem.windows])
    speeds = np.concatenate(
        [np.abs(problem.sightings[one.record].motion.speed)[one.rows] for one in problem.windows]
    )
    mean = np.bincount(problem.window, speeds) / np.bincount(problem.window)
    yield "without the slower half of the windows", mean <= np.median(mean)


def _friction_differs(linear: _Linear, kind: NDArray[np.bool_]) -> float:
    """Return the p-value of equal friction in windows of a kind (w,) and in the others; one if that is not known."""
    friction = [place for place, label in enumerate(linear.labels) if base_name(label) in _FRICTION]
    own = linear.J[:, friction] * kind[linear.problem.window][:, None]
    if not friction or not np.linalg.norm(own, axis=0).all():
        return 1.0
    lengths = np.linalg.norm(linear.J, axis=0)
    design = np.column_stack([linear.J / lengths, own / lengths[friction]])
    p_value = fit_linear(design, linear.residuals, linear.block).p_value(range(len(lengths), design.shape[1]))
    return p_value if np.isfinite(p_value) else 1.0


def _near_reversals(force: NDArray[np.float64], record: AxisRecord) -> NDArray[np.bool_]:
    """Return which rows (N,) are within the time of a crossing of play from where a force (N,) changes sign."""
    changes = np.diff(np.sign(force), append=np.sign(force[-1])) != 0.0
    reach = round(_CROSSING / record.sample_time)
    return np.convolve(changes, np.ones(2 * reach + 1), mode="same") > 0.5


def with_discrepancy(estimate: Estimate, errors: Mapping[str, float], quantile: float) -> Estimate:
    """Return an estimate whose intervals contain further errors, independent of its own.

    Parameters
    ----------
    estimate : Estimate
    errors : mapping of str to float
        Standard deviations by label.
    quantile : float
        Half the width of a 95 % interval over the standard error.
    """
    known = {
        label: one for label, one in errors.items() if np.isfinite(estimate.half_widths.get(label, np.nan))
    }

    def with_errors(own: Mapping[str, float], factor: float = 1.0) -> dict[str, float]:
        return dict(own) | {
            label: float(np.hypot(own.get(label, 0.0), factor * error)) for label, error in known.items()
        }

    return replace(
        estimate,
        standard_errors=with_errors(estimate.standard_errors),
        half_widths=with_errors(estimate.half_widths, quantile),
        discrepancies=with_errors(estimate.discrepancies),
    )


def discrepancy_findings(estimate: Estimate, found: Discrepancy, unit: str) -> list[Finding]:
    """Return a note on the parameters whose intervals are clearly wider by what the model lacks.

    Parameters
    ----------
    estimate : Estimate
        Without that in its errors.
    found : Discrepancy
    unit : str
        Of positions.
    """
    parts = []
    for cause in dict.fromkeys(found.causes.values()):
        labels = [label for label, own in found.causes.items() if own == cause]
        wide = [
            label
            for label in labels
            if found.errors[label] > _REPORTED * estimate.standard_errors[label]
            and found.errors[label] > _SHARE_REPORTED * abs(estimate.values[label])
        ]
        words = [
            f"{estimate.model.parameter(label).symbol} by "
            f"{digits(found.errors[label], 2)} {unit_for(estimate.model.parameter(label), unit)}".rstrip()
            for label in wide
        ]
        if words:
            parts.append(f"{cause} ({', '.join(words)})")
    if not parts:
        return []
    text = (
        "The model may lack something. The 95 % intervals include how far parameters move in a "
        f"fit {'; '.join(parts)}."
    )
    return [note("discrepancy", text)]
