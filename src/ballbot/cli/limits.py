"""`ballbot limits`: the largest tilts and impulses that a robot recovers from."""

from collections.abc import Sequence
from dataclasses import replace

from ballbot.cli import options
from ballbot.cli.context import changed_robot, open_result
from ballbot.control.controller import assumed_grip
from ballbot.control.source import designed
from ballbot.errors import InputError
from ballbot.fitting.run import Run
from ballbot.report.limits import MOST_CONTROLLERS, limits_report
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.candidates import parse_candidates
from ballbot.workflows.limits import ControlledRobot, RobotLimits, TwinLimit, find_limits, twin_limits

#: indices of the model's directions that are tried on the twin
_ON_TWIN = (0, 9, 18, 27)


def limits(
    robot: options.Robot,
    /,
    *controllers: str,
    grip: options.Positive | None = None,
    twin: bool = False,
    scenario: options.Scenario = "nominal",
    seed: options.Seed = 1,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Find the largest tilts and impulses that a robot recovers from with its controllers.

    Computes a lower and an upper bound of each limit: up to the lower bound, no wheel slips on the ball; the upper
    bound assumes that wheels never slip. Both are computed on the compiled loop with the torque limit, the motors'
    speed limit, and the sensors, delay, noise, floor and payload of the scenario, but not its play.

    Writes report.html and results.json.

    Example: ballbot limits found/robot.toml none full --twin --out limits

    Parameters
    ----------
    controllers
        As of ballbot check, several; none and full if not given. As in compare, LABEL=... renames one, and a trailing
        @kalman selects the estimator.
    grip
        Friction coefficient of the wheels on the ball, such as 1 for rubber on rubber. If not given, the robot file's
        less two deviations, or 1 if that is unknown.
    twin
        Also find the limits on the twin, in four directions: with slip and play.
    """
    described, candidates = changed_robot(robot, change), parse_candidates(controllers or ("none", "full"))
    chosen = {one.name: designed(one.controller(described), name=one.name) for one in candidates}
    if len(chosen) > MOST_CONTROLLERS:
        raise InputError(f"There are {len(chosen)} controllers; at most {MOST_CONTROLLERS} can be compared.")
    truth, grip = load_scenario(scenario, described), grip or assumed_grip(described)
    models, twins = dict[str, RobotLimits](), dict[str, Sequence[TwinLimit]]()
    with open_result(out, doing="limits", seed=seed) as result:
        for name, controller in chosen.items():
            loop = ControlledRobot(
                robot=described, controller=controller, scenario=truth, grip=grip, seed=seed
            )
            run = Run(seed=seed, progress=lambda now, name=name: result.report(replace(now, note=name)))
            models[name] = find_limits(loop, run=run)
            if twin:
                twins[name] = twin_limits(loop, models[name], directions=_ON_TWIN, run=run)
        page = limits_report(described, models, twins, grip=grip, scenario=truth.name)
        step = (
            "`ballbot export CONTROLLER --robot ROBOT --lean RADIANS --out firmware`, below the tilt found."
        )
        result.write(page, next_step=step)
