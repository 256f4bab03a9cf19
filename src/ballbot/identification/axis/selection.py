"""Selection of the horizon of an axis's fit and of its friction law; of other forces see `terms`.

Everything is selected by errors on blocks of time that the fit did not use: every third block is held out, three times.

1. Whether the force is held from row to row or changes evenly between them: whichever explains the positions better.
2. The horizon: over windows of each length the law `coulomb` is fitted in open loop, and predicts held-out blocks over
   all those lengths. The one with the least geometric mean of errors is taken.
3. Laws: each is fitted to windows of that length and predicts held-out blocks. Laws of bristles differ from the others
   only where the axis reverses or rests, and are judged on the windows in which it does; see also `presliding`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.model_selection import (
    Candidate,
    HeldOut,
    ModelSelection,
    gain_between,
    select_model,
)
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification.axis.laws import AXIS_LAWS, AxisLaw, Values
from ballbot.identification.axis.output_error import (
    OpenLoop,
    OutputErrorFit,
    Sighting,
    Windows,
    equal_spans,
    fit_output_error,
    windows_of,
)
from ballbot.identification.axis.presliding import bristles_agree
from ballbot.identification.axis.record import AxisRecord, Span
from ballbot.identification.axis.repetition import LEAST_PARTS, parts_at, parts_in
from ballbot.identification.axis.structure import AxisModel, base_name
from ballbot.progress import Progress

FOLDS = 3
LEAST_BLOCKS, MOST_BLOCKS = 9, 30
#: blocks are not shorter [s], nor than so many rows
SHORTEST_BLOCK, LEAST_BLOCK_ROWS = 0.4, 24
#: share by which a sum of durations may be off
_ROUNDING = 1e-9
#: lengths of windows tried [s]; a window has at least so many rows
HORIZONS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
LEAST_WINDOW_ROWS = 10
#: an error that is not above so many times the noise of the position is that noise
ABOVE_NOISE = 1.2
#: errors that differ by less than this share are the same
SAME = 1e-3
#: slower than this share of its usual speed, an axis reverses or rests
_SLOW = 0.1


@dataclass(frozen=True, kw_only=True)
class Blocks:
    """Blocks of time, each of one record."""

    spans: tuple[tuple[int, Span], ...]  #: the record and the rows of each
    duration: float  #: of each [s], about
    #: the part of the motion that each contains: blocks of one part repeat each other
    parts: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.spans)

    def held_out(self, fold: int) -> list[int]:
        """Return the blocks that a fold leaves out."""
        return [i for i, part in enumerate(self.parts) if part % FOLDS == fold]

    def seen(self, fold: int) -> list[int]:
        """Return the blocks that a fold is fitted to."""
        return [i for i, part in enumerate(self.parts) if part % FOLDS != fold]

    def groups(self, chosen: Sequence[int] | None = None) -> list[NDArray[np.int64]]:
        """Return the places, among some blocks or all, of those that repeat each other."""
        parts = np.array(self.parts)[list(range(len(self)) if chosen is None else chosen)]
        return [np.flatnonzero(parts == one) for one in np.unique(parts)]


def blocks_of(records: Sequence[AxisRecord], *, longest: bool = False) -> Blocks:
    """Return the blocks of records, of which there are many, or few and long ones.

    Raises
    ------
    InputError
        If there are too few rows.
    """
    total = sum(record.duration for record in records)
    usual = max(record.sample_time for record in records)
    shortest = max(SHORTEST_BLOCK, LEAST_BLOCK_ROWS * usual)
    duration = max(total / MOST_BLOCKS, shortest)
    if longest:
        duration = max(duration, min(total / LEAST_BLOCKS, HORIZONS[-1]))
    repeated = min((one.repetition for one in records if parts_in(one.repetition, shortest)), default=np.inf)
    # a whole number of blocks is one motion; long ones may each be more than one
    if np.isfinite(repeated) and (parts_in(repeated, duration) or not longest):
        duration = repeated / (parts_in(repeated, duration) or LEAST_PARTS)
    if duration * LEAST_BLOCKS > total * (1.0 + _ROUNDING):
        raise InputError(
            f"{records[0].name} lasts {total:.3g} s; to estimate friction and to judge it on parts that were held out, "
            f"the records must last {duration * LEAST_BLOCKS:.3g} s together."
        )
    spans = [
        (number, span)
        for number, record in enumerate(records)
        for span in equal_spans(record, duration)
        if span[1] - span[0] >= LEAST_BLOCK_ROWS // 2
    ]
    if len(spans) < LEAST_BLOCKS:
        raise InputError(
            f"{records[0].name} has {len(spans)} parts of {duration:.2g} s without a gap; "
            f"to estimate friction and to judge it on parts that were held out takes {LEAST_BLOCKS}."
        )
    return Blocks(spans=tuple(spans), duration=duration, parts=_parts_of(records, spans, duration))


def _parts_of(
    records: Sequence[AxisRecord], spans: Sequence[tuple[int, Span]], duration: float
) -> tuple[int, ...]:
    """Return the part of the motion that each span contains; no two records have one in common."""
    found = list[int]()
    for number, record in enumerate(records):
        begin = max(found, default=-1) + 1
        rows = np.array([span for of, span in spans if of == number]).reshape(-1, 2)
        count = parts_in(record.repetition, duration)
        middles = record.t[rows].mean(axis=1)
        parts = parts_at(middles, record.repetition, count) if count else np.arange(len(rows))
        found += (begin + parts).tolist()
    return tuple(found)


def show_noise_alone(model: AxisModel, start: Values, sightings: Sequence[Sighting], blocks: Blocks) -> bool:
    """Return whether the errors of the longest windows are the noise of the positions alone.

    Held-out errors do not distinguish lengths of windows then, and longer ones determine parameters far better.
    """
    longest = horizons_for(blocks, [one.record for one in sightings])[-1]
    return fit_all(model, start, sightings, blocks, longest).rms < ABOVE_NOISE * min(
        one.noise for one in sightings
    )


def horizons_for(blocks: Blocks, records: Sequence[AxisRecord]) -> tuple[float, ...]:
    """Return the lengths of windows that fit into blocks [s]."""
    least = LEAST_WINDOW_ROWS * max(record.sample_time for record in records)
    found = [one for one in HORIZONS if least <= one <= 1.01 * blocks.duration]
    return tuple(found) or (blocks.duration,)


def windows_in(
    sightings: Sequence[Sighting], blocks: Blocks, chosen: Sequence[int], horizon: float
) -> tuple[list[Windows], NDArray[np.int64]]:
    """Return the windows of a length in some of the blocks, and the block of each window."""
    spans: dict[int, list[Span]] = {}
    owners: dict[int, list[int]] = {}
    for i in chosen:
        number, rows = blocks.spans[i]
        cut = equal_spans(sightings[number].record, horizon, within=rows)
        spans.setdefault(number, []).extend(cut)
        owners.setdefault(number, []).extend([i] * len(cut))
    windows = [windows_of(sightings[number], cut, number) for number, cut in spans.items()]
    return windows, np.array(list(chain.from_iterable(owners.values())), dtype=np.int64)


def errors_on(
    fit: OutputErrorFit,
    sightings: Sequence[Sighting],
    blocks: Blocks,
    chosen: Sequence[int],
    horizon: float,
    *,
    slow: bool = False,
) -> NDArray[np.float64]:
    """Return the mean square position error [m^2] of each of the blocks over windows of a length (blocks,).

    If `slow`, only of windows in which the axis reverses or rests; NaN for a block without one.
    """
    windows, owner = windows_in(sightings, blocks, chosen, horizon)
    problem = OpenLoop(model=fit.model, sightings=sightings, windows=windows)
    squares = problem.from_best_starts(fit.values) ** 2
    counted = np.ones(len(squares))
    if slow:
        counted = np.concatenate(
            [windows_with(slow_rows(sightings[one.record]), one)[one.window] for one in windows]
        ).astype(float)
    of_row = owner[problem.window]
    sums = np.bincount(of_row, weights=squares * counted, minlength=len(blocks))
    counts = np.bincount(of_row, weights=counted, minlength=len(blocks))
    with np.errstate(invalid="ignore"):
        return (sums / counts)[list(chosen)]


def slow_rows(seen: Sighting) -> NDArray[np.bool_]:
    """Return in which rows (N,) the axis reverses or rests."""
    return np.abs(seen.motion.speed) < _SLOW * seen.usual_speed


def windows_with(rows: NDArray[np.bool_], windows: Windows) -> NDArray[np.bool_]:
    """Return which windows (w,) contain one of some rows (N,)."""
    ends = np.append(0, np.cumsum(rows))
    return ends[windows.firsts + windows.counts] > ends[windows.firsts]


def held_out_errors(
    fit: OutputErrorFit,
    sightings: Sequence[Sighting],
    blocks: Blocks,
    *,
    horizon: float,
    judged: Sequence[tuple[float, bool]],
) -> NDArray[np.float64]:
    """Fit a model again without each third of the blocks, from `fit`; return its errors on that third.

    Parameters
    ----------
    fit : OutputErrorFit
        To all blocks.
    sightings, blocks
    horizon : float
        Length of the windows that are fitted [s].
    judged : sequence of (float, bool)
        Lengths of the windows that are predicted [s], and whether only those are in which the axis reverses or rests.

    Returns
    -------
    ndarray (blocks, judged)
        Mean square errors of positions [m^2]; NaN for a block without such windows.
    """
    squares = np.empty((len(blocks), len(judged)))
    for fold in range(FOLDS):
        windows, _ = windows_in(sightings, blocks, blocks.seen(fold), horizon)
        problem = OpenLoop(model=fit.model, sightings=sightings, windows=windows)
        again = fit_output_error(fit.model, fit.values, problem)
        left_out = blocks.held_out(fold)
        for place, (length, slow) in enumerate(judged):
            squares[left_out, place] = errors_on(again, sightings, blocks, left_out, length, slow=slow)
    return squares


def at_constant_speed(records: int) -> OutputErrorFit:
    """Return the fit of an axis that goes on at the speed of a window's start, whatever the force."""
    model = AxisModel(law=AXIS_LAWS["viscous"], records=records)
    values = {"mass": 1e12, "viscous": 0.0, "offset": 0.0}
    return OutputErrorFit(
        model=model, values=values, standard_errors=dict.fromkeys(values, np.nan), rms=np.nan
    )


