"""What is settled about an axis before its laws are fitted: rows, forces, and when the recorded force acts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.findings import Finding
from ballbot.fitting.model_selection import Gain, gain_between
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification.axis.force_timing import (
    delay_findings,
    delayed,
    force_delay,
    is_interpolated,
    linear_delay,
    part_of_a_row,
    remaining_delay,
)
from ballbot.identification.axis.inverse import asymmetry_over_time, without_drift
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.laws import AXIS_LAWS, PARAMETERS, AxisLaw, axis_law_named
from ballbot.identification.axis.load import NO_LOAD_FRICTION, load_named, possible_loads
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting, sighting
from ballbot.identification.axis.play import (
    Contact,
    Play,
    away_from_reversals,
    contact_of,
    play_findings,
    play_of,
    with_rows,
)
from ballbot.identification.axis.prediction import axis_errors
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.residuals import ResidualTest, residual_tests
from ballbot.identification.axis.result import Estimate
from ballbot.identification.axis.selection import (
    USEFUL_GAIN,
    Blocks,
    HorizonChoice,
    blocks_of,
    fit_all,
    held_out_errors,
    select_windows,
)
from ballbot.identification.axis.structure import TURN, AxisModel, harmonic, terms_of
from ballbot.identification.axis.terms import (
    LARGEST_CHANCE,
    Kind,
    chance_of_load,
    gain_of_load,
    select_terms,
    without_refuted,
)
from ballbot.progress import Progress


@dataclass(frozen=True, kw_only=True)
class AxisOptions:
    """How an axis is identified; what is not given is selected by held-out errors.

    Raises
    ------
    InputError
        If there is no such law, harmonic or parameter, or a bandwidth or a period is not above zero.
    """

    law: str | None = None  #: the name of one of `AXIS_LAWS`
    bandwidth: float | None = None  #: of the motion [Hz]; from sampling and noise by default
    harmonics: tuple[int, ...] | None = None  #: of a force over position
    spring: bool | None = None  #: whether a force is proportional to position
    load_friction: str | None = (
        None  #: the kind of load that dry friction depends on, one of `LOADS`, or "none"
    )
    drift: bool | None = None  #: whether the offset drifts
    period: float | None = None  #: of the first harmonic [m]; one turn of an axis that turns by default
    separate: tuple[str, ...] = ()  #: parameters of which each record has its own

    def __post_init__(self) -> None:
        if self.law is not None:
            axis_law_named(self.law)
        if self.load_friction not in (None, NO_LOAD_FRICTION):
            load_named(self.load_friction)
        for name, meaning in _ABOVE_ZERO.items():
            value = getattr(self, name)
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"--{name} is {value:g}; {meaning} must be a finite number above zero.")
        known = (*PARAMETERS, *terms_of(spring=False, harmonics=self.harmonics or ()))
        for name in self.separate:
            if name not in known:
                hint = suggest(name, known, otherwise="the parameters are")
                raise InputError(f"--separate names no parameter: {name!r}; {hint}")


_ABOVE_ZERO = {"bandwidth": "the bandwidth of the motion [Hz]", "period": "the travel of the first harmonic"}
DEFAULT_OPTIONS = AxisOptions()
#: a delay leaves less than this share of what windows with reversals have of squared error beyond those without; of
#: three simulated records with delays the largest is 0.33, of two with play that looks like a delay the least 0.96, and
#: of one whose friction falls with time 0.73
_UNEXPLAINED = 0.5


@dataclass(frozen=True, kw_only=True)
class Bench:
    """The records that are fitted, and others that every estimate predicts."""

    records: tuple[AxisRecord, ...]
    others: tuple[AxisRecord, ...]
    bandwidth: float | None  #: that the user asks for
    flat: bool = False  #: whether a drift is subtracted from the forces
    #: names of other records that keep their rows near reversals, as too few are left without
    with_reversals: tuple[str, ...] = ()

    @property
    def all(self) -> tuple[AxisRecord, ...]:
        """The records that are fitted, then the others."""
        return (*self.records, *self.others)

    @cached_property
    def sightings(self) -> list[Sighting]:
        """The records that are fitted, with their filtered motion."""
        return [sighting(one, self.band(one)) for one in self.records]

    @property
    def asymmetry(self) -> NDArray[np.float64]:
        """The asymmetry of the only record over time (parts, 2); empty for several."""
        return asymmetry_over_time(self.records[0]) if len(self.records) == 1 else np.empty((0, 2))

    def residual_tests(
        self, model: AxisModel, found: Mapping[str, float], *, over_position: bool
    ) -> tuple[ResidualTest, ...]:
        """Return the tests of the inverse model's residual, with the Stribeck speed that was found."""
        return residual_tests(
            self.records,
            model,
            bandwidth=self.bandwidth,
            over_position=over_position,
            stribeck_speed=found.get("stribeck_speed"),
        )

    def delayed(self, rows: float) -> Bench:
        """Return records whose forces act so many rows later."""
        moved = (tuple(delayed(one, rows) for one in several) for several in (self.records, self.others))
        records, others = moved
        return replace(self, records=records, others=others)

    def in_contact(self, contact: Contact, axis: Axis) -> Bench:
        """Return records without the rows near reversals, which are those by `axis` in the other records."""
        records = tuple(with_rows(one, kept) for one, kept in zip(self.records, contact.rows, strict=True))
        others = tuple(
            _in_contact(one, sighting(one, self.band(one)), axis, after=contact.after) for one in self.others
        )
        whole = tuple(one.name for one, part in zip(self.others, others, strict=True) if part is one)
        return replace(self, records=records, others=others, with_reversals=whole)

    def drift_from(self, drifting: Bench) -> float:
        """Return the largest range [N] of the drift that was subtracted from the forces of `drifting`."""
        pairs = zip(drifting.records, self.records, strict=True)
        return max(float(np.ptp(one.force - flat.force)) for one, flat in pairs)

    def band(self, record: AxisRecord) -> float:
        """Return the bandwidth of a record's motion [Hz]."""
        return default_bandwidth(record) if self.bandwidth is None else self.bandwidth

    def estimate(self, method: str, fit: OutputErrorFit, horizon: float) -> Estimate:
        """Return an estimate with its errors on all records."""
        numbers: list[int | None] = [*range(len(self.records)), *(None for _ in self.others)]
        return Estimate(
            method=method,
            model=fit.model,
            values=fit.values,
            standard_errors=fit.standard_errors,
            half_widths=fit.half_widths,
            errors=tuple(
                axis_errors(fit, record, number, bandwidth=self.band(record), horizon=horizon)
                for record, number in zip(self.all, numbers, strict=True)
            ),
        )


