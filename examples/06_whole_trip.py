"""The whole trip: a log, a study, firmware, a balance with it, its log, and a study again.

    python examples/06_whole_trip.py --out trip

Needs a C compiler, such as `pip install ziglang`. The log of the first controller comes from the twin, and so does the
robot that the firmware balances: `ballbot run --emulated` compiles it for this computer. For your robot, give its port.
`tests/test_whole_trip.py` has settings that make it short.
"""

import argparse
import sys
from pathlib import Path

from ballbot.cli.main import main


def ballbot(line: str) -> None:
    """Run a command of Ballbot, and end the trip if it fails."""
    print(f"\n$ ballbot {line}", flush=True)
    if main(line.split()) != 0:
        sys.exit(f"ballbot {line} failed.")


def trip(out: Path, *, duration: float, draws: int, study_options: str) -> None:
    """Make the trip."""
    study = f"--draws {draws} {study_options}"
    ballbot(f"record nominal --reference square --duration {duration:g} --seed 1 --out {out}/before")
    ballbot(f"study alten {out}/before/log.csv {study} --out {out}/study")
    ballbot(f"export {out}/study/controller.toml --robot {out}/study/robot.toml --out {out}/firmware")
    ballbot(
        f"run --emulated --plant twin --robot {out}/study/robot.toml --controller {out}/study/controller.toml "
        f"--reference square --duration {duration:g} --seed 2 --out {out}/after"
    )
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
    trip(given.out, duration=given.duration, draws=given.draws, study_options=given.study_options)
