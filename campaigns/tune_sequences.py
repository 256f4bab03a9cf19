"""Falls that changes of a running controller add, over random changes, references and pushes.

.venv/bin/python -m campaigns.evidence tune_sequences

The rule: five presets with the nominal and the precise controller, each with a second gain that shares a Lyapunov
function with its own, as `ballbot export --with` demands. The robots are drawn from the presets' default errors, with
0.8 to 1.2 times the friction that the controller knows. A run lasts 16 s; every 4 s the reference jumps, twice the body
is pushed by 50 to 90 % of what this robot recovers from at rest in this direction with the exported setting, and about
once a second the setting changes: any mixture, any compensation, or a step back. The same run without the changes shows
which falls are additional; and the same run with the second gain, without compensation, and with neither, each from the
start on, which of these a fixed setting has as well. No such second gain is found for precise on cmu.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from ballbot.control.controller import Controller
from ballbot.control.gain_set import certified, tunable
from ballbot.control.law import MEMORY_TYPE
from ballbot.control.presets import (
    NOMINAL_STATE_WEIGHTS,
    PRECISE_STATE_WEIGHTS,
    design_gain,
    design_integral_gain,
    precise_controller,
)
from ballbot.control.tuning import Setting, take_setting
from ballbot.errors import InputError
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.robot.variations import draw_robots, with_default_errors
from ballbot.simulation.batch import OutcomeBounds, simulate_batch
from ballbot.simulation.imperfections import Imperfections, Push
from ballbot.simulation.inputs import draws_of, empty_outcome, inputs_of, new_commands
from ballbot.simulation.loop import Sampling, new_memory, run_block
from ballbot.simulation.run import sample_count
from ballbot.twin import Scenario
from campaigns.section import Section

PRESETS = ("alten", "rob311", "kugle", "rezero", "cmu")
#: of everything random, and the runs of each preset and kind
SEED, RUNS = 6804, 112
DURATION, JUMP_EVERY = 16.0, 4.0  # [s]
#: largest jumps of x and y [m], and of the heading [rad]
JUMP, TURN = 0.3, 0.5
#: mean time between two changes, and the time on whose multiples they come [s]
CHANGES_EVERY, CHUNK = 1.0, 0.25
PUSHES = ((2.0, 6.0), (9.0, 13.0))  # between which each begins [s]
PUSH_DURATION, PUSHED = 0.1, (0.5, 0.9)
#: break-away torque over the motors' limit
BREAKAWAY = 0.03
#: of the search for the largest push
_HALVINGS, _HORIZON = 7, 5.0
#: lean beyond which a robot has fallen [rad]
FALLEN = 0.6
#: the second gain's weights are so far on the way to those of the other kind: the first with which the gains share a
#: Lyapunov function
SHARES = (0.5, 0.3, 0.15, 0.05)


@dataclass(frozen=True, kw_only=True)
class Counted:
    """The runs of a preset with a kind of controller."""

    name: str
    runs: int
    untuned: int  #: falls without changes
    added: int  #: falls of runs that did not fall without
    fixed: int  #: of the added ones, those that fall with a fixed setting as well
    spared: int  #: runs that fell without changes only
    changes: int  #: that were made


def upper_bound(count: int, runs: int) -> float:
    """Return the upper 95 % bound of a share, one-sided (Clopper and Pearson)."""
    return 1.0 if count == runs else float(beta.ppf(0.95, count + 1, runs - count))


def designed(preset: str, kind: str) -> Controller:
    """Return a preset's controller with friction that it compensates, and a second gain."""
    robot = Robot.load(preset)
    friction = Scenario.nominal(robot).friction
    share = BREAKAWAY * robot.drive.torque_limit / max(friction.breakaway)
    robot = robot.replace(friction=scaled_friction(friction, share))
    own = with_weights(robot, kind, 0.0)
    for share in SHARES:
        controller = tunable(own, [with_weights(robot, kind, share)])
        try:
            certified(controller)
        except InputError:
            continue
        return controller
    raise InputError(f"{preset}, {kind}: no other gain shares a Lyapunov function with its own.")


