"""Intervals of an axis contain errors by what its model lacks, and are no wider where it lacks nothing."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from ballbot.fitting.least_squares import fit_in_time
from ballbot.fitting.model_selection import Candidate, Gain, HeldOut, ModelSelection
from ballbot.identification.axis import AXIS_LAWS, AxisLaw, AxisRecord
from ballbot.identification.axis.discrepancy import (
    Discrepancy,
    discrepancy_findings,
    discrepancy_of,
    with_another_law,
)
from ballbot.identification.axis.force_timing import delayed, part_of_a_row
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting, sighting
from ballbot.identification.axis.preparation import Bench
from ballbot.identification.axis.selection import Blocks, blocks_of, fit_all, possible_laws
from ballbot.identification.axis.structure import AxisModel
from campaigns.axis_machines import Drive, Logging, Machine, record_of

JOINT = Machine(kind="joint", inertia=1.0, viscous=1.0, coulomb=2.0)
#: rows of 5 ms, a fine encoder; windows of 0.2 s
LOGGING = Logging(duration=10.0, rate=200.0, amplitude=1.0, fastest=1.2, counts=65536.0, force_noise=0.04)
HORIZON = 0.2


def fitted(
    record: AxisRecord, *, interpolated: bool = False
) -> tuple[OutputErrorFit, list[Sighting], Blocks]:
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
    model = AxisModel(law=AXIS_LAWS["coulomb"], interpolated=interpolated)
    start = initial_values(seen, model, bandwidth=None)["coulomb"]
    return fit_all(model, start, seen, blocks, HORIZON), seen, blocks


def found_in(record: AxisRecord) -> tuple[OutputErrorFit, Discrepancy]:
    fit, seen, blocks = fitted(record)
    return fit, discrepancy_of(fit, seen, blocks, HORIZON)


def test_nothing_is_found_where_nothing_is_missing() -> None:
    """Of ten records without faults, friction's intervals widen by less than a quarter on average.

    Half of it is for a force that acts half a millisecond later, which rows of 5 ms do not quite exclude.

    The mass may have an error by a part of the effect of a usual drive, which widens it to some 0.1 % here.
    """
    factors = []
    for seed in range(10):
        fit, found = found_in(record_of(JOINT, LOGGING, seed))
        factors += [
            np.hypot(1.0, found.errors.get(name, 0.0) / fit.standard_errors[name])
            for name in ("viscous", "coulomb")
        ]
        assert found.errors.get("mass", 0.0) < 2e-3 * JOINT.inertia
    assert np.mean(factors) < 1.25


def test_a_delay_that_rows_hardly_show_is_in_the_mass_of_an_axis_of_much_friction() -> None:
    """A servo whose back EMF is most of its friction, by a log of 8 ms rows and a loop of 1 ms rows.

    Half a millisecond of b = 1.7 N m s/rad is 3 % of its inertia.
    """
    servo = Machine(kind="servo", inertia=0.03, viscous=1.7, coulomb=0.2)
    logging = Logging(duration=12.0, rate=125.0, held=False, amplitude=1.5, fastest=1.0, counts=4096.0)
    record = record_of(servo, logging, 1)
    fit, seen, blocks = fitted(record, interpolated=True)
    assert abs(fit.values["mass"] - servo.inertia) > 2.0 * fit.standard_errors["mass"]
    found = discrepancy_of(fit, seen, blocks, HORIZON)
    assert abs(fit.values["mass"] - servo.inertia) < 2.0 * found.errors["mass"]


def pulses(seed: int) -> AxisRecord:
    """Return the record of quick moves by pulses of 80 ms, with rests, of a noisy force."""
    random = np.random.default_rng(seed)
    force, way = np.zeros(12_000), 1.0
    for first in range(300, len(force) - 200, 500):
        size, way = way * random.uniform(0.5, 1.5), -way
        force[first : first + 40], force[first + 40 : first + 78] = size, -0.9 * size
    values = {"mass": 0.004, "viscous": 0.007, "coulomb": 0.05, "offset": 0.0}
    moved = Axis(law=AXIS_LAWS["coulomb"], values=values).open_loop(
        force, position=0.0, speed=0.0, sample_time=1e-3
    )
    return AxisRecord(
        name="pulses",
        sample_time=1e-3,
        force=force + 0.02 * random.standard_normal(len(force)),
        position=2e-5 * np.round(np.append(0.0, moved[:-1]) / 2e-5),
        unit="rad",
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_windows_at_rest_say_nothing_of_mass_and_viscous_friction(seed: int) -> None:
    """The windows of the largest errors are those that move: without them b had an error of 30 to 70 times b."""
    record = pulses(seed)
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    fit = fit_all(model, initial_values(seen, model, bandwidth=None)["coulomb"], seen, blocks, 0.1)
    found = discrepancy_of(fit, seen, blocks, 0.1)
    # half a millisecond of delay is some 5 % of b, and a usual elastic drive 3 % of the mass
    assert found.errors["viscous"] < 0.1 * 0.007
    assert found.errors["mass"] < 0.05 * 0.004


def test_friction_that_differs_between_directions_moves_the_means_over_both() -> None:
    def fit(law: str, **values: float) -> OutputErrorFit:
        errors = dict.fromkeys(values, 0.02)
        return OutputErrorFit(
            model=AxisModel(law=AXIS_LAWS[law]), values=values, standard_errors=errors, rms=1.0
        )

    plain = fit("coulomb", mass=1.0, viscous=2.0, coulomb=1.5, offset=0.1)
    sides = {"viscous_plus": 1.8, "viscous_minus": 2.2, "coulomb_plus": 1.5, "coulomb_minus": 1.1}
    before = Discrepancy(
        errors={"coulomb": 0.1, "mass": 0.3}, causes={"coulomb": "with play", "mass": "with play"}
    )
    found = with_another_law(before, plain, fit("asymmetric", mass=1.01, **sides), "with two frictions")
    # the means are 2.0 and 1.3, each with an error of 0.014
    assert found.errors == {"coulomb": pytest.approx(0.2, rel=0.01), "mass": 0.3}
    assert found.causes == {"coulomb": "with two frictions", "mass": "with play"}


@pytest.mark.parametrize(
    ("law", "gain", "speed", "possible"),
    [
        ("coulomb", 0.05, 0.1, {"stribeck", "asymmetric"}),
        ("coulomb", 0.01, 0.1, {"asymmetric"}),  # too little to matter
        ("coulomb", 0.05, 9.0, {"asymmetric"}),  # beyond the speeds of the record
        ("dahl", 0.05, 0.1, {"asymmetric"}),
        ("asymmetric", 0.05, 0.1, set()),
    ],
)
def test_laws_that_the_records_do_not_exclude_are_possible(
    law: str, gain: float, speed: float, possible: set[str]
) -> None:
    def candidate(name: str, upper: float, lower: float) -> Candidate[AxisLaw]:
        held_out = HeldOut(model=AXIS_LAWS[name], squares=np.ones((1, 1)), baseline=None, groups=[])
        found = Gain(share=0.5 * (lower + upper), lower=lower, upper=upper)
        return Candidate(
            name=name,
            within="coulomb",
            held_out=held_out,
            gain=found,
            over="coulomb",
            gain_over=found,
            error=1.0,
        )

    candidates = (candidate("stribeck", gain, -0.1), candidate("asymmetric", 0.4, 0.2))
    _, seen, _ = fitted(record_of(JOINT, LOGGING, 1))
    values = dict.fromkeys(("mass", "viscous", "coulomb", "offset", "stribeck"), 1.0) | {
        "stribeck_speed": speed
    }
    model = AxisModel(law=AXIS_LAWS["stribeck"])
    fits = {"stribeck": OutputErrorFit(model=model, values=values, standard_errors={}, rms=1.0)}
    selection = ModelSelection(candidates=candidates, best=candidates[0])
    assert {*possible_laws(selection, AXIS_LAWS[law], fits, seen)} == possible


@pytest.mark.parametrize(
    ("drive", "motion"),
    [(Drive(share=0.45, natural=25.0), "random"), (Drive(share=0.45, natural=80.0, play=0.003), "sines")],
)
def test_the_mass_of_a_drive_that_yields_is_within_its_error(
    drive: Drive, motion: Literal["sines", "random"]
) -> None:
    """The standard errors alone miss it by several times themselves."""
    machine = replace(JOINT, drive=drive)
    alone = together = 0
    for seed in range(3):
        fit, found = found_in(record_of(machine, replace(LOGGING, motion=motion), seed))
        error = abs(fit.values["mass"] - machine.inertia)
        alone += error < 2.3 * fit.standard_errors["mass"]
        # 2.3 is the quantile of the ten blocks of a second
        together += error < 2.3 * np.hypot(fit.standard_errors["mass"], found.errors.get("mass", 0.0))
    assert alone == 0
    assert together == 3


def test_the_mass_is_not_known_better_than_a_usual_drive_is_excluded() -> None:
    """Two inertias of one half on a shaft of 25 Hz change the mass by more than a clean record's standard error."""
    fit, found = found_in(record_of(JOINT, LOGGING, 0))
    assert found.errors["mass"] > 2.0 * fit.standard_errors["mass"]
    assert found.causes["mass"] in ("with an elastic drive", "with play in the drive")


