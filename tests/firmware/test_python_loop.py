"""`ballbot export --python`: a module that needs Python and a compiler alone computes what a board computes."""

import ctypes
import importlib.util
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot import Model, Robot
from ballbot.cli.main import main
from ballbot.control.file import read_controller, write_controller
from ballbot.control.presets import nominal_controller
from ballbot.firmware.estimators import READING, whole_counts
from ballbot.firmware.export import export_controller
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Twin
from tests.support.compiled_firmware import Firmware, library
from tests.support.foreign_log_examples import small_robot, swaying_log

pytestmark = pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler `cc`")

ROBOT = small_robot()
#: a course robot: duties of +-100, degrees, an IMU turned by 30 degrees with one axis reversed, other signs and orders
MAPPING = """
[columns]
t = { from = "ms", unit = "ms" }
[attitude]
from = ["roll", "pitch", "yaw"]
unit = "deg"
sign = [1, -1, 1]
turn = 30.0
rates = { from = ["gx", "gy", "gz"], unit = "deg/s", sign = [1, -1, 1] }
[wheels]
order = [1, 3, 2]
sign = [1, 1, -1]
angle = { from = ["enc_1", "enc_2", "enc_3"], unit = "deg" }
[input]
kind = "duty"
from = ["m1", "m2", "m3"]
scale = 0.01
sign = -1
supply_voltage = 11.1
torque_constant = 0.01
back_emf_constant = 0.01
resistance = 2.0
gear_ratio = 70.0
dead_band = 0.03
"""


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("given")
    ROBOT.write(folder / "robot.toml")
    write_controller(nominal_controller(ROBOT), folder / "controller.toml")
    assert export(folder, folder / "loop") == 0
    load(folder / "loop")  # compiles
    return folder


def export(given: Path, out: Path, mapping: str = "") -> int:
    """Export the controller, and take the compiled file along: the sources are the same."""
    arguments = ["export", str(given / "controller.toml"), "--robot", str(given / "robot.toml"), "--python"]
    if mapping:
        out.with_suffix(".toml").write_text(mapping)
        arguments += ["--mapping", str(out.with_suffix(".toml"))]
    code = main([*arguments, "--out", str(out), "--quiet"])
    if code == 0 and (given / "loop") != out:
        shutil.copy(next((given / "loop").glob("*.so")), out)
    return code


