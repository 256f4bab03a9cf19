"""Record the runs that `ballbot demo` shows, as log files in src/ballbot/report.

.venv/bin/python -m campaigns.demo_runs

The twin's nominal robot goes around the square for 40 s under the soft gain; its friction is identified from that log,
and the precise controller for that friction goes around with the same seed. Prints the largest distance from the
reference, once settled, of each.
"""

import numpy as np

import ballbot
from ballbot import Log, Robot
from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import square
from ballbot.estimation import named_estimator
from ballbot.log.columns import POSITION_NAMES, STATE_NAMES, TRUE_PREFIX, torque_names, wheel_speed_names
from ballbot.report import demo
from ballbot.robot.derived import encoder_step
from ballbot.twin import Scenario, Twin
from ballbot.workflows.metrics import score

SEED, DURATION = 1, 40.0


def recorded(robot: Robot, controller: Controller) -> Log:
    """Return a run of the nominal twin around the square, with its true states."""
    time = robot.sensors.sample_time
    estimator = named_estimator(controller.estimator, robot, sample_time=time)
    twin = Twin(robot, Scenario.nominal(robot), estimator=estimator)
    return ballbot.simulate(twin, controller, square(side=0.5, period=32.0), duration=DURATION, seed=SEED)


def rounded(log: Log, robot: Robot) -> Log:
    """Return the columns of a run that its file has, rounded to a tenth of the sensors' noise or to an encoder's step.

    The noise is 0.01 N m of the torques, 1.7e-3 rad of the lean and 1.9e-3 rad/s of the gyro; references are exact.
    """
    turn = encoder_step(robot) / robot.sensors.sample_time
    steps = {
        **dict.fromkeys((*torque_names(3), "ref_x", "ref_y", "ref_psi"), 1e-3),
        **dict.fromkeys((*STATE_NAMES[2:5], *STATE_NAMES[7:]), 1e-4),
        **{TRUE_PREFIX + name: 1e-5 for name in POSITION_NAMES},
        **dict.fromkeys(wheel_speed_names(3), turn),
    }
    return Log({"t": log.t} | {name: step * np.rint(log[name] / step) for name, step in steps.items()})


def main() -> None:
    """Record both runs and write the file."""
    robot = Robot.load(demo.ROBOT)
    soft = recorded(robot, nominal_controller(robot))
    identified = ballbot.identify(robot, soft.without_truth()).robot
    precise = recorded(robot, precise_controller(identified))
    for name, log in ((demo.SOFT, soft), (demo.PRECISE, precise)):
        path = demo.FILES[name]
        rounded(log, robot).write(path)
        print(f"{path}: {path.stat().st_size} bytes")
        print(f"{name}: at most {1000.0 * score(log).peak_position_error:.1f} mm off once settled")


if __name__ == "__main__":
    main()