def test_a_coarse_encoder_makes_no_drive_elastic() -> None:
    """Its noise is in the acceleration with the opposite sign: that of the recorded position gave sizes of -1 to -2."""
    coarse = replace(LOGGING, counts=4096.0, held=False, jitter=0.4)
    rigid, elastic = [], []
    for seed in range(4):
        for machine, sizes in (
            (JOINT, rigid),
            (replace(JOINT, drive=Drive(share=0.5, natural=20.0)), elastic),
        ):
            fit, seen, blocks = fitted(record_of(machine, coarse, seed), interpolated=True)
            sizes.append(discrepancy_of(fit, seen, blocks, HORIZON).drive["with an elastic drive"][0])
    assert abs(np.mean(rigid)) < 0.3
    # half the inertia at 20 Hz is (25 / 20)^2 of the usual size
    assert 0.5 < np.mean(elastic) < 2.0


def test_a_wrong_law_is_within_the_errors() -> None:
    """Friction that falls by a quarter from rest to higher speeds: windows of slow motion show it, at any length."""
    machine = replace(JOINT, stribeck=0.5, stribeck_speed=0.3)
    alone = together = 0
    for seed, motion in enumerate(("sines", "points", "random", "sines", "points", "random")):
        record = record_of(machine, replace(LOGGING, motion=motion), seed)
        fit, found = found_in(record)
        error = abs(fit.values["coulomb"] - machine.coulomb)
        alone += error < 2.3 * fit.standard_errors["coulomb"]
        together += error < 2.3 * np.hypot(fit.standard_errors["coulomb"], found.errors.get("coulomb", 0.0))
    assert alone <= 1
    assert together >= 4


