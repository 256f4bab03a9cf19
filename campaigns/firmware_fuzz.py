"""A coverage-guided fuzzer over the firmware's parameters, states, sensors and frames.

.venv/bin/python -m campaigns.evidence firmware_fuzz

libFuzzer of Clang searches for inputs that reach new branches of the C code (`campaigns/firmware_fuzz.c`), under the
address and the undefined-behaviour sanitizer. The inputs that were found are kept in build/firmware_fuzz, where a
campaign goes on.
"""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller
from ballbot.errors import InputError
from ballbot.firmware.build import NUMERICS, source_files, weights_folder
from ballbot.firmware.export import PROJECT, export_controller
from ballbot.firmware.header import SOURCES
from ballbot.firmware.records import STATE
from ballbot.records import Schema
from campaigns.section import Section
from tests.support.compiled_firmware import weights_of
from tests.support.law_comparison import controllers

HERE = Path(__file__).parent
KEPT = HERE.parent / "build" / "firmware_fuzz"
SECONDS = 3600
#: `float-cast-overflow` and `integer-divide-by-zero` are part of `undefined`; a division of floats by zero is not
SANITIZERS = "-fsanitize=fuzzer,address,undefined,float-cast-overflow"
_LONGEST = 4096  # [bytes] of an input


@dataclass(frozen=True, kw_only=True)
class Fuzzed:
    """The result of a run of the fuzzer."""

    inputs: int  #: that were run
    branches: int  #: of the code's edges, those that some input reached
    corpus: int  #: inputs that are kept because they reach something of their own
    seconds: float


def is_available() -> bool:
    """Return whether Clang and its libFuzzer are on this computer."""
    if shutil.which("clang") is None:
        return False
    trial = ["clang", "-fsanitize=fuzzer", "-x", "c", "-", "-o", "/dev/null"]
    source = "int LLVMFuzzerTestOneInput(const unsigned char *d, unsigned long n) { return d && n ? 0 : 0; }"
    return subprocess.run(trial, input=source, text=True, capture_output=True, check=False).returncode == 0


def real_words(schema: Schema = STATE, first: int = 0) -> list[int]:
    """Return the places of a record's real numbers, in words of 4 bytes; its whole numbers are indices and flags."""
    indices: list[int] = []
    for field in schema.fields.values():
        size = (
            field.dtype("single").itemsize // 4
            if isinstance(field, Schema)
            else int(np.prod(field.shape, dtype=int))
        )
        if isinstance(field, Schema):
            indices += real_words(field, first)
        elif not field.whole:
            indices += range(first, first + size)
        first += size
    return indices


def records_header() -> str:
    """Return the parameters of every preset and part and of mixed gains, and the real words of the state, as C."""
    records = [export_controller(make()).parameters for make in controllers().values()]
    own = nominal_controller("alten", compensation="partial")
    records.append(
        export_controller(own, [Controller(own.robot, 0.9 * own.gain, compensation="partial")]).parameters
    )
    words = [record.view(np.uint32).tolist() for record in records]
    rows = ",\n".join("{ " + ", ".join(f"{word}u" for word in row) + " }" for row in words)
    return (
        f"#define RECORD_COUNT {len(words)}u\n"
        f"static const uint32_t RECORDS[RECORD_COUNT][{len(words[0])}] = {{\n{rows}\n}};\n"
        f"static const uint16_t REAL_WORDS[] = {{ {', '.join(map(str, real_words()))} }};\n"
    )


def build(folder: Path) -> Path:
    """Compile the fuzzer into a folder and return it.

    Raises
    ------
    InputError
        If Clang refuses the sources.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "firmware_fuzz_records.h").write_text(records_header())
    weights_folder(folder, weights_of(controllers()["policy alone, 3 wheels"]()))
    target = folder / "fuzzer"
    command = [
        *("clang", "-g", "-O1", *NUMERICS, SANITIZERS, "-fno-sanitize-recover=all"),
        *(f"-I{folder}", f"-I{SOURCES}", f"-I{PROJECT}"),
        *map(str, [*source_files(), PROJECT / "robot.c", HERE / "firmware_fuzz.c"]),
        *("-o", str(target), "-lm"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"clang refuses the fuzzer: {done.stderr.strip()}")
    return target


def fuzz(folder: Path, *, seconds: int, seed: int = 1) -> Fuzzed:
    """Run the fuzzer for a time in one process.

    Raises
    ------
    InputError
        If it finds an input that fails; the message has its place and what failed.
    """
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    command = [
        str(build(folder)),
        *(f"-max_total_time={seconds}", f"-seed={seed}", f"-max_len={_LONGEST}", "-print_final_stats=1"),
        *(f"-artifact_prefix={folder}/", "-verbosity=1", str(corpus)),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"The firmware fails under an input of {folder}: {done.stderr[-3000:]}")
    matches = re.findall(r"cov: (\d+) ft: \d+ corp: (\d+)/", done.stderr)
    inputs = re.search(r"stat::number_of_executed_units: (\d+)", done.stderr)
    assert matches
    assert inputs
    ended = re.search(r"Done \d+ runs in (\d+) second", done.stderr)
    return Fuzzed(
        inputs=int(inputs[1]),
        branches=int(matches[-1][0]),
        corpus=int(matches[-1][1]),
        seconds=float(ended[1]) if ended else float(seconds),
    )


def campaign(seconds: int = SECONDS) -> Section:
    """Return the section of docs/generated/evidence.md."""
    done = fuzz(KEPT, seconds=seconds)
    return Section(
        title="The firmware under a coverage-guided fuzzer",
        before="libFuzzer chooses a controller (presets and every part, three and four wheels), up to three changed "
        "parameters of any bits, and then actions: samples with sensors and times of any kind, bytes and frames from "
        "the host of every kind, changed numbers of the state, arming, self-test. After each sample: every torque is "
        "finite and within the limit, zero unless the robot is armed or tests itself, a fault of the sample has "
        "stopped the robot, "
        "and a stop is latched. Compiled with the address and the undefined-behaviour sanitizer.",
        columns=["time [s]", "inputs", "edges of the code reached", "inputs kept", "failures"],
        rows=[[f"{done.seconds:.0f}", f"{done.inputs:,}", f"{done.branches:,}", f"{done.corpus:,}", "0"]],
        after="One process. A failure would have ended the campaign without this table.",
    )
