"""The residual force of an axis is tested against the load that its drive transmits, and beside a Stribeck curve."""

from dataclasses import replace
from functools import cache

import numpy as np

from ballbot.identification.axis import AXIS_LAWS, AxisRecord
from ballbot.identification.axis.record import KnownLoad
from ballbot.identification.axis.residuals import ResidualTest, residual_findings, residual_tests
from ballbot.identification.axis.structure import AxisModel

PLAIN = AxisModel(law=AXIS_LAWS["coulomb"], interpolated=True)
T = np.arange(5000) * 4e-3
WEIGHT = 1.5  #: of the known load [N m]


def turned(friction: float = 0.0, stribeck: float = 0.0) -> AxisRecord:
    """Return a pendulum of known load moved along sines; friction of that share of the load, a curve over 0.2 rad/s."""
    waves = ((0.9, 1.3), (0.4, 3.1), (0.2, 5.7))
    q, v, a = (
        np.sum([size * w**k * np.sin(w * T + k * np.pi / 2.0 + size) for size, w in waves], axis=0)
        for k in range(3)
    )
    sign = np.sign(v)
    load = WEIGHT * np.sin(q)
    force = (0.005 + 0.02) * a + 0.03 * v + 0.06 * sign + load + friction * np.abs(load) * sign
    force += stribeck * np.exp(-np.abs(v) / 0.2) * sign
    noise = 2e-3 * np.random.default_rng(0).standard_normal(len(T))
    known = KnownLoad(inertia=0.02, weight=WEIGHT)
    force = np.asarray(force + noise, dtype=np.float64)
    return AxisRecord(name="turned", sample_time=4e-3, force=force, position=q, unit="rad", known_load=known)


@cache
def dependences(friction: float, stribeck: float, speed: float | None) -> dict[str, ResidualTest]:
    found = residual_tests([turned(friction, stribeck)], PLAIN, stribeck_speed=speed)
    return {one.quantity: one for one in found}


def test_friction_that_grows_with_a_known_load_is_a_warning() -> None:
    found = dependences(0.1, 0.0, None)["load"]
    assert found.large
    (one,) = residual_findings([found], PLAIN, [turned()])
    assert one.severity == "warning"
    assert "c, and perhaps b, contain friction that grows with the load" in one.text
    (other,) = residual_findings([found], replace(PLAIN, load="drive"), [turned()])
    assert other.severity == "note"
    assert "another --load-friction may suit it" in other.text


def test_friction_that_does_not_depend_on_a_known_load_is_none() -> None:
    assert not dependences(0.0, 0.0, None)["load"].dependent


def test_a_large_dependence_needs_less_significance() -> None:
    def dependent(p: float, share: float) -> bool:
        return ResidualTest(quantity="load", p_value=p, share=share, size=1.0).dependent

    assert [dependent(2e-3, 0.7), dependent(2e-3, 0.3), dependent(2e-2, 0.7)] == [True, False, False]


def test_a_stribeck_curve_of_the_law_is_no_residual() -> None:
    without, with_curve = (dependences(0.0, 0.05, speed)["speed"] for speed in (None, 0.2))
    assert without.dependent
    # what the filter leaves at the reversals remains
    assert with_curve.size < 0.6 * without.size