def problem_of(model: AxisModel, sightings: Sequence[Sighting], blocks: Blocks, horizon: float) -> OpenLoop:
    """Return the open-loop problem over windows of a length in all blocks."""
    windows, _ = windows_in(sightings, blocks, range(len(blocks)), horizon)
    return OpenLoop(model=model, sightings=sightings, windows=windows)


def fit_all(
    model: AxisModel,
    start: Values,
    sightings: Sequence[Sighting],
    blocks: Blocks,
    horizon: float,
    *,
    restarts: int = 0,
) -> OutputErrorFit:
    """Fit a model to windows of a length in all blocks, and again from starts of the windows that lower the error."""
    problem = problem_of(model, sightings, blocks, horizon)
    fit = fit_output_error(model, start, problem)
    for _ in range(restarts):
        problem = problem.from_better_starts(fit.values)
        again = fit_output_error(model, fit.values, problem)
        if not again.rms < fit.rms:
            break
        fit = again
    return fit


@dataclass(frozen=True, kw_only=True, eq=False)
class HorizonChoice:
    """The lengths of windows tried, and the errors of their fits on held-out blocks."""

    horizons: tuple[float, ...]  #: [s]
    errors: NDArray[np.float64]  #: (fitted, predicted), root mean square [m]
    chosen: float  #: [s]


