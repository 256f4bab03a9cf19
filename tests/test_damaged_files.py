"""Damaged files: every loader accepts them, or refuses them in one sentence, without a warning and within 2 GB.

Each input is a file that the loader accepts, with one to four changes: numbers, words, lines, separators, encodings,
bytes. In what is accepted, all values are finite (NaN marks a missing cell of a log), and a written copy is read back
the same. With BALLBOT_EXAMPLES=exploring a thousand inputs of each loader are tried.
"""

import math
import os
import re
import resource
import warnings
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from ballbot.control.file import controller_text, read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import read_reference
from ballbot.errors import InputError, UnsuitedController
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.formats import WRITTEN_SUFFIXES, read_foreign_table
from ballbot.log.mapping import parse_mapping, read_mapping
from ballbot.log.row_order import LONGEST
from ballbot.report.blocks import sheet_of
from ballbot.report.log_check import COLUMNS, summed_columns
from ballbot.robot import Robot
from ballbot.robot.derived import derived_quantities
from ballbot.robot.file import robot_text
from ballbot.simulation.imperfections import Push, Roughness
from ballbot.twin import Scenario
from ballbot.twin.faults import Payload, Timing
from ballbot.twin.scenario_file import load_scenario, scenario_text
from tests.support.control_examples import example_parts
from tests.support.log_examples import smooth_log, with_wheels

ALTEN = Robot.load("alten")
COUNT = 1000 if os.environ.get("BALLBOT_EXAMPLES") == "exploring" else 5

MAPPING = """\
[file]
separator = "tab"
missing = ["NA"]
header_lines = 1
damaged_rows = "drop"
rows = [1, 90]
[time]
sample_time = 0.01
keep = [[0.0, 0.5]]
[columns]
t = { from = "time", unit = "ms" }
theta = { from = "roll", unit = "deg", sign = -1, offset = 0.01, delay = 0.016 }
phi = "pitch"
theta_dot = { derivative_of = "theta" }
[wheels]
order = [1, 3, 2]
sign = [1, 1, -1]
angle = { from = ["enc_1", "enc_2", "enc_3"], unit = "counts", counts_per_turn = 4480, largest_speed = 40.0 }
speed = { derivative_of = "angle" }
[input]
kind = "pwm"
from = ["d1", "d2", "d3"]
sign = -1
scale = 1.0
delay = 0.012
supply_voltage = 11.1
torque_constant = 0.01
back_emf_constant = 0.01
gear_ratio = 70.0
dead_band = 0.0314
"""
#: the attitude as a whole
ATTITUDE = """\
[file]
separator = "tab"
[time]
repair = true
[columns]
t = { from = "time", unit = "ms" }
[attitude]
from = ["roll", "pitch", "yaw"]
unit = "deg"
sign = [1, 1, 1]
turn = 30.0
delay = 0.016
[wheels]
angle = { from = ["enc_1", "enc_2", "enc_3"], unit = "counts", counts_per_turn = 4480 }
"""

# --- whole files ------------------------------------------------------------------------------------


@cache
def noisy_log() -> Log:
    """Return a log that is long enough for every check, with so few rows that it is written soon."""
    log = with_wheels(smooth_log(rows=1600), ALTEN).select(slice(None, None, 4))
    noise = np.random.default_rng(1)
    noisy = {name: log[name] + 1e-5 * noise.standard_normal(len(log)) for name in log.names if name != "t"}
    return log.with_columns(noisy)


def csv_of(log: Log, *, quoted: bool = False) -> bytes:
    mark = '"' if quoted else ""
    lines = [",".join(f"{mark}{name}{mark}" for name in log.names)]
    for row in np.column_stack([log[name] for name in log.names]).tolist():
        lines.append(",".join("" if quoted and k == 7 else f"{value:.9g}" for k, value in enumerate(row)))
    return ("\n".join(lines) + "\n").encode()


def waves(step: float, *names: str) -> Log:
    t = step * np.arange(200)
    return Log({"t": t} | {name: np.sin(5.0 * t + k) for k, name in enumerate(names)})


def raw() -> bytes:
    """Return a foreign table, for the mappings."""
    k = np.arange(100)[:, None]
    angles, counts = np.sin(0.05 * k + range(3)), np.round(1000 * np.sin(0.03 * k + range(3)))
    rows = np.hstack([5 * k, angles, counts, 0.3 * np.cos(0.1 * k + range(3))])
    head = "time\troll\tpitch\tyaw\tenc_1\tenc_2\tenc_3\td1\td2\td3"
    return "\n".join([head, *("\t".join(f"{one:.4g}" for one in row) for row in rows)]).encode()


