"""Controllers learned with ten seeds, tried on fresh robots of the loop and on the twin, beside an LQR.

.venv/bin/python -m campaigns.evidence learning

Trainings that are finished are kept in build/learning.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from ballbot.control.controller import Controller
from ballbot.control.lqr import frictionless_model
from ballbot.control.references import hold
from ballbot.fitting.run import Run, Threads
from ballbot.learning.learn import Confirmed, Learned, base_controller, confirm, learn
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import PUSH, action_limit, task_named
from ballbot.progress import ignore_progress
from ballbot.report.style import LOOKS
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Push
from ballbot.twin.imperfections import imperfections_of, true_model
from ballbot.twin.scenario import Scenario
from campaigns.section import Section, finished, write_picture

TASKS, SEEDS = ("balance", "drive"), 10
#: fresh robots of a trial on the loop, and of those on the twin of the first seeds' controllers
RUNS, TWIN_RUNS = 100, (34, 33, 33)
#: a push over the bound, its directions and seeds; how late a robot answers it at best, by two counts [s]
PUSHED, DIRECTIONS, PUSH_SEEDS, ANSWERS = 0.7, 8, 5, (0.0, 0.03)
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "learning")


def tried(piece: tuple[str, int]) -> tuple[Learned | None, list[Confirmed], list[float]]:
    """Learn a task with a seed (the linear law for a seed below 0), and return what was learned and its trials.

    Last, the shares of `push_shares`.
    """
    name, seed = piece
    scenario, task = Scenario.nominal("alten"), task_named(name)
    robots = drawn_robots(Robot.load("alten"), scenario, "boxes")
    known = robots[0].imperfections.known or robots[0].model.robot
    learned = learn(robots, task, run=Run(seed=seed, progress=ignore_progress)) if seed >= 0 else None
    controller = learned.controller if learned else base_controller(known)
    plants = [(False, RUNS), *([(True, TWIN_RUNS[seed])] if 0 <= seed < len(TWIN_RUNS) else [])]
    trials = [confirm(controller, task, known, scenario, runs=runs, twin=twin) for twin, runs in plants]
    return learned, trials, push_shares(controller, scenario, action_limit(task, known))


def largest_push(robot: Robot, torque: float, answer: float) -> float:
    """Return a bound of the impulse [N s] of a push that any controller recovers from, in its worst direction.

    The linear model without friction is lost once its unstable part z exceeds what the torque (of each wheel, from
    `answer` [s] after the push begins) brings back: z' = p z + b u + g F, |z| <= |b u| / p at the push's end.
    """
    model = frictionless_model(robot)
    linear = model.linearize()
    rates, vectors = (np.asarray(part, np.complex128) for part in np.linalg.eig(linear.A.T))
    unstable = np.argsort(-rates.real)[:2]
    p = float(rates.real[unstable[0]])
    basis = np.linalg.svd(np.hstack([vectors.real[:, unstable], vectors.imag[:, unstable]]))[0][:, :2].T
    along = np.zeros((5, 2))
    along[0, 0] = along[1, 1] = 1.0
    along[3, 0], along[2, 1] = robot.body.center_of_mass, -robot.body.center_of_mass
    pushed = basis @ np.vstack([np.zeros((5, 2)), np.linalg.solve(model.mass_matrix(np.zeros(5)), along)])
    angles = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    most = torque * np.abs(normals @ basis @ linear.B).sum(axis=1)
    reached = normals @ pushed @ normals.T  # of each direction of the push, a column
    forces = np.divide(most[:, None], reached, out=np.full_like(reached, np.inf), where=reached > 1e-9).min()
    return float(forces * PUSH * np.exp(p * (PUSH - answer)) / np.expm1(p * PUSH))


def push_shares(controller: Controller, scenario: Scenario, torque: float) -> list[float]:
    """Return the shares of single pushes recovered on the loop with slip, for each of `ANSWERS`.

    A policy acts alone to the end, without the law that catches it.
    """
    policy, robot = controller.parts.policy, controller.robot
    if policy is not None:
        policy = replace(policy, largest_lean=0.6, largest_speed=1e3)
        controller = controller.with_parts(replace(controller.parts, policy=policy))
    slipping = imperfections_of(scenario, known=robot, slips=True)
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    height, shares = robot.body.center_of_mass, []
    for answer in ANSWERS:
        size = PUSHED * largest_push(robot, torque, answer)
        pushes = [Push.of_impulse(size, a, time=1.0, duration=PUSH, height=height) for a in angles.tolist()]
        lanes = [
            replace(slipping, seed=seed, pushes=(push,))
            for seed, push in itertools.product(range(PUSH_SEEDS), pushes)
        ]
        batch = simulate_batch(
            true_model(robot, scenario),
            controller,
            hold(),
            duration=6.0,
            initial_states=np.zeros(10),
            imperfections=lanes,
            every=0,
        )
        shares.append(float(batch.survived.mean()))
    return shares


def campaign() -> Section:
    """Run the missing trainings and return the section of docs/generated/evidence.md."""
    pieces = {f"{name}_{seed}": (name, seed) for name in TASKS for seed in range(-1, SEEDS)}
    done = finished("learning", tried, pieces, packages=_PACKAGES, workers=Threads(count=1))
    rows, curves = [], dict[str, list[Learned]]()
    for name in TASKS:
        own = [done[f"{name}_{seed}"] for seed in range(SEEDS)]
        curves[name] = learned = [one for one, _, _ in own if one is not None]
        balanced = [
            next((p.seconds for p in one.curve if p.fallen == 0.0 and p.length > 0.0), np.nan)
            for one in learned
        ]
        columns = [
            [one.curve[-1].seconds for one in learned],
            balanced,
            [one.curve[-1].reward for one in learned],
            [loop[0].fell for _, loop, _ in own],
            [1e3 * loop[0].rms_position for _, loop, _ in own],
            [loop[0].rms_velocity for _, loop, _ in own],
            *np.array([shares for _, _, shares in own]).T.tolist(),
        ]
        trials = [trial for _, made, _ in own for trial in made]
        rows.append([f"{name}, learned", *map(_spread, columns), _on_twin(trials)])
        _, linear, shares = done[f"{name}_-1"]
        baseline = [np.nan, np.nan, learned[0].baseline, linear[0].fell]
        baseline += [1e3 * linear[0].rms_position, linear[0].rms_velocity, *shares]
        rows.append([f"{name}, LQR", *(_number(value) for value in baseline), _on_twin(linear)])
    return Section(
        title="Controllers learned from nothing",
        before=f"`ballbot learn` with {SEEDS} seeds: median (best to worst). Then each runs {RUNS} times 60 s on fresh "
        f"robots of the nominal scenario on the compiled loop, with rollers and play, and those of the first "
        f"{len(TWIN_RUNS)} seeds {sum(TWIN_RUNS)} times in all on the twin. Times are by the clock of this machine; "
        "the LQR is the nominal one with the Kalman filter. Trained in the boxes of `--randomize boxes`, with grip and "
        f"slip. Pushes: single ones of {PUSHED:.0%} of the bound at the policies' torque limit, from {DIRECTIONS} "
        f"directions, {PUSH_SEEDS} seeds, on the loop with slip and without the law that catches a policy; the bound "
        "is that of the linear model without friction whose torque acts so late after the push begins.",
        columns=[
            "task, controller",
            "training [s]",
            "until no episode fell [s]",
            "reward a second",
            f"falls of {RUNS}",
            "RMS position error [mm]",
            "RMS velocity error [m/s]",
            *(f"share of pushes recovered, answer {1e3 * answer:g} ms" for answer in ANSWERS),
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