def with_weights(robot: Robot, kind: str, share: float) -> Controller:
    """Return a controller of a kind whose state weights lie so far on the way to the other kind's."""
    ends = (NOMINAL_STATE_WEIGHTS, PRECISE_STATE_WEIGHTS)
    first, second = np.array(ends if kind == "nominal" else ends[::-1])
    weights = (first ** (1.0 - share) * second**share).tolist()
    if kind == "precise":
        return precise_controller(robot, design=design_integral_gain(robot, state_weights=weights))
    return Controller(robot, design_gain(robot, state_weights=weights).gain, compensation="partial")


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Robots of a preset, and what happens to each in its run."""

    models: list[Model]
    lanes: list[Imperfections]  #: sensors, and what the controller knows
    directions: NDArray[np.float64]  #: of the pushes [rad]
    pushes: list[tuple[Push, ...]]
    #: (samples, 10), the same for `LANES` robots
    references: list[NDArray[np.float64]]
    settings: list[dict[int, Setting | None]]  #: by the chunk that begins with the change


def push_in(robot: Robot, *, time: float, impulse: float, direction: float) -> Push:
    """Return a push at the centre of mass by an impulse [N s]."""
    force = impulse / PUSH_DURATION
    along = (force * float(np.cos(direction)), force * float(np.sin(direction)), 0.0)
    return Push(time=time, duration=PUSH_DURATION, force=along, height=robot.body.center_of_mass)


def drawn_runs(controller: Controller, runs: int, *, seed: int) -> Drawn:
    """Draw robots and runs; the largest push of each is found with the setting that was exported."""
    random, known = np.random.default_rng(seed), controller.robot
    robots = [
        robot.replace(friction=scaled_friction(known.friction, float(random.uniform(0.8, 1.2))))
        for robot in draw_robots(with_default_errors(known), runs, seed=seed)
    ]
    models = [Model(robot) for robot in robots]
    lanes = [Imperfections(sensors=known.sensors, known=known, seed=seed + k) for k in range(runs)]
    directions = random.uniform(-np.pi, np.pi, runs)
    largest = largest_pushes(controller, models, lanes, directions)
    pushes, settings = [], []
    for k in range(runs):
        sizes = largest[k] * random.uniform(*PUSHED, len(PUSHES))
        times = [float(random.uniform(*span)) for span in PUSHES]
        pairs = zip(times, sizes.tolist(), strict=True)
        direction = float(directions[k])
        pushes.append(tuple(push_in(known, time=t, impulse=p, direction=direction) for t, p in pairs))
        settings.append(changes(random, float(controller.record["tuning"]["compensation"][0])))
    samples = sample_count(DURATION, controller.sample_time)
    references = [jumps(random, samples, controller.sample_time) for _ in range(0, runs, LANES)]
    return Drawn(
        models=models,
        lanes=lanes,
        directions=directions,
        pushes=pushes,
        references=references,
        settings=settings,
    )


def changes(random: np.random.Generator, most: float) -> dict[int, Setting | None]:
    """Draw changes: any mixture of two gains, any compensation up to the certain one, or a step back."""
    asked: dict[int, Setting | None] = {}
    for chunk in range(1, round(DURATION / CHUNK)):
        if random.uniform() < CHUNK / CHANGES_EVERY:
            weight, kind = float(random.beta(0.5, 0.5)), random.uniform()
            setting = Setting(
                weights=(1.0 - weight, weight), compensation=most * float(random.beta(0.5, 0.5))
            )
            asked[chunk] = None if kind < 0.2 else setting
    return asked


def jumps(random: np.random.Generator, samples: int, h: float) -> NDArray[np.float64]:
    """Return a reference (samples, 10) that jumps about the start."""
    count = int(np.ceil(DURATION / JUMP_EVERY))
    places = np.zeros((count, 10))
    places[1:, [0, 1, 4]] = random.uniform(-1.0, 1.0, (count - 1, 3)) * [JUMP, JUMP, TURN]
    return places[np.minimum((h * np.arange(samples) / JUMP_EVERY).astype(int), count - 1)]


def largest_pushes(
    controller: Controller,
    models: Sequence[Model],
    lanes: Sequence[Imperfections],
    directions: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the largest impulse [N s] at rest that each robot recovers from, by halving."""
    known = controller.robot
    # of a robot that is pushed to a speed at which its centre of mass passes beyond any support
    high = np.full(len(models), known.body.mass * np.sqrt(known.gravity * known.body.center_of_mass))
    low = np.zeros(len(models))
    for _ in range(_HALVINGS):
        tried = 0.5 * (low + high)
        pushed = [
            replace(lane, pushes=(push_in(known, time=1.0, impulse=float(p), direction=float(a)),))
            for lane, p, a in zip(lanes, tried, directions, strict=True)
        ]
        batch = simulate_batch(
            models,
            controller,
            "hold",
            duration=_HORIZON,
            initial_states=np.zeros(10),
            imperfections=pushed,
            verdict=OutcomeBounds(lost=FALLEN),
            every=0,
        )
        recovered = np.isinf(batch.ended)
        low, high = np.where(recovered, tried, low), np.where(recovered, high, tried)
    return low


