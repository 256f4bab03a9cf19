"""The front of the firmware: arming, the safety layer's reasons, and a loop that balances as Python's does."""

import ctypes
import math
import re
import shutil
import subprocess
from random import Random

import numpy as np
import pytest

from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.safety import SafetyLimits, StopReason
from ballbot.errors import InputError
from ballbot.estimation.interface import Reading
from ballbot.firmware.build import compile_sources, compilers, source_files
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.export import PROJECT
from ballbot.firmware.records import SafetyRecord, SafetyState, SelfTestOutcome, parameter_record
from ballbot.records import schema_of
from tests.support.compiled_firmware import Firmware, library, weights_of
from tests.support.control_examples import FRICTION, alten, with_policy
from tests.support.firmware_beside import torques_beside
from tests.support.firmware_safety import Safety

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

ROBOT, H = alten(FRICTION), 0.005
LIMITS = SafetyLimits.on_robot(ROBOT, sample_time=H)


def firmware(*, armed: bool = True, compensation="partial") -> Firmware:
    """Return the firmware of the nominal controller."""
    made = Firmware(parameter_record(nominal_controller(ROBOT, compensation=compensation), LIMITS))
    made.skip_self_test()
    if armed:
        assert made.arm()
    return made


def reading(k: int, *, lean: float = 0.01, **changed) -> np.ndarray:
    """Return what the sensors of a robot that leans give in sample k, with a little noise."""
    noise = 1e-4 * math.sin(12.9898 * k)
    whole = Reading(
        wheel_angles=np.full(3, 0.01 * k),
        wheel_speeds=np.full(3, 0.01 / H),
        gyro=np.full(3, noise),
        attitude=np.array([lean, 0.0, 0.1]),
    )
    record = reading_record(whole, robot=ROBOT)
    for name, value in changed.items():
        record[name] = value
    return record


def run(made: Firmware, count: int, *, first: int = 0, **changed) -> np.ndarray:
    """Return the torques (count, 3) of samples in a row."""
    return np.array([made.update(reading(k, **changed), k * 5000, None) for k in range(first, first + count)])


def test_nothing_moves_before_it_is_armed_nor_after():
    made = firmware(armed=False)
    assert not run(made, 5).any()
    made.arm()
    assert run(made, 5, first=5).all()
    made.disarm()
    assert not run(made, 5, first=10).any()
    assert made.stop is None


@pytest.mark.parametrize("bad", [math.nan, -1.0, math.inf])
@pytest.mark.parametrize("name", ["sample_time", "torque_limit", "lean", "max_interval"])
def test_parameters_that_bound_nothing_are_refused(name, bad):
    record = parameter_record(nominal_controller(ROBOT), LIMITS)
    place = {"torque_limit": record["law"], "lean": record["safety"], "max_interval": record["safety"]}
    place.get(name, record)[name] = bad
    if name in ("lean", "max_interval") and bad == math.inf:  # these limits may be switched off
        Firmware(record)
    else:
        with pytest.raises(InputError, match="does not know these parameters"):
            Firmware(record)


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("checksum", 1),
        ("hidden", 63),
        ("wheels", 4),
        ("period", 0),
        ("torque_limit", 0.0),
        ("torque_limit", math.nan),
    ],
)
def test_policy_of_other_weights_is_refused(name, wrong):
    """As a host may send it; without a policy, the linear law runs in a library that has weights."""
    plain = nominal_controller(ROBOT)
    learned = with_policy(plain)
    weights, record = weights_of(learned), parameter_record(learned, LIMITS)
    for known in (record, parameter_record(plain, LIMITS)):
        Firmware(known, weights=weights)
    with pytest.raises(InputError, match="does not know these parameters"):
        Firmware(record)  # has no weights
    record["law"]["policy"][name] = wrong
    with pytest.raises(InputError, match="does not know these parameters"):
        Firmware(record, weights=weights)


@pytest.mark.parametrize(
    ("reason", "changed"),
    [
        (StopReason.MISSING, {"gyro": np.nan}),
        (StopReason.MISSING, {"encoders_valid": 0, "wheel_speeds": np.nan}),
        (StopReason.LEAN, {"lean": 0.36}),
        (StopReason.STUCK, {"gyro": 0.01}),
    ],
)
def test_every_fault_is_latched_until_armed_again(reason, changed):
    made = firmware()
    assert run(made, 10).all()
    run(made, 25, first=10, **changed)
    assert made.stop is reason
    assert not run(made, 10, first=35).any()
    made.arm()
    assert made.stop is None
    assert run(made, 10, first=45).all()


