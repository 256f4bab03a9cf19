"""Axes under gravity, with cogging, cables, known loads, drift and gaps: samples of campaigns/one_axis.py."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.fitting.model_selection import Gain
from ballbot.identification.axis import (
    AXIS_LAWS,
    AxisOptions,
    AxisRecord,
    KnownLoad,
    identify_axis,
    inverse_fit,
)
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, sighting
from ballbot.identification.axis.prediction import (
    PredictedError,
    elsewhere_findings,
    error_elsewhere,
    predicted_error,
    with_unknown_parameters,
)
from ballbot.identification.axis.record import NO_LOAD
from ballbot.identification.axis.residuals import ResidualTest, residual_findings, residual_tests
from ballbot.identification.axis.selection import blocks_of
from ballbot.identification.axis.structure import AxisModel
from ballbot.identification.axis.terms import select_terms, without_refuted
from campaigns.axis_machines import Logging, Machine, draw, record_of

PLAIN = AxisModel(law=AXIS_LAWS["coulomb"])
ARM = Machine(kind="arm", inertia=0.8, viscous=1.0, coulomb=1.5, offset=0.2, gravity=(4.0, -1.0))
LOGGED = Logging(duration=12.0, rate=200.0, force_noise=0.05, counts=50_000.0, fastest=1.0)


@pytest.mark.sample
@pytest.mark.parametrize(
    ("kind", "fault"),
    [("pendulum", "lost rows"), ("arm", "jitter"), ("motor", "as it is"), ("cart", "drift")],
)
def test_friction_of_simulated_machines(kind: str, fault: str) -> None:
    machine, logging = draw(kind, fault, 3)
    found = identify_axis(
        record_of(machine, replace(logging, duration=10.0), 3), options=AxisOptions(law="coulomb")
    )
    # published friction should be met within 12 % and 20 %
    assert found.best.values["coulomb"] == pytest.approx(machine.coulomb, rel=0.12)
    assert found.best.values["viscous"] == pytest.approx(machine.viscous, rel=0.20)


def test_gravity_is_selected_and_a_spring_is_not() -> None:
    model, gains = select_terms([record_of(ARM, LOGGED, 1)], PLAIN)
    assert model.terms == ("sin_1", "cos_1")
    assert [name for name, _ in gains] == ["harmonic 1"]
    fit = inverse_fit(record_of(ARM, LOGGED, 1), model=model, moving=True)
    # the noise of acceleration and the rows of a held force leave a few per cent
    assert fit.value("sin_1") == pytest.approx(4.0, rel=0.05)
    # over +-0.7 rad a cosine hardly differs from a constant; their sum is determined
    assert fit.value("cos_1") + fit.value("offset") == pytest.approx(-0.8, abs=0.05)


def test_forces_that_the_open_loop_refutes_are_dropped() -> None:
    """Gravity is there, and a ninth harmonic, which an inverse model might select, is not."""
    record = record_of(ARM, LOGGED, 1)
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
    model = replace(PLAIN, terms=("sin_1", "cos_1", "sin_9", "cos_9"))
    start = initial_values(seen, model, bandwidth=None)["coulomb"]
    gain = Gain(share=0.1, lower=0.05, upper=0.15)
    gravity, ninth = ("harmonic 1", gain), ("harmonic 9", gain)
    narrow, kept = without_refuted(model, start, (gravity, ninth), seen, blocks, 0.2)
    assert narrow.terms == ("sin_1", "cos_1")
    assert kept == (gravity,)
    # what the user asks for stays
    assert without_refuted(model, start, (gravity,), seen, blocks, 0.2) == (model, (gravity,))


def test_cogging_is_found_at_high_speed_and_with_lost_rows() -> None:
    """Of motors whose cogs pass faster than decimated rows come, but not always; all of 12 in a trial."""
    for seed in range(3):
        machine, logging = draw("motor", "lost rows", seed)
        model, _ = select_terms([record_of(machine, logging, seed)], PLAIN)
        assert f"sin_{machine.cogging[0]}" in model.terms


def test_cogging_is_found_among_the_harmonics() -> None:
    motor = replace(ARM, kind="motor", gravity=(0.0, 0.0), cogging=(14, 0.8, 0.5))
    model, _ = select_terms([record_of(motor, replace(LOGGED, fastest=0.3, amplitude=2.0), 2)], PLAIN)
    assert "sin_14" in model.terms


def test_a_drift_is_selected() -> None:
    model, gains = select_terms([record_of(ARM, replace(LOGGED, drift=2.0), 4)], PLAIN)
    assert model.drifts > 0
    assert "drift" in [name for name, _ in gains]


def test_records_with_known_loads_share_one_fit() -> None:
    """Two loads, of which each alone leaves the arm's own inertia and gravity; offsets differ."""
    records = []
    for number, (mass, offset) in enumerate(((0.5, 0.4), (1.5, -0.3))):
        load = KnownLoad(inertia=mass * 0.09, weight=9.81 * mass * 0.3)
        machine = replace(ARM, load=load, offset=offset)
        records.append(record_of(machine, LOGGED, 5 + number, f"load {number}"))
    model = replace(PLAIN, terms=("sin_1", "cos_1"), separate=("offset",), records=2)
    fit = inverse_fit(records, model=model, moving=True)
    found = fit.by_name
    assert {"offset[1]", "offset[2]"} < set(found)
    # as above
    assert found["mass"] == pytest.approx(0.8, rel=0.05)
    assert found["sin_1"] == pytest.approx(4.0, rel=0.05)
    assert found["coulomb"] == pytest.approx(1.5, rel=0.05)
    assert found["offset[1]"] == pytest.approx(0.4, abs=0.05)
    assert found["offset[2]"] == pytest.approx(-0.3, abs=0.05)
    assert model.values_elsewhere(found)["offset"] == pytest.approx(0.05, abs=0.05)


