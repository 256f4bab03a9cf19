"""Static analysis and sanitizers over the whole firmware; slow, and skipped without the tools."""

import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.safety import SafetyLimits
from ballbot.firmware.build import compile_sources, compilers, source_files, weights_folder
from ballbot.firmware.export import PROJECT
from ballbot.firmware.header import SOURCES
from ballbot.firmware.records import PARAMETERS, READING, parameter_record
from ballbot.link.emulated import HARDWARE
from ballbot.records import Number
from tests.support.compiled_firmware import Firmware, weights_of
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled, with_policy

pytestmark = pytest.mark.board

HERE = Path(__file__).parent
LEARNED = with_policy(everything(four_wheeled(friction=True)), feedback=0.6)
PAGE = (PROJECT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> list[Path]:
    """Return the folder of the weights of a policy, to be included first."""
    return weights_folder(tmp_path_factory.mktemp("weights"), weights_of(LEARNED))


def analysed(*options: str, weights: Sequence[Path], more: Sequence[Path] = ()) -> str:
    """Return what cppcheck prints about the library, with a policy's weights, and about more sources."""
    if not shutil.which("cppcheck"):
        pytest.skip("cppcheck is missing")
    folders = [f"-I{folder}" for folder in (*weights, SOURCES, PROJECT, HARDWARE)]
    command = ["cppcheck", "--std=c99", "--quiet", *folders, *options, *map(str, (SOURCES, *more))]
    return subprocess.run(command, capture_output=True, text=True, check=True).stderr


def test_cppcheck_finds_nothing(weights):
    more = [PROJECT / "robot.c", HARDWARE]
    found = analysed("--enable=warning,performance,portability", weights=weights, more=more)
    assert re.findall(r"^\S+:\d+:\d+: (?:error|warning|performance|portability).*", found, flags=re.M) == []


def test_rules_of_misra_that_are_not_kept_are_those_of_the_document(weights):
    found = set(re.findall(r"misra-c2012-([\d.]+)", analysed("--addon=misra", weights=weights)))
    if not found:
        pytest.skip("cppcheck has no MISRA addon")
    listed = set(re.findall(r"^\| (\d+\.\d+) \|", PAGE, flags=re.M))
    assert found <= listed  # versions of cppcheck differ in what they see


def random_words(random: np.random.Generator, schema, count: int) -> np.ndarray:
    """Return records whose bytes are anything: any bits, or numbers of the size of a reading."""
    record = np.zeros(count, schema.dtype("single"))
    anything = random.integers(0, 256, (count, record.itemsize), dtype=np.uint8)
    record[:] = anything.view(record.dtype)[:, 0]
    for k in range(0, count, 2):
        for name, one in schema.fields.items():
            if isinstance(one, Number) and not one.whole:
                record[name][k] = random.normal(size=one.shape) * 0.3
    return record


@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
def test_sanitizers_find_nothing_in_the_whole_firmware_and_change_no_bit(tmp_path, weights):
    """Any readings, references and times, armed at times: no undefined behaviour, and no torque beyond the limit."""
    run = tmp_path / "run"
    flags = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    flags += [f"-I{folder}" for folder in weights]
    try:
        compile_sources(run, [*source_files(), HERE / "run.c"], flags=flags)
    except InputError as refusal:
        pytest.skip(f"the compiler has no sanitizers: {str(refusal)[:200]}")
    random = np.random.default_rng(1)
    robot = alten(FRICTION)
    limits = SafetyLimits.on_robot(robot, sample_time=0.005, torque_limit=1.0)
    for controller in (
        nominal_controller(robot),
        precise_controller(robot),
        everything(four_wheeled(friction=True)),
        LEARNED,
    ):
        parameters, n = parameter_record(controller, limits), len(controller.gain)
        made = Firmware(parameters, weights=weights_of(LEARNED))
        made.skip_self_test()
        readings = random_words(random, READING, 300)
        readings["encoders_valid"] = random.integers(0, 2, 300)
        given, wanted = parameters.tobytes(), b""
        for k, reading in enumerate(readings):
            arm, time = k % 9 == 0, int(random.integers(0, 2**32))
            reference = np.where(random.uniform(size=10) < 0.1, np.nan, [0.1, 0.2, 0, 0, 0.3, 0, 0, 0, 0, 0])
            reference = reference.astype(np.float32)
            if arm:
                made.arm()
                time = k * 5000
            torques = made.update(reading.reshape(1), time, reference)
            assert np.abs(torques).max() <= np.float32(controller.torque_limit)
            given += np.array([int(arm)], np.int32).tobytes() + np.array([time], np.uint32).tobytes()
            given += reading.tobytes() + reference.tobytes()
            wanted += torques.tobytes()
        done = subprocess.run([run], input=given, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr.decode()[:3000]
        assert np.frombuffer(done.stdout, np.float32).reshape(-1, 4)[:, :n].tobytes() == wanted
    assert PARAMETERS.dtype("single").itemsize == parameters.itemsize