def test_reasons_have_the_numbers_of_their_order():
    """`ballbot.link` reads the reason from its number."""
    functions = library().functions
    functions.ballbot_stop_word.restype = ctypes.c_char_p
    words = [functions.ballbot_stop_word(number).decode() for number in range(len(StopReason) + 2)]
    assert words == ["", *StopReason, ""]


def test_late_loop_stops_and_the_clock_may_wrap_around():
    made = firmware()
    times = [2**32 - 7000, 2**32 - 2000, 2**32 + 3000, 2**32 + 8000]
    for k, time in enumerate(times):
        assert made.update(reading(k), time, None).all()
    assert not made.update(reading(4), times[-1] + 17_600, None).any()
    assert made.stop is StopReason.LATE


def test_torque_that_is_not_a_number_stops():
    made = firmware()
    made.parameters["law"]["gain"][0, 1, 4] = np.nan  # as a flipped bit in memory would
    assert not run(made, 1).any()
    assert made.stop is StopReason.TORQUE
    assert made.state["safety"]["stop_wheel"] == 2


def test_disarming_ends_the_self_test():
    made = Firmware(parameter_record(nominal_controller(ROBOT), LIMITS))
    made.skip_imu_check()
    made.start_self_test()
    assert run(made, 3).any()
    made.disarm()
    assert made.self_test is SelfTestOutcome.STOPPED
    assert not run(made, 100, first=3).any()
    assert not made.arm()


#: what a sample is drawn from; mostly of a robot that balances, or a run would hardly begin before it stops
SAMPLES = (
    (*(0.005, 0.01) * 20, 0.02, math.nan),  # [s] since the last one
    (*(True,) * 20, False),  # whether it is measured
    *((*(0.0, 0.1, -0.29) * 20, 0.31, -0.5, math.nan),) * 2,  # theta, phi
    (*(0.5, 0.25, 0.1, -0.3) * 10, math.nan),  # of the IMU
    (0, 1),  # encoder
    (*(True,) * 20, False),  # whether it is valid
    (*(1.0, -2.0, 1.5, -1.0) * 10, 0.0, math.nan, math.inf),  # torque
)


def test_safety_layer_decides_as_python_s():
    for seed in range(400):
        assert_safety_decides_alike(Random(seed))


def assert_safety_decides_alike(random: Random) -> None:
    counts = {name: random.randrange(4) for name in ("max_missing", "max_unchanged")}
    run = [[random.choice(one) for one in SAMPLES] for _ in range(25)]
    limits = SafetyLimits(lean=0.3, max_interval=0.0175, turning_torque=1.0, **counts)
    python, functions = Safety(limits), library().functions
    record = np.zeros(1, schema_of(SafetyRecord).dtype("single"))
    for name in record.dtype.names or ():
        record[name] = getattr(limits, name)
    state = np.zeros(1, schema_of(SafetyState).dtype("single"))
    own, now = ctypes.c_void_p(record.ctypes.data), ctypes.c_void_p(state.ctypes.data)
    admit, t, last = functions.ballbot_safety_admit, 0.0, np.zeros(1, np.float32)
    admit.restype, functions.ballbot_stop_word.restype = ctypes.c_bool, ctypes.c_char_p
    for k, (interval, measured, theta, phi, imu, count, valid, torque) in enumerate(run):
        t += interval if k else 0.0  # the first sample has no interval
        values, counts = np.full(6, imu, np.float32), np.array([count], np.int32)
        python.watch(values.tolist(), float(count) if valid else math.nan, float(last[0]))
        functions.ballbot_safety_watch(
            own, now, 1, ctypes.c_void_p(values.ctypes.data), ctypes.c_void_p(counts.ctypes.data),
            ctypes.c_bool(valid), ctypes.c_void_p(last.ctypes.data),
        )  # fmt: skip
        known = math.isfinite(theta) and math.isfinite(phi)
        may = python.admit(t, measured=measured, theta=theta, phi=phi)
        numbers = [ctypes.c_float(one) for one in (interval if k else 0.0, theta, phi)]
        assert may == admit(own, now, numbers[0], ctypes.c_bool(measured), ctypes.c_bool(known), *numbers[1:])
        last = np.array([torque if may else 0.0], np.float32)
        if may:
            released = python.release(torque)
            functions.ballbot_safety_release(now, 1, ctypes.c_void_p(last.ctypes.data))
            assert last[0] == released
        stop = functions.ballbot_stop_word(int(state["stop"][0]))
        assert stop.decode() == (python.stop or "")


