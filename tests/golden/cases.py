"""The commands whose results are frozen, in the order in which they run.

A case runs in a working folder that all cases share, and writes into the folder of its own name there; the log of
`record_square` is record_square/log.csv. `files` has a copy of the files beside this module. What a case needs is run
before it.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from . import inputs


@dataclass(frozen=True, kw_only=True)
class Case:
    """One command line, or a function that makes an input."""

    name: str
    words: tuple[str, ...] = ()  #: after `ballbot`
    make: Callable[[Path], None] | None = None  #: given the case's folder, instead of a command
    needs: tuple[str, ...] = ()  #: cases whose files it reads
    code: int = 0  #: the exit code it must have
    frozen: bool = True  #: whether its files are compared, not only read by other cases
    sampled: bool = False  #: whether it runs with the tests
    #: whether it runs in a process of its own: what was compiled before it can change the last digit of these results
    alone: bool = False


def _command(name: str, line: str, *, code: int = 0, sampled: bool = False, alone: bool = False) -> Case:
    """Return the case of a command line, whose folder is the one of its name unless the line has --out or --save."""
    words = tuple(line.split())
    out = () if {"--out", "--save"} & set(words) else ("--out", name)
    needs = dict.fromkeys(folder for folder in re.findall(r"(\w+)/", line) if folder not in (name, "files"))
    return Case(name=name, words=(*words, *out), needs=(*needs,), code=code, sampled=sampled, alone=alone)


def _input(name: str, make: Callable[[Path], None], *, needs: tuple[str, ...] = ()) -> Case:
    return Case(name=name, make=make, needs=needs, frozen=False)


_ROBOT = "files/robot.toml"
_WALK, _EIGHT = "record_square/log.csv", "record_eight/log.csv"
_FEW = "--bounds files/bounds.toml --window 0.1"
_FULL, _PRECISE = "files/controller_full.toml", "files/controller_precise.toml"
_UPSIDE_DOWN = "record_upside_down/log.csv"
_COURSES = "--courses files/courses.toml"
_OVER = "--allow-overcompensation"

CASES: tuple[Case, ...] = (
    # the robot's own file
    _command("new", "new bot --from alten --out new/bot.toml", sampled=True),
    _command("check", "check files/robot_geometry.toml", sampled=True),
    _command("check_controller", f"check {_ROBOT} --controller {_PRECISE}", alone=True),
    # the twin
    _command("record_square", f"record nominal --robot {_ROBOT} --duration 16 --seed 1", sampled=True),
    _command("record_eight", "record nominal --reference figure_eight --duration 40 --seed 2"),
    _command("record_scenario", "record files/scenario.toml --duration 1 --estimator kalman", sampled=True),
    _command(
        "record_seeds", f"record nominal --duration 1 --seeds 1-2 --robot {_ROBOT} --controller partial"
    ),
    _command("record_sweep", "record nominal --experiment driveline_sweep --duration 63"),
    _command("record_upside_down", "record nominal --experiment upside_down --duration 40"),
    _command("twin_export", "twin export alten --out twin_export/twin.xml", sampled=True),
    _command("twin_scenario", "twin scenario resonant --out twin_scenario/scenario.toml", sampled=True),
    # logs
    _command("check_log", f"check-log {_WALK} --robot alten", sampled=True),
    _input("foreign", inputs.foreign_log, needs=("record_square",)),
    # neither its names nor its numbers show whether it holds torques or currents
    _command("check_log_foreign", "check-log foreign/log.csv --robot alten", code=2),
    _command(
        "check_log_mapping",
        "check-log foreign/log.csv --robot foreign/robot.toml --mapping files/mapping.toml",
        code=2,  # as identify_foreign: its torques are taken for duties, and are late
        sampled=True,
    ),
    _command(
        "view",
        f"view square={_WALK} later=record_square/truth.csv --robot {_ROBOT} --save view/replay.html",
        sampled=True,
    ),
    _command("align", "align record_square/log.csv record_square/motion_capture.csv", sampled=True),
    # the equations of motion
    _command("simulate", f"simulate {_ROBOT} --duration 4", sampled=True),
    _command(
        "simulate_full", f"simulate {_ROBOT} --duration 4 --scenario nominal --controller {_FULL}", alone=True
    ),
    _command(
        "simulate_precise",
        f"simulate {_ROBOT} --duration 4 --scenario nominal --controller {_PRECISE} --seed 3",
        sampled=True,
        alone=True,
    ),
    _command(
        "simulate_thesis",
        f"simulate {_ROBOT} --duration 4 --formulation thesis --controller partial --reference change_pose",
    ),
    # identification
    _command("identify", f"identify alten {_WALK} --window 0.1"),
    _command(
        "identify_logs",
        f"identify alten {_WALK} --holdout {_EIGHT} --estimate friction,delay "
        f"--exclude-states psi,psi_dot --seed 2 {_FEW}",
    ),
    _command("identify_few", f"identify alten {_WALK} {_FEW} --law coulomb", sampled=True),
    _command("identify_asymmetric", f"identify alten {_WALK} {_FEW} --law asymmetric"),
    _command("identify_load", f"identify alten {_WALK} {_FEW} --law load"),
    _command("identify_best", f"identify alten {_WALK} {_FEW} --law best"),
    _command(
        "identify_foreign",
        f"identify foreign/robot.toml foreign/log.csv --mapping files/mapping.toml {_FEW}",
        code=2,  # its torques are taken for duties, and are late
    ),
    _command("identify_driveline", "identify-driveline alten record_sweep/log.csv"),
    _command("identify_upside_down", f"identify-upside-down alten {_UPSIDE_DOWN} --window 0.5"),
    _command("identify_geometry", f"identify-geometry alten --upside-down {_UPSIDE_DOWN}"),
    _command(
        "identify_geometry_mocap",
        f"identify-geometry alten --upside-down {_UPSIDE_DOWN} --balancing record_eight/log.csv "
        "--motion-capture record_eight/motion_capture.csv",
    ),
    _input("axis", inputs.axis_record),
    _command("identify_axis", "identify-axis axis/record.csv --law coulomb"),
    _command("identify_axis_laws", "identify-axis axis/record.csv"),
    _input("swing", inputs.swing),
    _command("check_swing", "check alten --swing swing/swing.csv --pivot-deviation 0.002"),
    _input("video", inputs.video),
    _command("spin", "spin video/ball.avi --log video/log.csv --robot alten"),
    # validation
    _command("validate", f"validate {_ROBOT} {_WALK}"),
    _command(
        "validate_controller",
        f"validate {_ROBOT} {_WALK} --against thesis --controller record_square/controller.toml --seed 4",
    ),
    # controllers
    _command("design", "design files/robot_geometry.toml", sampled=True),
    _command("design_sampled", f"design {_ROBOT} --sample-time 0.01 --r 60 --notch 12", sampled=True),
    _command("design_full", f"design {_ROBOT} --compensation full --compensation-gain 0.5", sampled=True),
    _command("design_partial", f"design {_ROBOT} --compensation partial {_OVER}", sampled=True),
    _command("design_precise", f"design {_ROBOT} --kind precise --delay 0.016 {_OVER}", sampled=True),
    _command("export", f"export design_full/controller.toml --robot {_ROBOT}", sampled=True),
    _command(
        "run", f"run --emulated --robot {_ROBOT} --reference files/reference.csv --duration 2", sampled=True
    ),
    _command("run_wiring", f"run wiring --emulated --robot {_ROBOT} --seed 2", sampled=True),
    _command("run_sweep", f"run sweep --emulated --robot {_ROBOT} --duration 2", sampled=True),
    _command("run_upside_down", f"run upside-down --emulated --robot {_ROBOT} --duration 2", sampled=True),
    _command("plan", f"plan {_ROBOT} --to 0.5 0.2 0.5 --runs 2", sampled=True, alone=True),
    _command("limits", f"limits {_ROBOT} none {_FULL}"),
    _command("compare", f"compare {_ROBOT} none full precise {_COURSES} --seeds 4,5", alone=True),
    _command(
        "compare_twin",
        f"compare {_ROBOT} none partial@kalman --plant twin {_COURSES} --seeds 1",
    ),
    # the whole
    _command("excite", f"excite {_ROBOT} --duration 10", sampled=True),
    _command("study", f"study alten {_WALK} --no-confirm --draws 6 --bounds files/bounds.toml"),
    _command(
        "simulate_study",
        "simulate study/robot.toml --controller study/controller.toml --scenario nominal --duration 32",
    ),
    _command("validate_prediction", "validate --prediction study/results.json simulate_study/log.csv"),
)
