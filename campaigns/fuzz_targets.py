"""The loaders to fuzz: valid inputs of each, and the properties of every accepted input."""

from __future__ import annotations

import io
import json
import math
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow
import scipy.io
import tomli_w
from numpy.typing import NDArray
from pyarrow import parquet

from ballbot.control.file import controller_text, read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import named_reference, read_reference, reference_text
from ballbot.errors import InputError, UnsuitedController
from ballbot.identification.axis.reading import AxisColumns, read_axis_record
from ballbot.identification.quantities import read_bounds
from ballbot.identification.sweep import read_sweep
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.formats import WRITTEN_SUFFIXES, read_foreign_table
from ballbot.log.mapping import parse_mapping, read_mapping
from ballbot.log.pose import read_poses
from ballbot.log.row_order import LONGEST
from ballbot.mechanics.model import Model
from ballbot.report.log_check import summarize
from ballbot.robot import Robot
from ballbot.robot.components import PARAMETERS
from ballbot.robot.derived import derived_quantities
from ballbot.robot.file import robot_text
from ballbot.robot.parameters import value_of
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario
from ballbot.twin.scenario_file import load_scenario, scenario_text
from ballbot.vision.video import open_video
from ballbot.workflows.courses import built_in_sets, read_courses
from tests.support.control_examples import example_parts

ALTEN = Robot.load("alten")


