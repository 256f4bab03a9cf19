"""One axis, identified by three methods, with a ladder of friction laws judged on windows held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis.filtering import (
    Motion,
    default_bandwidth,
    first_row,
    smoothed_motion,
    speed_at_start,
)
from ballbot.identification.axis.inverse import BLOCK, InverseFit, asymmetry_over_time, inverse_fit
from ballbot.identification.axis.ladder import chosen, climb
from ballbot.identification.axis.laws import RUNGS, Rung, Values, rung_of
from ballbot.identification.axis.motion import Axis
from ballbot.identification.axis.output_error import (
    OutputErrorFit,
    closed_loop_residuals,
    equal_spans,
    fit_output_error,
    open_loop_residuals,
    recalled,
    search_output_error,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.remarks import remarks
from ballbot.identification.axis.result import AxisErrors, AxisIdentification, Estimate
from ballbot.identification.checkpoint import Recall, afresh

Report = Callable[[float, str], None]

#: where a search starts: the bristles' travel over the record's, the break-away's share of Coulomb friction
_BRISTLE_TRAVEL, _BREAK_AWAY = 4e-4, 0.1
#: shares of the work done when the ladder begins and ends
_LADDER_FROM, _LADDER_TO = 0.1, 0.7


def identify_axis(
    record: AxisRecord,
    *,
    law: str | None = None,
    bandwidth: float | None = None,
    window: float = 1.0,
    horizon: float | None = None,
    held_against: Sequence[AxisRecord] = (),
    recall: Recall = afresh,
    progress: Report | None = None,
) -> AxisIdentification:
    """Identify an axis's mass and friction.

    Parameters
    ----------
    record : AxisRecord
        With its loop and reference, output error in closed loop is done as well.
    law : str, optional
        One of `RUNGS`; by default the symmetric one of the least error on windows held out, among those that earn
        their place.
    bandwidth : float, optional
        Of the motion [Hz]; 20 by default, or less where the sampling is slow.
    window : float
        Duration of the windows [s] that the ladder is judged by.
    horizon : float, optional
        Duration of the windows [s] that the final open-loop fit predicts; the whole record by default.
    held_against : sequence of AxisRecord
        Other records of the axis: every estimate is held against them, none is fitted to them.
    recall : Recall, optional
        A checkpoint's, for a run that can be resumed: it answers for each law on the ladder and each fit.
    progress : callable, optional
        Told a share of the work, 0 to 1, and what is being done.

    Raises
    ------
    InputError
        Where the record cannot give the parameters, there is no such law, or an option makes no sense.
    """
    _check(record, held_against, window=window, horizon=horizon)
    wanted = rung_of(law) if law else None
    tell = progress or _silent
    band = default_bandwidth(record) if bandwidth is None else bandwidth
    inverse = {
        "coulomb": inverse_fit(record, form="coulomb", bandwidth=band),
        "asymmetric": inverse_fit(record, form="asymmetric", bandwidth=band),
    }
    motion = smoothed_motion(record, bandwidth=band)
    starts = _starts(record, motion, inverse)

    def tell_ladder(share: float, what: str) -> None:
        tell(_LADDER_FROM + (_LADDER_TO - _LADDER_FROM) * share, what)

    ladder = climb(record, motion, starts, window=window, recall=recall, progress=tell_ladder)
    rung = wanted or chosen(ladder)
    bench = _Bench(records=(record, *held_against), bandwidth=band)
    rungs = {}
    for number, name in enumerate(RUNGS):
        tell(_LADDER_TO + 0.25 * number / len(RUNGS), f"open loop, law {name}")
        fit = partial(_open_loop, record, motion, RUNGS[name], starts[name], horizon)
        rungs[name] = bench.estimate(
            "open loop", recalled(recall, "open loop", RUNGS[name], starts[name], fit)
        )
    tell(0.95, "closed loop")
    estimates = [_inverse_estimate(bench, inverse)]
    if record.loop is not None:
        start = first_row(record, bandwidth=band)
        residuals = closed_loop_residuals(record, start=start, block=BLOCK)
        usual = float(np.std(record.force)) * 0.05
        begin = starts[rung.name]
        fit = partial(fit_output_error, rung, begin, residuals, scale=usual)
        estimates.append(bench.estimate("closed loop", recalled(recall, "closed loop", rung, begin, fit)))
    estimates.append(rungs[rung.name])
    asymmetry = asymmetry_over_time(record)
    tell(1.0, "done")
    return AxisIdentification(
        record=record.name,
        unit=record.unit,
        inverse=inverse,
        ladder=ladder,
        chosen=rung,
        estimates=tuple(estimates),
        rungs=rungs,
        asymmetry=asymmetry,
        remarks=remarks(record, ladder, rung, rungs, asymmetry, taken=wanted is not None),
    )


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """The records that every estimate is held against, that which is fitted first."""

    records: tuple[AxisRecord, ...]
    bandwidth: float

    def estimate(self, method: str, fit: OutputErrorFit) -> Estimate:
        return Estimate(
            method=method,
            rung=fit.rung,
            values=fit.values,
            standard_errors=fit.standard_errors,
            errors=tuple(axis_errors(fit.axis, record, bandwidth=self.bandwidth) for record in self.records),
        )


def axis_errors(axis: Axis, record: AxisRecord, *, bandwidth: float) -> AxisErrors:
    """Return how well an axis predicts a record; closed-loop errors leave out the filter's start, as published."""
    motion = smoothed_motion(record, bandwidth=bandwidth)
    positions = axis.open_loop(
        record.force[:-1],
        position=float(record.position[0]),
        speed=speed_at_start(record),
        sample_time=record.sample_time,
    )
    rmse = float(np.sqrt(np.mean((positions - record.position[1:]) ** 2)))
    force = position = None
    if record.loop is not None:
        start = first_row(record, bandwidth=bandwidth)
        moved = axis.closed_loop(record, speed=speed_at_start(record))
        force = _relative(moved.forces[start:], record.force[start:])
        position = _relative(moved.positions[start:], motion.position[start:])
    return AxisErrors(
        record=record.name, open_loop_rmse=rmse, closed_loop_force=force, closed_loop_position=position
    )


