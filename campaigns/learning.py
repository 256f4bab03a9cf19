"""Controllers learned with ten seeds, tried on fresh robots of the loop and on the twin, beside an LQR.

.venv/bin/python -m campaigns.evidence learning

Trainings that are finished are kept in build/learning.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ballbot.fitting.run import Run, Threads
from ballbot.learning.learn import Confirmed, Learned, base_controller, confirm, learn
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import task_named
from ballbot.progress import ignore_progress
from ballbot.report.style import LOOKS
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from campaigns.section import Section, finished, write_picture

TASKS, SEEDS = ("balance", "drive"), 10
#: fresh robots of a trial on the loop, and of those on the twin of the first seeds' controllers
RUNS, TWIN_RUNS = 100, (34, 33, 33)
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "learning")


def tried(piece: tuple[str, int]) -> tuple[Learned | None, list[Confirmed]]:
    """Learn a task with a seed (the linear law for a seed below 0), and return what was learned and its trials."""
    name, seed = piece
    scenario, task = Scenario.nominal("alten"), task_named(name)
    robots = drawn_robots(Robot.load("alten"), scenario, None)
    known = robots[0].imperfections.known or robots[0].model.robot
    learned = learn(robots, task, run=Run(seed=seed, progress=ignore_progress)) if seed >= 0 else None
    controller = learned.controller if learned else base_controller(known)
    plants = [(False, RUNS), *([(True, TWIN_RUNS[seed])] if 0 <= seed < len(TWIN_RUNS) else [])]
    return learned, [
        confirm(controller, task, known, scenario, runs=runs, twin=twin) for twin, runs in plants
    ]


def campaign() -> Section:
    """Run the missing trainings and return the section of docs/generated/evidence.md."""
    pieces = {f"{name}_{seed}": (name, seed) for name in TASKS for seed in range(-1, SEEDS)}
    done = finished("learning", tried, pieces, packages=_PACKAGES, workers=Threads(count=1))
    rows, curves = [], dict[str, list[Learned]]()
    for name in TASKS:
        own = [done[f"{name}_{seed}"] for seed in range(SEEDS)]
        curves[name] = learned = [one for one, _ in own if one is not None]
        balanced = [
            next((p.seconds for p in one.curve if p.fallen == 0.0 and p.length > 0.0), np.nan)
            for one in learned
        ]
        columns = [
            [one.curve[-1].seconds for one in learned],
            balanced,
            [one.curve[-1].reward for one in learned],
            [loop[0].fell for _, loop in own],
            [1e3 * loop[0].rms_position for _, loop in own],
            [loop[0].rms_velocity for _, loop in own],
        ]
        trials = [trial for _, made in own for trial in made]
        rows.append([f"{name}, learned", *map(_spread, columns), _on_twin(trials)])
        _, linear = done[f"{name}_-1"]
        baseline = [np.nan, np.nan, learned[0].baseline, linear[0].fell]
        baseline += [1e3 * linear[0].rms_position, linear[0].rms_velocity]
        rows.append([f"{name}, LQR", *(_number(value) for value in baseline), _on_twin(linear)])
    return Section(
        title="Controllers learned from nothing",
        before=f"`ballbot learn` with {SEEDS} seeds: median (best to worst). Then each runs {RUNS} times 60 s on fresh "
        f"robots of the nominal scenario on the compiled loop, with rollers and play, and those of the first "
        f"{len(TWIN_RUNS)} seeds {sum(TWIN_RUNS)} times in all on the twin. Times are by the clock of this machine; "
        "the LQR is the nominal one with the Kalman filter.",
        columns=[
            "task, controller",
            "training [s]",
            "until no episode fell [s]",
            "reward a second",
            f"falls of {RUNS}",
            "RMS position error [mm]",
            "RMS velocity error [m/s]",
            f"on the twin: falls of {sum(TWIN_RUNS)}; errors",
        ],
        rows=rows,
        after="The reward by the clock, with exploration, beside that of the LQR:\n\n![Learning curves of ten seeds]("
        f"{write_picture('learning_curves', lambda: curves_figure(curves))})",
    )


def curves_figure(learned: Mapping[str, Sequence[Learned]]) -> Figure:
    """Return the reward of each training by the clock, the worst at its end shown, beside the LQR's."""
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(learned), sharey=True))
    for axes, (name, trainings) in zip(panels, learned.items(), strict=True):
        worst = min(trainings, key=lambda each: each.curve[-1].reward)
        others = [each for each in trainings if each is not worst]
        for each, look in (*((each, "quiet") for each in others), (worst, "second")):
            seconds = np.array([point.seconds for point in each.curve])
            # without compiling, which only the first training of a process does
            axes.plot(seconds - seconds[0], [point.reward for point in each.curve], **LOOKS[look])
        axes.axhline(trainings[0].baseline, **LOOKS["sixth"])
        axes.set(title=name, xlabel="time after the first improvement [s]")
    panels[0].set_ylabel("reward a second")
    lines = [panels[0].lines[0], panels[0].lines[-2], panels[0].lines[-1]]
    panels[-1].legend(lines, ["other seeds", "worst seed", "LQR"], loc="lower right")
    return figure


def _spread(values: list[float]) -> str:
    least, middle, most = np.min(values), np.median(values), np.max(values)
    return f"{_number(middle)} ({_number(least)} to {_number(most)})"


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3g}"


def _on_twin(trials: list[Confirmed]) -> str:
    on = [one for one in trials if one.plant == "twin"]
    if not on:
        return ""
    position, velocity = [1e3 * one.rms_position for one in on], [one.rms_velocity for one in on]
    return f"{sum(one.fell for one in on)}; {_spread(position)} mm, {_spread(velocity)} m/s"