def _in_contact(record: AxisRecord, seen: Sighting, axis: Axis, *, after: float) -> AxisRecord:
    """Return a record without the rows near reversals; the whole record if too few are left."""
    try:
        return with_rows(record, away_from_reversals(seen, axis, after=after))
    except InputError:
        return record


def _structure(
    bench: Bench, options: AxisOptions, *, interpolated: bool = False
) -> tuple[AxisModel, tuple[tuple[str, Gain], ...]]:
    """Return the model with the forces that are given or selected and its bristles, and the selected ones' gains."""
    period = TURN if options.period is None else options.period
    if options.harmonics and options.period is None and bench.records[0].unit == "m":
        raise InputError("Harmonics of an axis that slides need the travel of one period; give --period.")
    model = AxisModel(
        law=AXIS_LAWS["coulomb"],
        terms=terms_of(spring=bool(options.spring), harmonics=options.harmonics or ()),
        drifts=2 if options.drift else 0,
        period=period,
        separate=options.separate,
        records=len(bench.records),
        interpolated=interpolated,
    )
    kinds: list[Kind] = []
    if options.spring is None:
        kinds.append("spring")
    if options.harmonics is None:
        kinds.append("harmonic")
    if options.drift is None:
        kinds.append("drift")
    if options.load_friction is None:
        kinds.append("load")
    found, selected = select_terms(bench.records, model, kinds=kinds, bandwidth=options.bandwidth)
    if options.load_friction not in (None, NO_LOAD_FRICTION):
        load = load_named(options.load_friction)
        if load not in possible_loads(bench.records, over_position=bool(found.terms)):
            missing = "a load in every record (--load)" if load == "recorded" else "a force over position"
            raise InputError(
                f"--load-friction {load}: the friction can depend on that load only with {missing}."
            )
        found = replace(found, load=load)
    return found, selected


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """Records with what the inverse model shows of them, and where searches begin."""

    bench: Bench  #: without a drift of the offset
    drifting: Bench
    model: AxisModel
    terms: tuple[tuple[str, Gain], ...]
    starts: dict[str, dict[str, float]]
    delay: float = 0.0  #: rows by which the forces were moved to act when they are recorded
    delay_is_clear: bool = True  #: whether windows between reversals show that it is no play
    unconfirmed_delay: float = 0.0  #: rows by which they were not moved, as these windows do not show it
    part: float = 0.0  #: of a row, by which interpolated forces were moved
    tested_for_play: bool = True  #: whether there are enough rows between reversals
    play: Play | None = None  #: for which the rows near reversals were left out

    @property
    def blocks(self) -> Blocks:
        """Blocks of time of the records."""
        return blocks_of(self.bench.records)

    def findings(self, records: Sequence[AxisRecord]) -> list[Finding]:
        """Return the findings on the time of the forces and on play in the records that were given."""
        delay = delay_findings(
            records,
            self.delay,
            clear=self.delay_is_clear,
            unconfirmed=self.unconfirmed_delay if self.play is None else 0.0,
            part=self.part,
        )
        play = play_findings(
            records, self.play, tested=self.tested_for_play, with_reversals=self.bench.with_reversals
        )
        return [*delay, *play]


