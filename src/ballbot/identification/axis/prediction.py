"""How well an identified axis predicts records, and the error to expect on another one.

The error expected is that of the position, root mean square over windows of one length from their best starts. Its
interval comes from the errors of held-out blocks: log e is taken as normal. Its variance is the sum of a bootstrap
variance of the blocks, both of these records and of the other one, and of a variance between records. Several records
estimate the variance between records. For a single one it is `BETWEEN`, a chosen value; campaigns/axis_machines.py
counts how often the interval then contains the error of a second record of a simulated machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.findings import Finding, note, warning
from ballbot.fitting.uncertainty import resamples
from ballbot.identification.axis.laws import Values
from ballbot.identification.axis.motion import (
    Decimation,
    default_bandwidth,
    first_row,
    smoothed_motion,
    speed_at_start,
)
from ballbot.identification.axis.output_error import (
    OpenLoop,
    OutputErrorFit,
    equal_spans,
    sighting,
    windows_of,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import Blocks
from ballbot.identification.axis.structure import AxisModel


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """How well parameters predict a record."""

    record: str
    window_rmse: float  #: of the position over windows of the fit's length, from their best starts [m]
    open_loop_rmse: float  #: of the position over the whole record, from its start [m]; NaN if it has gaps
    #: |F - F_hat| / |F| of the force that the recorded motion requires, decimated as in the inverse model
    inverse_force: float
    closed_loop_force: float | None  #: the same in closed loop; None if the loop is not known
    closed_loop_position: float | None  #: the same for the position


#: standard deviation of log e between records of one machine, beyond the variation of blocks; chosen, not calibrated
BETWEEN = 0.25
_DRAWS, _SEED = 2000, 0
#: a simulation of a whole record diverges if its error exceeds so many times the travel; chosen
_DIVERGED = 10.0


@dataclass(frozen=True, kw_only=True)
class PredictedError:
    """The error expected on another record."""

    horizon: float  #: length of the windows [s]
    error: float  #: root mean square of the position [m]
    lower: float  #: of the 95 % interval
    upper: float
    records: int  #: that the variation between records is estimated from; it is assumed for one

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "horizon": self.horizon,
            "position_rmse": self.error,
            "interval_95": [self.lower, self.upper],
            "between_records": "estimated" if self.records > 1 else "assumed",
        }


def predicted_error(
    squares: NDArray[np.float64], blocks: Blocks, *, horizon: float, elsewhere: int | None = None
) -> PredictedError:
    """Return the error to expect.

    Parameters
    ----------
    squares : ndarray (blocks,)
        Mean square errors of the held-out blocks [m^2].
    blocks : Blocks
    horizon : float
        Length of the windows that they are of [s].
    elsewhere : int, optional
        How many blocks the other record has; as many as these by default.
    """
    groups = blocks.groups()
    owner = np.array([blocks.spans[one[0]][0] for one in groups])
    # blocks that repeat each other show the variation between blocks once
    squares = np.array([squares[one].mean() for one in groups])
    count = len(squares)
    other = elsewhere or count
    own = resamples(count, block=1, repeats=_DRAWS, seed=_SEED) @ squares / count
    new = np.random.default_rng(_SEED + 1).choice(squares, size=(_DRAWS, other)).mean(axis=1)
    variance = float(np.var(0.5 * np.log(new / own))) * count / (count - 1)
    records = int(owner.max()) + 1
    logs = np.array([0.5 * np.log(squares[owner == i].mean()) for i in range(records)])
    freedom = count - 1
    between = BETWEEN**2
    if records > 1:
        # the estimate from few records shrinks towards the assumed value, which weighs as much as three records
        between = (3.0 * between + (records - 1) * float(np.var(logs, ddof=1))) / (records + 2)
        freedom = records + 2
    half = float(scipy.stats.t.ppf(0.975, freedom)) * np.sqrt(variance + between * (1.0 + 1.0 / records))
    middle = float(np.sqrt(squares.mean()))
    return PredictedError(
        horizon=horizon,
        error=middle,
        lower=middle * float(np.exp(-half)),
        upper=middle * float(np.exp(half)),
        records=records,
    )


#: how much a separate parameter differs between records, as standard deviation: a force by this share of the usual one,
#: any other by this share of itself; chosen, and used as a lower limit of the spread that the records show
_FORCE_SPREAD, _PARAMETER_SPREAD = 0.1, 0.2
#: it counts as much as so many records
_ASSUMED_RECORDS = 3


def shifted_parameters(model: AxisModel, values: Values, usual_force: float) -> dict[str, float]:
    """Return parameters by label with the separate ones moved by the spread assumed, up and down by turns."""
    found = dict(values)
    for name in model.names:
        for number in range(model.records):
            label = model.label(name, number)
            if label != name and not name.startswith("drift_"):
                force = model.parameter(label).unit == "N" and model.parameter(label).scale == "signed"
                size = _FORCE_SPREAD * usual_force if force else _PARAMETER_SPREAD * abs(values[label])
                found[label] += size if number % 2 else -size
    return found


def with_unknown_parameters(
    expected: PredictedError, squares: NDArray[np.float64], assumed: NDArray[np.float64]
) -> PredictedError:
    """Return the error to expect on a record whose separate parameters are its own and not known.

    The part of the error that their spread makes is known from as many records as were fitted, and from what is
    assumed, if that is more: two records alone might be alike by chance, and would leave any size possible.

    Parameters
    ----------
    expected : PredictedError
        With each record's own parameters.
    squares : ndarray (blocks,)
        Mean square errors of the blocks, each record's separate parameters averaged over the other records [m^2].
    assumed : ndarray (blocks,)
        The same with `shifted_parameters`.
    """
    known = expected.error**2
    shown, prior = (max(float(one.mean()) - known, 0.0) for one in (squares, assumed))
    freedom = expected.records - 1 + _ASSUMED_RECORDS
    spread = np.sqrt(max(shown, (_ASSUMED_RECORDS * prior + (expected.records - 1) * shown) / freedom))
    least, most = (spread * float(scipy.stats.t.ppf(share, freedom)) for share in (0.5125, 0.9875))
    return replace(
        expected,
        error=float(np.hypot(expected.error, spread)),
        lower=float(np.hypot(expected.lower, least)),
        upper=float(np.hypot(expected.upper, most)),
    )


def error_elsewhere(
    fit: OutputErrorFit, record: AxisRecord, *, horizon: float, number: int | None = None
) -> float:
    """Return the error [m] of a fit on a record over windows of that length [s].

    The record is one that was fitted if it has a `number` among those, or another one.
    """
    own = (
        fit.model.values_elsewhere(fit.values) if number is None else fit.model.values_for(fit.values, number)
    )
    drifts = 0 if number is None else fit.model.drifts
    model = replace(fit.model, drifts=drifts, separate=(), records=1)
    seen = sighting(record, default_bandwidth(record))
    windows = windows_of(seen, equal_spans(record, horizon))
    problem = OpenLoop(model=model, sightings=[seen], windows=[windows])
    return float(np.sqrt(np.mean(problem.from_best_starts(own) ** 2)))


def elsewhere_findings(
    expected: PredictedError, found: Sequence[tuple[AxisRecord, float]], *, unit: str
) -> list[Finding]:
    """Return a finding for each other record: whether its error lies within the interval."""
    findings = []
    for record, error in found:
        text = (
            f"{record.name}: the position error over windows of {expected.horizon:g} s is {1e3 * error:.3g} m{unit}; "
            f"{1e3 * expected.error:.3g} was expected, with a 95 % interval of {1e3 * expected.lower:.3g} "
            f"to {1e3 * expected.upper:.3g}"
        )
        if error > expected.upper:
            findings.append(
                warning(
                    "other-record",
                    f"{text}. The record differs in what the model leaves out: load, temperature, supply, "
                    "faster motion or more reversals (an elastic drive), another machine, or a wrong column or scale.",
                )
            )
        elif error < expected.lower:
            findings.append(
                warning(
                    "other-record",
                    f"{text}. It moves less, or in a part of the range where the model is better, and shows "
                    "little about the rest.",
                )
            )
        else:
            findings.append(note("other-record", f"{text}."))
    return findings


def failure_findings(records: Sequence[AxisRecord], errors: Sequence[AxisErrors]) -> list[Finding]:
    """Return a warning for each record that a model with these errors does not predict at all."""
    findings = []
    for record, one in zip(records, errors, strict=True):
        travel = float(np.ptp(record.position))
        failures = []
        if np.any(record.force) and not one.inverse_force <= 1.0:
            failures.append(
                f"the force that the motion requires by the model differs by {100.0 * one.inverse_force:.0f} % from "
                "the recorded force, more than a force of zero"
            )
        if len(record.segments) == 1 and not one.open_loop_rmse <= _DIVERGED * travel:
            failures.append(
                f"the simulation of the whole record diverges: its error exceeds {_DIVERGED:.0f} times the travel"
            )
        if failures:
            text = (
                f"{record.name}: {'; '.join(failures)}. Do not use these parameters. Check the columns, units and "
                "signs of force and position, and whether the recorded force acts in all rows."
            )
            findings.append(warning("not-predicted", text))
    return findings


@np.errstate(over="ignore", invalid="ignore")  # a simulation that diverges has an infinite error
def axis_errors(
    fit: OutputErrorFit, record: AxisRecord, number: int | None, *, bandwidth: float, horizon: float
) -> AxisErrors:
    """Return how well a fit predicts a record; closed-loop errors leave out the filter's start, as published."""
    axis = fit.model.axis(fit.values, number)
    motion = smoothed_motion(record, bandwidth=bandwidth)
    whole = np.nan
    if len(record.segments) == 1:
        speed = speed_at_start(record)
        positions = axis.windows(
            record,
            np.array([0]),
            np.array([len(record) - 1]),
            np.array([[record.position[0], speed, np.sign(speed)]]),
            interpolated=fit.model.interpolated,
        )
        whole = float(np.sqrt(np.mean((positions - record.position[1:]) ** 2)))
    force = position = None
    start = max(0, first_row(record, bandwidth=bandwidth))
    if record.loop is not None:
        moved = axis.closed_loop(record, speed=speed_at_start(record))
        force = _relative(moved.forces[start:], record.force[start:])
        position = _relative(moved.positions[start:], motion.position[start:])
    needed = axis.needed_force(record, motion.position, motion.speed, motion.acceleration)
    rows, compared = Decimation(record, bandwidth=bandwidth), [needed[start:], record.force[start:]]
    if rows.kept:
        compared = [rows.of(one)[~rows.disturbed] for one in (needed, record.force)]
    return AxisErrors(
        record=record.name,
        window_rmse=error_elsewhere(fit, record, horizon=horizon, number=number),
        open_loop_rmse=whole,
        inverse_force=_relative(*compared),
        closed_loop_force=force,
        closed_loop_position=position,
    )


def _relative(found: NDArray[np.float64], measured: NDArray[np.float64]) -> float:
    size = float(np.linalg.norm(measured))
    return float(np.linalg.norm(found - measured)) / size if size > 0.0 else float("nan")
