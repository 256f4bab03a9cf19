"""What robots drawn from uniform boxes gain over one: policies trained with each, on held-out robots.

.venv/bin/python -m campaigns.evidence randomisation

A true robot is a twin with all faults of random sizes, of which the boxes know nothing. Its friction is identified from
its log, and policies are trained on the robot as identified, or on robots drawn from uniform boxes about it. Then each
does its task on the true robot. What is finished is kept in build/randomisation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.fitting.run import Run, Threads
from ballbot.identification.identify import IdentificationOptions, identify
from ballbot.learning.learn import Learned, fresh_conditions, learn, velocity_asked
from ballbot.learning.ppo import Training
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import Task, TaskNumbers, action_limit, reward, task_named
from ballbot.log import STATE_NAMES, Log
from ballbot.progress import ignore_progress
from ballbot.robot import Robot
from ballbot.workflows.grid import GridRun, run_grid
from ballbot.workflows.metrics import position_error, true_place
from ballbot.workflows.statistics import mean_ratio, mean_with_interval
from campaigns.between_logs import UNSEEN, drawn, pair_log
from campaigns.section import Made, Piece, Section, finished
from campaigns.twin_logs import NOMINAL, ROBOT

TASKS = ("balance", "drive")
#: nothing was developed on these twins, and the spread between logs was not fitted to them
HELD_OUT = UNSEEN[:10]
#: what robots a policy is trained on, in words
KINDS = {"none": "as identified", "boxes": "boxes"}
#: half as long as usual: no episode falls any more after 15 to 25 updates
TRAINING = Training(updates=30)
#: the twin of which only friction and play are the true robot's
EASIER = "twin with its friction"
#: runs of a policy on the true robot (of Drive on the twin `DRIVE_RUNS`), and their length [s]
DRIVE_RUNS = 10
RUNS, DURATION = {"loop": 20, "twin": 1, EASIER: 1}, 15.0
#: a velocity's error counts so long after another one is asked for [s]
_REACHED = 2.0
IDENTIFYING = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "identification")
PACKAGES = (*IDENTIFYING, "learning")


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A policy's run on a true robot."""

    reward: float  #: mean a second of the whole run; none after a fall
    peak: float  #: largest error of position [m], or of velocity once reached [m/s] if one is asked for; NaN if it fell
    fell: bool


@dataclass(frozen=True, kw_only=True)
class PolicyRun:
    """A policy to be learned: the task, the kind of randomisation, the true robot and the one identified."""

    task: str
    kind: str
    seed: int  #: of the true robot and of the training
    robot: Robot  #: as identified
    training: Training = TRAINING

    @property
    def of(self) -> Task:
        """The task."""
        return task_named(self.task)


def identified(seed: int) -> Robot:
    """Return a true robot as identified from its logs, quickly."""
    options = IdentificationOptions(most_steps=30, step=2.5e-3, most_profiles=0)
    return identify(
        ROBOT, pair_log(seed, 0), seed=0, options=options, run=Run(executor=Threads(count=1))
    ).robot


def learned(run: PolicyRun) -> Learned:
    """Learn a policy for a true robot from its identification."""
    randomize = {"none": None, "boxes": "boxes"}[run.kind]
    robots = drawn_robots(run.robot, NOMINAL, randomize, seed=run.seed)
    context = Run(seed=run.seed, progress=ignore_progress)
    return learn(robots, run.of, training=run.training, run=context)


def policy_of(run: PolicyRun) -> Controller:
    """Learn a policy; return its controller."""
    return learned(run).controller


def tried(policy: tuple[PolicyRun, Controller]) -> dict[str, list[Trial]]:
    """Return a policy's runs on the true robot, by its name in `RUNS`."""
    run, controller = policy
    true = drawn(run.seed)
    easier = replace(NOMINAL, friction=true.friction, backlash=true.backlash)
    results = dict[str, list[Trial]]()
    for name, count in RUNS.items():
        conditions = fresh_conditions(
            run.of,
            controller.robot,
            easier if name == EASIER else true,
            runs=DRIVE_RUNS if (run.task, name) == ("drive", "twin") else count,
            duration=DURATION,
            seed=run.seed,
            twin=name != "loop",
        )
        runs = [GridRun(candidate=run.kind, controller=controller, condition=each) for each in conditions]
        answers = run_grid(runs, partial(_trial, run.task), workers=Threads(count=1)).answers
        results[name] = list(answers)
    return results


