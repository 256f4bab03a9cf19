"""Tables in JSON: lists of objects, objects of lists, and refusals in one sentence."""

import json

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log.formats.json import read_json_table

T, ROLL = [0.0, 0.005, 0.01], [0.1, None, 0.3]
ROWS = [{"t": t, "imu": {"roll": roll}, "w": [1, {"speed": t}]} for t, roll in zip(T, ROLL, strict=True)]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (json.dumps({"t": T, "roll": ROLL, "name": "r2"}), ["t", "roll"]),
        (json.dumps(ROWS), ["t", "imu.roll", "w_1", "w_2.speed"]),
        (json.dumps({"robot": "r2", "data": ROWS}), ["t", "imu.roll", "w_1", "w_2.speed"]),
        ("\n".join(map(json.dumps, ROWS)), ["t", "imu.roll", "w_1", "w_2.speed"]),
    ],
)
def test_lists_of_objects_objects_of_lists_and_lines_of_objects_are_one_table(tmp_path, text, names):
    (tmp_path / "log.json").write_text(text)
    columns = read_json_table(tmp_path / "log.json")
    assert list(columns) == names
    for values, wanted in zip(columns.values(), (T, [0.1, np.nan, 0.3], [1, 1, 1], T), strict=False):
        np.testing.assert_array_equal(values, wanted)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not JSON"),
        ("[1, 2]", "contains no table"),
        ("3", "contains no table"),
        ("[" * 5000, "is not JSON"),
    ],
)
def test_what_is_no_table_is_refused_in_one_sentence(tmp_path, text, words):
    (tmp_path / "log.json").write_text(text)
    with pytest.raises(InputError, match=words):
        read_json_table(tmp_path / "log.json")
