"""`ballbot export`: whole, repeatable, refused if controller and robot do not belong together, and it compiles."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller, InputError, Robot
from ballbot.cli.main import main
from ballbot.control.file import write_controller
from ballbot.control.presets import (
    NOMINAL_STATE_WEIGHTS,
    PRECISE_STATE_WEIGHTS,
    design_gain,
    nominal_controller,
    precise_controller,
)
from ballbot.firmware import processor_load
from ballbot.firmware.build import compile_sources, compilers, source_files
from ballbot.firmware.export import export_controller, exported_names
from ballbot.firmware.processor_load import what_to_install
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled, with_policy
from tests.support.report_pages import shown_text

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

ROBOT = alten(FRICTION)


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> Path:
    """Return a folder with robot files and controllers."""
    folder = tmp_path_factory.mktemp("given")
    ROBOT.write(folder / "robot.toml")
    write_controller(precise_controller(ROBOT), folder / "controller.toml")
    return folder


def export(given: Path, out: Path, *more: str, controller: str = "controller.toml") -> int:
    robot, made = str(given / "robot.toml"), str(out)
    return main(["export", str(given / controller), "--robot", robot, "--out", made, *more])


def write_project(controller: Controller, folder: Path) -> Path:
    for path, text in export_controller(controller).files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.slow  # it measures on the emulated processor
def test_files_are_whole_and_the_same_each_time_with_the_load(given, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(processor_load, "_NEEDED", ("no_such_package",))
    assert export(given, tmp_path / "made") == 0
    printed = capsys.readouterr().out
    assert "stops beyond a lean of" in printed
    text = shown_text((tmp_path / "made" / "report.html").read_text(encoding="utf-8"))
    assert "Not measured: instructions, cycles, flash and stack need" in text
    assert "pip install no_such_package" in text
    first = contents(tmp_path / "made")
    assert set(exported_names()) | {"results.json"} <= set(first)
    results = json.loads(first["results.json"])
    assert results["processor"] is None
    assert results["safety"]["lean"] == 0.35
    assert results["estimator"] == "kalman"
    monkeypatch.undo()
    if what_to_install():
        pytest.skip("ziglang or unicorn is not installed")
    # over what is there
    assert export(given, tmp_path / "made", "--clock", "36e6") == 0
    second = contents(tmp_path / "made")
    for name in exported_names():
        assert first[name] == second[name], name
    load = json.loads(second["results.json"])["processor"]
    assert load["worst_share"] == pytest.approx(load["worst_cycles"] / (36e6 * 0.005))
    text = shown_text((tmp_path / "made" / "report.html").read_text(encoding="utf-8"))
    assert f"{load['worst_instructions']:,}" in text
    assert "of the period of 5 ms at 36 MHz" in text
    assert export(given, tmp_path / "made", "--clock", "72") == 2


@pytest.mark.parametrize(
    ("old", "new", "lean", "sentence"),
    [
        ('robot = "', 'robot = "other ', "0.35", "was designed for the robot 'other "),
        ("yaw_frequency = 12.0", "yaw_frequency = 1e9", "0.35", "can have up to 10000 rad/s"),
        *(("", "", lean, "lean of the safety limits is") for lean in ("0", "nan", "1.21")),
    ],
)
def test_what_cannot_be_exported_is_refused(given, tmp_path, capsys, old, new, lean, sentence):
    (given / "changed.toml").write_text((given / "controller.toml").read_text().replace(old, new, 1))
    assert export(given, tmp_path / "out", f"--lean={lean}", controller="changed.toml") == 2
    refusal = capsys.readouterr().err
    assert sentence in refusal
    assert refusal.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_gain_of_another_robot_is_refused():
    controller = nominal_controller(ROBOT)
    with pytest.raises(InputError, match=r"does not stabilise the robot 'alten': an error grows by a factor"):
        export_controller(Controller(ROBOT, -controller.gain))


def test_gain_that_recovers_from_less_is_not_mixed_in():
    # a stiffer gain of a tall robot: they share a Lyapunov function, and it recovers from some 77 %
    robot = Robot.load("kugle")
    weights = np.array(NOMINAL_STATE_WEIGHTS) ** 0.7 * np.array(PRECISE_STATE_WEIGHTS) ** 0.3
    stiffer = Controller(robot, design_gain(robot, state_weights=weights.tolist()).gain)
    with pytest.raises(InputError, match=r"Gain 2 recovers from \d\d % of the impulse"):
        export_controller(nominal_controller(robot), [stiffer])


def test_policy_too_large_for_firmware_is_refused():
    with pytest.raises(InputError, match="has 65 units in a hidden layer; firmware can have up to 64"):
        export_controller(with_policy(nominal_controller(ROBOT), units=65))


@needs_compiler
@pytest.mark.parametrize(
    "compiler", ["gcc", *(pytest.param(name, marks=pytest.mark.board) for name in ("clang", "zig"))]
)
def test_what_is_exported_compiles_without_a_warning(compiler, tmp_path):
    if compiler not in compilers():
        pytest.skip(f"{compiler} is missing")
    controllers = {
        "nominal": nominal_controller(ROBOT),
        "everything": everything(four_wheeled(friction=True)),
        "learned": with_policy(nominal_controller(ROBOT)),
    }
    for name, controller in controllers.items():
        folder = write_project(controller, tmp_path / name)
        flags = ("-c", f"-I{folder / 'src'}")
        for source in ("src/robot.c", "src/parts/policy.c", "examples/rtos_task.c"):
            target = (folder / source).with_suffix(".o")
            compile_sources(target, [folder / source], flags=flags, compiler=compiler)
            assert target.stat().st_size
    # the library's sources are those that every test of the firmware compiles, with warnings as errors
    library = [path for path in source_files(tmp_path / "nominal" / "src") if path.name != "robot.c"]
    assert [path.name for path in library] == [path.name for path in source_files()]
    for source, own in zip(library, source_files(), strict=True):
        assert source.read_text() == own.read_text()


ARDUINO = """
#include <stddef.h>
#include <stdint.h>
uint32_t micros();
struct {
    void begin(long);
    int available(), read(), availableForWrite();
    size_t write(const uint8_t *, size_t);
} Serial;
"""


@pytest.mark.skipif(not shutil.which("g++"), reason="no C++ compiler")
def test_sketch_of_arduino_is_cpp_and_its_libraries_name_the_folder(tmp_path):
    folder = write_project(nominal_controller(ROBOT), tmp_path)
    (tmp_path / "Arduino.h").write_text(ARDUINO)
    sketch = folder / "examples" / "balance" / "balance.ino"
    command = [
        "g++",
        "-std=gnu++11",
        "-fsyntax-only",
        f"-I{folder / 'src'}",
        "-include",
        tmp_path / "Arduino.h",
    ]
    subprocess.run([*command, "-x", "c++", sketch], check=True)
    build = json.loads((folder / "library.json").read_text())["build"]
    assert "-ffp-contract=off" in build["flags"]
    assert (folder / build["srcDir"] / "ballbot.h").is_file()
    listed = (folder / "library.properties").read_text().partition("includes=")[2].split(",")
    assert all((folder / "src" / name.strip()).is_file() for name in listed)


@pytest.mark.board
@needs_compiler
@pytest.mark.slow
def test_makefile_and_cmake_build_the_library(tmp_path):
    write_project(nominal_controller(ROBOT), tmp_path)
    if shutil.which("make") and shutil.which("cc"):
        subprocess.run(["make", "-C", tmp_path, "all"], check=True, capture_output=True)
        assert (tmp_path / "build" / "libballbot.a").is_file()
    if shutil.which("cmake") and shutil.which("cc"):
        made = tmp_path / "made"
        subprocess.run(["cmake", "-S", tmp_path, "-B", made], check=True, capture_output=True)
        subprocess.run(["cmake", "--build", made], check=True, capture_output=True)
        assert (made / "libballbot.a").is_file()
