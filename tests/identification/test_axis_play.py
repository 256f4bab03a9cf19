"""Play between drive and axis: found by the rows near reversals of the force, and left out of the fit."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.identification.axis import AXIS_LAWS, AxisOptions, identify_axis, play, preparation
from ballbot.identification.axis.force_timing import LinearDelay
from ballbot.identification.axis.inverse import at_rest
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting, sighting
from ballbot.identification.axis.play import (
    Contact,
    Play,
    away_from_reversals,
    contact_of,
    play_findings,
    play_of,
)
from ballbot.identification.axis.preparation import Bench, Prepared, is_confirmed, prepared_records
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import blocks_of
from ballbot.identification.axis.structure import AxisModel
from campaigns.axis_machines import Logging, Machine, record_of
from tests.support.play_examples import COULOMB, INERTIA, VISCOUS, record_with_play

TRUTH = {"mass": INERTIA, "viscous": VISCOUS, "coulomb": COULOMB}

ONLY_FRICTION = AxisOptions(harmonics=(), spring=False, drift=False, load_friction="none")


def prepared(record: AxisRecord) -> Prepared:
    bench = Bench(records=(record,), others=(), bandwidth=None)
    return prepared_records(bench, ONLY_FRICTION, blocks_of([record]))


def contact_in(record: AxisRecord, everywhere: OutputErrorFit, between: OutputErrorFit) -> Contact:
    """Return all rows of a record as those between reversals, with these fits."""
    return Contact(
        rows=[np.ones(len(record), dtype=bool)],
        moving=1.0,
        sightings=[sighting(record, default_bandwidth(record))],
        blocks=blocks_of([record]),
        everywhere=everywhere,
        between=between,
        starts={name: {} for name in AXIS_LAWS},
        after=0.04,
        length=0.2,
    )


@pytest.mark.parametrize("on_motor", [False, True])
def test_friction_between_reversals_is_right_in_spite_of_play(on_motor: bool) -> None:
    record = record_with_play(0.01, on_motor=on_motor)
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    found = contact_of(seen, [(model, initial_values(seen, model, bandwidth=None))], blocks)
    assert found is not None
    assert found.everywhere.rms > 3.0 * found.between.rms
    for name, truth in TRUTH.items():
        # a small share of impacts stays
        assert found.between.values[name] == pytest.approx(truth, rel=0.02)


def test_rows_at_rest_are_not_between_reversals() -> None:
    """Any friction that is large enough predicts them, so that their error would make reversals seem far worse."""
    record = record_of(
        Machine(kind="motor", inertia=0.02, viscous=0.05, coulomb=0.1),
        Logging(duration=8.0, rate=500.0, counts=65536.0, motion="points"),
        1,
    )
    seen = sighting(record, default_bandwidth(record))
    axis = AxisModel(law=AXIS_LAWS["coulomb"]).axis(TRUTH | {"offset": 0.0}, None)
    resting = at_rest(seen.motion.speed)
    assert resting.any()
    assert not (away_from_reversals(seen, axis, after=0.04) & resting).any()


@pytest.mark.parametrize(
    ("between", "moved", "confirmed"),
    [(3.0, 9.0, True), (0.0, 9.0, False), (0.0, 2.0, True), (0.0, 0.5, True)],
)
def test_a_delay_that_explains_most_of_what_is_worse_at_reversals_is_no_play(
    monkeypatch: pytest.MonkeyPatch, between: float, moved: float, confirmed: bool
) -> None:
    """Noise of the force is larger in windows that stick, so that an error at reversals is left when it is moved."""
    record = record_with_play(0.0, duration=4.0)

    def contact(everywhere: float) -> Contact:
        fit = OutputErrorFit(
            model=AxisModel(law=AXIS_LAWS["coulomb"]), values=TRUTH, standard_errors={}, rms=everywhere
        )
        return contact_in(record, fit, replace(fit, rms=1.0))

    monkeypatch.setattr(preparation, "force_delay", lambda *_: between)
    bench = Bench(records=(record,), others=(), bandwidth=None)
    prepared = Prepared(
        bench=bench, drifting=bench, model=AxisModel(law=AXIS_LAWS["coulomb"]), terms=(), starts={}
    )
    assert is_confirmed(3.0, contact(8.0), contact(moved), prepared) is confirmed
    assert is_confirmed(3.0, contact(8.0), None, prepared) is (between > 0.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_noisy_force_that_reverses_often_is_no_play(seed: int) -> None:
    """Between quick reversals windows are short, and by noise of the force their errors were six to ten times less."""
    motor = Machine(kind="motor", inertia=0.006, viscous=0.016, coulomb=0.25)
    quick = Logging(
        duration=6.0, rate=1000.0, amplitude=1.5, slowest=0.3, fastest=4.0, counts=98304.0, force_noise=0.0125
    )
    found = prepared(record_of(motor, quick, seed))
    assert found.tested_for_play
    assert found.play is None


def test_play_shows_in_the_mean_of_both_directions_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The law that predicts all rows best has friction of each direction; between reversals they are one."""
    record = record_with_play(0.0, duration=4.0)
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])

    def fit(law: str, times: float, **values: float) -> OutputErrorFit:
        errors = {name: 0.001 * value for name, value in values.items()}
        model = AxisModel(law=AXIS_LAWS[law])
        return OutputErrorFit(model=model, values=values, standard_errors=errors, rms=times * seen[0].noise)

    plain = fit("coulomb", 3.5, mass=0.02, viscous=0.08, coulomb=0.07)
    sides = {"viscous_plus": 0.07, "viscous_minus": 0.09, "coulomb_plus": 0.08, "coulomb_minus": 0.06}
    asymmetric = fit("asymmetric", 3.0, mass=0.02, **sides)
    monkeypatch.setattr(
        play, "fit_law", lambda own, *_: asymmetric if own.law.name == "asymmetric" else plain
    )
    # the record has no play: the fits are made
    monkeypatch.setattr(play, "_error_of_most", lambda *_: np.inf)
    between = fit("coulomb", 1.0, mass=0.02, viscous=0.05, coulomb=0.1)
    found = play_of(contact_in(record, plain, between), seen, blocks)
    assert found is not None
    assert found.values == {
        "viscous": (pytest.approx(0.08), 0.05),
        "coulomb": (pytest.approx(0.07), 0.1),
    }


