"""Fuzzed bytes through the robot's side of the link: false accepts of each layer, expected and observed.

.venv/bin/python -m campaigns.evidence link_fuzz          10^8 bytes

A false accept of a layer is a frame that passes it by chance. Frames are right up to a layer and random in it, so that
each layer is measured by itself; random bytes and changed frames go through all of them. The expected numbers follow
from how many of the possible values are right:

    framing     random nonzero bytes are COBS if the lengths in them lead exactly to their end: a renewal process,
                summed over all lengths of a frame
    length      those of them whose payload is 12 to 208 bytes long
    checksum    1 of 2^32; for more numbers, 1 of 2^16 in the low half of the CRC-32
    version     1 of 256
    type        11 of 256
    body        1 of 197 lengths
    session     1 of 2^32
    sequence    32767 of 65536: it keeps late and repeated frames out, and is no protection against chance

Values are no matter of chance; tests give the robot wrong ones (`tests/link/test_faults.py`).
"""

from __future__ import annotations

import ctypes
import tempfile
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from pathlib import Path

import numpy as np
from scipy.stats import binom

from ballbot import Robot
from ballbot.control.presets import nominal_controller
from ballbot.control.safety import SafetyLimits
from ballbot.firmware.build import compile_sources, source_files
from ballbot.firmware.records import parameter_record
from ballbot.link.frames import LONGEST_FRAME, LONGEST_PAYLOAD, OVERHEAD, SEQUENCE_WINDOW
from ballbot.link.messages import LAYERS, TO_ROBOT, Layer
from campaigns.section import Section

BYTES = 100_000_000
SEED = 1
_SOURCE = Path(__file__).with_suffix(".c")


class Kind(IntEnum):
    """What is random."""

    RANDOM_BYTES = 0
    CHECKSUM = 1
    VERSION = 2
    TYPE = 3
    BODY = 4
    SESSION = 5
    SEQUENCE = 6
    CHANGED = 7


#: parts of all bytes
SHARES = dict.fromkeys(Kind, 0.05) | {Kind.RANDOM_BYTES: 0.3, Kind.CHECKSUM: 0.3, Kind.CHANGED: 0.15}

