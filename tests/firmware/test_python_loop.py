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
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller, write_controller
from ballbot.control.presets import nominal_controller
from ballbot.firmware.estimators import READING, whole_counts
from ballbot.firmware.export import export_controller
from ballbot.log.mapping import apply_mapping, parse_mapping
from ballbot.simulation.held_robot import HeldRobot
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.plant import Measurement
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
speed = { from = ["v_1", "v_2", "v_3"], unit = "deg/s" }
[input]
kind = "duty"
from = ["m1", "m2", "m3"]
scale = 0.01
sign = -1
supply_voltage = 11.1
torque_constant = 0.01
back_emf_constant = 0.01
gear_ratio = 70.0
dead_band = 0.03
"""
#: of Ballbot's logs
NAMES = {
    "wheels": ("wheel1", "wheel2", "wheel3"),
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
    "attitude": ("theta", "phi", "psi"),
}


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("given")
    ROBOT.write(folder / "robot.toml")
    soft = nominal_controller(ROBOT)
    # by kinematics: a Kalman filter's state differs by more than the readings do
    onboard = Controller(ROBOT, soft.gain, sample_time=soft.sample_time)
    write_controller(onboard, folder / "controller.toml")
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
    names = [name for group in NAMES.values() for name in group]
    table = np.column_stack([log[name] for name in names])[:2000]
    table[random.random(table.shape) < 0.002] = np.nan
    readings = [
        dict(zip(names, (None if math.isnan(v) else v for v in row), strict=True)) for row in table.tolist()
    ]
    return [{"t": t, **reading} for t, reading in zip(log.t.tolist(), readings, strict=False)]


def followed(t: float) -> list[float]:
    """Return what the swaying robot followed; a wheel that turned under other torques would seem stuck."""
    x, y, psi = 0.25 * math.sin(1.3 * t), 0.25 * math.sin(1.9 * t + 1.0), 0.6 * math.sin(1.1 * t)
    return [x, y, 0.0, 0.0, psi]


def test_module_alone_gives_the_bits_of_the_firmware_on_a_log(given, rows, tmp_path):
    program = """