@pytest.mark.parametrize("after", [0.04, 0.1])
def test_validation_records_lose_the_same_time_after_reversals(after: float) -> None:
    record = record_with_play(0.0, duration=4.0)
    other = replace(record, name="other")
    fast = replace(record, name="fast", position=np.sin(2.0 * np.pi * 10.0 * record.t))
    fit = OutputErrorFit(
        model=AxisModel(law=AXIS_LAWS["coulomb"]),
        values=TRUTH | {"offset": 0.0},
        standard_errors=dict.fromkeys(TRUTH, 0.0),
        rms=1.0,
    )
    axis = fit.model.axis(fit.values, None)
    kept = away_from_reversals(sighting(record, default_bandwidth(record)), axis, after=after)
    contact = replace(contact_in(record, fit, fit), after=after, rows=[kept])
    bench = Bench(records=(record,), others=(other, fast), bandwidth=None).in_contact(contact, axis)
    fitted, validated, whole = bench.all
    assert len(fitted) == np.count_nonzero(kept) < len(record)
    np.testing.assert_array_equal(validated.t, fitted.t)
    # ten reversals in a second leave no part that is long enough
    assert whole is fast
    assert bench.with_reversals == ("fast",)
    left_out = Play(contact=contact, error=2e-3, error_between=1e-3, values={})
    (finding,) = play_findings(bench.records, left_out, with_reversals=bench.with_reversals)
    assert "fast keeps its rows near reversals" in finding.text
    (finding,) = play_findings(bench.records, left_out)
    assert "keeps its rows" not in finding.text


@pytest.mark.parametrize("with_play", [False, True])
def test_a_delay_that_rows_between_reversals_do_not_confirm_is_named(
    monkeypatch: pytest.MonkeyPatch, with_play: bool
) -> None:
    record = record_with_play(0.0, duration=6.0)

    def delay(sightings: list[Sighting], *_: object) -> float:
        return 3.0 if len(sightings[0].record) == len(record) else 0.0

    def shown(contact: Contact, *_: object) -> Play | None:
        return Play(contact=contact, error=2.0, error_between=1.0, values={}) if with_play else None

    def open_(*_: object) -> LinearDelay:
        return LinearDelay(rows=0.3, error=1.5, p_value=0.8, improves=False)

    monkeypatch.setattr(preparation, "force_delay", delay)
    monkeypatch.setattr(preparation, "linear_delay", open_)
    monkeypatch.setattr(preparation, "play_of", shown)
    found = prepared(record)
    assert found.delay == 0.0
    assert found.unconfirmed_delay == 3.0
    (finding,) = found.findings([record])
    assert finding.severity == "warning"
    # play would explain such a lag
    assert finding.code == ("play" if with_play else "force-delay")
    if not with_play:
        assert "acts 6 ms (3 rows) later than its row" in finding.text
        assert "do not confirm it, so it is not moved" in finding.text


