"""`ballbot compare`: controllers side by side, on the same courses with the same seeds."""

from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import changed_robot, open_result, parse_seeds, robot_words
from ballbot.control.references import is_reference_file
from ballbot.fitting.run import Run
from ballbot.report.comparison import league_report
from ballbot.workflows.courses import PlantName, choose_courses
from ballbot.workflows.league import DEFAULT_CONTROLLERS
from ballbot.workflows.league import compare as run_comparison


def compare(
    robot: options.Robot,
    /,
    *controllers: str,
    plant: PlantName = "model",
    courses: str = "motions",
    seeds: str = "1-3",
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Compare controllers in closed loop: the same courses and seeds for all, with intervals of the differences.

    Example: ballbot compare found/robot.toml none partial mine=mine.py:Mine --plant twin --courses league --seeds
    1-20 --out league

    Writes report.html (tables and figures) and results.json (every run's scores).

    Parameters
    ----------
    controllers
        none, full and partial if not given. These (the nominal gain with that compensation), precise, controller
        files, or your own in Python as FILE.py:NAME, where NAME(robot) returns the controller. LABEL=... renames one.
        Each uses the estimator that it names (estimator = "kalman" in its file, or an attribute of your class),
        otherwise onboard; a trailing @kalman or @onboard overrides this. All others are compared with the first.
    plant
        model: the compiled loop, with the sensors, drive and floor of each course. twin: a MuJoCo robot, also with
        rollers and slip.
    courses
        Separated by commas: sets (motions, disturbances, league: both, mismatch: robots 20 % off,
        recommendations: the thesis's, benchmark: what ballbots are known for), courses (hold,
        square, circle, figure_eight, change_pose, push, ramp, payload, floor, heading) and course files.
    seeds
        Random seeds, such as 1-20 or 1,4,7-9. Each controller runs once per course and seed.
    """
    described, numbers = changed_robot(robot, change), parse_seeds(seeds)
    references = [course.reference_spec.name for course in choose_courses(courses, described, plant)]
    beside = [Path(name) for name in references if is_reference_file(name)]
    with open_result(out, doing=f"comparing on the {plant}", beside=beside, seed=seeds) as result:
        league = run_comparison(
            described,
            controllers or DEFAULT_CONTROLLERS,
            courses=courses,
            plant=plant,
            seeds=numbers,
            run=Run(progress=result.report),
        )
        words = robot_words(robot, change)
        step = f"`ballbot limits {words} CONTROLLER --out limits`, with the controller that you choose."
        result.write(league_report(league), next_step=step)