def select_windows(
    model: AxisModel,
    start: Values,
    sightings: Sequence[Sighting],
    blocks: Blocks,
    run: Run = DEFAULT_RUN,
) -> tuple[Blocks, HorizonChoice]:
    """Return blocks, fewer and longer ones if short windows show noise alone, and the length of windows in them."""
    if show_noise_alone(model, start, sightings, blocks):
        with suppress(InputError):  # if gaps leave too few long ones
            blocks = blocks_of([one.record for one in sightings], longest=True)
    return blocks, select_horizon(model, start, sightings, blocks, run)


def select_horizon(
    model: AxisModel,
    start: Values,
    sightings: Sequence[Sighting],
    blocks: Blocks,
    run: Run = DEFAULT_RUN,
) -> HorizonChoice:
    """Return the length of windows whose fit predicts held-out blocks best, over windows of all lengths.

    Of lengths that predict the same, it is the shortest.
    """
    horizons = horizons_for(blocks, [one.record for one in sightings])
    if len(horizons) == 1:
        return HorizonChoice(horizons=horizons, errors=np.full((1, 1), np.nan), chosen=horizons[0])
    rows = []
    for number, horizon in enumerate(horizons):
        run.progress(Progress(stage=f"horizon {horizon:g} s", done=number, total=len(horizons)))
        fit = fit_all(model, start, sightings, blocks, horizon)
        judged = [(one, False) for one in horizons]
        squares = held_out_errors(fit, sightings, blocks, horizon=horizon, judged=judged)
        rows.append(np.sqrt(squares.mean(axis=0)))
    errors = np.array(rows)
    return HorizonChoice(horizons=horizons, errors=errors, chosen=horizons[least_errors(errors)])


