"""Play between the drive and the axis, found by what the rows near reversals of the force do to a fit.

While the force between drive and axis keeps its sign, both move as one mass. When it changes sign, the drive crosses
the play, the axis coasts or rests meanwhile, and the impact changes its speed at once. No friction law describes that:
a fit with these rows has too little dry friction and too much of viscous one, finds a break-away force that is not
there, or takes the lag after each reversal for a delay of the force.

The axis is fitted with all rows, and without those near a reversal or at rest (`away_from_reversals`). There is play if
every law predicts windows of all rows with several times the error of the windows between reversals (`play_of`). Then
these rows are left out of everything. An elastic drive, and friction near rest that no law describes, do the same, and
matter as little between reversals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, note, warning
from ballbot.identification.axis.inverse import at_rest
from ballbot.identification.axis.law_fits import fit_law
from ballbot.identification.axis.laws import AXIS_LAWS, PARAMETERS, Values, unit_for
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.motion import LEAST_SEGMENT, Motion
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import (
    Blocks,
    blocks_of,
    fit_all,
    horizons_for,
    problem_of,
    windows_in,
)
from ballbot.identification.axis.structure import AxisModel, base_name

#: a reversal lasts from where force or speed falls below this share of its usual size to where it exceeds it again
_SMALL_FORCE, _SMALL_SPEED = 0.1, 0.05
#: and what follows is left out for one of these times [s], and for so many rows at least
_AFTER, _LEAST_ROWS_AFTER = (0.04, 0.1), 6
#: windows of both fits last so long, or the next shorter length that suits the records [s]
_DURATION = 0.2
#: the error of windows with reversals is above so many times that of windows without, if parameters of the best law
#: differ and the model is complete between reversals, where its error is below so many times the noise, or above
#: `_SURELY` times. Of simulated machines with play whose friction a fit of all rows misses by 6 % or more, the least is
#: 5.3; of 31 without play 3.4, but for one of which an eighth of the rows was left
_CLEARLY, _COMPLETE, _SURELY = 2.5, 3.0, 4.5
#: with a smaller share of rows left, which are the calm ones of any record, both are so many times as large
_FEW_ROWS, _FACTOR_FOR_FEW = 0.25, 2.0
#: by the parameters that hold between reversals, the error of windows of all rows but this share, those of the largest
#: errors, still is above so many times that between reversals: play is crossed again and again, and a blow is in few
_WORST, _STILL = 0.1, 1.5
#: parameters differ beyond so many of their errors, and by this share
_APART, _SHARE_APART = 2.0, 0.02
#: reversals are looked for again, so often at most, while the error between them falls to less than this share
_ROUNDS, _WORTH_A_ROUND = 3, 0.8
_LAWS = ("stribeck", "dahl", "lugre", "asymmetric")


@dataclass(frozen=True, kw_only=True)
class Contact:
    """The rows of records between reversals of the force, in which the drive does not cross any play."""

    rows: Sequence[NDArray[np.bool_]]  #: (N,) of each record
    moving: float  #: share of all rows in which the axis moves
    sightings: Sequence[Sighting]  #: of these rows
    blocks: Blocks
    everywhere: OutputErrorFit  #: of the law coulomb to all rows, over windows of `length`
    between: OutputErrorFit  #: and to these rows
    starts: Mapping[str, Values]  #: by law, where fits of this model begin
    after: float  #: how long a reversal counts after its end [s]
    length: float  #: of windows whose errors are comparable with those between reversals [s]

    @property
    def share(self) -> float:
        """The share of the rows in motion that are left."""
        return float(np.mean(np.concatenate(self.rows))) / self.moving


@dataclass(frozen=True, kw_only=True)
class Play:
    """What the rows near reversals do to a fit."""

    contact: Contact
    error: float  #: of windows of all rows by the law that predicts them best, root mean square [m]
    error_between: float  #: of windows between reversals
    values: Mapping[str, tuple[float, float]]  #: parameters that differ, by name, with all rows and without


def away_from_reversals(seen: Sighting, axis: Axis, *, after: float) -> NDArray[np.bool_]:
    """Return which rows (N,) are in motion and not near a reversal of the speed, or of the force that it needs.

    Any friction that is large enough predicts an axis at rest: an error between reversals that includes rest shows
    nothing.

    Parameters
    ----------
    seen : Sighting
    axis : Axis
        Gives that force.
    after : float
        How long a reversal counts after its end [s].
    """
    record, motion = seen.record, seen.motion
    force = axis.needed_force(record, motion.position, motion.speed, motion.acceleration)
    force = force - (record.force - axis.acting(record))
    kept = ~at_rest(motion.speed)
    rows = max(_LEAST_ROWS_AFTER, round(after / record.sample_time))
    for values, share in ((force, _SMALL_FORCE), (motion.speed, _SMALL_SPEED)):
        least = share * float(np.sqrt(np.mean(values**2)))
        large = np.flatnonzero(np.abs(values) > least)
        changes = np.flatnonzero(np.diff(np.sign(values[large])) != 0.0)
        for place in changes:
            kept[large[place] : large[place + 1] + rows] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]])))
    for first, last in pairwise(edges.tolist()):
        if last - first < LEAST_SEGMENT:
            kept[first:last] = False
    return kept


def with_rows(record: AxisRecord, kept: NDArray[np.bool_]) -> AxisRecord:
    """Return a record with gaps where rows (N,) are not kept, without its loop, which needs all rows."""
    names = ("force", "position", "added", "temperature", "load")
    columns = {name: getattr(record, name) for name in names if getattr(record, name) is not None}
    picked = {name: column[kept] for name, column in columns.items()}
    return replace(record, times=record.t[kept], reference=None, loop=None, **picked)


def contact_of(
    sightings: Sequence[Sighting],
    candidates: Sequence[tuple[AxisModel, Mapping[str, Values]]],
    blocks: Blocks,
) -> Contact | None:
    """Return the rows of records away from reversals, by the law coulomb; of models and of times left out, the best.

    None if they are too few to fit, or if nothing drives an axis, as a pendulum that swings freely.
    """
    if any(np.ptp(one.record.force) == 0.0 for one in sightings):
        return None
    horizon = _horizon(blocks, sightings)

    def everywhere(model: AxisModel, start: Values) -> OutputErrorFit:
        return fit_all(model.with_law(AXIS_LAWS["coulomb"]), start, sightings, blocks, horizon)

    fits = [everywhere(model, starts["coulomb"]) for model, starts in candidates]
    place = min(range(len(fits)), key=lambda one: fits[one].rms)
    whole, starts = fits[place], candidates[place][1]
    best = _between(sightings, whole, whole, horizon, starts)
    for _ in range(_ROUNDS):
        if best is None or best.between.rms > _WORTH_A_ROUND * whole.rms:
            break
        # impacts make the first fit wrong, and with it where the force reverses
        whole = min(whole, everywhere(whole.model, best.between.values), key=lambda one: one.rms)
        again = _between(sightings, whole, best.between, horizon, starts)
        if again is None or again.between.rms > _WORTH_A_ROUND * best.between.rms:
            best = replace(best, everywhere=whole)
            break
        best = again
    return best and _over_comparable_windows(best, sightings, blocks)


def _over_comparable_windows(contact: Contact, sightings: Sequence[Sighting], blocks: Blocks) -> Contact:
    """Return what was found, with the fit to all rows over windows as short as those between reversals are.

    By noise of the force a position error grows with the power 1.5 of time: where reversals follow each other quickly,
    windows that contain them would be worse for being longer.
    """
    again = fit_all(contact.everywhere.model, contact.everywhere.values, sightings, blocks, contact.length)
    return replace(contact, everywhere=again)


def _comparable_length(sightings: Sequence[Sighting], blocks: Blocks, horizon: float) -> float:
    """Return the length [s] of equal windows whose error by noise of the force is that of windows in these blocks."""
    windows, _ = windows_in(sightings, blocks, range(len(blocks)), horizon)
    found = [
        np.diff(sightings[one.record].record.t[[one.firsts, one.firsts + one.counts]], axis=0)[0][one.window]
        for one in windows
    ]
    return float(np.mean(np.concatenate(found) ** 3) ** (1.0 / 3.0))


def _between(
    sightings: Sequence[Sighting],
    whole: OutputErrorFit,
    fit: OutputErrorFit,
    horizon: float,
    starts: Mapping[str, Values],
) -> Contact | None:
    """Return the rows away from reversals by a fit, with the fit to them; None if they are too few."""
    found = list[Contact]()
    resting = np.concatenate([at_rest(seen.motion.speed) for seen in sightings])
    for after in _AFTER:
        rows = [
            away_from_reversals(seen, fit.model.axis(fit.values, number), after=after)
            for number, seen in enumerate(sightings)
        ]
        try:
            parts = [_sighting_of(seen, kept) for seen, kept in zip(sightings, rows, strict=True)]
            blocks = blocks_of([one.record for one in parts])
        except InputError:
            continue
        for interpolated in {False, whole.model.interpolated}:
            held = replace(whole.model, interpolated=interpolated)
            between = fit_all(held, fit.values, parts, blocks, horizon)
            contact = Contact(
                rows=rows,
                moving=1.0 - float(np.mean(resting)),
                sightings=parts,
                blocks=blocks,
                everywhere=whole,
                between=between,
                starts=starts,
                after=after,
                length=_comparable_length(parts, blocks, horizon),
            )
            found.append(contact)
    return min(found, key=lambda one: one.between.rms, default=None)


def _horizon(blocks: Blocks, sightings: Sequence[Sighting]) -> float:
    shortest, *others = horizons_for(blocks, [one.record for one in sightings])
    return max(shortest, *(one for one in others if one <= _DURATION), 0.0)


def play_of(contact: Contact, sightings: Sequence[Sighting], blocks: Blocks) -> Play | None:
    """Return what the rows near reversals do to the fit of any law; None if that is not clear.

    Parameters
    ----------
    contact : Contact
    sightings : sequence of Sighting
        Of all rows.
    blocks : Blocks
        Of all rows.
    """
    plain, between, horizon = contact.everywhere, contact.between, contact.length
    if not _error_of_most(between, sightings, blocks, horizon) > _STILL * between.rms:
        return None
    values = _apart(plain, between)
    noise = max(one.noise for one in sightings)
    complete = bool(values) and between.rms < _COMPLETE * noise
    times = (_CLEARLY if complete else _SURELY) * (_FACTOR_FOR_FEW if contact.share < _FEW_ROWS else 1.0)
    fits = {"coulomb": plain}
    for name in _LAWS:
        if not plain.rms > times * between.rms:
            return None
        law = AXIS_LAWS[name]
        own = plain.model.with_law(law)
        fits[name] = fit_law(
            own, contact.starts[name], fits[law.below or "coulomb"], sightings, blocks, horizon
        )
        if not fits[name].rms > times * between.rms:
            return None
    best = min(fits.values(), key=lambda one: one.rms)
    values = _apart(best, between)
    if complete and not values and not best.rms > _SURELY * between.rms:
        return None
    return Play(contact=contact, error=best.rms, error_between=between.rms, values=values)


def _error_of_most(
    fit: OutputErrorFit, sightings: Sequence[Sighting], blocks: Blocks, horizon: float
) -> float:
    """Return the error [m] of a fit over windows of all rows without those of the largest errors."""
    problem = problem_of(fit.model, sightings, blocks, horizon)
    errors = problem.projection(fit.values)(problem.errors(fit.values))
    squares = np.sort(np.bincount(problem.window, errors**2) / np.bincount(problem.window))
    return float(np.sqrt(squares[: len(squares) - round(_WORST * len(squares))].mean()))


def _apart(plain: OutputErrorFit, between: OutputErrorFit) -> dict[str, tuple[float, float]]:
    """Return which of mass and friction differ between two fits, with both values."""
    found = {}
    first, second = of_both_directions(plain), of_both_directions(between)
    for label in (one for one in first if one in second):
        (ours, our_error), (theirs, their_error) = first[label], second[label]
        error = float(np.hypot(our_error, their_error))
        difference = abs(ours - theirs)
        if (
            base_name(label) in ("mass", "viscous", "coulomb")
            and difference > _APART * error
            and difference > _SHARE_APART * abs(theirs)
        ):
            found[label] = (ours, theirs)
    return found


def of_both_directions(fit: OutputErrorFit) -> dict[str, tuple[float, float]]:
    """Return parameters by label with their standard errors; in place of one for each direction, their mean."""
    found = {label: (value, fit.standard_errors[label]) for label, value in fit.values.items()}
    for plus in [one for one in found if base_name(one).endswith("_plus")]:
        forwards, backwards = found.pop(plus), found.pop(plus.replace("_plus", "_minus"))
        mean, error = 0.5 * (forwards[0] + backwards[0]), 0.5 * float(np.hypot(forwards[1], backwards[1]))
        found[plus.replace("_plus", "")] = (mean, error)
    return found


def play_findings(
    records: Sequence[AxisRecord],
    play: Play | None,
    *,
    tested: bool = True,
    with_reversals: Sequence[str] = (),
) -> list[Finding]:
    """Return the finding on play.

    Parameters
    ----------
    records : sequence of AxisRecord
    play : Play or None
    tested : bool
        Whether there are enough rows between reversals to show it.
    with_reversals : sequence of str
        Names of records that keep their rows near reversals.
    """
    if play is None and not tested and all(np.ptp(one.force) > 0.0 for one in records):
        text = (
            "The force reverses too often, or the axis rests too long, to show whether there is play (backlash) "
            "between drive and axis, which would make dry friction too small. Record longer motions in one direction "
            "if the drive may have play."
        )
        return [note("play", text)]
    if play is None:
        return []
    unit = records[0].unit
    numbers = ", ".join(
        f"{PARAMETERS[base_name(label)].symbol} {ours:.3g} and {theirs:.3g} "
        f"{unit_for(PARAMETERS[base_name(label)], unit)}"
        for label, (ours, theirs) in play.values.items()
    )
    changes = f"With and without the rows near them the fit gives {numbers}. " if numbers else ""
    left_out = 100.0 * (1.0 - play.contact.share)
    text = (
        "Where the force on the axis reverses, no friction law describes the motion: over windows the error of "
        f"the best of them is {1e3 * play.error:.3g} m{unit}, and {1e3 * play.error_between:.3g} m{unit} between "
        f"reversals. Play (backlash) between drive and axis does this, or an elastic drive. {changes}The rows near "
        f"reversals, {left_out:.0f} % of those in motion, and the rows at rest are left out of all results, which hold "
        "while drive and axis are in contact and do not predict reversals. Remove the play, or preload the axis, to "
        "identify friction near rest."
    )
    if with_reversals:
        keep = "keeps its" if len(with_reversals) == 1 else "keep their"
        text += (
            f" {' and '.join(with_reversals)} {keep} rows near reversals, as too few rows are left without them: "
            "errors there include reversals, and the error expected there does not."
        )
    return [warning("play", text)]


def _sighting_of(seen: Sighting, kept: NDArray[np.bool_]) -> Sighting:
    motion = Motion(
        *(column[kept] for column in (seen.motion.position, seen.motion.speed, seen.motion.acceleration))
    )
    return replace(seen, record=with_rows(seen.record, kept), motion=motion)