def test_an_unconfirmed_delay_is_not_moved_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """The windows that show the whole of it, as of slight play, show a part of a row as well."""
    record = record_with_play(0.0, duration=6.0)
    delays, parts = iter([0.5, 0.0, 0.0]), 0.4

    monkeypatch.setattr(preparation, "force_delay", lambda *_: next(delays))
    monkeypatch.setattr(
        preparation, "linear_delay", lambda *_: LinearDelay(rows=0.3, error=0.5, p_value=0.8, improves=False)
    )
    monkeypatch.setattr(preparation, "part_of_a_row", lambda *_: parts)
    monkeypatch.setattr(preparation, "play_of", lambda *_: None)
    found = prepared(record)
    assert (found.unconfirmed_delay, found.part) == (0.5, 0.0)
    (finding,) = found.findings([record])
    assert "do not confirm it, so it is not moved" in finding.text
    assert prepared(record).part == parts  # without such a delay


def test_a_delay_that_rows_between_reversals_refute_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The windows of a record without a delay determine it to a small part of a row."""
    record = record_with_play(0.0, duration=6.0)

    def delay(sightings: list[Sighting], *_: object) -> float:
        return 3.0 if len(sightings[0].record) == len(record) else 0.0

    monkeypatch.setattr(preparation, "force_delay", delay)
    monkeypatch.setattr(preparation, "play_of", lambda *_: None)
    found = prepared(record)
    assert (found.delay, found.unconfirmed_delay) == (0.0, 0.0)
    assert found.findings([record]) == []


@pytest.mark.slow
def test_play_is_found_and_is_no_delay() -> None:
    found = prepared(record_with_play(0.01, on_motor=True))
    assert found.delay == 0.0
    assert found.play is not None
    (finding,) = play_findings(found.bench.records, found.play)
    assert finding.severity == "warning"
    assert "Play (backlash) between drive and axis does this" in finding.text


def test_a_record_that_cannot_show_play_is_named() -> None:
    record = record_with_play(0.0, duration=1.0)
    (finding,) = play_findings([record], None, tested=False)
    assert finding.severity == "note"
    assert "to show whether there is play" in finding.text
    assert not play_findings([record], None)
    free = replace(record, force=np.zeros(len(record)))
    assert not play_findings([free], None, tested=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "record",
    [
        record_with_play(0.0),
        record_of(
            Machine(kind="motor", inertia=0.02, viscous=0.05, coulomb=0.1, stribeck=0.05, stribeck_speed=0.3),
            Logging(duration=10.0, rate=500.0, counts=65536.0, force_noise=0.002),
            1,
        ),
    ],
    ids=["rigid", "stribeck"],
)
def test_an_axis_without_play_keeps_all_rows(record: AxisRecord) -> None:
    found = prepared(record)
    assert found.play is None
    assert found.bench.records == (record,)


@pytest.mark.slow
def test_a_delay_is_found_between_reversals_too() -> None:
    record = record_with_play(0.0)
    late = replace(record, force=np.append(record.force[3:], np.full(3, record.force[-1])))
    found = prepared(late)
    # halves of a row are tried
    assert found.delay == pytest.approx(3.0, abs=0.5)
    assert found.delay_is_clear
    assert found.play is None


@pytest.mark.slow
def test_the_friction_of_an_axis_with_play_is_right() -> None:
    found = identify_axis(record_with_play(0.01, on_motor=True, duration=6.0), options=ONLY_FRICTION)
    codes = {one.code for one in found.findings if one.severity == "warning"}
    assert "play" in codes
    assert "force-delay" not in codes
    for name, truth in TRUTH.items():
        # a small share of impacts stays
        assert found.best.values[name] == pytest.approx(truth, rel=0.02)
    assert found.chosen == AXIS_LAWS["coulomb"]
