"""`ballbot learn`: a controller for a task, learned on simulated robots."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from ballbot.cli import options
from ballbot.cli.context import changed_robot, open_result
from ballbot.control.file import controller_text
from ballbot.control.source import named_controller
from ballbot.fitting.run import Run
from ballbot.learning.learn import base_controller, confirm, film
from ballbot.learning.learn import learn as learn_task
from ballbot.learning.ppo import Training
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import TASKS, task_named
from ballbot.progress import Progress
from ballbot.report.learning import learning_report
from ballbot.robot.file import robot_text
from ballbot.twin.scenario_file import load_scenario

if TYPE_CHECKING:
    TaskName = str
else:
    TaskName = Literal[tuple(name.lower() for name in TASKS)]

_WRITTEN = ("controller.toml", "robot.toml", "contract.json")


def learn(
    task: TaskName,
    robot: options.Robot = "alten",
    /,
    *,
    onto: str | None = None,
    randomize: str | None = None,
    updates: options.Count = Training.updates,
    scenario: options.Scenario = "nominal",
    runs: options.Count = 100,
    duration: options.Positive = 60.0,
    confirm_on_twin: options.Count | None = None,
    seed: options.Seed = 0,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Learn a controller for a task on simulated robots; then try it on fresh ones.

    A small network, at first a stiff law, learns by proximal policy optimisation on the compiled loop. The controller
    that it writes is used as every other one: ballbot compare, simulate, export. Where the robot's state is not like
    those of the training, a linear law acts. Ctrl-C ends the training and keeps the last policy that did not fall.

    Writes report.html (with the learning curve, and a film of the robot before the training and after a sixth, a third
    and all of it), results.json, controller.toml, robot.toml, and contract.json, which says what the policy observes
    and does.

    Example: ballbot learn balance found/robot.toml --out learned

    Example: ballbot learn drive found/robot.toml --confirm-on-twin 20 --out learned

    Parameters
    ----------
    task
        balance: stay in place; track: go to places and headings; drive: keep velocities of up to 0.5 m/s; push: stay in
        place under pushes of up to 8 N s.
    onto
        A controller to whose torques the policy's are added, as of ballbot check.
    randomize
        boxes: robots that differ from episode to episode, by the uniform ranges of published work. By default all are
        the robot as described.
    updates
        Number of improvements of the policy; each takes 51,200 samples of the loop.
    runs
        Fresh robots on the loop on which the result is tried, and the controller without the policy too.
    duration
        Of each of these runs [s].
    confirm_on_twin
        Number of runs on the twin as well; each takes some seconds.
    """
    described = changed_robot(robot, change)
    wanted = task_named(task)
    truth = load_scenario(scenario, described)
    robots = drawn_robots(described, truth, randomize, seed=seed)
    known = robots[0].imperfections.known or described
    base = named_controller(onto, known) if onto else None
    with open_result(out, doing=f"learning to {task}", writes=_WRITTEN, seed=seed) as result:
        run = Run(seed=seed, progress=result.report)
        learned = learn_task(robots, wanted, base=base, training=Training(updates=updates), run=run)
        tried = []
        for controller in (learned.controller, base or base_controller(known)):
            result.report(Progress(stage="trying it"))
            confirmed = (
                confirm(controller, wanted, known, truth, runs=count, duration=duration, twin=twin, run=run)
                for count, twin in ((runs, False), (confirm_on_twin, True))
                if count
            )
            tried.append(tuple(confirmed))
        learned = replace(learned, confirmed=tried[0], baseline_confirmed=tried[1])
        path = result.path("controller.toml")
        result.write(
            learning_report(learned, scenario=truth.name, film=film(learned, known, truth, run=run)),
            files={
                "controller.toml": controller_text(learned.controller),
                "robot.toml": robot_text(known),
                "contract.json": learned.contract.text(),
            },
            named=["controller.toml", "robot.toml"],
            next_step=f"`ballbot compare {result.path('robot.toml')} {path} precise --out compared`",
        )
