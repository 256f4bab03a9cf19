"""The inverse model of one axis, against the published numbers of EMPS and against simulated truth."""

import numpy as np
import pytest

from ballbot.identification.axis import AxisRecord, inverse_fit
from ballbot.identification.axis.model import AXIS_LAWS, AxisModel
from ballbot.identification.axis.reading import AxisColumns, read_axis_record
from tests.support.axis_examples import TRUTH, simulated_record

#: Janot, Gautier and Brunot, Data set and reference models of EMPS, 2019
PUBLISHED = {
    "mass": (95.1089, 0.1085),
    "viscous": (203.5034, 1.1460),
    "coulomb": (20.3935, 0.1012),
    "offset": (-3.1648, 0.0444),
}
PUBLISHED_ASYMMETRIC = {
    "mass": 95.1540,
    "viscous_plus": 166.7061,
    "coulomb_plus": 20.1440,
    "viscous_minus": 240.4236,
    "coulomb_minus": 20.6277,
}


COULOMB = AxisModel(law=AXIS_LAWS["coulomb"])


@pytest.fixture(scope="module")
def emps(shared_data) -> AxisRecord:
    columns = AxisColumns(position="qm", force="vir", force_scale="gtau")
    return read_axis_record(shared_data / "emps" / "DATA_EMPS.mat", columns)


def test_published_parameters_and_standard_deviations_to_every_digit(emps):
    found = inverse_fit(emps, COULOMB)
    for name, (value, deviation) in PUBLISHED.items():
        assert round(found.value(name), 4) == value
        assert round(float(found.standard_deviations[found.names.index(name)]), 4) == deviation
    assert round(100.0 * found.relative_force_error, 4) == 4.0834


def test_published_asymmetric_parameters_to_every_digit(emps):
    found = inverse_fit(emps, AxisModel(law=AXIS_LAWS["asymmetric"]))
    assert {name: round(found.value(name), 4) for name in found.names} == PUBLISHED_ASYMMETRIC
    assert round(100.0 * found.relative_force_error, 4) == 3.1117


def test_clustered_standard_errors_are_larger(emps):
    found = inverse_fit(emps, COULOMB)
    assert np.all(found.clustered_errors > 1.5 * found.standard_deviations)


def test_known_parameters_come_back():
    found = inverse_fit(simulated_record(), COULOMB)
    for name, value in TRUTH.items():
        # the filters round off reversals: one percent of the force, whose root mean square is about 60 N
        assert found.value(name) == pytest.approx(value, rel=0.03, abs=0.6)


def test_friction_below_zero_is_held_at_zero():
    """An axis that a force along its speed pushes has less than no viscous friction."""
    record = simulated_record()
    speed = np.gradient(record.position, record.sample_time)
    pushed = AxisRecord(
        name="pushed", sample_time=1e-3, force=record.force - 240.0 * speed, position=record.position
    )
    assert inverse_fit(pushed, COULOMB, signed=True).value("viscous") < 0.0
    held = inverse_fit(pushed, COULOMB)
    assert held.value("viscous") == 0.0
    assert np.isnan(held.clustered_errors[held.names.index("viscous")])
    assert held.value("coulomb") > 0.0
