"""Machines simulated apart from Ballbot, identified: their parameters within the intervals, their forces selected."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.identification.axis import AxisOptions, identify_axis
from campaigns.axis_machines import Logging, Machine, record_of

LOGGING = Logging(duration=8.0, rate=200.0, counts=2.0**16, slowest=0.2, fastest=1.2, force_noise=0.03)


def joint(**more: object) -> Machine:
    return replace(
        Machine(kind="joint", inertia=1.0, viscous=1.2, coulomb=2.0, offset=0.2),
        **more,  # pyright: ignore[reportArgumentType] (fields of a machine)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "terms"),
    [(joint(gravity=(8.0, 0.0)), ("gravity",)), (joint(kind="cart"), ())],
    ids=["joint", "slide"],
)
def test_intervals_contain_the_machine(machine: Machine, terms: tuple[str, ...]) -> None:
    found = identify_axis(record_of(machine, LOGGING, 1), options=AxisOptions(law="coulomb"))
    assert tuple(found.forces) == terms
    best = found.best
    for name in ("mass", "viscous", "coulomb"):
        truth = {"mass": machine.inertia, "viscous": machine.viscous, "coulomb": machine.coulomb}[name]
        # one run with three parameters; 5 % is twice the largest error of 54 such records
        assert abs(best.values[name] - truth) < min(1.5 * best.half_widths[name], 0.05 * truth)


@pytest.mark.slow
def test_friction_under_load_is_selected_and_found() -> None:
    machine = joint(gravity=(10.0, 0.0), gears=0.2)
    found = identify_axis(
        record_of(machine, replace(LOGGING, duration=12.0), 2), options=AxisOptions(law="coulomb")
    )
    assert found.forces.keys() == {"gravity", "load"}
    # the share of the load: shapes of c and mu resemble each other, 15 % apart at most
    assert found.best.values["load"] == pytest.approx(0.2, rel=0.15)


@pytest.mark.slow
def test_a_late_force_is_said() -> None:
    record = record_of(joint(), LOGGING, 3)
    late = replace(record, force=np.append(record.force[4:], np.full(4, record.force[-1])))
    found = identify_axis(late, options=AxisOptions(law="coulomb", gravity=False))
    assert "force-delay" in {one.code for one in found.findings}