def _prepared(bench: Bench, options: AxisOptions, blocks: Blocks) -> Prepared:
    held = _prepared_between_rows(bench, options, interpolated=False)
    if not is_interpolated(held.bench.sightings, held.model, held.starts, blocks):
        return held
    # an inverse model of held forces is half a row off, which hides other forces
    return _prepared_between_rows(bench, options, interpolated=True)


def _prepared_between_rows(bench: Bench, options: AxisOptions, *, interpolated: bool) -> Prepared:
    """Return what the inverse model shows of forces that are held, or that change evenly between rows."""
    model, terms = _structure(bench, options, interpolated=interpolated)
    drifting = bench
    if model.drifts:
        flat = without_drift(bench.records, model, bandwidth=options.bandwidth)
        bench, model = replace(bench, records=flat, flat=True), replace(model, drifts=0)
    starts = initial_values(bench.sightings, model, bandwidth=bench.bandwidth)
    return Prepared(bench=bench, drifting=drifting, model=model, terms=terms, starts=starts)


def prepared_records(bench: Bench, options: AxisOptions, blocks: Blocks) -> Prepared:
    """Return records whose forces act when they are recorded, without the rows near reversals if the drive has play."""
    prepared = _prepared(bench, options, blocks)
    contact = _contact(prepared, blocks)
    rows, unconfirmed = force_delay(prepared.bench.sightings, prepared.model, prepared.starts, blocks), 0.0
    if rows:
        later = bench.delayed(rows)
        moved = _prepared(later, options, blocks)
        in_contact = _contact(moved, blocks)
        if contact is None or is_confirmed(rows, contact, in_contact, prepared):
            clear, contact = contact is not None, in_contact
            more = remaining_delay(moved.bench.sightings, moved.model, moved.starts, blocks)
            if more:
                rows += more
                later = bench.delayed(rows)
                moved = _prepared(later, options, blocks)
                contact = _contact(moved, blocks)
            bench, prepared = later, replace(moved, delay=rows, delay_is_clear=clear)
        else:
            seen = linear_delay(contact.sightings, prepared.model, prepared.starts, contact.blocks)
            unconfirmed = 0.0 if seen and seen.refutes(rows) else rows
    if not (prepared.delay or unconfirmed):  # of an unconfirmed delay, all windows would show a part
        part = part_of_a_row(prepared.bench.sightings, prepared.model, prepared.starts, blocks)
        if part:
            bench = bench.delayed(part)
            prepared = replace(_prepared(bench, options, blocks), part=part)
            contact = _contact(prepared, blocks)
    play = contact and play_of(contact, prepared.bench.sightings, blocks)
    prepared = replace(prepared, unconfirmed_delay=unconfirmed)
    if contact is None or play is None:
        return replace(prepared, tested_for_play=contact is not None)
    axis = contact.between.model.axis(contact.between.values, None)
    again = _prepared(bench.in_contact(contact, axis), options, contact.blocks)
    return replace(
        again,
        delay=prepared.delay,
        delay_is_clear=prepared.delay_is_clear,
        unconfirmed_delay=unconfirmed,
        part=prepared.part,
        play=play,
    )


