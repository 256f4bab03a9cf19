"""Bounds of the firmware's parameters: Python and the compiled library refuse the same records for the same reason."""

import ctypes
from functools import cache

import numpy as np
import pytest

from ballbot.control.presets import precise_controller
from ballbot.control.safety import SafetyLimits
from ballbot.errors import InputError
from ballbot.firmware.bounds import (
    BOUNDS,
    FIRST_BOUND,
    Refusal,
    check_bounds,
    refusal_clause,
    violated_bound,
)
from ballbot.firmware.build import compilers
from ballbot.firmware.records import PARAMETERS, parameter_record
from tests.support.compiled_firmware import library
from tests.support.control_examples import FRICTION, alten
from tests.support.firmware_headers import member

ROBOT = alten(FRICTION)


@cache
def exported() -> np.ndarray:
    controller = precise_controller(ROBOT)
    limits = SafetyLimits.on_robot(ROBOT, sample_time=0.005, torque_limit=controller.torque_limit)
    return parameter_record(controller, limits)


def parameters() -> np.ndarray:
    return exported().copy()


def set_value(record: np.ndarray, field: str, value: float) -> None:
    *tables, name = field.split(".")
    for table in tables:
        record = record[table]
    record[name] = value


def value_of(record: np.ndarray, bound: float | str) -> float:
    if not isinstance(bound, str):
        return float(bound)
    for name in bound.split("."):
        record = record[name]
    return float(record[0])


def beyond(record: np.ndarray, row: int) -> list[float]:
    """Return values that just violate a row."""
    bound, least = BOUNDS[row], value_of(record, BOUNDS[row].least)
    if member(PARAMETERS, bound.field).whole:
        return [least - 1, *([] if bound.most is None else [value_of(record, bound.most) + 1])]
    below = np.nextafter(np.float32(least), np.float32(-np.inf))
    if bound.most is None:
        return [below, np.nan]
    return [below, np.nan, np.nextafter(np.float32(value_of(record, bound.most)), np.float32(np.inf))]


@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
def test_library_refuses_what_python_refuses():
    refused = library().functions.ballbot_refused
    refused.restype, refused.argtypes = ctypes.c_int32, [ctypes.c_void_p]

    def verdicts(record: np.ndarray) -> tuple[int, int]:
        row = violated_bound(record)
        return refused(record.ctypes.data), 0 if row is None else FIRST_BOUND + row

    assert verdicts(parameters()) == (0, 0)
    found = set()
    for row, bound in enumerate(BOUNDS):
        for value in beyond(parameters(), row):
            record = parameters()
            set_value(record, bound.field, value)
            c, python = verdicts(record)
            assert c == python != 0
            found.add(c - FIRST_BOUND)
            clause = refusal_clause(record, c)
            assert clause.startswith(f"{BOUNDS[c - FIRST_BOUND].field} is ")
            with pytest.raises(InputError, match="The firmware would refuse these parameters: "):
                check_bounds(record)
    assert found == set(range(len(BOUNDS)))
    random, words = np.random.default_rng(5), len(parameters().view(np.int32))
    schema = len(parameters()["schema"][0])
    for _ in range(3000):  # records with numbers of any bits, and with numbers from the edges
        record = parameters()
        if random.random() < 0.5:
            places = random.integers(schema, words, 300)
            record.view(np.int32)[places] = random.integers(-(2**31), 2**31, 300)
            record["law"]["policy"] = np.zeros((), record.dtype["law"]["policy"])
        for row in np.flatnonzero(random.random(len(BOUNDS)) < 0.1):
            set_value(record, BOUNDS[row].field, random.choice(beyond(record, int(row))))
        c, python = verdicts(record)
        assert c == python
    record = parameters()
    record["schema"][0, 3] += 1
    assert refused(record.ctypes.data) == Refusal.SCHEMA