def test_a_pendulum_that_swings_freely_is_known_by_its_load() -> None:
    """Without a motor, a known weight gives the scale: integrated by Euler steps of 50 us with dry friction."""
    load, c, b, inertia = KnownLoad(inertia=0.02, weight=1.2), 0.01, 0.004, 0.003
    q, w, angles, h = 1.2, 0.0, [], 5e-5
    for k in range(200_000):
        if k % 100 == 0:
            angles.append(q)
        net = -load.weight * np.sin(q) - b * w
        if w == 0.0 and abs(net) <= c:
            continue
        faster = w + h * (net - c * np.sign(w if w != 0.0 else net)) / (load.inertia + inertia)
        w = 0.0 if w * faster < 0.0 else faster
        q += h * w
    record = AxisRecord(
        name="swing",
        sample_time=5e-3,
        force=np.zeros(len(angles)),
        position=np.array(angles),
        unit="rad",
        known_load=load,
    )
    fit = inverse_fit(record, moving=True)
    assert fit.value("mass") == pytest.approx(inertia, rel=0.1)
    assert fit.value("coulomb") == pytest.approx(c, rel=0.12)
    assert fit.value("viscous") == pytest.approx(b, rel=0.20)


def test_residuals_show_what_the_model_leaves_out() -> None:
    clean = record_of(ARM, replace(LOGGED, duration=20.0), 7)
    warmth = 30.0 + 8.0 * np.sin(0.6 * clean.t)
    friction = np.sign(np.gradient(clean.position)) * 0.03 * (warmth - 30.0)
    uneven = 0.3 * np.sin(3.0 * clean.position)
    for force, quantity in ((0.0, ""), (friction, "temperature"), (uneven, "position")):
        record = replace(clean, force=clean.force + force, temperature=warmth)
        found = {one.quantity for one in residual_tests([record], with_gravity()) if one.dependent}
        # the residual may depend on other quantities too; that of a complete model depends on none
        assert quantity in found if quantity else not found


def with_gravity() -> AxisModel:
    return replace(PLAIN, terms=("sin_1", "cos_1"))


def test_a_law_that_explains_a_dependence_is_not_advised() -> None:
    test = ResidualTest(quantity="speed", p_value=1e-9, share=0.3, size=1.0)
    text = {
        name: " ".join(
            one.text for one in residual_findings([test], PLAIN.with_law(law), [record_of(ARM, LOGGED, 1)])
        )
        for name, law in AXIS_LAWS.items()
    }
    assert text["coulomb"].endswith("try --law stribeck or asymmetric.")
    assert text["asymmetric"].endswith("try --law stribeck.")
    assert not text["stribeck"]
    assert not text["lugre"]