def is_confirmed(rows: float, contact: Contact, moved: Contact | None, prepared: Prepared) -> bool:
    """Return whether a delay by so many rows is no play, whose lag after a reversal resembles one.

    A delay acts between reversals, too. If these rows say nothing, as those of calm motion or of noisy forces, a delay
    still explains what is worse at reversals, `contact`, when the force is `moved` by it.
    """
    between = force_delay(contact.sightings, prepared.model, prepared.starts, contact.blocks)
    if rows * between > 0.0:
        return True
    if moved is None:
        return False
    before, after = (one.everywhere.rms**2 - one.between.rms**2 for one in (contact, moved))
    return after < _UNEXPLAINED * before


def _contact(prepared: Prepared, blocks: Blocks) -> Contact | None:
    """Return the rows between reversals, by the model and by one with gravity or a spring and without bristles.

    Of a record with play, the inverse model may show bristles in place of these forces.
    """
    seen, own = prepared.bench.sightings, prepared.model
    usual = harmonic(1) if prepared.bench.records[0].unit == "rad" else ("spring",)
    wider = replace(own, bending=0.0, terms=tuple(dict.fromkeys((*own.terms, *usual))))
    candidates = [(own, prepared.starts)]
    with suppress(InputError):  # if the records do not determine these forces
        candidates.append((wider, initial_values(seen, wider, bandwidth=prepared.bench.bandwidth)))
    return contact_of(seen, candidates, blocks)


def prepared_with_windows(
    bench: Bench, options: AxisOptions, run: Run = DEFAULT_RUN
) -> tuple[Prepared, Prepared, Blocks, HorizonChoice]:
    """Return what was prepared, the same without forces that the open loop refutes, blocks and horizon."""
    run.progress(Progress(stage="inverse model"))
    prepared = prepared_records(bench, options, blocks_of(bench.records))
    dry = AXIS_LAWS["dahl" if prepared.model.bending else "coulomb"]
    model, start = prepared.model.with_law(dry), prepared.starts[dry.name]
    blocks, horizon = select_windows(model, start, prepared.bench.sightings, prepared.blocks, run)
    run.progress(Progress(stage="forces"))
    prepared = with_best_load(prepared, dry, blocks, horizon.chosen)
    if options.load_friction is None:
        prepared = with_missed_load(prepared, dry, blocks, horizon.chosen)
    return prepared, without_refuted_forces(prepared, dry, blocks, horizon.chosen), blocks, horizon


