"""Methods that identify an axis are compared whatever laws they have, and only where they can be."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot.identification.axis import AXIS_LAWS, AxisRecord, inverse_fit
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.comparison import disagreements, largest_differences
from ballbot.identification.axis.conclusions import inverse_mass_findings
from ballbot.identification.axis.discrepancy import with_discrepancy
from ballbot.identification.axis.identify import inverse_estimates
from ballbot.identification.axis.loop_law import fitted_loop_law
from ballbot.identification.axis.preparation import Bench
from ballbot.identification.axis.result import Estimate
from ballbot.identification.axis.structure import AxisModel
from tests.support.axis_examples import TRUTH, simulated_record

STRIBECK = TRUTH | {"stribeck": 12.0, "stribeck_speed": 0.05}


@cache
def record(law: str) -> AxisRecord:
    return simulated_record(law=law, values=STRIBECK if law == "stribeck" else TRUTH, duration=9.0, noise=1.0)


def estimate(method: str, law: str, values: dict[str, float], error: float = 0.01) -> Estimate:
    errors = {name: error * abs(value) for name, value in values.items()}
    return Estimate(
        method=method,
        model=AxisModel(law=AXIS_LAWS[law]),
        values=values,
        standard_errors=errors,
        half_widths={name: 2.0 * one for name, one in errors.items()},
        errors=(),
    )


def inverse(of: AxisRecord) -> Estimate:
    fit = inverse_fit(of, model=AxisModel(law=AXIS_LAWS["coulomb"]), moving=True)
    errors = dict(zip(fit.names, fit.clustered_errors.tolist(), strict=True))
    return Estimate(
        method="inverse",
        model=AxisModel(law=AXIS_LAWS["coulomb"]),
        values=fit.by_name,
        standard_errors=errors,
        half_widths=errors,
        errors=(),
    )


def differences(of: AxisRecord, best: Estimate) -> list[str]:
    return [one.finding.text for one in disagreements([of], best, [inverse(of), best])]


def test_a_law_without_dry_friction_is_compared_with_the_inverse_model() -> None:
    best = estimate("open loop", "viscous", {"mass": 95.0, "viscous": 290.0, "offset": -3.0})
    texts = differences(record("coulomb"), best)
    assert any("b is 290 N s/m by the open loop, with the law viscous, and 20" in text for text in texts)
    assert any("c is zero by the open loop, with the law viscous, and " in text for text in texts)
    assert not any(text.startswith("M ") for text in texts)


def test_a_stribeck_curve_is_no_difference() -> None:
    """The inverse model's straight lines are far from b and c of the curve, and as far as they should be."""
    found = inverse(record("stribeck"))
    assert abs(found.values["viscous"] / STRIBECK["viscous"] - 1.0) > 0.1
    assert differences(record("stribeck"), estimate("open loop", "stribeck", STRIBECK)) == []


def test_a_wrong_mass_is_found_beside_a_stribeck_curve() -> None:
    wrong = estimate("open loop", "stribeck", STRIBECK | {"mass": 120.0})
    (text,) = differences(record("stribeck"), wrong)
    assert text.startswith("M is 120 kg by the open loop, with the law stribeck, and 9")


def test_an_inverse_model_without_a_mass_is_no_estimate() -> None:
    """The mass of a light motor that steps, with a late force, was below zero, and could not be simulated."""
    of = record("coulomb")
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    fit = inverse_fit(of, model=model, moving=True)
    bench = Bench(records=(of,), others=(), bandwidth=None)
    (usual,) = inverse_estimates(bench, fit, model, 0.2)
    assert inverse_mass_findings(fit, [usual], "m") == []
    below = replace(fit, values=np.where(np.array(fit.names) == "mass", -0.8, fit.values))
    assert inverse_estimates(bench, below, model, 0.2) == []
    (found,) = inverse_mass_findings(below, [], "m")
    assert found.text.startswith("The inverse model estimates a mass of -0.8")


def test_methods_of_one_law_are_compared_by_their_numbers() -> None:
    (text,) = differences(record("coulomb"), estimate("open loop", "coulomb", TRUTH | {"viscous": 300.0}))
    assert text.startswith("b is 300 N s/m by the open loop and ")


def test_the_interval_includes_what_another_method_finds() -> None:
    of, best = record("coulomb"), estimate("open loop", "coulomb", TRUTH | {"viscous": 300.0})
    other = inverse(of)
    found = disagreements([of], best, [other])
    (text,) = (one.finding.text for one in found)
    assert text.endswith("The 95 % interval of b includes this difference.")
    quantile = 2.0
    errors = {name: size / quantile for name, size in largest_differences(found).items()}
    wider = with_discrepancy(best, errors, quantile)
    assert wider.half_widths["viscous"] > abs(300.0 - other.values["viscous"]) > best.half_widths["viscous"]
    assert wider.half_widths["mass"] == best.half_widths["mass"]
    # one number, with one meaning, wherever it is written
    written = json.loads(json.dumps(wider.to_dict()))
    low, high = written["intervals_95"]["viscous"]
    assert high - low == pytest.approx(2.0 * quantile * written["standard_errors"]["viscous"])


@pytest.mark.parametrize("factor", [1.0, 1.2])
def test_another_loop_is_no_error_of_the_result(factor: float) -> None:
    of = record("coulomb")
    assert of.loop is not None
    of = replace(of, loop=replace(of.loop, position_gain=factor * of.loop.position_gain))
    law = fitted_loop_law(of)
    assert law is not None
    assert (law.position * factor, law.velocity) == (
        pytest.approx(1.0, abs=0.01),
        pytest.approx(1.0, abs=0.01),
    )
    assert law.differs == (factor != 1.0)
    assert [one.code for one in record_findings(of)] == (["axis-loop"] if law.differs else [])
    best = estimate("open loop", "coulomb", TRUTH)
    (found,) = disagreements([of], best, [estimate("closed loop", "coulomb", TRUTH | {"viscous": 150.0})])
    assert largest_differences([found]) == ({} if law.differs else {"viscous": 50.0})
    assert found.finding.text.endswith(
        "does not include this difference." if law.differs else "includes this difference."
    )


def test_the_largest_difference_of_several_methods_counts() -> None:
    of, best = record("coulomb"), estimate("open loop", "coulomb", TRUTH | {"viscous": 300.0})
    closed = estimate("closed loop", "coulomb", TRUTH | {"viscous": 150.0})
    assert largest_differences(disagreements([of], best, [inverse(of), closed])) == {"viscous": 150.0}
