"""Tables in JSON: lists of objects, objects of lists, and refusals in one sentence."""

import json

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log.formats import read_columns
from ballbot.log.formats.json import read_json_table

T = [0.0, 0.005, 0.01]


def written(folder, tree) -> str:
    path = folder / "log.json"
    path.write_text(tree if isinstance(tree, str) else json.dumps(tree))
    return str(path)


@pytest.mark.parametrize(
    "tree",
    [
        {"t": T, "roll": [0.1, None, 0.3]},
        [{"t": t, "roll": roll} for t, roll in zip(T, [0.1, None, 0.3], strict=True)],
        {"robot": "r2", "data": [{"t": t, "roll": r} for t, r in zip(T, [0.1, None, 0.3], strict=True)]},
    ],
)
def test_lists_of_objects_and_objects_of_lists_are_one_table(tmp_path, tree):
    columns = read_columns(written(tmp_path, tree))
    np.testing.assert_array_equal(columns["t"], T)
    np.testing.assert_array_equal(columns["roll"], [0.1, np.nan, 0.3])


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
    with pytest.raises(InputError, match=words):
        read_json_table(written(tmp_path, text))


def test_one_object_in_each_line_is_a_table(tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_text(
        '{"ts": 0, "imu": {"roll": 0.1}, "w": [1, 2]}\n{"ts": 10, "imu": {"roll": 0.2}, "w": [3, 4]}\n'
    )
    found = read_json_table(path)
    assert {name: list(values) for name, values in found.items()} == {
        "ts": [0.0, 10.0],
        "imu.roll": [0.1, 0.2],
        "w_1": [1.0, 3.0],
        "w_2": [2.0, 4.0],
    }