def least_errors(errors: NDArray[np.float64]) -> int:
    """Return the row of errors (fitted, predicted) with the least geometric mean; the first of those that are the same.

    Rounding differs from processor to processor, and would choose among these.
    """
    means = np.exp(np.log(np.maximum(errors, np.finfo(float).tiny)).mean(axis=1))
    return int(np.argmax(means <= (1.0 + SAME) * means.min()))


#: laws that are judged on all windows, each with the law within it, and those of bristles
_SLIDING = {"viscous": None, "coulomb": "viscous", "stribeck": "coulomb", "asymmetric": "coulomb"}
_BRISTLES = {"coulomb": None, "dahl": "coulomb", "lugre": "dahl"}
#: a law that lowers the error by less than this share is not worth its parameters
USEFUL_GAIN = 0.02
#: and one that surely lowers it by this share is needed, even if parameters of its own are not determined; chosen
_CLEAR_GAIN = 0.2
#: a break-away force fades if it is below 1 / e^2 at the speed below which the axis is in this share of the rows
_FADED, _FAST = 0.5, 0.95
#: standard errors that a Coulomb friction is above zero where chance makes it so in less than one of 1,000 cases
_CLEARLY_DRY = 3.3


def select_law(
    fits: Mapping[str, OutputErrorFit],
    sightings: Sequence[Sighting],
    blocks: Blocks,
    *,
    horizon: float,
    run: Run = DEFAULT_RUN,
) -> tuple[ModelSelection[AxisLaw], dict[str, NDArray[np.float64]]]:
    """Select a law among those fitted to windows of a length, by its errors on held-out blocks.

    Returns
    -------
    selection : ModelSelection
        Laws of bristles are judged on windows in which the axis reverses or rests. A block that a law predicts worse
        than an axis that goes on as it is counts as one of those: where a law expects an axis to stick that slips, or
        the other way, a single block would be most of a sum of squares.
    squares : dict
        By law, mean square errors of all held-out windows (blocks,) [m^2].
    """
    tables = {}
    for number, (name, fit) in enumerate(fits.items()):
        run.progress(Progress(stage=f"law {name}", done=number, total=len(fits)))
        judged = [(horizon, False), (horizon, True)]
        tables[name] = held_out_errors(fit, sightings, blocks, horizon=horizon, judged=judged)
    squares = {name: table[:, 0] for name, table in tables.items()}
    going_on = at_constant_speed(len(sightings))
    useless = [
        errors_on(going_on, sightings, blocks, range(len(blocks)), horizon, slow=s) for s in (False, True)
    ]
    tables = {name: np.fmin(table, np.column_stack(useless)) for name, table in tables.items()}
    sliding = _select(_SLIDING, {name: table[:, 0] for name, table in tables.items()}, blocks)
    candidates: tuple[Candidate[AxisLaw], ...] = sliding.candidates
    best = _useful(sliding, fits, sightings)
    slow = {name: table[:, 1] for name, table in tables.items()}
    if np.isfinite(slow["coulomb"]).sum() >= LEAST_BLOCKS:
        bristles = _select(_BRISTLES, slow, blocks)
        candidates += tuple(one for one in bristles.candidates if one.within)
        softer = _useful(bristles, fits, sightings)
        while softer.within and not bristles_agree(fits[softer.name], sightings):
            softer = bristles.find(softer.within)
        everywhere = gain_between(tables[softer.name][:, :1], tables[best.name][:, :1], blocks.groups())
        # laws that slide imitate bristles that the inverse model shows
        eligible = best.name == "coulomb" or fits[best.name].model.bending > 0.0
        if eligible and softer.within and everywhere.upper > 0.0:
            best = softer
    order = list(AXIS_LAWS)
    selection = ModelSelection(
        candidates=tuple(sorted(candidates, key=lambda one: order.index(one.name))), best=best
    )
    return selection, squares


