"""Dry friction of an axis that grows with a load: against a simulation of other origin, and laws with more friction."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.identification.axis import (
    AXIS_LAWS,
    AxisOptions,
    AxisRecord,
    identify_axis,
    inverse_fit,
    preparation,
)
from ballbot.identification.axis.load import (
    LOADS,
    Load,
    force_with_load_friction,
    load_at,
    load_named,
)
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.preparation import Bench, prepared_records, with_missed_load
from ballbot.identification.axis.selection import blocks_of
from ballbot.identification.axis.structure import AxisModel
from ballbot.identification.axis.terms import select_terms
from campaigns.axis_machines import Logging, Machine, record_of
from tests.support.axis_examples import LOOP, reference

SHARES = {"position": (0.0, 1.0), "transmitted": (0.5, 0.5), "drive": (1.0, 0.0)}
PENDULUM = Machine(kind="pendulum", inertia=0.03, viscous=0.03, coulomb=0.06, gravity=(2.0, 0.0))
LOGGED = Logging(duration=15.0, rate=250.0, amplitude=1.2, counts=4096.0, force_noise=0.01)
PLAIN = AxisModel(law=AXIS_LAWS["coulomb"])
MU = 0.1


def geared(kind: str, seed: int = 1) -> AxisRecord:
    """Return the record of a pendulum whose gears have friction over that load."""
    return record_of(replace(PENDULUM, gears=(MU, *SHARES[kind])), LOGGED, seed)


@pytest.mark.parametrize("kind", ["position", "transmitted", "drive"])
def test_the_load_is_selected_and_the_inverse_model_finds_its_friction(kind: Load) -> None:
    model, gains = select_terms([geared(kind)], PLAIN)
    assert model.load == kind
    assert dict(gains)[f"load {kind}"].lower > 0.1
    # the filtered motion of an encoder biases c and mu by some percent; without the load c is 0.13, more than twice it
    found = inverse_fit([geared(kind)], model=model, moving=True).by_name
    assert found["coulomb"] == pytest.approx(PENDULUM.coulomb, rel=0.15)
    assert found["load"] == pytest.approx(MU, rel=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_load_is_selected_without_its_friction(seed: int) -> None:
    model, _ = select_terms([record_of(PENDULUM, LOGGED, seed)], PLAIN)
    assert "sin_1" in model.terms
    assert model.load is None


def test_a_gravity_that_is_not_yet_found_is_no_load() -> None:
    # the drive's force contains it
    heavy = replace(PENDULUM, gravity=(2.0, 0.6), load=replace(PENDULUM.load, inertia=0.03, weight=2.0))
    model, gains = select_terms([record_of(heavy, replace(LOGGED, rate=100.0, amplitude=0.8), 5)], PLAIN)
    assert gains[0][0] == "harmonic 1"
    assert model.load is None


@pytest.mark.sample
@pytest.mark.parametrize("kind", ["position", "transmitted", "drive"])
def test_friction_under_load_is_identified(kind: Load) -> None:
    options = AxisOptions(law="coulomb", harmonics=(1,), spring=False, drift=False)
    found = identify_axis(geared(kind), options=options)
    assert found.model.load == kind
    for name, truth in (("coulomb", 0.06), ("viscous", 0.03), ("load", MU), ("mass", 0.03)):
        value, half = found.best.values[name], found.best.half_widths[name]
        # a few of twelve 95 % intervals may miss, none by a whole one
        assert abs(value - truth) < 2.0 * half
        assert value == pytest.approx(truth, rel=0.1)
    assert not any(one.dependent for one in found.residuals if one.quantity == "load")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "load"),
    [
        (replace(PENDULUM, gears=(MU, *SHARES["position"])), "position"),
        # friction that falls with speed is largest where a pendulum turns, as its load is
        (replace(PENDULUM, stribeck=0.05, stribeck_speed=0.3), None),
    ],
    ids=["gears", "stribeck"],
)
def test_a_load_that_the_inverse_model_misses_is_selected_by_the_open_loop(
    machine: Machine, load: Load | None
) -> None:
    record = record_of(machine, LOGGED, 1)
    bench = Bench(records=(record,), others=(), bandwidth=None)
    options = AxisOptions(harmonics=(1,), spring=False, drift=False, load_friction="none")
    missed = prepared_records(bench, options, blocks_of([record]))
    found = with_missed_load(missed, AXIS_LAWS["coulomb"], missed.blocks, 0.2)
    assert missed.model.load is None
    assert found.model.load == load
    assert [name for name, _ in found.terms] == ([f"load {load}"] if load else [])


@pytest.mark.parametrize("interpolated", [False, True])
def test_forces_are_selected_as_they_act_between_rows(
    monkeypatch: pytest.MonkeyPatch, interpolated: bool
) -> None:
    """Half a row of 8 ms hid a servo's friction under load, which was a fifth of its dry friction."""
    tried = list[bool]()

    def select(_: object, model: AxisModel, **__: object) -> tuple[AxisModel, tuple[()]]:
        tried.append(model.interpolated)
        return model, ()

    monkeypatch.setattr(preparation, "select_terms", select)
    monkeypatch.setattr(preparation, "is_interpolated", lambda *_: interpolated)
    record = geared("position")
    bench = Bench(records=(record,), others=(), bandwidth=None)
    options = AxisOptions(harmonics=(1,), spring=False, drift=False)
    found = prepared_records(bench, options, blocks_of([record]))
    assert found.model.interpolated is interpolated
    assert tried[-1] is interpolated


