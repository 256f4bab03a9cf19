"""The check of the IMU's axes: right ones pass, wrong ones are named."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot.control.presets import nominal_controller
from ballbot.control.safety import SafetyLimits
from ballbot.firmware.build import compilers
from ballbot.firmware.records import READING, SelfTestOutcome, parameter_record
from tests.support.compiled_firmware import Firmware
from tests.support.control_examples import alten

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

H = 0.02
#: rotation vectors of a body that is moved as it should be: about y, -x and z, and back each time [rad]
TURNS = np.radians([[0, 15, 0], [0, 0, 0], [-15, 0, 0], [0, 0, 0], [0, 0, 45]])


@cache
def motion(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return orientations (N, 3, 3) of a body and its angular velocities (N, 3), with the tremor of a hand."""
    random = np.random.default_rng(seed)
    way, present = [np.zeros(3)] * 40, np.zeros(3)
    for turn in TURNS:
        ramp = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 50))[:, None]
        way += [*(present + ramp * (turn - present)), *[turn] * 40]
        present = turn
    tremor = np.cumsum(2e-4 * random.standard_normal((len(way), 3)), axis=0)
    body = Rotation.from_rotvec(np.array(way) + tremor)
    turned = (body[:-1].inv() * body[1:]).as_rotvec() / H
    return body.as_matrix(), np.vstack([np.zeros(3), turned]) + 0.005 * random.standard_normal((len(way), 3))


RIGHT = Rotation.identity()


def sensed(mounting: Rotation = RIGHT) -> tuple[np.ndarray, np.ndarray]:
    """Return gyro and attitude of an IMU whose frame is turned in the body; its heading begins at zero."""
    orientations, rates = motion()
    turned = mounting.inv() * Rotation.from_matrix(orientations) * mounting
    attitude = turned.as_euler("XYZ")
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return mounting.inv().apply(rates), attitude


def result(gyro: np.ndarray, attitude: np.ndarray) -> tuple[SelfTestOutcome, int]:
    """Return what the firmware waits for in the end, or its result, and the number of the movement."""
    record = parameter_record(nominal_controller(alten()), SafetyLimits.on_robot(alten(), sample_time=H))
    record["sample_time"] = H
    made = Firmware(record)
    reading = np.zeros(1, READING.dtype("single"))
    made.start_self_test()
    for k, (rate, angles) in enumerate(zip(gyro, attitude, strict=True)):
        reading["gyro"], reading["attitude"] = rate, angles
        assert not made.update(reading, 20_000 * k, None).any()
        assert not made.arm()
    return made.self_test, int(made.state["self_test"]["wheel"][0])


@pytest.mark.parametrize("off", [0.0, 10.0])
def test_right_axes_pass_though_they_are_ten_degrees_off_about_the_vertical(off):
    mounting = Rotation.from_rotvec([0.0, 0.0, np.radians(off)])
    assert result(*sensed(mounting))[0] is SelfTestOutcome.IMU_PASSED


@pytest.mark.parametrize(
    "offset", [[np.pi, 0.0], [0.0, np.pi / 2], [0.15, 0.0]], ids=["upside down", "on its side", "at an angle"]
)
def test_imu_that_does_not_show_gravity_where_it_is_never_begins(offset):
    gyro, attitude = sensed()
    assert result(gyro, attitude + np.array([*offset, 0.0])) == (SelfTestOutcome.HOLD_UPRIGHT, 1)


def changed(array: np.ndarray, *, order=(0, 1, 2), signs=(1.0, 1.0, 1.0)) -> np.ndarray:
    return array[:, order] * np.array(signs)


@pytest.mark.parametrize(
    ("options", "movement"),
    [
        ({"order": (1, 0, 2)}, 1),
        ({"signs": (1.0, -1.0, 1.0)}, 1),
        ({"signs": (-1.0, 1.0, 1.0)}, 2),
        ({"signs": (1.0, 1.0, -1.0)}, 3),
    ],
)
def test_exchanged_or_negated_axis_is_found_in_attitude_and_gyro(options, movement):
    gyro, attitude = sensed()
    assert result(gyro, changed(attitude, **options)) == (SelfTestOutcome.IMU_AXES, movement)
    assert result(changed(gyro, **options), attitude) == (SelfTestOutcome.IMU_GYRO, movement)
    # the same mistake in both, as of a driver that has left for right
    both = changed(gyro, **options), changed(attitude, **options)
    assert result(*both) == (SelfTestOutcome.IMU_AXES, movement)


@pytest.mark.parametrize("scale", [0.0, 0.5, 2.0])
def test_gyro_in_another_unit_or_dead_is_found(scale):
    gyro, attitude = sensed()
    assert result(scale * gyro, attitude) == (SelfTestOutcome.IMU_GYRO, 1)


@pytest.mark.parametrize("seed", range(3))
def test_no_other_mounting_passes(seed):
    stage, _ = result(*sensed(Rotation.random(random_state=seed)))
    assert stage is not SelfTestOutcome.IMU_PASSED
