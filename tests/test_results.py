"""From values to results.json: dataclasses by their fields, other keys, properties, and what JSON does not have."""

import json
import math
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from ballbot.file_formats import read_results, results_text
from ballbot.results import key, left_out, reported, to_results


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True, kw_only=True)
class Part:
    size: float

    @reported
    def half(self) -> float:
        return 0.5 * self.size


@dataclass(frozen=True, kw_only=True)
class Whole(Part):
    """A dataclass with every kind of field."""

    parts: dict[str, Part]
    samples: np.ndarray = field(metadata=left_out)
    at_limit: float = field(metadata=key("share_at_limit"))
    poles: np.ndarray
    file: Path = Path("a.csv")
    colour: Colour = Colour.RED

    @property
    def count(self) -> int:
        return len(self.parts)


WHOLE = Whole(
    size=2.0,
    parts={"left": Part(size=math.nan)},
    samples=np.zeros(1000),
    at_limit=math.inf,
    poles=np.array([1.0 + 2.0j]),
)


def test_fields_keys_and_reported_properties_are_written_and_others_left_out():
    assert to_results(WHOLE) == {
        "size": 2.0,
        "parts": {"left": {"size": None, "half": None}},
        "share_at_limit": "Infinity",
        "poles": [[1.0, 2.0]],
        "file": "a.csv",
        "colour": "red",
        "half": 1.0,
    }


def test_missing_and_infinite_numbers_are_told_apart_and_read_back(tmp_path):
    values = {"a": np.array([1.0, np.nan, -np.inf]), "b": {"c": (math.inf, None, "inf", np.int64(2))}}
    text = results_text(values)
    found = json.loads(text, parse_constant=pytest.fail)  # strict JSON has no NaN and no Infinity
    assert found["a"] == [1.0, None, "-Infinity"]
    (tmp_path / "results.json").write_text(text)
    read = read_results(tmp_path / "results.json")
    assert isinstance(read, dict)
    assert read["a"] == [1.0, None, -math.inf]
    assert read["b"] == {"c": [math.inf, None, "inf", 2]}
