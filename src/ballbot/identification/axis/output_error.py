"""Output error, and the friction laws fitted by it and compared on held-out windows.

Output error: the parameters whose simulation comes closest to the record, in open or in closed loop.

In open loop the recorded force moves the axis from the state at a window's start, and positions are compared; in
closed loop the recorded reference does, and forces are compared. Levenberg and Marquardt's steps by SciPy, with
central differences wide enough to average over single events of sticking.

Selection: each law is fitted to all windows but those of one fold, and predicts these, so that every window is held
out once; `ballbot.fitting.model_selection` selects the law that they support.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.least_squares import Stopping, minimize_squares
from ballbot.fitting.model_selection import HeldOut, ModelSelection, neighbours, select_model
from ballbot.fitting.parameter import RelativeSpace
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import evolve
from ballbot.fitting.uncertainty import block_length, covariance_in_time
from ballbot.identification.axis.inverse import Motion, speed_at_start
from ballbot.identification.axis.model import AXIS_LAWS, Axis, AxisLaw, Values, space_about, values_of
from ballbot.identification.axis.record import AxisRecord
from ballbot.progress import Progress

#: half the central difference, in the scaled parameter
_DIFFERENCE = 5e-4
_MOST_STEPS = 30
#: the descent ends where a step lowers the sum of squares by less than this share
_ENOUGH = 1e-4
#: it starts at least this far inside the bounds, and ends at one where it comes closer than `_AT_BOUND`
_INSIDE, _AT_BOUND = 1e-3, 1e-6
#: the evolution strategy looks this far around, in scaled parameters
_REACH, _REACH_LOGARITHMIC = 0.2, 2.0
_GENERATIONS, _POPULATION = 25, 10
#: positions are compared this often [s]
_COMPARED_EVERY = 0.01
#: residuals up to so many blocks apart are taken for dependent, of the record's blocks one in
_NEIGHBOURS = 4

Span = tuple[int, int]  #: first row and the row after the last


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """Simulated minus recorded, and in which block of time each lies."""

    values: NDArray[np.float64]  #: (m,)
    block: NDArray[np.int64]  #: (m,)


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputErrorFit:
    """What output error gives."""

    law: AxisLaw
    values: dict[str, float]  #: SI units
    standard_errors: dict[str, float]  #: NaN if a parameter stands at a bound
    rms: float  #: of the residuals: [m] in open loop, [N] in closed loop

    @property
    def axis(self) -> Axis:
        """The axis with these parameters."""
        return Axis(law=self.law, values=self.values)


def equal_spans(record: AxisRecord, duration: float) -> list[Span]:
    """Return windows of about that duration [s], end to end; one of the whole record where that is shorter."""
    count = max(1, round(len(record) * record.sample_time / duration))
    edges = np.linspace(0, len(record) - 1, count + 1).astype(int)
    return [(int(a), int(b)) for a, b in pairwise(edges)]


def open_loop_residuals(
    record: AxisRecord, motion: Motion, spans: Sequence[Span], *, block: float
) -> Callable[[Axis], Residuals]:
    """Return what gives an axis's position errors [m] in these windows; blocks are of that duration [s]."""
    every = max(1, round(_COMPARED_EVERY / record.sample_time))
    rows = [np.arange(first + every, last + 1, every) for first, last in spans]
    blocks = (np.concatenate(rows) * record.sample_time // block).astype(np.int64)
    measured = np.concatenate([record.position[row] for row in rows])
    speeds = [float(motion.speed[first]) if first else speed_at_start(record) for first, _ in spans]

    def residuals(axis: Axis) -> Residuals:
        predicted = [
            axis.open_loop(
                record.force[first:last],
                position=float(record.position[first]),
                speed=speed,
                sample_time=record.sample_time,
            )[every - 1 :: every]
            for (first, last), speed in zip(spans, speeds, strict=True)
        ]
        return Residuals(values=np.concatenate(predicted) - measured, block=blocks)

    return residuals


def closed_loop_residuals(record: AxisRecord, *, start: int, block: float) -> Callable[[Axis], Residuals]:
    """Return what gives an axis's force errors [N] in closed loop, from row `start` on."""
    blocks = (np.arange(start, len(record)) * record.sample_time // block).astype(np.int64)
    speed = speed_at_start(record)

    def residuals(axis: Axis) -> Residuals:
        forces = axis.closed_loop(record, speed=speed).forces
        return Residuals(values=forces[start:] - record.force[start:], block=blocks - blocks[0])

    return residuals


def fit_output_error(
    law: AxisLaw, start: Values, residuals_of: Callable[[Axis], Residuals], *, scale: float
) -> OutputErrorFit:
    """Descend from `start`; `scale` is a usual size of the residuals."""
    space = space_about(law, start)
    lower, upper = space.bounds()

    def axis_at(z: NDArray[np.float64]) -> Axis:
        return Axis(law=law, values=values_of(law, space.physical(z)))

    def errors(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return residuals_of(axis_at(z)).values / scale

    def slopes(z: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = []
        for i in range(len(z)):
            step = _DIFFERENCE * np.eye(len(z))[i]
            ahead, behind = np.minimum(z + step, upper), np.maximum(z - step, lower)
            columns.append((errors(ahead) - errors(behind)) / (ahead - behind)[i])
        return np.column_stack(columns)

    begin = np.maximum(space.scaled(np.array([start[name] for name in law.names])), lower + _INSIDE)
    found = minimize_squares(
        errors,
        begin,
        jacobian_of=slopes,
        bounds=(lower, upper),
        scale="jac",
        stopping=Stopping(most_evaluations=_MOST_STEPS, least_gain=_ENOUGH, least_step=1e-5),
    )
    last = residuals_of(axis_at(found.point))
    return OutputErrorFit(
        law=law,
        values=values_of(law, space.physical(found.point)),
        standard_errors=values_of(law, _standard_errors(space, found.point, found.jacobian, last, scale)),
        rms=float(np.sqrt(np.mean(last.values**2))),
    )


def memoized(
    run: Run, stage: str, law: AxisLaw, start: Values, fit: Callable[[], OutputErrorFit]
) -> OutputErrorFit:
    """Return a law's fit from `start`, from a checkpoint if that has it."""

    def answer() -> list[NDArray[np.float64]]:
        found = fit()
        tables = (found.values, found.standard_errors)
        return [*(np.array([table[name] for name in law.names]) for table in tables), np.array(found.rms)]

    asked = np.array([start[name] for name in law.names])
    values, errors, rms = run.memoize(f"{stage}, {law.name}", asked, answer)
    return OutputErrorFit(
        law=law,
        values=dict(zip(law.names, values.tolist(), strict=True)),
        standard_errors=dict(zip(law.names, errors.tolist(), strict=True)),
        rms=float(rms),
    )


def search_output_error(
    law: AxisLaw, start: Values, residuals_of: Callable[[Axis], Residuals], *, scale: float
) -> OutputErrorFit:
    """Descend from the best of an evolution strategy around where a descent from `start` ends.

    Over long windows single events of sticking make many small valleys, of which a descent finds the nearest.
    """
    near = fit_output_error(law, start, residuals_of, scale=scale)
    space = space_about(law, near.values)
    middle, (lower, upper) = (
        space.scaled(np.array([near.values[name] for name in law.names])),
        space.bounds(),
    )
    logarithmic = space.logarithmic & np.array([name != "mass" for name in law.names])
    reach = np.where(logarithmic, _REACH_LOGARITHMIC, _REACH)

    def z_of(drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.clip(middle + (2.0 * drawn - 1.0) * reach, lower, upper)

    def costs(population: NDArray[np.float64]) -> NDArray[np.float64]:
        axes = [Axis(law=law, values=values_of(law, space.physical(z_of(one)))) for one in population]
        return np.array([0.5 * np.log(np.mean(residuals_of(axis).values ** 2)) for axis in axes])

    evolved = evolve(
        costs,
        size=len(law.names),
        generations=_GENERATIONS,
        population=_POPULATION,
        run=DEFAULT_RUN,
    )
    start_again = values_of(law, space.physical(z_of(evolved.best)))
    found = fit_output_error(law, start_again, residuals_of, scale=scale)
    return min(near, found, key=lambda fit: fit.rms)


def _standard_errors(
    space: RelativeSpace, z: NDArray[np.float64], J: NDArray[np.float64], last: Residuals, scale: float
) -> NDArray[np.float64]:
    lower, upper = space.bounds()
    kept = (z - lower > _AT_BOUND) & (upper - z > _AT_BOUND) & (np.linalg.norm(J, axis=0) > 0.0)
    errors = np.full(len(z), np.nan)
    neighbours = (int(last.block.max()) + 1) // _NEIGHBOURS
    covariance = covariance_in_time(J[:, kept], last.values / scale, last.block, neighbours=neighbours)
    errors[kept] = np.sqrt(covariance.diagonal())
    return errors * space.slopes(z)


FOLDS = 3
LEAST_WINDOWS = 8


def cross_validate_laws(
    record: AxisRecord,
    motion: Motion,
    starts: Mapping[str, Values],
    *,
    window: float,
    run: Run = DEFAULT_RUN,
) -> ModelSelection[AxisLaw]:
    """Fit every law to folds of windows, and select one by its errors on those held out.

    Parameters
    ----------
    record : AxisRecord
    motion : Motion
        The record's, filtered: windows start from it.
    starts : mapping of str to mapping
        By the law's name, where its search starts.
    window : float
        Duration of the windows [s].
    run : Run, optional
        Its checkpoint answers for each law; each is reported.

    Raises
    ------
    InputError
        If the record has too few such windows.
    """
    spans = equal_spans(record, window)
    if len(spans) < LEAST_WINDOWS:
        raise InputError(
            f"{record.name} has {len(spans)} windows of {window:g} s; model "
            f"selection needs {LEAST_WINDOWS}. Choose a shorter --window."
        )
    counted = iter(range(len(AXIS_LAWS)))

    def held_out(name: str, inner: AxisLaw | None) -> HeldOut[AxisLaw]:  # noqa: ARG001 (every fit starts anew)
        law = AXIS_LAWS[name]
        run.progress(Progress(stage=f"law {name}", done=next(counted), total=len(AXIS_LAWS)))
        asked = np.array([starts[name][one] for one in law.names])
        squares = run.memoize(
            f"ladder, {name}", asked, lambda: [_held_out(record, motion, law, starts[name], spans)]
        )[0]
        groups = neighbours(range(len(spans)), block=block_length(len(spans)))
        return HeldOut(model=law, squares=squares[:, None], baseline=None, groups=groups)

    # An asymmetry is not selected from one record: windows of the same record share whatever made it, such as a
    # temperature, and do not show that it is the machine's own.
    symmetric = [name for name, law in AXIS_LAWS.items() if law.symmetric]
    within = {name: law.below for name, law in AXIS_LAWS.items()}
    return select_model(within, held_out, eligible=symmetric)


def _held_out(
    record: AxisRecord, motion: Motion, law: AxisLaw, start: Values, spans: Sequence[Span]
) -> NDArray[np.float64]:
    """Return each window's mean square error (w,) [m^2] by the fit that did not see it."""
    squares = np.empty(len(spans))
    scale = float(np.ptp(record.position)) * 1e-3
    for fold in range(FOLDS):
        seen = [span for i, span in enumerate(spans) if i % FOLDS != fold]
        fit = fit_output_error(
            law, start, open_loop_residuals(record, motion, seen, block=np.inf), scale=scale
        )
        for i in range(fold, len(spans), FOLDS):
            errors = open_loop_residuals(record, motion, [spans[i]], block=np.inf)(fit.axis).values
            squares[i] = np.mean(errors**2)
    return squares