def full_scenario() -> Scenario:
    parts = {
        "pushes": (Push(time=1.0, duration=0.1, force=(10.0, 0.0, 0.0), height=0.4),),
        "payload": Payload(mass=1.0, position=(0.0, 0.1, 0.5)),
        "roughness": Roughness(height=1e-4, wavelength=0.05, seed=1),
        "timing": Timing(delay=1, jitter=1e-3),
    }
    return replace(Scenario.nominal(ALTEN), name="full", **parts)


def controllers() -> list[bytes]:
    plain = nominal_controller(ALTEN, compensation="full")
    return [controller_text(one).encode() for one in (plain, plain.with_parts(example_parts(3)))]


# --- what must hold of an accepted file -------------------------------------------------------------


def checked(path: Path) -> None:
    """Check a log that is read, written and read back."""
    log = Log.read(path)
    whole(log)
    for suffix in WRITTEN_SUFFIXES:
        copy = path.with_name(f"copy{suffix}")
        try:
            log.write(copy)
        except InputError as error:
            if "; use " not in str(error) and "cannot be written to" not in str(error):
                raise
            continue
        back = Log.read(copy)
        assert back.names == log.names
        assert all(np.array_equal(log[name], back[name], equal_nan=True) for name in log.names)
    sheet_of(summed_columns(log), COLUMNS)
    check(log, robot=ALTEN)


def whole(log: Log) -> None:
    assert len(log) > 0
    assert np.isfinite(log.t).all()
    assert (np.diff(log.t) > 0.0).all()
    assert log.t[-1] - log.t[0] <= LONGEST
    assert not any(np.isinf(log[name]).any() for name in log.names)


def foreign(path: Path) -> None:
    table = read_foreign_table(path).columns
    assert len({values.shape for values in table.values()}) == 1
    assert not any(np.isinf(values).any() for values in table.values())


def mapped(path: Path) -> None:
    whole(Log.read(path, mapping=parse_mapping(MAPPING, source="the mapping"), robot="rob311"))


def mapping(path: Path) -> None:
    table = path.with_name("raw.txt")
    table.write_bytes(raw())
    whole(Log.read(table, mapping=read_mapping(path), robot="rob311"))


def finite(value: object) -> None:
    if is_dataclass(value):
        value = [getattr(value, field.name) for field in fields(value)]
    if isinstance(value, tuple | list):
        for one in value:
            finite(one)
    elif isinstance(value, int | float):
        assert math.isfinite(value)


def kept(path: Path, read: Callable[[Path], object], text: Callable[[Any], str]) -> Any:
    """Return what a file holds, of which a written copy reads back the same."""
    found, copy = read(path), path.with_name("copy.toml")
    copy.write_text(text(found), encoding="utf-8")
    assert text(read(copy)) == text(found)
    return found


def robot(path: Path) -> None:
    read = kept(path, Robot.load, robot_text)
    finite([read, *(one.value for one in derived_quantities(read))])


def controller(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnsuitedController)  # a damaged gain need not stabilise the robot
        read = kept(path, lambda one: read_controller(one, ALTEN), controller_text)
    for k, lean in enumerate((0.0, 0.01, -0.1)):
        state = np.array([0.1, 0.0, lean, -lean, 0.2, 0.0, 0.1, lean, 0.0, 0.0])
        torques = read.update(k * read.sample_time, state, np.zeros(10))
        assert np.isfinite(torques).all()
        assert np.abs(torques).max() <= read.torque_limit * (1.0 + 1e-12)


def reference(path: Path) -> None:
    poses = np.array([read_reference(path)(t) for t in (0.0, 0.005, 37.3, 86400.0)])
    assert poses.shape == (4, 10)
    assert np.isfinite(poses).all()


def axis(path: Path) -> None:
    record = read_axis_record(path, AxisColumns())
    assert np.isfinite([record.force, record.position]).all()
    assert 0.0 < record.sample_time < math.inf


#: by loader: the ending of its files, what makes whole ones, and what reads one and asserts what must hold
LOADERS: dict[str, tuple[str, Callable[[], list[bytes]], Callable[[Path], object]]] = {
    "log, CSV": (".csv", lambda: [csv_of(noisy_log()), csv_of(noisy_log(), quoted=True)], checked),
    "foreign table": (".txt", lambda: [raw(), raw().replace(b"\t", b";")], foreign),
    "mapped table": (".txt", lambda: [raw()], mapped),
    "mapping": (".toml", lambda: [MAPPING.encode(), ATTITUDE.encode()], mapping),
    "robot": (".toml", lambda: [robot_text(Robot.load(one)).encode() for one in ("alten", "kugle")], robot),
    "scenario": (
        ".toml",
        lambda: [scenario_text(full_scenario()).encode()],
        lambda path: finite(kept(path, lambda one: load_scenario(one, ALTEN), scenario_text)),
    ),
    "controller": (".toml", controllers, controller),
    "reference": (".csv", lambda: [csv_of(waves(0.5, "ref_x", "ref_y", "ref_psi"))], reference),
    "axis record": (".csv", lambda: [csv_of(waves(0.001, "position", "force"))], axis),
}


