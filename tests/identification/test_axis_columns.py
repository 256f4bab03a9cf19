"""Columns of an axis's record that are stuck, a reference, a magnitude or a demand are named as such."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot.findings import Finding
from ballbot.identification.axis import AxisRecord
from ballbot.identification.axis.checks import record_findings
from tests.support.axis_examples import simulated_record


@cache
def record() -> AxisRecord:
    return replace(simulated_record(duration=9.0, noise=1.0), loop=None, reference=None)


def noisy(force: np.ndarray) -> AxisRecord:
    noise = 0.1 * np.random.default_rng(1).standard_normal(len(force))
    return replace(record(), force=np.asarray(force + noise, dtype=np.float64))


def found(of: AxisRecord, code: str) -> Finding:
    return next(one for one in record_findings(of) if one.code == code)


def test_a_position_that_is_stuck_while_the_axis_moves_is_an_error() -> None:
    position = record().position.copy()
    position[2000:2800] = position[2000]
    finding = found(replace(record(), position=position), "stuck")
    assert finding.severity == "error"
    assert "without change for 0.8 s (from row 2001" in finding.text


def test_a_force_that_is_stuck_while_the_axis_accelerates_is_an_error() -> None:
    force = noisy(record().force).force.copy()
    assert not any(one.code == "stuck" for one in record_findings(replace(record(), force=force)))
    force[2000:3500] = force[2000]
    finding = found(replace(record(), force=force), "stuck")
    assert finding.text.startswith("The force is")


@pytest.mark.parametrize("factor", [1.0, float(np.degrees(1.0)), 1000.0])
def test_a_reference_is_no_force(factor: float) -> None:
    led = np.append(record().position[20:], np.full(20, record().position[-1]))
    finding = found(replace(record(), force=factor * led), "force-unrelated")
    assert finding.severity == "error"
    assert "it appears to be the reference" in finding.text


def test_a_magnitude_is_no_force() -> None:
    finding = found(replace(record(), force=np.abs(record().force)), "force-sign")
    assert "it is the magnitude of a force or current" in finding.text