_OUTCOME = np.dtype(
    [
        ("bytes", "u8"),
        ("frames", "u8"),
        ("accepted", "u8"),
        ("refused", "u8", LAYERS),
        ("segments", "u8"),
        ("too_long", "u8"),
        ("low_bits", "u8"),
        ("false_accepts", "u8"),
        ("same", "u8"),
        ("acted", "u8"),
    ]
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """False accepts of one layer."""

    name: str
    tried: int  #: frames that reached it
    chance: float  #: of each
    passed: int

    @property
    def expected(self) -> float:
        """Expected false accepts."""
        return self.tried * self.chance

    @property
    def is_likely(self) -> bool:
        """Whether so many or more, and so many or fewer, pass in at least one of a million campaigns."""
        least = binom.cdf(self.passed, self.tried, self.chance)
        most = binom.sf(self.passed - 1, self.tried, self.chance)
        return min(least, most) >= 1e-6


@cache
def _fuzz() -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fuzz.so"
        compile_sources(path, [*source_files(), _SOURCE], flags=("-O2", "-fPIC", "-shared"))
        return ctypes.CDLL(str(path))


def run(kind: Kind, count: int, *, seed: int = SEED) -> np.void:
    """Give a robot at least so many bytes of a kind and return what happened."""
    robot = Robot.load("alten")
    parameters = parameter_record(nominal_controller(robot), SafetyLimits.on_robot(robot, sample_time=0.005))
    outcome = np.zeros(1, _OUTCOME)
    refused = _fuzz().link_fuzz(
        int(kind),
        ctypes.c_uint64(seed * 100 + kind),
        ctypes.c_uint64(count),
        ctypes.c_void_p(parameters.ctypes.data),
        ctypes.c_void_p(outcome.ctypes.data),
    )
    assert not refused
    return outcome[0]


def framing_chances() -> tuple[float, float]:
    """Return the chance that random bytes between two zeros are COBS, and that such a frame has an allowed length.

    A frame of L bytes comes between zeros with the chance (255/256)^(L-1) / 256. Longer ones than `LONGEST_FRAME` are
    refused for their length, without a look at them. Within it no block is longer than 254 bytes, so that the payload
    has a byte less than the frame.
    """
    is_coded = np.zeros(LONGEST_FRAME + 1)
    is_coded[0] = 1.0
    for length in range(1, LONGEST_FRAME + 1):
        is_coded[length] = is_coded[:length].sum() / 255.0
    lengths = np.arange(1, LONGEST_FRAME + 1)
    comes = (255.0 / 256.0) ** (lengths - 1) / 256.0
    coded = comes * is_coded[1:]
    allowed = (lengths - 1 >= OVERHEAD) & (lengths - 1 <= LONGEST_PAYLOAD)
    return float(coded.sum() / comes.sum()), float(coded[allowed].sum() / coded.sum())


def passed(outcome: np.void, layer: Layer) -> tuple[int, int]:
    """Return how many frames reached a layer, and how many passed it."""
    reached = int(outcome["accepted"]) + int(outcome["refused"][layer:].sum())
    return reached, reached - int(outcome["refused"][layer])


def rows(count: int, *, seed: int = SEED) -> tuple[list[Row], dict[Kind, np.void]]:
    """Return the layers' false accepts over so many bytes together, and what happened by kind."""
    found = {kind: run(kind, round(share * count), seed=seed) for kind, share in SHARES.items()}
    noise, checked = found[Kind.RANDOM_BYTES], found[Kind.CHECKSUM]
    coded, allowed = framing_chances()
    # what is too long for a frame is refused for its length before anybody looks at its framing
    segments, too_long = int(noise["segments"]), int(noise["too_long"])
    framed = segments - int(noise["refused"][Layer.FRAMING])
    long_enough = framed - (int(noise["refused"][Layer.LENGTH]) - too_long)
    table = [
        Row(name="framing", tried=segments, chance=coded, passed=framed),
        Row(name="length", tried=framed, chance=allowed, passed=long_enough),
        Row(
            name="checksum",
            tried=int(checked["frames"]),
            chance=2.0**-32,
            passed=passed(checked, Layer.CHECKSUM)[1],
        ),
        Row(
            name="checksum, low 16 bits",
            tried=int(checked["frames"]),
            chance=2.0**-16,
            passed=int(checked["low_bits"]),
        ),
    ]
    chances = {
        Kind.VERSION: 1.0 / 256.0,
        Kind.TYPE: len(TO_ROBOT) / 256.0,
        Kind.BODY: 1.0 / (LONGEST_PAYLOAD - OVERHEAD + 1.0),
        Kind.SESSION: 2.0**-32,
        Kind.SEQUENCE: SEQUENCE_WINDOW / 65536.0,
    }
    for kind, chance in chances.items():
        tried, through = passed(found[kind], Layer[kind.name])
        table.append(Row(name=kind.name.lower(), tried=tried, chance=chance, passed=through))
    whole = found[Kind.CHANGED]
    table.append(
        Row(
            name="all layers, changed frames",
            tried=int(whole["frames"]) - int(whole["same"]),
            chance=2.0**-32,
            passed=int(whole["false_accepts"]),
        )
    )
    table.append(
        Row(
            name="all layers, random bytes",
            tried=segments,
            # framing, length, CRC-32, version and the session's number
            chance=coded * allowed * 2.0**-72,
            passed=int(noise["accepted"]),
        )
    )
    return table, found


def campaign(count: int = BYTES) -> Section:
    """Return the false accepts of each layer over so many bytes together."""
    table, found = rows(count)
    given = sum(int(one["bytes"]) for one in found.values())
    acted = sum(int(one["acted"]) for one in found.values())
    return Section(
        title="Fuzzed bytes on the link",
        before=f"{given:,} bytes through the robot's side of the link in C, seed {SEED}. A layer is tried with frames "
        "that are right up to it and random in it; random bytes and right frames with one to eight changed bytes go "
        "through all layers. A false accept is a frame that passes by chance; the expected number follows from how "
        "many of the possible values are right. The sequence window keeps late and repeated frames out, and is no "
        "protection against chance.",
        columns=["layer", "frames that reached it", "expected to pass", "passed"],
        rows=[[one.name, f"{one.tried:,}", _number(one.expected), f"{one.passed:,}"] for one in table],
        after=f"The robot never moved and its parameters stayed as they were ({acted} changes).",
    )


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.2g}"