@pytest.mark.parametrize("kind", [nominal_controller, precise_controller])
def test_firmware_balances_a_robot_with_the_torques_of_python(kind):
    """Sensors in, torques out, in a loop with noise, encoder counts and play; each has its own estimator and memory."""
    torques = torques_beside(kind(ROBOT, compensation="partial"), duration=4.0)
    # precise: the heading's lags, whose last bits lie w^4 times in the torque; 9e-6 measured
    assert torques.max() < (1e-6 if kind is nominal_controller else 5e-5)


class Held:
    """A robot whose wheels turn freely, wired as given."""

    def __init__(self, signs=(1, 1, 1), order=(0, 1, 2)) -> None:
        self.counts, self.signs, self.order = np.zeros(3), np.array(signs), list(order)

    def sample(self, k: int, torques: np.ndarray) -> np.ndarray:
        """Let the motors turn the wheels for a sample; return what the sensors give."""
        turned = np.zeros(3)
        turned[self.order] = 20.0 * self.signs * torques
        self.counts += turned - 0.3 * turned.sum() / 3.0  # through the ball they turn the others, backward
        record = reading(k)
        record["wheel_counts"][0, :3] = self.counts.astype(np.int64)
        return record


def self_tested(robot: Held, **changed) -> Firmware:
    """Return the firmware after its self-test."""
    made = Firmware(parameter_record(nominal_controller(ROBOT), LIMITS))
    assert not made.arm()
    assert made.self_test is SelfTestOutcome.NOT_RUN
    made.skip_imu_check()
    made.start_self_test()
    torques, k = np.zeros(3), 0
    while made.self_test in (SelfTestOutcome.NOT_RUN, SelfTestOutcome.RUNNING):
        record = robot.sample(k, torques)
        for name, value in changed.items():
            record[name] = value
        torques = made.update(record, 5000 * k, None)
        assert np.count_nonzero(torques) <= 1  # one wheel at a time
        assert np.abs(torques).max() <= made.parameters["self_test"]["torque"][0]
        k += 1
        assert k <= 363  # three wheels, each three pushes of at most 40 samples
    assert not torques.any()
    return made


@pytest.mark.parametrize(
    ("robot", "outcome", "wheel"),
    [
        (Held(), SelfTestOutcome.PASSED, 0),
        (Held(signs=(1, -1, 1)), SelfTestOutcome.TORQUE_SIGN, 2),
        (Held(signs=(1, 1, 0)), SelfTestOutcome.DEAD_MOTOR, 3),
        (Held(order=(0, 2, 1)), SelfTestOutcome.TORQUE_ORDER, 2),
    ],
)
def test_right_wiring_arms_and_wrong_wiring_does_not(robot, outcome, wheel):
    made = self_tested(robot)
    assert made.self_test is outcome
    if outcome is SelfTestOutcome.PASSED:
        assert made.arm()
    else:
        assert made.state["self_test"]["wheel"] == wheel
        assert not made.arm()
        assert not run(made, 3).any()


@pytest.mark.parametrize("changed", [{"encoders_valid": 0}, {"gyro": np.nan}, {"attitude": 0.4}])
def test_self_test_is_stopped_by_what_stops_a_balance(changed):
    made = self_tested(Held(), **changed)
    assert made.self_test is SelfTestOutcome.STOPPED
    assert not made.arm()


@pytest.mark.slow
def test_library_calls_nobody_and_has_no_variables(tmp_path):
    if not shutil.which("nm"):
        pytest.skip("nm is missing")
    compile_sources(tmp_path / "all.o", source_files(), flags=("-O2", "-r", "-nostdlib"))
    listed = subprocess.run(["nm", tmp_path / "all.o"], capture_output=True, text=True, check=True).stdout
    symbols = [line.split()[-2:] for line in listed.splitlines()]
    # what a compiler itself writes for copies of structs
    own = {"memcpy", "memmove", "memset", "_GLOBAL_OFFSET_TABLE_"}
    assert {name for kind, name in symbols if kind == "U"} <= own
    assert [name for kind, name in symbols if kind in "bBdDC"] == []
    assert {name for kind, name in symbols if kind == "T" and not name.startswith("ballbot_")} == set()


def test_functions_are_called_by_name_and_no_jump_leads_backward():
    """So that `Image.stack_bound` finds each circle of calls, and loops are all that takes time."""
    text = "".join(path.read_text() for path in (*source_files(), PROJECT / "robot.c"))
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    assert not re.search(r"\bgoto\b|\bsetjmp\b|\(\*\s*\w+\)\s*\(", text)
