"""Findings: ordered by severity, errors stop a command unless accepted, and every code is in the one registry.

The registry is what `--accept` knows.
"""

import ast
import re
from collections.abc import Iterable, Sequence

import pytest

from ballbot.errors import InputError
from ballbot.findings import CODES, Finding, Place, as_argument, check_codes, stop_on_errors
from ballbot.log.checks.table import CHECKS
from tests.support.source import modules, nodes_of

SIGN = Finding(
    code="torque-sign", severity="error", text="The torques are negated.", where=Place(file="a.csv")
)
DEAD = Finding(code="dead-motor", severity="error", text="Motor 2 does nothing.")
GAP = Finding(code="gap", severity="warning", text="One gap in time.")
USE = Finding(code="use", severity="note", text="Not enough for drivelines.")


def test_error_stops_with_file_text_and_the_accepting_option():
    with pytest.raises(InputError) as refusal:
        stop_on_errors([SIGN, DEAD, GAP])
    assert str(refusal.value).startswith("a.csv: The torques are negated. (1 more")
    assert str(refusal.value).endswith("--accept torque-sign --accept dead-motor.")


def test_accepted_errors_do_not_stop():
    with pytest.raises(InputError, match="Motor 2"):
        stop_on_errors([SIGN, DEAD], accept=["torque-sign"])
    stop_on_errors([SIGN, DEAD], accept=["torque-sign", "dead-motor"])


def _texts(node: ast.expr) -> set[str]:
    return {
        part.value
        for part in ast.walk(node)
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    }


def _argument(call: ast.Call, name: str, place: int | None) -> ast.expr | None:
    for keyword in call.keywords:
        if keyword.arg == name:
            return keyword.value
    return call.args[place] if place is not None and place < len(call.args) else None


def _calls(nodes: Iterable[ast.AST], name: str) -> list[ast.Call]:
    return [
        node
        for node in nodes
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
    ]


def _codes_in(nodes: Sequence[ast.AST], everywhere: Sequence[ast.AST]) -> set[str]:
    """Return the codes of all findings that a module makes, through its helper functions too.

    `everywhere` has the nodes of all modules, which may call those that do not begin with an underscore.
    """
    made = {id(call): _argument(call, "code", None) for call in _calls(nodes, "Finding")}
    codes = {code for value in made.values() if value is not None for code in _texts(value)}
    for function in (node for node in nodes if made and isinstance(node, ast.FunctionDef)):
        names = [one.arg for one in (*function.args.args, *function.args.kwonlyargs)]
        for call in _calls(ast.walk(function), "Finding"):
            value = made[id(call)]
            if isinstance(value, ast.Name) and value.id in names:
                callers = nodes if function.name.startswith("_") else everywhere
                for outer in _calls(callers, function.name):
                    given = _argument(outer, value.id, names.index(value.id))
                    codes |= _texts(given) if given is not None else set()
    for made_by in ("warning", "note", "error", "finding", "_of", "_Usual", "Way"):
        for call in _calls(nodes, made_by):
            given = _argument(call, "code", 0)
            codes |= _texts(given) if given is not None else set()
    return codes


def test_every_code_made_in_the_source_is_registered_and_every_registered_one_is_made():
    everywhere = [node for name in modules() for node in nodes_of(name)]
    made = {code for name in modules() for code in _codes_in(nodes_of(name), everywhere)}
    assert made | {name.partition(":")[0] for name in CHECKS} == set(CODES)


def test_codes_are_kebab_case_and_in_alphabetical_order():
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)*", code) for code in CODES)
    assert list(CODES) == sorted(CODES)


def test_an_unknown_code_is_refused_with_the_nearest():
    assert check_codes(["gap", "sign", "gap"]) == ("gap", "sign")
    with pytest.raises(InputError, match=r"no finding with the code 'signs'.*did you mean 'sign'"):
        check_codes(["signs"])
    with pytest.raises(InputError, match="the codes are alignment, "):
        check_codes(["qqqqqq"])


def test_python_names_the_argument_that_accepts():
    finding = Finding(code="sign", severity="error", text="The rate is negated.")
    with pytest.raises(InputError, match=r"To continue despite this: accept=\['sign'\]\."):
        stop_on_errors([finding], going_on=as_argument)