@pytest.fixture
def strict(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Bound the memory to 2 GB beside the process's own, and make warnings errors; no file need outlive the machine."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    found = re.search(r"VmSize:\s*(\d+)", Path("/proc/self/status").read_text())
    before = resource.getrlimit(resource.RLIMIT_AS)
    assert found
    resource.setrlimit(resource.RLIMIT_AS, (1024 * int(found[1]) + 2 * 2**30, before[1]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", ResourceWarning)
        yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.usefixtures("strict")
@pytest.mark.parametrize("name", LOADERS)
def test_damaged_files_are_accepted_or_refused(tmp_path: Path, name: str) -> None:
    suffix, make, judge = LOADERS[name]
    samples, path, refusals = make(), tmp_path / f"input{suffix}", []
    for content in samples:  # the whole files are accepted
        path.write_bytes(content)
        judge(path)
    for number in range(COUNT):
        random = Random(f"10 {name} {number}")
        path.write_bytes(mutated(random.choice(samples), random))
        try:
            judge(path)
        except InputError as error:
            refusals.append(str(error))
    assert refusals
    assert [one for one in refusals if not (one.isprintable() and 0 < len(one) < 20_000)] == []


# --- damage, the same for the same random numbers ---------------------------------------------------

_NUMBERS = """
0 -0.0 -1 1 2 3.5 1e-3 0.005 5e-9 1e-300 5e-324 1e308 -1e308 1e400 nan -nan inf -inf 1.7e9 1.7e18 1000 1e5 1_000
2147483647 2147483648 -2147483649 9223372036854775808 18446744073709551616 0x7fffffff 0b1
true false [] {} [[]] NaN NA None - １２ 1,5
"""
_WORDS = r"[/x] $\frac$ %s {} # = [ ] [[ t x u1 u9 true_x é 日本 nan base name - --"
#: replacements of a number
NUMBERS = (*_NUMBERS.split(), '""', "''", "9" * 30, "9" * 5000)
#: replacements of a word, or insertions
WORDS = (*_WORDS.split(), "", " ", "\t", "\0", "\x1b[31m", "\\", '"', "'", "\ufeff", "\u202e", "a" * 300)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])")
WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")
SEPARATORS = ((",", ";"), (",", "\t"), ("\n", "\r\n"), ("\n", "\r"), ("=", ":"), (".", ","), ("\n", ""))
FACTORS = (-1.0, 0.5, 2.0, 1e3, 1e-3, 1e6, 57.3, 1.0 + 1e-12)
ENCODINGS = ("utf-16", "utf-8-sig", "latin-1", "utf-32")


def mutated(content: bytes, random: Random) -> bytes:
    """Return a file's content with one to four things changed in it; bytes that are no UTF-8 stay what they are."""
    for _ in range(random.choice((1, 1, 1, 2, 3, 4))):
        text = content.decode("utf-8", "surrogateescape")
        found = list(random.choice((NUMBER, WORD)).finditer(text))
        place, end = (random.randrange(len(text) + 1) for _ in range(2))
        match random.choice(
            ("one", "one", "one", "separator", "insert", "piece", "piece", "end", "encoding")
        ):
            case "one" if found:
                one = random.choice(found)
                if one.re is NUMBER:
                    by = random.choice((*NUMBERS, *(repr(factor * float(one[0])) for factor in FACTORS)))
                else:
                    by = random.choice((*WORDS, *WORD.findall(text)))
                text = text[: one.start()] + by + text[one.end() :]
            case "separator":
                text = text.replace(*random.choice(SEPARATORS), random.choice((1, -1)))
            case "insert":
                text = text[:place] + random.choice((*WORDS, *NUMBERS, "\udcff", "\x01")) + text[place:]
            case "piece":  # removed, or again and again; often of whole lines
                if random.random() < 0.7:
                    place, end = (text.rfind("\n", 0, one) + 1 for one in (place, end))
                piece = text[place : min(end, place + 2000)]
                text = text[:place] + piece * random.choice((0, 2, 2, 10)) + text[place + len(piece) :]
            case "end":
                text = text[:place]
            case "encoding":
                return text.encode(random.choice(ENCODINGS), "replace")
        content = text.encode("utf-8", "surrogateescape")[:200_000]
    return content