def _check(
    record: AxisRecord, held_against: Sequence[AxisRecord], *, window: float, horizon: float | None
) -> None:
    for name, value in (("window", window), ("horizon", horizon)):
        if value is not None and not 10.0 * record.sample_time <= value < np.inf:
            raise InputError(f"The {name} is {value:g} s; it must be at least ten samples.")
    names = [one.name for one in (record, *held_against)]
    if len(set(names)) < len(names):
        raise InputError(
            f"Two of the records have the same name ({', '.join(names)}); give each its own name."
        )
    if np.ptp(record.force) == 0.0:
        raise InputError(
            f"{record.name}: the force is {record.force[0] + 0.0:g} {record.force_unit} "
            "throughout, so nothing can be identified; check its column and its scale."
        )


def _relative(found: NDArray[np.float64], measured: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(found - measured) / np.linalg.norm(measured))


def _inverse_estimate(bench: _Bench, inverse: dict[str, InverseFit]) -> Estimate:
    fit = inverse["coulomb"]
    return bench.estimate(
        "inverse",
        OutputErrorFit(
            rung=RUNGS["coulomb"],
            values=dict(zip(fit.names, fit.values.tolist(), strict=True)),
            standard_errors=dict(zip(fit.names, fit.clustered_errors.tolist(), strict=True)),
            rms=fit.relative_force_error,
        ),
    )


def _open_loop(
    record: AxisRecord, motion: Motion, rung: Rung, start: Values, horizon: float | None
) -> OutputErrorFit:
    spans = equal_spans(record, np.inf if horizon is None else horizon)
    residuals = open_loop_residuals(record, motion, spans, block=BLOCK)
    return search_output_error(rung, start, residuals, scale=1e-3 * float(np.ptp(record.position)))


def _starts(
    record: AxisRecord, motion: Motion, inverse: dict[str, InverseFit]
) -> dict[str, dict[str, float]]:
    """Return where each rung's search starts: at the inverse model's parameters."""
    least = 1e-3 * float(np.std(record.force))
    symmetric = inverse["coulomb"]
    values = dict(zip(symmetric.names, symmetric.values.tolist(), strict=True))
    if values["mass"] <= 0.0:
        raise InputError(
            f"{record.name}: the inverse model estimates a mass of {values['mass']:.3g}. "
            "The sign of the force or its column is wrong, or the axis hardly accelerates."
        )
    values |= {name: max(values[name], least) for name in ("viscous", "coulomb")}
    values["stiffness"] = values["coulomb"] / (_BRISTLE_TRAVEL * float(np.ptp(record.position)))
    values["stribeck"] = _BREAK_AWAY * values["coulomb"]
    values["stribeck_speed"] = float(np.median(np.abs(motion.speed))) / 3.0
    values["micro_damping"] = 0.1 * float(np.sqrt(values["stiffness"] * values["mass"]))
    asymmetric = dict(zip(inverse["asymmetric"].names, inverse["asymmetric"].values.tolist(), strict=True))
    asymmetric = {name: max(value, least) for name, value in asymmetric.items()}
    return {name: (values if rung.symmetric else asymmetric) for name, rung in RUNGS.items()}


def _silent(share: float, what: str) -> None:
    """Tell nobody."""