@pytest.mark.parametrize("law", ["coulomb", "stribeck", "dahl", "lugre", "asymmetric"])
def test_under_a_constant_load_an_axis_moves_as_one_with_more_coulomb_friction(law: str) -> None:
    values = {
        "mass": 95.0,
        "viscous": 200.0,
        "coulomb": 20.0,
        "offset": -3.0,
        "load": 0.25,
        "stribeck": 5.0,
        "stribeck_speed": 0.01,
        "stiffness": 1e5,
        "micro_damping": 50.0,
        "viscous_plus": 210.0,
        "viscous_minus": 190.0,
        "coulomb_plus": 22.0,
        "coulomb_minus": 18.0,
    }
    wanted = reference(2.0)
    record = AxisRecord(
        name="slide",
        sample_time=1e-3,
        force=np.zeros(len(wanted)),
        position=wanted,
        reference=wanted,
        loop=LOOP,
        load=np.full(len(wanted), -40.0),  # of either sign
    )
    more = {name: values[name] + 10.0 for name in values if name.startswith("coulomb")}
    loaded, plain = (
        Axis(law=AXIS_LAWS[law], values=own, load=load).closed_loop(record, speed=0.1)
        for own, load in ((values, "recorded"), (values | more, None))
    )
    # the same arithmetic but for one sum
    np.testing.assert_allclose(loaded.positions, plain.positions, rtol=0.0, atol=1e-9)
    assert np.abs(loaded.forces).max() > 20.0


@given(
    st.sampled_from(list(LOADS)),
    st.floats(0.0, 0.9),
    st.floats(-5.0, 5.0),
    st.floats(-5.0, 5.0),
    st.floats(-5.0, 5.0),
    st.floats(-1.0, 1.0),
)
def test_the_force_of_a_motion_balances_its_load_friction(kind, mu, needed, field, recorded, sign) -> None:
    needed, field, sign = (np.array([one]) for one in (needed, field, sign))
    column = np.array([recorded if kind == "recorded" else 0.0])
    force = force_with_load_friction(kind, mu, needed, field, column, sign)
    assert force == pytest.approx(needed + sign * mu * load_at(kind, force, field, column), abs=1e-9)


def test_a_load_that_the_records_do_not_have_is_refused() -> None:
    slide = AxisRecord(
        name="slide",
        sample_time=1e-3,
        force=np.sin(np.arange(8000) * 0.01),
        position=np.sin(np.arange(8000) * 0.01),
    )
    flat = AxisOptions(load_friction="recorded", spring=False, drift=False)
    with pytest.raises(InputError, match=r"only with a load in every record \(--load\)"):
        identify_axis(slide, options=flat)
    with pytest.raises(InputError, match="only with a force over position"):
        identify_axis(slide, options=replace(flat, load_friction="drive"))
    with pytest.raises(InputError, match=r"no load 'transmited'.*transmitted"):
        load_named("transmited")


@pytest.mark.sample
def test_of_loads_that_resemble_each_other_the_open_loop_takes_the_closest() -> None:
    # of seven records of such a machine of which the inverse model names another load, three are put right, this too
    small = Machine(
        kind="pendulum",
        inertia=0.0077,
        viscous=0.023,
        coulomb=0.196,
        gravity=(0.68, 0.0),
        gears=(0.06, *SHARES["transmitted"]),
    )
    logged = Logging(duration=12.0, rate=100.0, amplitude=1.2, counts=4096.0, force_noise=0.014)
    record = record_of(small, logged, 8)
    assert select_terms([record], PLAIN)[0].load == "drive"
    options = AxisOptions(law="coulomb", harmonics=(1,), spring=False, drift=False)
    assert identify_axis(record, options=options).model.load == "transmitted"