def test_blocks_without_rows_are_not_counted() -> None:
    """Eight blocks of 40: the standard error of a mean is that of the eight, by its spread over 400 draws (4 %)."""
    random = np.random.default_rng(2)
    block = np.repeat(5 * np.arange(8), 25)
    means, errors = [], []
    for _ in range(400):
        values = np.repeat(random.standard_normal(8), 25)
        found = fit_in_time(np.ones((200, 1)), values, block)
        assert found is not None
        means.append(found.values[0])
        errors.append(found.errors[0] ** 2)
    assert np.sqrt(np.mean(errors)) == pytest.approx(np.std(means), rel=0.1)


def test_a_late_force_widens_viscous_friction() -> None:
    record = record_of(JOINT, LOGGING, 0)
    early = delayed(record, -0.2)  # logged a fifth of a row before it acts
    fit, found = found_in(early)
    assert abs(fit.values["viscous"] - JOINT.viscous) > 3.0 * fit.standard_errors["viscous"]
    assert found.causes["viscous"] == "with a force that acts part of a row later or earlier"
    error = np.hypot(fit.standard_errors["viscous"], found.errors["viscous"])
    assert abs(fit.values["viscous"] - JOINT.viscous) < 2.0 * error


def test_the_part_of_a_row_of_a_faster_loop_is_found() -> None:
    """A loop at 1 kHz holds its force for 1 ms, half of which is a tenth of a row of 5 ms."""
    record = record_of(JOINT, replace(LOGGING, held=False), 0)
    fit, seen, blocks = fitted(record, interpolated=True)
    starts = initial_values(seen, fit.model, bandwidth=None)
    part = part_of_a_row(seen, fit.model, starts, blocks)
    assert part == pytest.approx(0.1, abs=0.02)
    assert part_of_a_row(seen, replace(fit.model, interpolated=False), starts, blocks) == 0.0
    wrong, _, _ = fitted(record, interpolated=True)
    right, _, _ = fitted(delayed(record, part), interpolated=True)
    before, after = (abs(one.values["viscous"] - JOINT.viscous) for one in (wrong, right))
    assert after < 0.5 * before


def test_the_note_names_the_effect_and_the_parameters() -> None:
    record = record_of(JOINT, LOGGING, 0)
    fit, _, _ = fitted(record)
    estimate = Bench(records=(record,), others=(), bandwidth=None).estimate("open loop", fit, HORIZON)
    found = Discrepancy(
        errors={"viscous": 0.2, "mass": 1e-9},
        causes={"viscous": "with an elastic drive", "mass": "with play"},
    )
    (note,) = discrepancy_findings(estimate, found, "rad")
    assert (note.code, note.severity) == ("discrepancy", "note")
    assert note.text.endswith("in a fit with an elastic drive (b by 0.20 N m s/rad).")
    assert discrepancy_findings(estimate, Discrepancy(errors={}, causes={}), "rad") == []


def test_a_column_that_the_rows_do_not_determine_is_refused() -> None:
    block = np.repeat(np.arange(5), 4)
    ones = np.ones((20, 1))
    assert fit_in_time(np.hstack([ones, ones]), np.arange(20.0), block) is None
    assert fit_in_time(np.zeros((20, 1)), np.arange(20.0), block) is None
    found = fit_in_time(ones, np.arange(20.0), block)
    assert found is not None
    assert found.values == pytest.approx([9.5])
