"""Bristles of one axis: in the inverse model, at the starts of windows, and whether a record contradicts them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.identification.axis import AXIS_LAWS, AxisOptions, identify_axis
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.inverse import free_inverse_fit
from ballbot.identification.axis.motion import bent_bristles
from ballbot.identification.axis.output_error import OutputErrorFit, sighting
from ballbot.identification.axis.presliding import bristles_agree, bristles_travel
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import blocks_of, problem_of
from ballbot.identification.axis.structure import AxisModel
from ballbot.identification.axis.terms import select_terms
from tests.support.axis_examples import TRUTH, simulated_record

BRISTLES = TRUTH | {"stiffness": 1e5}
#: a small gear motor whose bristles bend over 2.5 mrad
SMALL = {"mass": 0.05, "viscous": 0.2, "coulomb": 1.5, "stiffness": 600.0}
COULOMB = AxisModel(law=AXIS_LAWS["coulomb"])


def small_motions() -> AxisRecord:
    """Return a record of `SMALL` with quick reversals of 30 mrad, by steps that share no code with the package."""
    interval, substeps, duration = 1e-3, 20, 12.0
    t = np.arange(0.0, duration, interval)
    wanted = 0.2 * np.sin(1.3 * t) + 0.015 * np.sin(11.0 * t) + 0.012 * np.sin(17.3 * t + 1.0)
    M, b, c, sigma = SMALL.values()
    q, v, z, h = 0.0, 0.0, 0.0, interval / substeps
    positions, torques = [], []
    for reference in wanted:
        torque = 200.0 * (reference - q) - 3.0 * v
        positions.append(q)
        torques.append(torque)
        for _ in range(substeps):
            z += h * (v - sigma * abs(v) * z / c)
            v += h * (torque - sigma * z - b * v) / M
            q += h * v
    noise = np.random.default_rng(1).standard_normal((2, len(t)))
    return AxisRecord(
        name="small",
        sample_time=interval,
        position=np.array(positions) + 2e-6 * noise[0],
        force=np.array(torques) + 0.02 * noise[1],
        unit="rad",
    )


@pytest.fixture(scope="module")
def small() -> AxisRecord:
    return small_motions()


def fit_of(law: str, **values: float) -> OutputErrorFit:
    model = AxisModel(law=AXIS_LAWS[law])
    chosen = {label: values[label] for label in model.labels}
    return OutputErrorFit(model=model, values=chosen, standard_errors=dict.fromkeys(chosen, 0.0), rms=0.0)


@settings(deadline=None)
@given(
    travel=st.floats(1e-6, 1e3),
    moves=st.lists(st.floats(-1e3, 1e3, allow_subnormal=False), min_size=1, max_size=30),
    parts=st.integers(1, 5),
)
def test_bristles_bend_by_the_way_and_not_by_the_rows(travel: float, moves: list[float], parts: int) -> None:
    ends = np.concatenate([[0.0], np.cumsum(moves)])
    rows = np.interp(np.arange(len(moves) * parts + 1) / parts, np.arange(len(ends)), ends)
    bent = bent_bristles(rows, travel)
    assert np.all(np.abs(bent) <= 1.0)
    # rounding of the positions, over the travel
    tolerance = 1e-9 + 1e-13 * np.abs(ends).max() / travel
    np.testing.assert_allclose(bent[::parts], bent_bristles(ends, travel), atol=tolerance)


def test_the_inverse_model_with_bristles_finds_an_axis_of_small_motions(small: AxisRecord) -> None:
    step = free_inverse_fit(small, model=COULOMB)
    # a step takes what bends for viscous friction
    assert step.value("mass") < 0.1 * SMALL["mass"]
    model, terms = select_terms((small,), COULOMB)
    assert not terms
    assert model.bending == pytest.approx(SMALL["coulomb"] / SMALL["stiffness"], rel=0.1)
    found = free_inverse_fit(small, model=model, moving=True)
    for name in ("mass", "viscous", "coulomb"):
        assert found.value(name) == pytest.approx(SMALL[name], rel=0.05)
    assert not record_findings(small)


def test_a_step_serves_an_axis_that_slides() -> None:
    sliding = simulated_record(law="coulomb", values=TRUTH, duration=6.0)
    assert bristles_travel((sliding,), COULOMB) == 0.0


def test_windows_of_small_motions_begin_with_bent_bristles(small: AxisRecord) -> None:
    truth = fit_of("dahl", offset=0.0, **SMALL)
    blocks, seen = blocks_of([small]), [sighting(small, 20.0)]
    problem = problem_of(truth.model, seen, blocks, 0.1)
    # a constant speed is off by 0.25 mrad; bristles that begin bent fully, by ten times that
    assert problem.rms(truth.values) < 0.05e-3


@pytest.mark.sample
def test_an_axis_of_small_motions_is_identified(small: AxisRecord) -> None:
    found = identify_axis(small)
    assert found.chosen.name == "dahl"
    for name, truth in SMALL.items():
        assert found.best.values[name] == pytest.approx(truth, rel=0.05)


def rested(law: str) -> AxisRecord:
    """Return the record of an axis that its loop moves to and fro, and by less than its bristles' travel."""
    whole = simulated_record(law=law, values=BRISTLES, duration=6.0)
    assert whole.reference is not None
    still = np.clip(whole.reference, 0.05, 0.15)
    t = whole.t
    small = 1e-4 * np.sin(2.0 * np.pi * 2.0 * t) * (np.diff(still, append=still[-1]) == 0.0)
    return simulated_record(law=law, values=BRISTLES, duration=6.0, wanted=still + small)


def test_an_axis_that_yields_at_rest_has_bristles_and_one_that_sticks_has_none() -> None:
    yields, sticks = (sighting(rested(law), 20.0) for law in ("dahl", "coulomb"))
    bristles = fit_of("dahl", **BRISTLES)
    assert bristles_agree(bristles, [yields])
    assert not bristles_agree(bristles, [sticks])
    # a travel of a picometre is not seen in a position
    assert not bristles_agree(fit_of("dahl", **(BRISTLES | {"stiffness": 2e13})), [yields])


@pytest.mark.sample
@pytest.mark.parametrize("law", ["dahl", "coulomb"])
def test_bristles_are_selected_where_they_are(law: str) -> None:
    found = identify_axis(rested(law), options=AxisOptions(harmonics=(), spring=False, drift=False))
    assert found.chosen.name == law
    assert found.best.values["coulomb"] == pytest.approx(20.0, rel=0.1)
