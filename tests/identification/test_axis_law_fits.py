"""Fits of the friction laws of one axis: starts, nesting, and records that determine nothing."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.fitting.model_selection import Gain
from ballbot.identification.axis import (
    AXIS_LAWS,
    AxisIdentification,
    AxisOptions,
    identify_axis,
    inverse_fit,
    selection,
)
from ballbot.identification.axis.conclusions import axis_findings
from ballbot.identification.axis.law_fits import check_determined, improved, initial_values
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, sighting
from ballbot.identification.axis.result import Estimate
from ballbot.identification.axis.selection import (
    LEAST_BLOCKS,
    SAME,
    blocks_of,
    fades,
    has_dry_friction,
    least_errors,
    problem_of,
    show_noise_alone,
)
from ballbot.identification.axis.structure import AxisModel
from campaigns.axis_machines import Logging, Machine, record_of
from tests.support.axis_examples import TRUTH, simulated_record

#: dry friction is ten times the force that accelerates it
GEAR = Machine(kind="motor", inertia=0.05, viscous=1.0, coulomb=8.0)
GEARED = record_of(
    GEAR, Logging(duration=6.0, rate=200.0, amplitude=2.0, counts=4096.0, force_noise=0.2), 1, "gear"
)


def fit_of(law: str, **values: float) -> OutputErrorFit:
    model = AxisModel(law=AXIS_LAWS[law])
    chosen = {label: values[label] for label in model.labels}
    return OutputErrorFit(model=model, values=chosen, standard_errors=dict.fromkeys(chosen, 0.0), rms=0.0)


@pytest.fixture(scope="module")
def geared() -> AxisIdentification:
    return identify_axis(GEARED, options=AxisOptions(law="coulomb", harmonics=(), spring=False, drift=False))


@pytest.mark.sample
def test_dry_friction_ten_times_the_inertia_s_force_is_found(geared: AxisIdentification) -> None:
    for name, truth in (("mass", 0.05), ("viscous", 1.0), ("coulomb", 8.0)):
        assert geared.best.values[name] == pytest.approx(truth, rel=0.1)
    assert not {"lost-minimum", "undetermined"} & {one.code for one in geared.findings}


@pytest.mark.sample
def test_no_law_fits_the_windows_worse_than_the_law_within_it(geared: AxisIdentification) -> None:
    blocks, seen = blocks_of([GEARED]), [sighting(GEARED, default_bandwidth(GEARED))]
    errors = {
        name: problem_of(one.model, seen, blocks, geared.horizon.chosen).rms(one.values)
        for name, one in geared.by_law.items()
    }
    for name, law in AXIS_LAWS.items():
        if law.below and name != "dahl":  # which a step of the simulation does not resolve
            assert errors[name] <= 1.001 * errors[law.below]


@pytest.mark.sample
def test_a_lost_minimum_and_an_undetermined_mass_are_warnings(geared: AxisIdentification) -> None:
    best = geared.best
    lost = replace(
        best,
        half_widths=best.half_widths | {"mass": 400.0},
        errors=tuple(replace(one, window_rmse=5.0 * one.window_rmse) for one in best.errors),
    )
    found = axis_findings([GEARED], geared.laws, lost, geared.estimates, geared.asymmetry, by_user=True)
    texts = {one.code: one.text for one in found if one.severity == "warning"}
    assert "did not find the parameters of the least error" in texts["lost-minimum"]
    assert texts["undetermined"].startswith("M is not determined")
    assert "±" not in texts["undetermined"]


@pytest.mark.sample
def test_intervals_decide_what_is_poorly_determined(geared: AxisIdentification) -> None:
    """A standard error says little from few blocks; a constant force near zero is known if it is small."""
    best, half = geared.best, geared.best.half_widths

    def codes(**changes: float) -> set[str]:
        wide = replace(best, values=best.values | {"offset": 1e-6}, half_widths=half | changes)
        found = axis_findings([GEARED], geared.laws, wide, [wide], geared.asymmetry, by_user=True)
        return {f"{one.code} {one.text.split()[0]}" for one in found if one.code.endswith("determined")}

    assert codes() == set()
    assert codes(offset=0.02 * GEARED.usual_force) == set()
    assert codes(offset=0.3 * GEARED.usual_force) == {"poorly-determined offset"}
    assert codes(offset=3.0 * GEARED.usual_force) == {"undetermined offset"}
    assert codes(mass=1.3 * best.values["mass"]) == {"poorly-determined M"}


@pytest.mark.sample
def test_a_stiffness_that_is_not_determined_has_no_number(geared: AxisIdentification) -> None:
    """Half an interval of 1.84 times the value was printed as "8.68e+06 ± 1.6e+07", which bounds nothing."""
    soft = geared.by_law["dahl"]
    half = 1.84 * soft.values["stiffness"]
    wide = replace(
        soft,
        standard_errors=soft.standard_errors | {"stiffness": half},
        half_widths=soft.half_widths | {"stiffness": half, "viscous": 1.2 * soft.values["viscous"]},
    )
    found = axis_findings([GEARED], geared.laws, wide, [wide], geared.asymmetry, by_user=True)
    texts = {one.text.split()[0]: one.text for one in found if one.code.endswith("determined")}
    assert texts["sigma_0"].startswith("sigma_0 is not determined")
    assert "±" not in texts["sigma_0"]
    assert texts["b"].endswith("N m s/rad.")  # an upper end of friction is of use


@pytest.mark.sample
@pytest.mark.parametrize(
    ("share", "words"),
    [
        (0.5, "other: the asymmetric law has 50 % less error there as well"),
        (0.99, "is not clearly better there"),
    ],
)
def test_another_record_says_whether_an_asymmetry_is_the_machine_s(
    geared: AxisIdentification, share: float, words: str
) -> None:
    errors = geared.best.errors[0]
    best = replace(geared.best, errors=(errors, errors))
    sides = replace(
        geared.by_law["asymmetric"],
        errors=(errors, replace(errors, window_rmse=share * errors.window_rmse)),
    )
    gain = Gain(share=0.4, lower=0.3, upper=0.5)
    laws = replace(
        geared.laws,
        candidates=tuple(
            replace(one, gain=gain, over=None, gain_over=None) if one.name == "asymmetric" else one
            for one in geared.laws.candidates
        ),
    )
    found = axis_findings(
        [GEARED, replace(GEARED, name="other")],
        laws,
        best,
        [best],
        geared.asymmetry,
        by_user=True,
        asymmetric=sides,
    )
    (text,) = (one.text for one in found if one.code == "asymmetry")
    assert words in text


@pytest.mark.sample
def test_records_fitted_together_are_compared_together(geared: AxisIdentification) -> None:
    """A fit of several records predicts one of them worse than another method, and all of them better."""

    def estimate(method: str, *errors: float) -> Estimate:
        windows = tuple(replace(geared.best.errors[0], window_rmse=error) for error in errors)
        return replace(
            geared.best, method=method, model=replace(geared.best.model, records=2), errors=windows
        )

    chosen = estimate("open loop", 2e-3, 1e-3)
    for other, expected in ((estimate("inverse", 1.8e-3, 2e-3), 0), (estimate("inverse", 1.8e-3, 1e-3), 1)):
        found = axis_findings(
            [GEARED, GEARED], geared.laws, chosen, [chosen, other], geared.asymmetry, by_user=True
        )
        assert [one.code for one in found].count("lost-minimum") == expected


def test_a_break_away_force_beyond_the_speeds_is_no_stribeck_friction() -> None:
    """At the fastest speeds a third of it would be left, and Coulomb friction would be that of no speed."""
    seen = [sighting(GEARED, default_bandwidth(GEARED))]
    fastest = float(np.quantile(np.abs(seen[0].motion.speed), 0.95))
    values = {"mass": 1.0, "viscous": 1.0, "coulomb": 1.0, "offset": 0.0, "stribeck": 1.0}
    assert fades(fit_of("stribeck", **values, stribeck_speed=0.4 * fastest), seen)
    assert not fades(fit_of("stribeck", **values, stribeck_speed=0.9 * fastest), seen)
    assert fades(fit_of("coulomb", **values), seen)


@pytest.mark.parametrize(("error", "dry"), [(0.1, True), (0.5, False), (np.nan, False)])
def test_dry_friction_is_clear_by_its_own_error(error: float, dry: bool) -> None:
    """A position that noise makes most of the error of hardly improves by a friction that is known to 10 %."""
    fit = fit_of("coulomb", mass=1.0, viscous=1.0, coulomb=1.0, offset=0.0)
    assert has_dry_friction(replace(fit, standard_errors=fit.standard_errors | {"coulomb": error})) is dry


def test_windows_of_noise_are_lengthened() -> None:
    """Held-out errors cannot distinguish short windows whose errors are the camera's; a longer one shows the decay."""
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    noisy = replace(
        GEARED, position=GEARED.position + 0.02 * np.random.default_rng(1).standard_normal(len(GEARED))
    )
    for record, alone in ((GEARED, False), (noisy, True)):
        seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
        start = {"mass": 0.05, "viscous": 1.0, "coulomb": 8.0, "offset": 0.0}
        assert show_noise_alone(model, start, seen, blocks) is alone
    assert blocks_of([GEARED], longest=True).duration == pytest.approx(GEARED.duration / LEAST_BLOCKS)
    assert blocks_of([GEARED]).duration < 0.8 * GEARED.duration / LEAST_BLOCKS


