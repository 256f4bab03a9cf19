"""The drivers against encoders of their own: Xbus messages, counters of 16 bits, duty."""

import ctypes
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbot.firmware.build import compilers
from ballbot.mechanics.geometry import rotation
from tests.support.compiled_firmware import library

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")


class Escon(ctypes.Structure):
    _fields_ = [("torque_per_ampere", ctypes.c_float), ("current_range", ctypes.c_float)]


class Quadrature(ctypes.Structure):
    _fields_ = [
        ("reversed", ctypes.c_bool),
        ("started", ctypes.c_bool),
        ("counter", ctypes.c_uint16),
        ("count", ctypes.c_int32),
    ]


class Mti3(ctypes.Structure):
    _fields_ = [
        ("mounting", ctypes.c_float * 9),
        ("data", ctypes.c_uint8 * 254),
        ("sum", ctypes.c_uint8),
        ("length", ctypes.c_uint8),
        ("place", ctypes.c_uint16),
        ("fresh", ctypes.c_bool),
        ("gyro", ctypes.c_float * 3),
        ("quaternion", ctypes.c_float * 4),
    ]


class Sensor:
    """An MTi-3 on the wire, and the driver that reads it."""

    def __init__(self, mounting: np.ndarray | None = None) -> None:
        straight = np.eye(3) if mounting is None else mounting
        self.driver = Mti3(mounting=(ctypes.c_float * 9)(*straight.ravel()))

    def take(self, data: bytes) -> None:
        library().functions.ballbot_mti3_take(ctypes.byref(self.driver), data, ctypes.c_size_t(len(data)))

    def read(self) -> tuple[np.ndarray, np.ndarray] | None:
        gyro, attitude = (ctypes.c_float * 3)(), (ctypes.c_float * 3)()
        call = library().functions.ballbot_mti3_read
        call.restype = ctypes.c_bool
        return (
            (np.array(gyro), np.array(attitude)) if call(ctypes.byref(self.driver), gyro, attitude) else None
        )


def packet(identifier: int, values) -> bytes:
    return struct.pack(f">HB{len(values)}f", identifier, 4 * len(values), *values)


def message(data: bytes, *, kind: int = 0x36) -> bytes:
    body = bytes([0xFF, kind, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) % 256])


def measured(R: np.ndarray, gyro, *, frame: int = 0) -> bytes:
    """Return the message of a sensor whose frame is turned by R and turns with `gyro` in its own frame."""
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    counter = struct.pack(">HBH", 0x1020, 2, 7)
    return message(counter + packet(0x2010 | frame, [w, x, y, z]) + packet(0x8020 | frame, gyro))


angle = st.floats(-1.0, 1.0)
rates = st.lists(st.floats(-5.0, 5.0, width=32), min_size=3, max_size=3)


@settings(max_examples=100, deadline=None)
@given(
    angle,
    angle,
    st.floats(-3.1, 3.1),
    rates,
    st.sampled_from([0x0, 0x8]),
    st.binary(max_size=40),
    st.integers(0, 99),
)
def test_message_gives_the_attitude_and_the_rates(theta, phi, psi, gyro, frame, before, seed):
    """Whatever came before, cut into pieces of any length, and mounted anyhow."""
    mounting = Rotation.random(random_state=seed).as_matrix()
    R = rotation(theta, phi, psi)
    sensor = Sensor(mounting)
    # a sensor in the body: its frame to the body's is the mounting
    wire = before + bytes(260) + measured(R @ mounting, gyro, frame=frame)
    for first in range(0, len(wire), 7):
        sensor.take(wire[first : first + 7])
    found = sensor.read()
    assert found is not None
    # quaternion and mounting are of single precision, and its rotation is summed in it; 1e-6 is eight roundings
    np.testing.assert_allclose(found[1], [theta, phi, psi], atol=1e-6)
    np.testing.assert_allclose(found[0], mounting @ gyro, atol=3e-6)
    assert sensor.read() is None


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 39), st.integers(1, 255))
def test_changed_byte_is_not_taken(place, change):
    wire = bytearray(measured(rotation(0.1, 0.2, 0.3), [1.0, 2.0, 3.0]))
    wire[place] ^= change
    sensor = Sensor()
    sensor.take(bytes(wire))
    assert sensor.read() is None
    sensor.take(bytes(300) + measured(rotation(0.1, 0.2, 0.3), [1.0, 2.0, 3.0]))
    assert sensor.read() is not None


#: beginnings of messages; 255 bytes are more than a message may have
heads = st.sampled_from([bytes.fromhex(one) for one in ("fa", "faff36", "faff3600", "faff36fe", "faff36ff")])
noise = st.lists(heads | st.binary(max_size=300), max_size=4).map(b"".join)


@settings(max_examples=200, deadline=None)
@given(noise)
def test_any_bytes_leave_the_driver_within_its_buffer_and_able_to_take_a_message(data):
    sensor = Sensor()
    for wire in (data, message(data[:254])):
        for byte in wire:
            sensor.take(bytes([byte]))
            # the next byte of a message goes to place - 4 of the buffer, unless it is the checksum
            assert sensor.driver.place <= 4 + min(sensor.driver.length, 254)
            assert sensor.driver.length <= 254 or sensor.driver.place <= 3
        sensor.read()
    assert list(sensor.driver.mounting) == list(np.eye(3).ravel())
    sensor.take(bytes(260) + measured(rotation(0.1, 0.2, 0.3), [1.0, 2.0, 3.0]))
    found = sensor.read()
    assert found is not None
    np.testing.assert_array_equal(found[0], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found[1][:2], [0.1, 0.2], atol=1e-6)


@given(st.booleans(), st.lists(st.integers(-32767, 32767), max_size=30), st.integers(0, 65535))
def test_counts_follow_a_counter_that_wraps_around(backward, steps, start):
    encoder = Quadrature(reversed=backward)
    call = library().functions.ballbot_quadrature_count
    call.restype = ctypes.c_int32
    assert call(ctypes.byref(encoder), ctypes.c_uint16(start)) == 0
    counter, count = start, 0
    for step in steps:
        counter, count = (counter + step) % 65536, count + (-step if backward else step)
        assert call(ctypes.byref(encoder), ctypes.c_uint16(counter)) == count


@given(st.floats(width=32), st.floats(0.125, 2.0, width=32), st.floats(1.0, 10.0, width=32))
def test_duty_stays_within_the_driver_s_range(torque, per_ampere, current_range):
    driver = Escon(per_ampere, current_range)
    call = library().functions.ballbot_escon_duty
    call.restype = ctypes.c_float
    duty = call(ctypes.byref(driver), ctypes.c_float(torque))
    if not math.isfinite(torque):
        assert duty == 0.5
    else:
        wanted = 0.5 + 0.4 * min(1.0, max(-1.0, torque / (per_ampere * current_range)))
        assert duty == pytest.approx(wanted, abs=1e-6)
