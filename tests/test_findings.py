"""Findings: ordered by severity, errors stop a command unless accepted, and every code is in the one registry.

The registry is what `--accept` knows.
"""

import ast
import re

import pytest

from ballbot.errors import InputError
from ballbot.findings import CODES, Finding, Place, check_codes, stop_on_errors
from ballbot.log.checks.table import CHECKS
from tests.support.source import modules, nodes_of

SIGN = Finding(
    code="torque-sign", severity="error", text="The torques are negated.", where=Place(file="a.csv")
)
DEAD = Finding(code="dead-motor", severity="error", text="Motor 2 does nothing.")
GAP = Finding(code="gap", severity="warning", text="One gap in time.")


def test_error_stops_with_file_text_and_the_accepting_option():
    with pytest.raises(InputError) as refusal:
        stop_on_errors([SIGN, DEAD, GAP])
    assert str(refusal.value).startswith("a.csv: The torques are negated. (1 more")
    assert str(refusal.value).endswith("--accept torque-sign --accept dead-motor.")


def test_accepted_errors_do_not_stop():
    with pytest.raises(InputError, match="Motor 2"):
        stop_on_errors([SIGN, DEAD], accept=["torque-sign"])
    stop_on_errors([SIGN, DEAD], accept=["torque-sign", "dead-motor"])


def test_every_code_made_in_the_source_is_registered_and_every_registered_one_is_made():
    nodes = [node for name in modules() if name != "ballbot.findings" for node in nodes_of(name)]
    written = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert set(CODES) <= written | {name.partition(":")[0] for name in CHECKS}
    made = {
        node.args[0].value
        for node in nodes
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
        if node.func.id in ("error", "warning", "note", "finding") and isinstance(node.args[0], ast.Constant)
    }
    assert made <= set(CODES)


def test_codes_are_kebab_case_and_in_alphabetical_order():
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)*", code) for code in CODES)
    assert list(CODES) == sorted(CODES)


def test_an_unknown_code_is_refused_with_the_nearest():
    assert check_codes(["gap", "sign", "gap"]) == ("gap", "sign")
    with pytest.raises(InputError, match=r"no finding with the code 'signs'.*did you mean 'sign'"):
        check_codes(["signs"])
    with pytest.raises(InputError, match="the codes are adequacy, "):
        check_codes(["qqqqqq"])