def _trial(task: str, run: GridRun, log: Log) -> Trial:
    true, asked, fell = true_place(log), velocity_asked(log), log.ended is not None
    if task == "drive":
        reached = log.t % task_named(task).interval >= _REACHED
        errors = np.hypot(true["x_dot"] - asked[:, 0], true["y_dot"] - asked[:, 1])[reached]
    else:
        errors = position_error(log)
    states = np.stack([true[name] for name in STATE_NAMES], axis=1)
    references = np.zeros_like(states)
    for index, name in ((0, "x"), (1, "y"), (4, "psi")):
        references[:, index] = log[f"ref_{name}"]
    references[:, 5:7] = asked
    named, torques = task_named(task), log.torques
    numbers = TaskNumbers.of(named, ROBOT, torque_limit=action_limit(named, ROBOT), sensing=True)
    # the torques of a row act from it on: the state at that sample's end is the next row's
    paid = sum(
        reward.py_func(numbers, states[k + 1], references[k], torques[k], torques[max(k - 1, 0)])
        for k in range(len(log) - 1)
    )
    return Trial(
        reward=float(paid) / run.condition.duration, peak=np.nan if fell else float(errors.max()), fell=fell
    )


def _finished(
    part: str, make: Callable[[Piece], Made], runs: Mapping[str, Piece], packages: Sequence[str]
) -> dict[str, Made]:
    workers = Threads(count=1)
    return finished(f"randomisation/{part}", make, runs, packages=packages, workers=workers)


def campaign() -> Section:
    """Learn the missing policies and return the section of docs/generated/evidence.md."""
    known = _finished("identified", identified, {f"{seed}": seed for seed in HELD_OUT}, IDENTIFYING)
    runs = {
        f"{task}_{seed}_{kind}": PolicyRun(task=task, kind=kind, seed=seed, robot=known[f"{seed}"])
        for task in TASKS
        for seed in HELD_OUT
        for kind in KINDS
    }
    policies = _finished("policies", policy_of, runs, PACKAGES)
    pairs = {name: (run, policies[name]) for name, run in runs.items()}
    done = _finished("trials", tried, pairs, PACKAGES)
    rows = []
    for task in TASKS:
        for name in RUNS:
            trials = {kind: [done[f"{task}_{seed}_{kind}"][name] for seed in HELD_OUT] for kind in KINDS}
            rows += _rows(f"{task}, {name}", trials)
    return Section(
        title="Robots drawn from boxes",
        before=f"{len(HELD_OUT)} true robots: twins with all faults at once, of random sizes, on which nothing was "
        "developed. Each records a log of 24 s, from which its friction is identified. Two policies are trained for "
        f"it by {TRAINING.updates} updates: on the robot as identified, and in the boxes of `--randomize boxes` about "
        "it. Each does its task on the true robot, "
        f"{RUNS['loop']} times {DURATION:g} s on the loop, once on the twin ({DRIVE_RUNS} times in Drive), "
        f"and once on a twin of which only friction "
        "and play are the true robot's and all else nominal. Means over the policies; in brackets the 95 % interval of "
        "the geometric mean of their ratios, or of the mean difference of falls. Peak: the largest distance from the "
        f"place asked for, in Drive the largest error of the velocity from {_REACHED:g} s after another one is asked "
        "for, of runs without a fall.",
        columns=["task, on", "", *KINDS.values(), "boxes over as identified"],
        rows=rows,
    )


def _rows(name: str, trials: Mapping[str, Sequence[Sequence[Trial]]]) -> list[list[str]]:
    rows = []
    for words, of, ratio, size in (
        ("return a second", lambda trial: trial.reward, True, 1.0),
        ("peak error [mm or mm/s]", lambda trial: trial.peak, True, 1e3),
        ("falls [%]", lambda trial: trial.fell, False, 1e2),
    ):
        values = {
            kind: np.array([_mean([of(trial) for trial in policy]) for policy in by_robot])
            for kind, by_robot in trials.items()
        }
        cells = [f"{size * _mean(each):.3g}" for each in values.values()]
        against = compared_words(size * values["boxes"], size * values["none"], ratio=ratio)
        rows.append([name, words, *cells, against])
    return rows


def compared_words(ours: NDArray[np.float64], theirs: NDArray[np.float64], *, ratio: bool) -> str:
    """Return the mean ratio or difference of pairs (n,) with its 95 % interval."""
    found = mean_ratio(ours, theirs) if ratio else mean_with_interval(ours - theirs)
    if not found.runs:
        return "–"
    digits = ".3g" if ratio else "+.2g"
    return f"{found.mean:{digits}} ({found.low:{digits}} to {found.high:{digits}})"


def _mean(values: Sequence[float] | NDArray[np.float64]) -> float:
    """Return the mean of what is not NaN; NaN of nothing."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else np.nan