import json, sys
sys.path.insert(0, sys.argv[1])
from ballbot_loop import Loop
loop, rows = Loop(), json.load(open(sys.argv[2]))
loop.skip_self_test()
assert loop.arm()
commands = [loop.update(row["t"], row, reference) for row, reference in rows]
assert "numpy" not in sys.modules and "site" not in sys.modules
json.dump([commands, loop.stop], sys.stdout)
"""
    references = [followed(row["t"]) for row in rows]
    (tmp_path / "rows.json").write_text(json.dumps(list(zip(rows, references, strict=True))))
    command = [sys.executable, "-I", "-S", "-c", program, given / "loop", tmp_path / "rows.json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    commands, stop = json.loads(done.stdout)
    assert stop == ""

    robot = Robot.load(given / "robot.toml")
    exported = export_controller(read_controller(given / "controller.toml", robot))
    firmware, encoders = Firmware(exported.parameters), ctypes.create_string_buffer(64)
    firmware.skip_self_test()
    firmware.arm()
    for row, reference, command in zip(rows, references, commands, strict=True):
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
        torques = firmware.update(record, round(1e6 * row["t"]), np.array([*reference, 0, 0, 0, 0, 0.0]))
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


def logged(seen: Measurement) -> dict[str, float]:
    """Return what the robot of `MAPPING` logs of a measurement."""
    attitude = seen.state[2:5] if seen.attitude is None else seen.attitude
    row = as_logged(attitude[None], seen.gyro[None], seen.wheel_angles[None])
    return {name: float(value[0]) for name, value in row.items()}


def torques_of(command: dict[str, float], speeds: np.ndarray) -> np.ndarray:
    """Return the torques [N m] of the motors of `MAPPING` under a command, at wheel speeds [rad/s]."""
    duty = -0.01 * np.array([command["m1"], command["m3"], command["m2"]])
    acting = np.clip(duty + 0.03 * np.sign(duty), -1.0, 1.0)
    return 70.0 * 0.01 / ROBOT.drive.resistance * (11.1 * acting - 0.01 * 70.0 * speeds)


ATTITUDE = MAPPING[MAPPING.index("[attitude]") : MAPPING.index("[wheels]")]
INPUT = MAPPING[MAPPING.index("[input]") :]
OTHERS = {
    "duty and degrees": MAPPING,
    "no yaw": MAPPING.replace(', "yaw"', "").replace("sign = [1, -1, 1]\nturn", "sign = [1, -1]\nturn"),
    "upside down": MAPPING.replace('"roll"', '"hanging"').replace("turn =", "upside_down = true\nturn ="),
    "quaternion": MAPPING.replace(
        ATTITUDE,
        '[attitude]\nfrom = ["qw", "qx", "qy", "qz"]\nturn = 30.0\n'
        'rates = { from = ["gx", "gy", "gz"], unit = "deg/s", sign = [1, -1, 1] }\n',
    ),
    "tilts": MAPPING.replace("turn =", 'sequence = "XYZ"\nturn ='),
    "angles of the body": MAPPING.replace(
        ATTITUDE,
        'theta = { from = "roll", unit = "deg" }\nphi = { from = "pitch", unit = "deg", offset = 0.01 }\n'
        'psi = { from = "yaw", unit = "deg" }\ngyro_x = { from = "gx", unit = "deg/s" }\n'
        'gyro_y = { from = "gy", unit = "deg/s" }\ngyro_z = { from = "gz", unit = "deg/s" }\n',
    ),
    "current and direction": MAPPING.replace(
        INPUT,
        '[input]\nkind = "current"\nfrom = ["m1", "m2", "m3"]\ndirection = ["d1", "d2", "d3"]\nsign = [1, -1, 1]\n'
        "scale = 0.001\nzero = 12.0\ntorque_constant = 0.01\ngear_ratio = 70.0\nefficiency = 0.8\n",
    ),
    "counts that wrap, and torques": MAPPING.replace(
        INPUT, '[input]\nkind = "torque"\nfrom = ["m1", "m2", "m3"]\nunit = "mN m"\n'
    ).replace(
        'from = ["enc_1", "enc_2", "enc_3"], unit = "deg"',
        'from = ["n_1", "n_2", "n_3"], unit = "counts", counts_per_turn = 4480, wrap = 256',
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_mapping_turned_round_is_the_inverse_of_the_log_s_reader(given, tmp_path, name):
    """Commands of the module, read as a log by the mapping, are the torques of the module in SI units."""
    log = swaying_log().between(0.0, 5.0)
    columns = {name: np.column_stack([log[one] for one in NAMES[name]]) for name in NAMES}
    table = as_logged(columns["attitude"], columns["gyro"], columns["wheels"])
    for i in (1, 2, 3):
        table[f"n_{i}"] = np.round(4480.0 / 360.0 * table[f"enc_{i}"]) % 256.0
        table[f"v_{i}"] = np.diff(table[f"enc_{i}"], prepend=0.0) / 0.005
    table |= {"ms": 1e3 * log.t} | {f"{c}{i}": 0.0 * log.t for i in (1, 2, 3) for c in "md"}
    assert export(given, tmp_path / "course", OTHERS[name]) == 0
    mapping, mapped, plain = (
        parse_mapping(OTHERS[name], source="a test"),
        load(tmp_path / "course"),
        load(given / "loop"),
    )
    seen = apply_mapping(mapping, table, robot=ROBOT)
    loops = plain.Loop(), mapped.Loop()
    for loop in loops:
        loop.skip_self_test()
        assert loop.arm()
    torques = np.zeros((len(log.t), 3))
    for k, t in enumerate(log.t):
        torques[k] = [
            *loops[0].update(t, {name: seen[name][k] for name in plain.COLUMNS}, followed(t)).values()
        ]
        command = loops[1].update(1e3 * t, {name: table[name][k] for name in mapped.COLUMNS}, followed(t))
        for column, value in command.items():
            table[column][k] = value
    assert loops[0].stop == loops[1].stop == ""
    found = apply_mapping(mapping, table, robot=ROBOT)
    zeros = {"current and direction": 12.0}.get(name, 0.0)
    for i, u in enumerate(torques.T, start=1):
        # a command within the dead band is zero
        commanded = np.abs(table[mapping.sources[f"u{i}"].column] - zeros) > 1e-9
        assert np.count_nonzero(commanded) > 500
        # single precision of the readings; without a yaw, the log's reader integrates the gyro by trapezoids
        np.testing.assert_allclose(found[f"u{i}"][commanded], u[commanded], atol=1e-3)


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
        command = loop.update(1e3 * seen.t, logged(seen))
        seen = robot.step(torques_of(command, seen.wheel_speeds), module.SAMPLE_TIME)
        lean.append(math.hypot(*seen.truth[2:4]))
        assert seen.ended is None
    assert loop.stop == ""
    assert max(lean[-200:]) < 0.03  # the start has 0.035
    loop.disarm()
    assert set(loop.update(1e3 * seen.t + 5.0, dict.fromkeys(module.COLUMNS)).values()) == {0.0}


#: theta, phi, psi [rad] to which a hand moves the robot
POSITIONS = {
    "hold upright": (0.0, 0.0, 0.0),
    "tilt forward": (0.0, math.radians(15.0), 0.0),
    "tilt left": (-math.radians(15.0), 0.0, 0.0),
    "turn left": (0.0, 0.0, math.radians(45.0)),
}


@pytest.mark.parametrize(("reversed_motor", "result"), [(None, ("passed", 0)), ("m3", ("torque sign", 2))])
def test_self_test_moves_through_its_positions_and_names_a_wrong_motor(
    given, tmp_path, reversed_motor, result
):
    assert export(given, tmp_path / "course", MAPPING) == 0
    module, hand = load(tmp_path / "course"), HeldRobot(ROBOT)
    loop, seen, words = module.Loop(), hand.reset(seed=1), [""]
    loop.start_self_test()
    assert not loop.arm()
    while loop.self_test in ("running", *POSITIONS) and seen.t < 60.0:
        command = loop.update(1e3 * seen.t, logged(seen))
        if loop.self_test == "imu passed":
            loop.start_self_test()
        if loop.self_test != words[-1]:
            words.append(loop.self_test)
            if loop.self_test in POSITIONS:
                hand.tilt(POSITIONS[loop.self_test])
        if reversed_motor:
            command[reversed_motor] *= -1.0
        seen = hand.step(torques_of(command, seen.wheel_speeds), module.SAMPLE_TIME)
    assert set(words) >= {*POSITIONS, "running"}
    assert (loop.self_test, loop.wheel) == result
    assert loop.arm() == (result[0] == "passed")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[columns]", "complete = false\n[columns]", "the mapping is not complete"),
        ("rates =", "# ", "needs the IMU's rates; the mapping lacks imu_rate_x, imu_rate_y, imu_rate_z"),
        (INPUT, "", "needs [input]; the mapping lacks u1, u2, u3"),
        ("gear_ratio = 70.0", "gear_ratio = 53.0", "of another robot: it has 3 motors of gear ratio 53"),
    ],
)
def test_mapping_that_cannot_be_turned_round_is_refused(given, tmp_path, capsys, old, new, sentence):
    assert export(given, tmp_path / "course", MAPPING.replace(old, new)) == 2
    refusal = capsys.readouterr().err
    assert sentence in refusal
    assert refusal.count("ballbot: ") == 1
    assert not (tmp_path / "course").exists()


def test_mapping_without_python_is_refused(given, tmp_path, capsys):
    arguments = [str(given / "controller.toml"), "--robot", "rob311", "--mapping", "mapping.toml"]
    assert main(["export", *arguments, "--out", str(tmp_path / "out")]) == 2
    assert "--mapping is for the module that --python writes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("compiler", "sentence"),
    [
        (None, "ballbot_loop needs a C compiler: there is no `cc`; install gcc."),
        ("echo broken >&2; exit 1", "cc refuses the sources of ballbot_loop: broken"),
    ],
)
def test_missing_or_failing_compiler_is_one_sentence(given, tmp_path, compiler, sentence):
    folder = shutil.copytree(
        given / "loop", tmp_path / "loop", ignore=shutil.ignore_patterns("*.so", "__pycache__")
    )
    done = imported(folder, tmp_path / "bin", compiler)
    assert done.stderr.strip().splitlines()[-1].startswith("ImportError: ")
    assert done.stderr.strip().endswith(sentence)
    assert not list(folder.glob("ballbot_loop-*"))


def test_sources_are_compiled_once_by_one_call_and_again_when_they_change(given, tmp_path):
    folder = shutil.copytree(given / "loop", tmp_path / "loop")
    compiled, calls = next(folder.glob("*.so")), tmp_path / "calls"
    takes = f'echo "$@" >> {calls}; for target; do :; done; /bin/cp {compiled} "$target"'
    assert imported(folder, tmp_path / "bin", takes).returncode == 0
    assert not calls.exists()
    with (folder / "src" / "safety.c").open("a") as file:
        file.write("/* changed */\n")
    for _ in range(2):
        assert imported(folder, tmp_path / "bin", takes).returncode == 0
    (call,) = calls.read_text().splitlines()
    assert "-ffp-contract=off" in call.split()
    assert len(list(folder.glob("*.so"))) == 2


def imported(folder: Path, tools: Path, compiler: str | None) -> subprocess.CompletedProcess[str]:
    """Import the module where only this shell script is a compiler."""
    tools.mkdir(exist_ok=True)
    if compiler is not None:
        (tools / "cc").write_text(f"#!/bin/sh\n{compiler}\n")
        (tools / "cc").chmod(0o755)
    program = f"import sys; sys.path.insert(0, {str(folder)!r}); import ballbot_loop"
    command = [sys.executable, "-I", "-S", "-c", program]
    return subprocess.run(command, env={"PATH": str(tools)}, capture_output=True, text=True, check=False)