@dataclass(frozen=True, kw_only=True)
class Target:
    """A loader."""

    suffix: str  #: of its files
    samples: tuple[bytes, ...]  #: contents that it accepts
    judge: Callable[[Path], None]  #: reads a file and asserts what must hold; InputError where it is refused


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
resistance = 2.0
gear_ratio = 70.0
dead_band = 0.0314
"""
_MAPPING_2 = """\
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
[input]
kind = "current"
from = ["d1", "d2", "d3"]
torque_constant = 0.01
gear_ratio = 70.0
"""
_BOUNDS = """\
viscous = [0.0, 0.1]
coulomb = [0.0, 0.5]
stribeck_speed = [0.1, 3.0]
stribeck_exponent = [0.3, 10.0]
rolling = [0.0, 0.05]
delay = [0.012, 0.012]
lean_bias = [-0.1, 0.1]
"""


@cache
def _log(duration: float = 8.0, every: int = 4) -> Log:
    """Return a log that is long enough for every check, with so few rows that it is written soon."""
    lean = np.zeros(10)
    lean[2] = 0.03
    controller = nominal_controller(ALTEN)
    run = simulate(
        Model(ALTEN),
        controller,
        named_reference("square"),
        duration=duration,
        initial_state=lean,
    )
    noise = np.random.default_rng(1)
    log = run.without_truth().select(slice(None, None, every))
    noisy = {name: log[name] + 1e-5 * noise.standard_normal(len(log)) for name in log.names if name != "t"}
    return log.with_columns(noisy)


def _film() -> Log:
    t = 0.01 * np.arange(60)
    zero = np.zeros_like(t)
    angle = 0.1 * np.sin(t)
    columns = {
        "t": t,
        "x": 0.1 * t,
        "y": zero,
        "z": zero + 0.11,
        "qw": np.cos(angle / 2),
        "qx": np.sin(angle / 2),
    }
    return Log(columns | {"qy": zero, "qz": zero})


def _reference() -> Log:
    t = 0.5 * np.arange(12)
    return Log({"t": t, "ref_x": np.sin(t), "ref_y": np.cos(t), "ref_psi": 0.0 * t})


def _axis() -> Log:
    t = 0.001 * np.arange(200)
    return Log(
        {"t": t, "position": np.sin(5.0 * t), "force": np.cos(5.0 * t), "reference": np.sin(5.0 * t + 0.1)}
    )


def _csv(log: Log, *, quoted: bool = False) -> bytes:
    mark = '"' if quoted else ""
    rows = np.column_stack([log[name] for name in log.names]).tolist()
    lines = [",".join(f"{mark}{name}{mark}" for name in log.names)]
    lines += [
        ",".join("" if quoted and k == 7 else f"{value:.9g}" for k, value in enumerate(row)) for row in rows
    ]
    return ("\n".join(lines) + "\n").encode()


def _parquet(log: Log) -> tuple[bytes, ...]:
    contents = []
    for compression in ("snappy", "none"):
        stream = io.BytesIO()
        parquet.write_table(pyarrow.table(dict(log.columns)), stream, compression=compression)
        contents.append(stream.getvalue())
    return tuple(contents)


def _mat(log: Log) -> tuple[bytes, ...]:
    variables = dict(log.columns) | {
        "kp": 3.0,
        "words": "text",
        "table": np.eye(3),
        "cell": np.array([1, "a"], object),
    }
    contents = []
    for version, packed in (("5", False), ("5", True), ("4", False)):
        stream = io.BytesIO()
        kept = {name: value for name, value in variables.items() if version == "5" or name != "cell"}
        scipy.io.savemat(stream, kept, format=version, do_compression=packed)
        contents.append(stream.getvalue())
    return tuple(contents)


def _raw() -> bytes:
    lines = ["time\troll\tpitch\tyaw\tenc_1\tenc_2\tenc_3\td1\td2\td3"]
    for k in range(100):
        angles = [f"{np.sin(0.05 * k + i):.4f}" for i in range(3)]
        counts = [str(round(1000 * np.sin(0.03 * k + i))) for i in range(3)]
        duties = [f"{0.3 * np.cos(0.1 * k + i):.3f}" for i in range(3)]
        lines.append("\t".join([str(5 * k), *angles, *counts, *duties]))
    return "\n".join(lines).encode()


def _video() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (64, 48))
        for k in range(12):
            picture = np.zeros((48, 64, 3), np.uint8)
            picture[:, 2 * k : 2 * k + 20] = (200, 100, 50)
            writer.write(picture)
        writer.release()
        return path.read_bytes()


def _scenarios() -> tuple[bytes, ...]:
    from ballbot.simulation.imperfections import Push
    from ballbot.twin.faults import Payload, Roughness, Timing

    nominal = Scenario.nominal(ALTEN)
    full = replace(
        nominal,
        name="full",
        pushes=(Push(time=1.0, duration=0.1, force=(10.0, 0.0, 0.0), height=0.4),),
        payload=Payload(mass=1.0, position=(0.0, 0.1, 0.5)),
        roughness=Roughness(height=1e-4, wavelength=0.05, seed=1),
        timing=Timing(delay=1, jitter=1e-3),
    )
    return scenario_text(nominal).encode(), scenario_text(full).encode()


def _courses() -> bytes:
    some = [*built_in_sets()["disturbances"].items()][:4]
    return tomli_w.dumps({"mine": dict(some)}).encode()


def _controllers() -> tuple[bytes, ...]:
    plain = nominal_controller(ALTEN, compensation="full")
    return tuple(
        controller_text(one).encode() for one in (plain, plain.with_parts(example_parts(ALTEN.wheel_count)))
    )


def _sweep() -> bytes:
    parameters = {"b": [0.01, 0.02, 0.015], "c": [0.1, 0.2, 0.15]}
    labels = {"labels": ["b", "c"], "matrices": [[[1.0, 0.2], [0.2, 1.0]]] * 3}
    return json.dumps(
        {"parameters": parameters, "standard_errors": parameters, "correlation": labels}, indent=1
    ).encode()


def _judge_log(path: Path) -> None:
    log = _judge_columns(path)
    summarize(log)
    check(log, robot=ALTEN)


def _judge_columns(path: Path) -> Log:
    """Return a log that is read, written and read back; the checks see the same numbers from every format."""
    log = Log.read(path)
    _assert_log(log)
    for suffix in WRITTEN_SUFFIXES:
        copy = path.with_name(f"copy{suffix}")
        try:
            log.write(copy)
        except InputError as error:
            if "; use " not in str(error) or "cannot be written to" not in str(error):
                raise
            continue
        _assert_same(log, Log.read(copy))
    return log


def _judge_parquet(path: Path) -> None:
    _judge_columns(path)


def _assert_log(log: Log) -> None:
    assert len(log) > 0
    assert np.isfinite(log.t).all()
    assert (np.diff(log.t) > 0.0).all()
    assert log.t[-1] - log.t[0] <= LONGEST
    for name in log.names:
        assert log[name].shape == log.t.shape
        assert not np.isinf(log[name]).any(), f"{name} holds an infinity"


def _assert_same(log: Log, copy: Log) -> None:
    assert copy.names == log.names
    for name in log.names:
        assert np.array_equal(log[name], copy[name], equal_nan=True), f"{name} was not read back"


def _judge_foreign(path: Path) -> None:
    table = read_foreign_table(path)
    lengths = {values.shape for values in table.columns.values()}
    assert len(lengths) == 1
    assert not any(np.isinf(values).any() for values in table.columns.values())


def _judge_mapped(path: Path) -> None:
    _assert_log(Log.read(path, mapping=parse_mapping(MAPPING, source="the mapping")))


_RAW = _raw()


def _judge_mapping(path: Path) -> None:
    mapping = read_mapping(path)
    raw = path.with_name("raw.txt")
    raw.write_bytes(_RAW)
    _assert_log(Log.read(raw, mapping=mapping))


def _judge_robot(path: Path) -> None:
    robot = Robot.load(path)
    for parameter in PARAMETERS:
        assert np.isfinite(np.asarray(value_of(robot, parameter), float)).all()
    assert all(math.isfinite(one.value) for one in derived_quantities(robot))
    copy = path.with_name("copy.toml")
    copy.write_text(robot_text(robot), encoding="utf-8")
    assert Robot.load(copy) == robot


def _judge_scenario(path: Path) -> None:
    scenario = load_scenario(path, ALTEN)
    _assert_finite(scenario)
    copy = path.with_name("copy.toml")
    copy.write_text(scenario_text(scenario), encoding="utf-8")
    assert load_scenario(copy, ALTEN) == scenario


def _assert_finite(value: Any) -> None:
    if is_dataclass(value):
        for field in fields(value):
            _assert_finite(getattr(value, field.name))
    elif isinstance(value, tuple | list):
        for one in value:
            _assert_finite(one)
    elif isinstance(value, int | float):
        assert math.isfinite(value)


def _judge_courses(path: Path) -> None:
    for course in read_courses(path, ALTEN, "twin"):
        assert 0.0 < course.duration <= 86400.0
        assert math.isfinite(course.settle)
        _assert_reference(course.reference_spec.reference())
        _assert_finite(course.scenario)


def _assert_reference(reference: Callable[[float], NDArray[np.float64]]) -> None:
    for t in (0.0, 0.005, 1.0, 37.3, 86400.0):
        wanted = reference(t)
        assert wanted.shape == (10,)
        assert np.isfinite(wanted).all()


def _judge_controller(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnsuitedController)  # a damaged gain need not stabilise the robot
        controller = read_controller(path, ALTEN)
        copy = path.with_name("copy.toml")
        copy.write_text(controller_text(controller), encoding="utf-8")
        assert controller_text(read_controller(copy, ALTEN)) == controller_text(controller)
    controller.reset()
    for k, lean in enumerate((0.0, 0.01, -0.1)):
        state = np.array([0.1, 0.0, lean, -lean, 0.2, 0.0, 0.1, lean, 0.0, 0.0])
        torques = controller.update(k * controller.sample_time, state, np.zeros(10))
        assert np.isfinite(torques).all()
        assert np.abs(torques).max() <= controller.torque_limit * (1.0 + 1e-12)


def _judge_bounds(path: Path) -> None:
    bounds = read_bounds(path)
    for lower, upper in bounds.limits.values():
        assert math.isfinite(lower)
        assert lower <= upper < math.inf


def _judge_reference(path: Path) -> None:
    _assert_reference(read_reference(path))
    copy = path.with_name("copy.csv")
    copy.write_text(reference_text(path))
    assert reference_text(copy) == reference_text(path)


def _judge_sweep(path: Path) -> None:
    sweep = read_sweep(path, wheel_count=3)
    assert np.isfinite(sweep.values).all()
    assert not np.isinf(sweep.covariances).any()


def _judge_axis(path: Path) -> None:
    record = read_axis_record(path, AxisColumns())
    assert np.isfinite(record.force).all()
    assert np.isfinite(record.position).all()
    assert 0.0 < record.sample_time < math.inf


def _judge_video(path: Path) -> None:
    video = open_video(path)
    assert min(video.size) > 0
    assert 0.0 < video.frame_rate < math.inf
    times = [time for time, _ in islice(video.frames(), 50)]
    assert np.isfinite(times).all()
    video.samples()


def _judge_film(path: Path) -> None:
    poses = read_poses(Log.read(path))
    assert np.isfinite(poses.t).all()


#: what makes each loader, by its name
MAKERS: dict[str, Callable[[], Target]] = {
    "log, CSV": lambda: Target(
        suffix=".csv", samples=(_csv(_log()), _csv(_log(), quoted=True)), judge=_judge_log
    ),
    "log, Parquet": lambda: Target(suffix=".parquet", samples=_parquet(_log()), judge=_judge_parquet),
    "foreign table": lambda: Target(
        suffix=".txt", samples=(_raw(), _raw().replace(b"\t", b";")), judge=_judge_foreign
    ),
    "mapped table": lambda: Target(suffix=".txt", samples=(_raw(),), judge=_judge_mapped),
    "mapping": lambda: Target(
        suffix=".toml", samples=(MAPPING.encode(), _MAPPING_2.encode()), judge=_judge_mapping
    ),
    "robot": lambda: Target(
        suffix=".toml",
        samples=tuple(robot_text(Robot.load(name)).encode() for name in ("alten", "kugle")),
        judge=_judge_robot,
    ),
    "scenario": lambda: Target(suffix=".toml", samples=_scenarios(), judge=_judge_scenario),
    "courses": lambda: Target(suffix=".toml", samples=(_courses(),), judge=_judge_courses),
    "controller": lambda: Target(suffix=".toml", samples=_controllers(), judge=_judge_controller),
    "bounds": lambda: Target(suffix=".toml", samples=(_BOUNDS.encode(),), judge=_judge_bounds),
    "reference": lambda: Target(suffix=".csv", samples=(_csv(_reference()),), judge=_judge_reference),
    "sweep's results": lambda: Target(suffix=".json", samples=(_sweep(),), judge=_judge_sweep),
    "axis record, CSV": lambda: Target(suffix=".csv", samples=(_csv(_axis()),), judge=_judge_axis),
    "axis record, MATLAB": lambda: Target(suffix=".mat", samples=_mat(_axis()), judge=_judge_axis),
    "motion capture": lambda: Target(suffix=".csv", samples=(_csv(_film()),), judge=_judge_film),
    "video": lambda: Target(suffix=".avi", samples=(_video(),), judge=_judge_video),
}