def _select(
    within: Mapping[str, str | None], squares: Mapping[str, NDArray[np.float64]], blocks: Blocks
) -> ModelSelection[AxisLaw]:
    """Return the selection among laws with such errors of blocks (blocks,), NaN for a block without errors."""
    known = np.isfinite(squares["coulomb"])
    groups = blocks.groups(np.flatnonzero(known).tolist())

    def held_out(name: str, inner: AxisLaw | None) -> HeldOut[AxisLaw]:  # noqa: ARG001 (fits are made)
        return HeldOut(
            model=AXIS_LAWS[name], squares=squares[name][known][:, None], baseline=None, groups=groups
        )

    # An asymmetry is not selected from one record: blocks of the same record share whatever made it, such as a
    # temperature, and do not show that it is the machine's own.
    return select_model(within, held_out, eligible=[name for name in within if AXIS_LAWS[name].symmetric])


def _useful(
    selection: ModelSelection[AxisLaw], fits: Mapping[str, OutputErrorFit], sightings: Sequence[Sighting]
) -> Candidate[AxisLaw]:
    """Return the best law, or one within it while it gains too little.

    One whose own parameters are not determined has to gain more, and so has a break-away force that does not fade
    within the speeds of the records: it represents another curve, and the Coulomb friction beside it is that of no
    recorded speed.
    """
    best = selection.best
    while best.within and best.gain:
        fit, inner = fits[best.name], AXIS_LAWS[best.within].names
        own = [label for label in fit.values if base_name(label) in best.model.names]
        own = [label for label in own if base_name(label) not in inner]
        determined = all(fit.standard_errors[label] < abs(fit.values[label]) for label in own)
        determined = determined and fades(fit, sightings)
        if (determined or best.gain.lower >= _CLEAR_GAIN) and best.gain.share >= USEFUL_GAIN:
            break
        best = selection.find(best.within)
    if best.name == "viscous" and has_dry_friction(fits["coulomb"]):
        return selection.find("coulomb")
    return best


def possible_laws(
    selection: ModelSelection[AxisLaw],
    chosen: AxisLaw,
    fits: Mapping[str, OutputErrorFit],
    sightings: Sequence[Sighting],
) -> dict[str, str]:
    """Return the laws beside the chosen one that may be the axis's own, each with what it would add to that."""
    found = {}
    stribeck = selection.find("stribeck").gain
    if (
        chosen.name == "coulomb"
        and stribeck
        and stribeck.upper >= USEFUL_GAIN
        and fades(fits["stribeck"], sightings)
    ):
        found["stribeck"] = "with a break-away force"
    if chosen.symmetric and selection.find("asymmetric").accepted:
        found["asymmetric"] = "with friction that differs between directions"
    return found


def fades(fit: OutputErrorFit, sightings: Sequence[Sighting]) -> bool:
    """Return whether a fit has no break-away force, or one of which little is left at the fastest speeds."""
    slowest = [value for label, value in fit.values.items() if base_name(label) == "stribeck_speed"]
    fastest = max(float(np.quantile(np.abs(one.motion.speed), _FAST)) for one in sightings)
    return all(value <= _FADED * fastest for value in slowest)


def has_dry_friction(fit: OutputErrorFit) -> bool:
    """Return whether the Coulomb friction of a fit is clearly above zero.

    Noise of the position may be most of the error, and hide a friction that is known to a few percent.
    """
    dry = [label for label in fit.values if base_name(label) == "coulomb"]
    return all(fit.values[label] > _CLEARLY_DRY * fit.standard_errors[label] for label in dry)
