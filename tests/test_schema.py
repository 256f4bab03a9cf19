"""Every mistake in a TOML file ends in a sentence of ours: the key, what it holds, what it may hold."""

import pytest

from ballbot.errors import InputError
from ballbot.log.mapping import LogMapping
from ballbot.schema import validate_table
from ballbot.workflows.courses import CourseTable

DUTY = {
    "kind": "pwm",
    "from": ["u1", "u2", "u3"],
    "supply_voltage": 12.0,
    "torque_constant": 0.01,
    "back_emf_constant": 0.01,
    "gear_ratio": 70.0,
}


def mapping(**changes):
    return {"columns": {"t": "t"}, "input": DUTY | changes}


@pytest.mark.parametrize(
    ("tree", "key", "words"),
    [
        (mapping(kind="curent"), "input.kind is 'curent'", "mean 'current'? It must be 'current', 'duty'"),
        ({"columns": {"t": "t"}, "input": {"from": ["a"]}}, "input.kind is missing", "'current', 'duty'"),
        ({"columns": {"t": "t"}, "input": {"kind": "pwm"}}, "input.from is missing", "[input] needs it"),
        (mapping(gear_ration=2.0), "input.gear_ration is not a key of a file", "did you mean 'gear_ratio'?"),
        (mapping(gear_ratio=-1), "input.gear_ratio is -1", "above 0"),
        (mapping(gear_ratio="70"), "input.gear_ratio is '70'", "a number"),
        (mapping(gear_ratio=True), "input.gear_ratio is true", "a number"),
        (mapping(duty_limit=1.5), "input.duty_limit is 1.5", "at most 1"),
        (mapping(delay=float("inf")), "input.delay is inf", "a finite number"),
        (mapping(sign="-"), "input.sign is '-'", "1, -1 or a list"),
        (mapping(sign=[1, 0, 1]), "input.sign[2] is 0", "1 or -1"),
        (mapping() | {"file": {"rows": [1, 2, 3]}}, "file.rows has 3 entries", "at most 2"),
        (mapping() | {"time": True}, "time is true", "a table: write its keys below a line [time]"),
        (mapping() | {"x": {}}, "x is not a key", "the keys there are complete, file, time, columns"),
        ({}, "columns is missing", "a file needs it"),
    ],
)
def test_a_mistake_ends_in_its_key_and_what_it_may_hold(tree, key, words):
    with pytest.raises(InputError) as refused:
        validate_table(LogMapping, tree, of="a file")
    said = str(refused.value)
    assert said.startswith(key)
    assert words in said
    assert "\n" not in said
    for theirs in ("Input should", "input should", "valid ", " tag", "discriminator"):
        assert theirs not in said


def test_the_member_of_a_union_that_was_meant_is_refused():
    tree = {"reference": {"name": "hold", "x": [1]}, "duration": 1.0}
    with pytest.raises(InputError, match=r"reference\.x is \[1\]; it must be a number or a text in quotes"):
        validate_table(CourseTable, tree, of="a file")
