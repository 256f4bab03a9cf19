"""Columns without names: recognised by their numbers, or left open."""

import numpy as np
import pytest

from ballbot.log.mapping_inference.evidence import CONFIDENT, Conclusion
from ballbot.log.mapping_inference.roles import Roles, roles_by_data
from tests.support.foreign_log_examples import Habits, columns_of, small_robot, swaying_log


def unnamed(habits: Habits, *names: str) -> tuple[Roles | None, list[str]]:
    """Return the roles of columns of a foreign log, in this order and without their names, and the columns used."""
    logged = columns_of(swaying_log(), habits)
    table = {f"column_{place}": logged[name] for place, name in enumerate(names, start=1)}
    found = roles_by_data(table, small_robot())
    if found is None:
        return None, []
    meant = dict(zip(table, names, strict=True))
    return found, [meant[name] for name in (*found.attitude, *found.angles, *found.commands)]


LEAN, WHEELS, COMMANDS = ("theta_x", "theta_y", "theta_z"), ("psi_1", "psi_2", "psi_3"), ("u1", "u2", "u3")


@pytest.mark.parametrize(
    "habits",
    [
        Habits(),
        Habits(order=(2, 1, 3), signs=(1, -1, 1), turn=1.0),
        Habits(signs=(-1, -1, -1), command_sign=-1, counts=True),
        Habits(order=(3, 1, 2), signs=(-1, 1, 1), degrees=False, full_duty=255.0),
    ],
)
def test_lean_heading_wheels_and_commands_are_found_in_any_order_and_with_any_signs(habits):
    found, columns = unnamed(habits, "t_now", *LEAN, *WHEELS, *COMMANDS)
    assert columns == [*LEAN, *WHEELS, *COMMANDS]
    assert found is not None
    assert found.confidence >= 0.85


def test_a_log_without_a_heading_has_none():
    found, columns = unnamed(Habits(yaw=False), "t_now", *LEAN[:2], *WHEELS, *COMMANDS)
    assert found is not None
    assert columns == [*LEAN[:2], *WHEELS, *COMMANDS]


def test_columns_between_lean_and_wheels_that_may_be_a_heading_leave_it_open():
    logged = columns_of(swaying_log(), Habits())
    still = 1e-3 * np.random.default_rng(5).standard_normal(len(logged["t_now"]))
    named = {"t": logged["t_now"], "a": logged["theta_x"], "b": logged["theta_y"], "c": still}
    named |= {name: logged[name] for name in (*WHEELS, *COMMANDS)}
    found = roles_by_data(named, small_robot())
    assert found is not None
    assert len(found.attitude) == 2
    assert found.confidence < CONFIDENT


@pytest.mark.parametrize(
    ("confidence", "shown"), [(0.999, "> 99"), (0.991, "> 99"), (0.98, "98"), (0.8999, "89")]
)
def test_no_confidence_is_shown_as_certain_or_above_what_it_is(confidence, shown):
    assert Conclusion(name="", value="", confidence=confidence, evidence="").percent == shown