def fallen(controller: Controller, drawn: Drawn, *, tuned: bool) -> NDArray[np.bool_]:
    """Run all, in blocks and chunks between which settings change; return which fell."""
    ends = [_block(controller, drawn, first, tuned=tuned) for first in range(0, len(drawn.models), LANES)]
    return np.concatenate(ends)


def _block(controller: Controller, drawn: Drawn, first: int, *, tuned: bool) -> NDArray[np.bool_]:
    models = drawn.models[first : first + LANES]
    width, n, h = len(models), controller.robot.wheel_count, controller.sample_time
    lanes = [
        replace(lane, pushes=pushes)
        for lane, pushes in zip(
            drawn.lanes[first : first + width], drawn.pushes[first : first + width], strict=True
        )
    ]
    references, estimator = drawn.references[first // LANES], controller.estimator
    inputs = inputs_of(models, lanes, sample_time=h, laws=[controller], estimators=[estimator])
    samples = len(references)
    sampling = Sampling(
        references=references,
        sample_time=h,
        steps=models[0].steps_in(h),
        every=samples,
        lost_lean=FALLEN,
    )
    out = empty_outcome(width, 1, samples, n)
    draws = draws_of([(lane, lane.seed) for lane in lanes], width, n=n, samples=samples, sample_time=h)
    memory = new_memory(inputs.loops, width, n, filtering=len(inputs.filters) > 0)
    commands = new_commands(width, 0)
    given = models[0].selected, inputs, draws, sampling, memory, commands, out
    run_block(*given, (0, 0))
    begins = [sample_count(chunk * CHUNK, h) if chunk else 0 for chunk in range(round(DURATION / CHUNK))]
    for chunk, (begin, end) in enumerate(zip(begins, [*begins[1:], samples], strict=True)):
        for robot, settings in enumerate(drawn.settings[first : first + width] if tuned else ()):
            if chunk in settings:
                state = memory.laws[robot].view(MEMORY_TYPE)["tuning"][0]
                take_setting(controller.record["tuning"][0], state, settings[chunk])
        run_block(*given, (begin, end))
    return out.ended < samples


def counted(preset: str, kind: str, *, runs: int = RUNS, seed: int = SEED) -> Counted:
    """Run a preset with a kind of controller, each run with and without changes."""
    controller = designed(preset, kind)
    drawn = drawn_runs(controller, runs, seed=seed)
    without, tuned = (fallen(controller, drawn, tuned=tuned) for tuned in (False, True))
    most = float(controller.record["tuning"]["compensation"][0])
    fixed = np.zeros(runs, dtype=bool)
    for weight, share in ((1.0, most), (0.0, 0.0), (1.0, 0.0)):
        setting = Setting(weights=(1.0 - weight, weight), compensation=share)
        kept = replace(drawn, settings=[{1: setting}] * runs)
        fixed |= fallen(controller, kept, tuned=True)
    added = tuned & ~without
    return Counted(
        name=f"{preset}, {kind}",
        runs=runs,
        untuned=int(without.sum()),
        added=int(added.sum()),
        fixed=int((added & fixed).sum()),
        spared=int((without & ~tuned).sum()),
        changes=sum(map(len, drawn.settings)),
    )


def campaign() -> Section:
    """Return the section of docs/generated/evidence.md."""
    cases = [(preset, kind) for preset in PRESETS for kind in ("nominal", "precise")][:-1]
    rows = [counted(preset, kind, seed=SEED + 1000 * k) for k, (preset, kind) in enumerate(cases)]
    runs, added, fixed = (sum(getattr(row, name) for row in rows) for name in ("runs", "added", "fixed"))
    return Section(
        title="Changes of a running controller",
        before="Random sequences of changes (mixtures of two gains, compensation, steps back; one a second), jumps of "
        "the reference and two pushes of 50 to 90 % of what this robot recovers from at rest in this direction with "
        "the exported setting, 16 s each, on robots drawn from the presets' default errors. Each run is repeated "
        "without the changes; an additional fall is one that the repetition does not have. Some of these happen with a "
        "fixed setting too: the second gain, no compensation, or both, from the start on.",
        columns=[
            "robot, controller",
            "runs",
            "changes",
            "falls without",
            "additional falls",
            "of these with a fixed setting too",
            "falls spared",
        ],
        rows=[
            [
                row.name,
                *(str(n) for n in (row.runs, row.changes, row.untuned, row.added, row.fixed, row.spared)),
            ]
            for row in rows
        ],
        after=f"Additional falls: {added} of {runs}, {100.0 * added / runs:.2f} %; the one-sided upper 95 % bound "
        f"(Clopper and Pearson) is {100.0 * upper_bound(added, runs):.2f} %. Without those that a fixed setting has as "
        f"well: {added - fixed}, with a bound of {100.0 * upper_bound(added - fixed, runs):.2f} %.",
    )