def load(folder: Path):
    """Return the module of a folder."""
    spec = importlib.util.spec_from_file_location(f"loop_{folder.name}", folder / "ballbot_loop.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rows() -> list[dict[str, float | None]]:
    """Return a swaying robot's readings, some without the encoders or a value of the IMU."""
    log, random = swaying_log(), np.random.default_rng(5)
    names = [f"wheel{i}" for i in (1, 2, 3)] + ["gyro_x", "gyro_y", "gyro_z", "theta", "phi", "psi"]
    table = np.column_stack([log[name] for name in names])[:2000]
    table[random.random(table.shape) < 0.002] = np.nan
    readings = [
        dict(zip(names, (None if math.isnan(v) else v for v in row), strict=True)) for row in table.tolist()
    ]
    return [{"t": t, **reading} for t, reading in zip(log.t.tolist(), readings, strict=False)]


def test_module_alone_gives_the_bits_of_the_firmware_on_a_log(given, rows, tmp_path):
    program = """
import json, sys
sys.path.insert(0, sys.argv[1])
from ballbot_loop import Loop
loop, rows = Loop(), json.load(open(sys.argv[2]))
loop.skip_self_test()
assert loop.arm()
commands = [loop.update(row["t"], row, [0.1, 0.0, 0.0, 0.0, 0.2]) for row in rows]
assert "numpy" not in sys.modules and "site" not in sys.modules
json.dump([commands, loop.stop], sys.stdout)
"""
    (tmp_path / "rows.json").write_text(json.dumps(rows))
    command = [sys.executable, "-I", "-S", "-c", program, given / "loop", tmp_path / "rows.json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    commands, stop = json.loads(done.stdout)
    assert stop == ""

    robot = Robot.load(given / "robot.toml")
    exported = export_controller(read_controller(given / "controller.toml", robot))
    firmware, encoders = Firmware(exported.parameters), ctypes.create_string_buffer(64)
    firmware.skip_self_test()
    firmware.arm()
    for row, command in zip(rows, commands, strict=True):
        record = np.zeros(1, READING.dtype("single"))
        record["fix_position"], record["fix_heading"] = np.nan, np.nan
        record["gyro"] = [[np.nan if row[f"gyro_{axis}"] is None else row[f"gyro_{axis}"] for axis in "xyz"]]
        record["attitude"] = [[np.nan if row[n] is None else row[n] for n in ("theta", "phi", "psi")]]
        angles = [row[f"wheel{i}"] for i in (1, 2, 3)]
        counts = None if None in angles else whole_counts(angles, robot=robot)
        library().functions.ballbot_take_encoders(
            encoders, ctypes.c_void_p(exported.parameters.ctypes.data),
            None if counts is None else ctypes.c_void_p(counts.ctypes.data), ctypes.c_void_p(record.ctypes.data),
        )  # fmt: skip
        torques = firmware.update(
            record, round(1e6 * row["t"]), np.array([0.1, 0, 0, 0, 0.2, 0, 0, 0, 0, 0.0])
        )
        assert [command[f"u{i}"] for i in (1, 2, 3)] == torques.tolist()
    assert np.abs(torques).max() > 0.01


def as_logged(attitude: np.ndarray, gyro: np.ndarray, wheels: np.ndarray) -> dict[str, np.ndarray]:
    """Return what the robot of `MAPPING` logs, (N,) each, of its angles (N, 3) [rad] and gyro (N, 3) [rad/s]."""
    mounted = Rotation.from_euler("XYZ", attitude) * Rotation.from_euler("Z", math.radians(30.0))
    yaw, pitch, roll = np.degrees(mounted.as_euler("ZYX")).T
    gx, gy, gz = np.degrees(Rotation.from_euler("Z", -math.radians(30.0)).apply(gyro)).T
    first, second, third = np.degrees(wheels).T
    qx, qy, qz, qw = mounted.as_quat().T
    imu = {"roll": roll, "pitch": -pitch, "yaw": yaw, "hanging": (roll + 360.0) % 360.0 - 180.0}
    imu |= {"gx": gx, "gy": -gy, "gz": gz, "qw": qw, "qx": qx, "qy": qy, "qz": qz}
    return imu | {"enc_1": first, "enc_3": -second, "enc_2": third}


def torques_of(command: dict[str, float], speeds: np.ndarray) -> np.ndarray:
    """Return the torques [N m] of the motors of `MAPPING` under a command, at wheel speeds [rad/s]."""
    duty = -0.01 * np.array([command["m1"], command["m3"], command["m2"]])
    acting = np.clip(duty + 0.03 * np.sign(duty), -1.0, 1.0)
    return 70.0 * 0.01 / 2.0 * (11.1 * acting - 0.01 * 70.0 * speeds)


@pytest.mark.parametrize(
    "plant",
    [
        lambda: SensedPlant(Model(ROBOT), Imperfections(sensors=ROBOT.sensors, backlash=0.005)),
        pytest.param(lambda: Twin(ROBOT), marks=pytest.mark.slow),
    ],
    ids=["model", "twin"],
)
def test_robot_that_speaks_duty_and_degrees_balances(given, tmp_path, plant):
    assert export(given, tmp_path / "course", MAPPING) == 0
    module, robot = load(tmp_path / "course"), plant()
    loop = module.Loop()
    start = np.zeros(10)
    start[3] = math.radians(2.0)
    seen = robot.reset(start, seed=3)
    loop.skip_self_test()
    assert loop.arm()
    lean = []
    for _ in range(round(4.0 / module.SAMPLE_TIME)):
        attitude = seen.state[2:5] if seen.attitude is None else seen.attitude
        row = as_logged(attitude[None], seen.gyro[None], seen.wheel_angles[None])
        command = loop.update(1e3 * seen.t, {name: float(value[0]) for name, value in row.items()})
        seen = robot.step(torques_of(command, seen.wheel_speeds), module.SAMPLE_TIME)
        lean.append(math.hypot(*seen.truth[2:4]))
        assert seen.ended is None
    assert loop.stop == ""
    assert max(lean[-200:]) < 0.03  # the start has 0.035
    loop.disarm()
    assert set(loop.update(1e3 * seen.t + 5.0, dict.fromkeys(module.COLUMNS)).values()) == {0.0}
