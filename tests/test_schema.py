"""Every mistake in a TOML file ends in a sentence of ours: the key, what it holds, what it may hold."""

import pytest

from ballbot.control.file import ControllerTable
from ballbot.errors import InputError
from ballbot.log.mapping import MappingTable
from ballbot.schema import validate_table
from ballbot.twin.scenario import Scenario
from ballbot.workflows.courses import CourseTable

DUTY = {
    "kind": "pwm",
    "from": ["u1", "u2", "u3"],
    "supply_voltage": 12.0,
    "torque_constant": 0.01,
    "back_emf_constant": 0.01,
    "resistance": 2.0,
    "gear_ratio": 70.0,
}


def mapping(**changes):
    return {"columns": {"t": "t"}, "input": DUTY | changes}


@pytest.mark.parametrize(
    ("schema", "tree", "sentence"),
    [
        (
            MappingTable,
            mapping(kind="curent"),
            "input.kind is 'curent'; did you mean 'current'? "
            "It must be 'torque', 'current', 'duty', 'pwm' or 'voltage'.",
        ),
        (
            MappingTable,
            mapping(kind="volts"),
            "input.kind is 'volts'; did you mean 'voltage'? "
            "It must be 'torque', 'current', 'duty', 'pwm' or 'voltage'.",
        ),
        (
            MappingTable,
            {"columns": {"t": "t"}, "input": {"from": ["a"]}},
            "input.kind is missing; it must be 'torque', 'current', 'duty', 'pwm' or 'voltage'.",
        ),
        (
            MappingTable,
            mapping(kind=3),
            "input.kind is 3; it must be 'torque', 'current', 'duty', 'pwm' or 'voltage'.",
        ),
        (
            MappingTable,
            {"columns": {"t": "t"}, "input": {one: DUTY[one] for one in DUTY if one != "resistance"}},
            "input.resistance is missing; [input] needs it.",
        ),
        (
            MappingTable,
            mapping(resistence=2.0),
            "input.resistence is not a key of a file; did you mean 'resistance'?",
        ),
        (MappingTable, mapping(gear_ratio=-1), "input.gear_ratio is -1; it must be above 0."),
        (MappingTable, mapping(gear_ratio="70"), "input.gear_ratio is '70'; it must be a number."),
        (MappingTable, mapping(gear_ratio=True), "input.gear_ratio is true; it must be a number."),
        (MappingTable, mapping(duty_limit=1.5), "input.duty_limit is 1.5; it must be at most 1."),
        (MappingTable, mapping(delay=float("inf")), "input.delay is inf; it must be a finite number."),
        (MappingTable, mapping(sign="-"), "input.sign is '-'; it must be 1, -1 or a list."),
        (MappingTable, mapping(sign=[1, 0, 1]), "input.sign[2] is 0; it must be 1 or -1."),
        (
            MappingTable,
            mapping() | {"file": {"separator": "semi-colon"}},
            "file.separator is 'semi-colon'; did you mean 'semicolon'? It must be 'comma', 'semicolon', 'tab' or "
            "'blanks'.",
        ),
        (
            MappingTable,
            mapping() | {"file": {"header_lines": 1.5}},
            "file.header_lines is 1.5; it must be a whole number.",
        ),
        (MappingTable, mapping() | {"file": {"rows": [1]}}, "file.rows has one entry; it needs more."),
        (
            MappingTable,
            mapping() | {"file": {"rows": [1, 2, 3]}},
            "file.rows has 3 entries; it must have at most 2.",
        ),
        (
            MappingTable,
            mapping() | {"time": True},
            "time is true; it must be a table: write its keys below a line [time].",
        ),
        (MappingTable, mapping() | {"columns": {"t": 3}}, "columns.t is 3; it must be a table"),
        (
            MappingTable,
            mapping() | {"whels": {}},
            "whels is not a key of a file; did you mean 'wheels'?",
        ),
        (
            MappingTable,
            mapping() | {"x": {}},
            "the keys there are complete, file, time, columns, attitude, wheels",
        ),
        (MappingTable, {}, "columns is missing; a file needs it."),
        (ControllerTable, {"compensation": "ful"}, "robot is missing; a file needs it."),
        (
            CourseTable,
            {"reference": 5, "duration": 1.0},
            "reference is 5; it must be a text in quotes or a table.",
        ),
        (
            CourseTable,
            {"reference": {"name": "hold", "x": [1]}, "duration": 1.0},
            "reference.x is [1]; it must be a number or a text in quotes.",
        ),
        (Scenario, {"backlash": 1}, "is missing; a file needs it."),
    ],
)
def test_schema_errors_end_in_our_sentences(schema, tree, sentence):
    with pytest.raises(InputError) as refused:
        validate_table(schema, tree, of="a file")
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)
    for theirs in ("Input should", "input should", "valid ", " tag", "discriminator"):
        assert theirs not in str(refused.value)
