"""Findings are ordered by severity, and errors stop a command unless their codes are accepted."""

import pytest

from ballbot.errors import InputError
from ballbot.findings import Finding, Place, by_severity, stop_on_errors

SIGN = Finding(
    code="torque-sign", severity="error", text="The torques are negated.", where=Place(file="a.csv")
)
DEAD = Finding(code="dead-motor", severity="error", text="Motor 2 does nothing.")
GAP = Finding(code="gap", severity="warning", text="One gap in time.")
USE = Finding(code="use", severity="note", text="Not enough for drivelines.")


def test_errors_come_first_and_order_is_kept_within_a_severity():
    assert by_severity([USE, GAP, SIGN, DEAD]) == (SIGN, DEAD, GAP, USE)


def test_warnings_and_notes_do_not_stop():
    stop_on_errors([GAP, USE])


def test_an_error_stops_with_its_file_its_text_and_the_option_that_goes_on():
    with pytest.raises(InputError) as refusal:
        stop_on_errors([SIGN, DEAD, GAP])
    assert str(refusal.value).startswith("a.csv: The torques are negated. (1 more")
    assert str(refusal.value).endswith("--accept torque-sign --accept dead-motor.")


def test_accepted_errors_do_not_stop():
    with pytest.raises(InputError, match="Motor 2"):
        stop_on_errors([SIGN, DEAD], accept=["torque-sign"])
    stop_on_errors([SIGN, DEAD], accept=["torque-sign", "dead-motor"])
