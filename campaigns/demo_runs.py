"""Record the runs that `ballbot demo` shows, into src/ballbot/report/demo_runs.npz.

.venv/bin/python -m campaigns.demo_runs

The twin's nominal robot goes around the square for 40 s under the soft gain; its friction is identified from that log,
and the precise controller for that friction goes around with the same seed. Prints the largest distance from the
reference, once settled, of each.
"""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import ballbot
from ballbot import Log, Robot
from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import square
from ballbot.estimation import named_estimator
from ballbot.report import demo
from ballbot.twin import Scenario, Twin
from ballbot.workflows.metrics import score

SEED, DURATION = 1, 40.0


def recorded(robot: Robot, controller: Controller) -> Log:
    """Return a run of the nominal twin around the square, with its true states."""
    time = robot.sensors.sample_time
    estimator = named_estimator(controller.estimator, robot, sample_time=time)
    twin = Twin(robot, Scenario.nominal(robot), estimator=estimator)
    return ballbot.simulate(twin, controller, square(side=0.5, period=32.0), duration=DURATION, seed=SEED)


def runs_file(runs: Mapping[str, Log]) -> bytes:
    """Return the content of the file with these runs, each with its true states."""
    arrays: dict[str, NDArray[np.int32]] = {}
    for run, log in runs.items():
        for name, step in demo.steps().items():
            whole = np.rint(log[name] / step).astype(np.int64)
            arrays[f"{demo.KEYS[run]} {name}"] = np.diff(whole, prepend=0).astype(np.int32)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def main() -> None:
    """Record both runs and write the file."""
    robot = Robot.load(demo.ROBOT)
    soft = recorded(robot, nominal_controller(robot))
    identified = ballbot.identify(robot, soft.without_truth()).robot
    precise = recorded(robot, precise_controller(identified))
    path = Path(demo.__file__).with_name("demo_runs.npz")
    path.write_bytes(runs_file({demo.SOFT: soft, demo.PRECISE: precise}))
    print(f"{path}: {path.stat().st_size} bytes")
    for name, log in ((demo.SOFT, soft), (demo.PRECISE, precise)):
        identified_score = score(log)
        print(f"{name}: at most {1000.0 * identified_score.peak_position_error:.1f} mm off once settled")


if __name__ == "__main__":
    main()
