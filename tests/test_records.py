"""Records: one schema gives the structured type, the file table and the conversion to single precision."""

from dataclasses import dataclass, field, make_dataclass

import numpy as np
import pytest

from ballbot import InputError
from ballbot.control.parts import KINDS, Parts
from ballbot.records import MAX_WHEELS, converted, fill_record, number, schema_of, whole
from tests.support.control_examples import FRICTION, alten, everything, with_policy


@dataclass(frozen=True, kw_only=True, eq=False)
class Example:
    """A record with a flag, a number and an array."""

    on: int = field(default=1, metadata=whole())
    torque: float = field(default=0.5, metadata=number("N m"))
    gains: np.ndarray = field(metadata=number("1", MAX_WHEELS, 2))


def test_structured_type_has_the_names_order_and_lengths_of_the_dataclass():
    assert schema_of(Example).dtype() == np.dtype([("on", "i8"), ("torque", "f8"), ("gains", "f8", (4, 2))])
    assert schema_of(Example).lines() == ["on whole [] 1", "torque real [] N m", "gains real [4, 2] 1"]


def test_digest_covers_names_types_lengths_units_and_order():
    def digest(**described) -> str:
        made = make_dataclass("Made", [(name, float, field(metadata=one)) for name, one in described.items()])
        return schema_of(made).digest

    plain = digest(a=number("m"), b=number("s"))
    assert digest(a=number("m"), b=number("s")) == plain
    others = [
        digest(b=number("s"), a=number("m")),
        digest(a=number("m"), c=number("s")),
        digest(a=number("mm"), b=number("s")),
        digest(a=number("m", 2), b=number("s")),
        digest(a=number("m"), b=whole()),
    ]
    assert len({plain, *others}) == 6


@pytest.mark.parametrize(
    ("gains", "sentence"),
    [
        (np.ones((5, 2)), r"gains of .*Example has the shape \(5, 2\); there is room for \(4, 2\)"),
        (np.ones(2), r"the shape \(2,\)"),
        (np.full((3, 2), np.nan), "not finite"),
    ],
)
def test_array_without_room_is_refused(gains, sentence):
    with pytest.raises(InputError, match=sentence):
        fill_record(schema_of(Example).zeros(), Example(gains=gains))


def test_single_precision_refuses_what_is_out_of_range_or_lost():
    schema = schema_of(Example)
    for torque, sentence in ((1e39, "becomes? inf|become inf"), (1e-46, "become 0")):
        record = schema.zeros()
        record["torque"] = torque
        with pytest.raises(InputError, match=f"Example.torque is {torque:g}; .*{sentence}"):
            converted(record, schema)
    record = schema.zeros()
    record["on"] = 2**40
    with pytest.raises(InputError, match=r"Example.on is 1.09951e\+12"):
        converted(record, schema)


def test_record_begins_with_a_flag_and_is_zero_without_the_part():
    """A step reads `on` of its record: 1 if the controller has the part; otherwise the whole record is zeros."""
    whole = with_policy(everything(alten(FRICTION)))
    bare = whole.with_parts(Parts()).record
    for name, kind in KINDS.items():
        assert next(iter(schema_of(kind.record).fields)) == "on"
        assert whole.record[name]["on"][0] == 1
        assert not any(bare[name].tobytes())