def with_best_load(prepared: Prepared, law: AxisLaw, blocks: Blocks, horizon: float) -> Prepared:
    """Return what was prepared, with that of the loads whose fit is closest, if one was selected.

    The loads resemble each other, and the inverse model's error, which noise of the position biases, hardly
    distinguishes them.
    """
    selected = next((name for name, _ in prepared.terms if name.startswith("load ")), None)
    if selected is None:
        return prepared
    bench, seen = prepared.bench, prepared.bench.sightings
    found = [prepared]
    for load in possible_loads(bench.records, over_position=bool(prepared.model.terms)):
        model = replace(prepared.model, load=load)
        gain = gain_of_load(bench.records, model, bandwidth=bench.bandwidth)
        if load == prepared.model.load or gain is None:
            continue
        terms = tuple((f"load {load}", gain) if one[0] == selected else one for one in prepared.terms)
        starts = initial_values(seen, model, bandwidth=bench.bandwidth)
        found.append(replace(prepared, model=model, terms=terms, starts=starts))

    def error(one: Prepared) -> float:
        return fit_all(one.model.with_law(law), one.starts[law.name], seen, blocks, horizon, restarts=1).rms

    return min(found, key=error) if len(found) > 1 else prepared


def with_missed_load(prepared: Prepared, law: AxisLaw, blocks: Blocks, horizon: float) -> Prepared:
    """Return what was prepared, with friction under a load that the open loop needs and the inverse model suspects.

    Noise of a coarse position hides from the inverse model's errors what windows show clearly. An axis that is loaded
    most where it turns seems to have such a friction if its own falls with speed; so that law must need it as well.
    """
    bench, seen = prepared.bench, prepared.bench.sightings
    if prepared.model.load:
        return prepared
    laws = (law, AXIS_LAWS["lugre" if prepared.model.bending else "stribeck"])
    found = list[tuple[float, Prepared]]()
    for load in possible_loads(bench.records, over_position=bool(prepared.model.terms)):
        model = replace(prepared.model, load=load)
        if not chance_of_load(bench.records, model, bandwidth=bench.bandwidth) < LARGEST_CHANCE:
            continue
        starts = initial_values(seen, model, bandwidth=bench.bandwidth)
        wider = replace(prepared, model=model, starts=starts)
        gains = [_gain_in_open_loop(wider, prepared, one, blocks, horizon) for one in laws]
        if all(gain.significant and gain.share > USEFUL_GAIN for gain in gains):
            terms = (*prepared.terms, (f"load {load}", gains[0]))
            found.append((gains[0].share, replace(wider, terms=terms)))
    return max(found, key=lambda one: one[0])[1] if found else prepared


def _gain_in_open_loop(
    wider: Prepared, prepared: Prepared, law: AxisLaw, blocks: Blocks, horizon: float
) -> Gain:
    """Return what the model of `wider` gains in the prediction of held-out windows with a law."""
    seen, judged = prepared.bench.sightings, [(horizon, False)]
    wide, thin = (
        held_out_errors(
            fit_all(one.model.with_law(law), one.starts[law.name], seen, blocks, horizon),
            seen,
            blocks,
            horizon=horizon,
            judged=judged,
        )
        for one in (wider, prepared)
    )
    return gain_between(wide, thin, blocks.groups())


def without_refuted_forces(prepared: Prepared, law: AxisLaw, blocks: Blocks, horizon: float) -> Prepared:
    """Return what was prepared, without the forces over position that a law's fit refutes."""
    model, seen = prepared.model.with_law(law), prepared.bench.sightings
    model, terms = without_refuted(model, prepared.starts[law.name], prepared.terms, seen, blocks, horizon)
    if terms == prepared.terms:
        return prepared
    model = model.with_law(AXIS_LAWS["coulomb"])
    starts = initial_values(seen, model, bandwidth=prepared.bench.bandwidth)
    return replace(prepared, model=model, terms=terms, starts=starts)
