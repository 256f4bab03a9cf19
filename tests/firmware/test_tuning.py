"""Changes of the law while it runs: C moves as Python does, takes the same settings, and refuses others with a code."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.control.safety import SafetyLimits
from ballbot.control.tuning import Setting, TuningState, check_setting
from ballbot.errors import InputError
from ballbot.firmware.build import compile_sources, compilers, source_files
from ballbot.firmware.records import READING, parameter_record
from ballbot.link.messages import SCHEMAS, AnswerResult, Arm, StepBack, Tune
from ballbot.records import schema_of
from tests.firmware.test_law import mixing, random_setting

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

TUNING = schema_of(TuningState)
SETTING = SCHEMAS[Tune.TYPE].dtype("single")
SAMPLE = np.dtype([("type", np.int32), ("setting", SETTING), ("reading", READING.dtype("single"))])
OUTCOME = np.dtype([("result", np.int32), ("torques", np.float32, 4), ("tuning", TUNING.dtype("single"))])


def drawn_numbers(random: np.random.Generator) -> list[float]:
    """Return numbers of a setting, (4,): in the set, or one of them anything else."""
    setting = random_setting(random)
    numbers = [*setting.weights, setting.compensation]
    if random.uniform() < 0.6:
        wrong = [np.nan, np.inf, -np.inf, -0.1, 0.1, 1.1, 1e30, -1e-30, 2.0]
        numbers[random.integers(4)] = random.choice(wrong)
    return numbers


def is_within(controller: Controller, numbers: np.ndarray) -> bool:
    *weights, compensation = numbers.astype(float).tolist()
    setting = Setting(weights=tuple(weights), compensation=compensation)
    try:
        check_setting(controller.record["tuning"][0], setting)
    except InputError:
        return False
    return True


def test_firmware_takes_the_settings_that_python_takes_and_sanitizers_find_nothing(tmp_path):
    run, flags = tmp_path / "tune", ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    try:
        compile_sources(run, [*source_files(), Path(__file__).parent / "tune.c"], flags=flags)
    except InputError as refusal:
        pytest.skip(f"the compiler has no sanitizers: {str(refusal)[:200]}")
    random, controller = np.random.default_rng(3), mixing()
    samples = np.zeros(1500, SAMPLE)
    samples["reading"]["gyro"] = 0.01 * random.standard_normal((1500, 3))
    samples["reading"]["attitude"] = 0.01 * random.standard_normal((1500, 3))
    samples["reading"]["encoders_valid"] = 1
    samples["type"][1::10], samples["type"][5::40] = Tune.TYPE, StepBack.TYPE
    samples["type"][100] = Arm.TYPE
    for sample in samples[1::10]:
        *weights, sample["setting"]["compensation"] = drawn_numbers(random)
        sample["setting"]["weights"] = weights
    limits = SafetyLimits.on_robot(controller.robot, sample_time=controller.sample_time)
    record = parameter_record(controller, replace(limits, max_unchanged=0))  # the encoders never count
    given = record.tobytes() + samples.tobytes()
    done = subprocess.run([run], input=given, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[:3000]
    outcomes = np.frombuffer(done.stdout, OUTCOME)
    assert len(outcomes) == len(samples)
    counts = dict.fromkeys(AnswerResult, 0)
    for number, (sample, outcome) in enumerate(zip(samples, outcomes, strict=True)):
        if sample["type"] in (Tune.TYPE, StepBack.TYPE):
            counts[AnswerResult(outcome["result"])] += 1
        if sample["type"] == Tune.TYPE:
            numbers = np.array([*sample["setting"]["weights"], sample["setting"]["compensation"]])
            wanted = number > 100 and is_within(controller, numbers)
            assert (outcome["result"] == AnswerResult.OK) == wanted, numbers
    # each refusal occurs, and before the arming every command is refused
    refused = (AnswerResult.DISARMED, AnswerResult.GAINS, AnswerResult.COMPENSATION)
    assert all(counts[result] > 0 for result in (AnswerResult.OK, *refused))
    now = outcomes["tuning"]["now"]
    step = float(record["law"]["tuning"]["step"][0])
    assert np.abs(np.diff(now, axis=0)).max() <= step * (1.0 + 1e-4)
    assert (now >= 0.0).all()
    assert (now[:, :2].sum(axis=1) <= 1.0 + 1e-5).all()
    assert np.abs(outcomes["torques"]).max() <= controller.torque_limit * (1.0 + 1e-6)
    assert np.abs(outcomes["torques"][101:]).max() > 0.0