@pytest.mark.parametrize(("error", "law"), [(0.1, "coulomb"), (0.5, "viscous")])
def test_a_dry_friction_that_noise_hides_is_selected_if_it_is_clear(
    monkeypatch: pytest.MonkeyPatch, error: float, law: str
) -> None:
    seen, blocks = [sighting(GEARED, default_bandwidth(GEARED))], blocks_of([GEARED])
    monkeypatch.setattr(selection, "held_out_errors", lambda *_, **__: np.full((len(blocks), 2), 1e-6))
    some = dict.fromkeys(
        ("mass", "viscous", "coulomb", "offset", "stribeck", "stribeck_speed", "stiffness"), 1.0
    )
    some |= dict.fromkeys(
        ("micro_damping", "viscous_plus", "viscous_minus", "coulomb_plus", "coulomb_minus"), 1.0
    )
    fits = {name: fit_of(name, **some) for name in AXIS_LAWS}
    dry = fits["coulomb"]
    fits["coulomb"] = replace(dry, standard_errors=dry.standard_errors | {"coulomb": error})
    chosen, _ = selection.select_law(fits, seen, blocks, horizon=0.2)
    assert chosen.best.name == law


def test_a_break_away_force_that_makes_the_axis_stick_is_in_the_law_s_start() -> None:
    """From dry friction and a tenth of it as break-away force, the descent ended at twice the mass."""
    machine = Machine(
        kind="motor", inertia=12.0, viscous=30.0, coulomb=8.0, stribeck=6.0, stribeck_speed=0.005
    )
    slow = Logging(duration=12.0, rate=250.0, amplitude=0.04, slowest=0.08, fastest=0.3, force_noise=0.1)
    record = record_of(machine, slow, 1, "slow")
    seen = [sighting(record, default_bandwidth(record))]
    starts = initial_values(seen, AxisModel(law=AXIS_LAWS["coulomb"]), bandwidth=None)
    for name in ("stribeck", "lugre"):
        # of six records the masses are within 3 %; a large force at a low speed and a smaller one at a higher are alike
        assert starts[name]["mass"] == pytest.approx(12.0, rel=0.05)
        assert 4.0 < starts[name]["stribeck"] < 15.0
        assert 0.3 < starts[name]["stribeck_speed"] / 0.005 < 2.0