def test_an_angle_at_which_a_load_hangs_is_asked_for() -> None:
    loads = [
        replace(record_of(ARM, LOGGED, 1), known_load=KnownLoad(inertia=0.01, weight=weight))
        for weight in (1.0, 2.0)
    ]
    test = ResidualTest(quantity="record", p_value=1e-9, share=0.3, size=1.0)
    (several,) = residual_findings([test], PLAIN, loads)
    assert "the load hangs straight down at another angle (--hanging), or the records differ" in several.text
    (alike,) = residual_findings([test], PLAIN, [loads[0], loads[0]])
    assert "--hanging" not in alike.text
    free = replace(loads[0], force=np.zeros(len(loads[0])), known_load=NO_LOAD)
    with pytest.raises(InputError, match="or give the load of a pendulum by --load-mass and --load-arm"):
        identify_axis(free)


def test_another_machine_is_outside_the_interval() -> None:
    """An error is expected from held-out blocks; the same machine keeps it, one with twice the friction does not."""
    values = {"mass": 0.8, "viscous": 1.0, "coulomb": 1.5, "offset": 0.2, "sin_1": 4.0, "cos_1": -1.0}
    fit = OutputErrorFit(
        model=with_gravity(), values=values, standard_errors=dict.fromkeys(values, 0.0), rms=0.0
    )
    record, same = (record_of(ARM, LOGGED, seed, f"record {seed}") for seed in (1, 2))
    blocks = blocks_of([record])
    squares = np.random.default_rng(1).chisquare(20, len(blocks)) / 20
    squares *= error_elsewhere(fit, record, horizon=0.2) ** 2
    expected = predicted_error(squares, blocks, horizon=0.2)
    other = record_of(replace(ARM, coulomb=3.0), LOGGED, 2, "other")
    judged = [(one, error_elsewhere(fit, one, horizon=0.2)) for one in (same, other)]
    findings = elsewhere_findings(expected, judged, unit="rad")
    assert [one.severity for one in findings] == ["note", "warning"]
    assert "differs in what the model leaves out" in findings[1].text


@pytest.mark.slow
def test_the_error_expected_elsewhere_contains_the_spread_of_separate_parameters() -> None:
    """Offsets that differ by a third of the dry friction; another record has one that no fit knows."""
    plain = Machine(kind="motor", inertia=0.05, viscous=0.1, coulomb=0.4)
    short = Logging(duration=4.0, rate=200.0, counts=16384.0, force_noise=0.02, fastest=2.0)
    fitted, other = (
        [
            record_of(replace(plain, offset=offset), short, seed, f"offset {offset}")
            for seed, offset in enumerate(offsets, first)
        ]
        for first, offsets in ((0, (0.06, 0.0, -0.06)), (10, (0.04,)))
    )
    options = AxisOptions(law="coulomb", harmonics=(), spring=False, drift=False, separate=("offset",))
    found = identify_axis(fitted, options=options, validation_records=other)
    elsewhere = found.best.errors[-1].window_rmse
    # each record by its own offset is predicted far better
    assert max(one.window_rmse for one in found.best.errors[:3]) < 0.6 * elsewhere
    assert found.expected.lower < elsewhere < found.expected.upper


def test_two_records_bound_the_error_that_separate_parameters_make_elsewhere() -> None:
    """Two offsets alike by chance leave what is assumed of them; without that no size could be excluded."""
    expected = PredictedError(horizon=0.5, error=1e-4, lower=5e-5, upper=2e-4, records=2)
    shown, assumed, alike = np.full(9, 1e-6), np.full(9, 4e-6), np.full(9, 1e-8)
    found = with_unknown_parameters(expected, shown, assumed)
    # 1.8 mm: three parts of 4 - 0.01 and one of 1 - 0.01; times 3.5, the quantile of t for four degrees of freedom
    assert found.error == pytest.approx(1.8e-3, rel=0.02)
    assert found.upper == pytest.approx(6.3e-3, rel=0.02)
    assert expected.lower < found.lower < found.error
    chance = with_unknown_parameters(expected, alike, assumed)
    # of the thirteen parts above, the one that the records themselves show is missing
    assert chance.upper == pytest.approx(np.sqrt(12.0 / 13.0) * found.upper, rel=0.01)


@pytest.mark.parametrize("seed", [1, 3, 5, 7])
def test_gravity_over_a_small_swing_is_a_spring_and_no_cogging(seed: int) -> None:
    machine, logging = draw("arm", "as it is", seed)
    record = record_of(machine, replace(logging, amplitude=0.15), seed)
    assert np.ptp(record.position) < 0.4
    model, _ = select_terms((record,), PLAIN)
    assert model.terms == ("spring",)
