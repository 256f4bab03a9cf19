"""The whole trip: a log, a study, firmware, a board, a balance on it, its log, and a study again.

    python examples/06_whole_trip.py --out trip

Needs QEMU and a compiler for its processor: on Debian, apt-get install qemu-system-arm gcc-arm-none-eabi. The log of
the first controller comes from the twin, and so does the robot below the board: sensors and motors of a simulated
robot on the board's serial line. `tests/test_whole_trip.py` has settings that make it short.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from ballbot import Log, Robot
from ballbot.cli.main import main
from ballbot.control.references import square
from ballbot.estimation import named_estimator
from ballbot.firmware.qemu import QemuBoard, build_board, what_to_install
from ballbot.link.emulated import EmulatedRobot
from ballbot.link.live import FollowReference, LiveRobot, log_columns
from ballbot.link.lock_step import BoardLine
from ballbot.link.messages import ControllerPlace
from ballbot.link.references import CourseReference
from ballbot.link.session import Session
from ballbot.twin import Twin

SAMPLE_TIME = 0.005


def ballbot(line: str) -> None:
    """Run a command of Ballbot, and end the trip if it fails."""
    print(f"\n$ ballbot {line}", flush=True)
    if main(line.split()) != 0:
        sys.exit(f"ballbot {line} failed.")


def build(firmware: Path) -> Path:
    """Build an exported firmware for the board and return the program."""
    files = {
        path.relative_to(firmware).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(firmware.rglob("*"))
        if path.suffix in (".c", ".h")
    }
    program = firmware.parent / "board.elf"
    build_board(files, program)
    return program


def balance(program: Path, *, duration: float, seed: int) -> Log:
    """Let the firmware on the board test itself, arm and balance the twin around a square; return its log."""
    alten = Robot.load("alten")
    twin = Twin(alten, estimator=named_estimator("onboard", alten, sample_time=SAMPLE_TIME))
    with QemuBoard(program) as board:
        robot = EmulatedRobot(twin, BoardLine(board), sample_time=SAMPLE_TIME, seed=seed)
        session = Session(robot, clock=robot.clock)
        session.connect()
        live = LiveRobot(session, clock=robot.clock)
        live.test()
        live.arm(lambda: True, controller=ControllerPlace.ROBOT)  # nobody is near a simulated robot
        rows: list[list[float]] = []
        ending = live.run(
            FollowReference(CourseReference(square()), sample_time=SAMPLE_TIME),
            duration=duration,
            record=lambda row: rows.append(list(row)),
            watch=lambda _: None,
        )
        live.disarm()
    print(ending.text)
    if ending.early:
        sys.exit(1)
    return Log(dict(zip(log_columns(alten.wheel_count), np.array(rows).T, strict=True)))


def trip(out: Path, *, duration: float, draws: int, study_options: str) -> None:
    """Make the trip."""
    study = f"--draws {draws} {study_options}"
    ballbot(f"record nominal --reference square --duration {duration:g} --seed 1 --out {out}/before")
    ballbot(f"study alten {out}/before/log.csv {study} --out {out}/study")
    ballbot(f"export {out}/study/controller.toml --robot {out}/study/robot.toml --out {out}/firmware")
    print("\nBuilding the firmware and balancing on an emulated board")
    log = balance(build(out / "firmware"), duration=duration, seed=2)
    log.write(out / "after" / "log.csv")
    print(f"{len(log)} samples; log: {out}/after/log.csv")
    ballbot(f"study alten {out}/after/log.csv {study} --out {out}/study_again")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("trip"), help="folder of all results")
    parser.add_argument("--duration", type=float, default=48.0, help="of each log [s]")
    parser.add_argument(
        "--draws", type=int, default=100, help="simulated robots that a study tries controllers on"
    )
    parser.add_argument("--study-options", default="", help="more options of `ballbot study`")
    given = parser.parse_args()
    if missing := what_to_install():
        sys.exit(missing)
    trip(given.out, duration=given.duration, draws=given.draws, study_options=given.study_options)