def test_an_axis_without_a_break_away_force_starts_from_a_small_one() -> None:
    record = simulated_record(duration=6.0)
    starts = initial_values([sighting(record, 20.0)], AxisModel(law=AXIS_LAWS["coulomb"]), bandwidth=None)
    assert starts["stribeck"]["stribeck"] == pytest.approx(0.1 * starts["coulomb"]["coulomb"])


@pytest.mark.sample
def test_a_fit_goes_on_from_better_parameters_of_another_method() -> None:
    record = simulated_record(duration=6.0)
    blocks, seen = blocks_of([record]), [sighting(record, 20.0)]
    lost = fit_of("coulomb", **(TRUTH | {"mass": 5e3, "viscous": 0.1}))
    found = improved(lost, [TRUTH], seen, blocks, 0.2)
    assert found.values["mass"] == pytest.approx(95.0, rel=0.01)
    assert improved(found, [lost.values], seen, blocks, 0.2) is found


def test_a_fit_no_better_than_a_constant_speed_is_refused() -> None:
    record = simulated_record(duration=6.0)
    blocks, seen, inverse = blocks_of([record]), [sighting(record, 20.0)], inverse_fit(record).by_name
    check_determined(fit_of("coulomb", **TRUTH), inverse, seen, blocks, 0.2)
    heavy = fit_of("coulomb", **(TRUTH | {"mass": 1e6}))
    with pytest.raises(
        InputError, match=r"does not determine mass and friction: .* The inverse model, .* gives M ="
    ):
        check_determined(heavy, inverse, seen, blocks, 0.2)


def test_of_horizons_that_predict_the_same_the_shortest_is_chosen() -> None:
    errors = np.array([[1.0, 4.0, 9.0], [1.0, 4.0, 9.0], [1.0, 4.0, 9.0]])
    errors[1] *= 1.0 - 0.5 * SAME
    errors[2] *= 1.0 - 0.2 * SAME
    assert least_errors(errors) == 0
    errors[2] *= 1.0 - 10.0 * SAME
    assert least_errors(errors) == 2
