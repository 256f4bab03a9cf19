"""Falls that changes of a running controller add, over random changes, references and pushes.

.venv/bin/python -m campaigns.evidence tune_sequences

The rule: five presets with the nominal and the precise controller, each with a second gain that `ballbot export --with`
takes: it shares a Lyapunov function with the own one and recovers from impulses as large. The robots are drawn from the
presets' default errors, with 0.8 to 1.2 times the friction that the controller knows. A run lasts 16 s; every 4 s the
reference jumps, twice the body is pushed, and about once a second the setting changes: any mixture, any compensation,
or a step back. The pushes are 50 to 90 % of the largest two from which the robot recovers in this very run, with its
references and its noise, without the changes. The same run without the changes shows which falls are additional. No
second gain is found for precise on cmu.
"""

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
from ballbot.simulation.imperfections import Imperfections, Push
from ballbot.simulation.inputs import draws_of, empty_outcome, inputs_of, new_commands
from ballbot.simulation.loop import Sampling, new_memory, run_block
from ballbot.simulation.run import sample_count
from ballbot.twin import Scenario
from ballbot.workflows.limits import refuse_weaker_gains
from campaigns.section import Section

PRESETS = ("alten", "rob311", "kugle", "rezero", "cmu")
#: of everything random, other than the one that the law was changed on (6804), and the runs of each preset and kind
SEED, RUNS = 6901, 112
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
_HALVINGS = 7
#: lean beyond which a robot has fallen [rad]
FALLEN = 0.6
#: the second gain's weights are so far on the way to those of the other kind: the first that may be mixed
SHARES = (0.5, 0.3, 0.15, 0.05)


@dataclass(frozen=True, kw_only=True)
class Counted:
    """The runs of a preset with a kind of controller."""

    name: str
    runs: int
    untuned: int  #: falls without changes
    added: int  #: falls of runs that did not fall without
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
            refuse_weaker_gains(controller)
        except InputError:
            continue
        return controller
    raise InputError(f"{preset}, {kind}: no other gain may be mixed with its own.")


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
    directions: NDArray[np.float64]  #: (runs,) of the pushes [rad]
    times: NDArray[np.float64]  #: (runs, pushes), when they begin [s]
    impulses: NDArray[np.float64]  #: (runs, pushes) [N s]
    #: (samples, 10), the same for `LANES` robots
    references: list[NDArray[np.float64]]
    settings: list[dict[int, Setting | None]]  #: by the chunk that begins with the change


def drawn_runs(controller: Controller, runs: int, *, seed: int) -> Drawn:
    """Draw robots and runs; the largest pushes of each are found with the setting that was exported."""
    random, known = np.random.default_rng(seed), controller.robot
    robots = [
        robot.replace(friction=scaled_friction(known.friction, float(random.uniform(0.8, 1.2))))
        for robot in draw_robots(with_default_errors(known), runs, seed=seed)
    ]
    models = [Model(robot) for robot in robots]
    lanes = [Imperfections(sensors=known.sensors, known=known, seed=seed + k) for k in range(runs)]
    samples = sample_count(DURATION, controller.sample_time)
    drawn = Drawn(
        models=models,
        lanes=lanes,
        directions=random.uniform(-np.pi, np.pi, runs),
        times=np.column_stack([random.uniform(*span, runs) for span in PUSHES]),
        impulses=np.zeros((runs, len(PUSHES))),
        references=[jumps(random, samples, controller.sample_time) for _ in range(0, runs, LANES)],
        settings=[
            changes(random, float(controller.record["tuning"]["compensation"][0])) for _ in range(runs)
        ],
    )
    shares = random.uniform(*PUSHED, drawn.impulses.shape)
    return replace(drawn, impulses=shares * largest_pushes(controller, drawn)[:, None])


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


def largest_pushes(controller: Controller, drawn: Drawn) -> NDArray[np.float64]:
    """Return the impulse [N s] with which each robot recovers from both pushes of its run, by halving."""
    known, ones = controller.robot, np.ones_like(drawn.impulses)
    # of a robot that is pushed to a speed at which its centre of mass passes beyond any support
    high = np.full(len(drawn.models), known.body.mass * np.sqrt(known.gravity * known.body.center_of_mass))
    low = np.zeros_like(high)
    for _ in range(_HALVINGS):
        tried = 0.5 * (low + high)
        fell = fallen(controller, replace(drawn, impulses=tried[:, None] * ones), tuned=False)
        low, high = np.where(fell, low, tried), np.where(fell, tried, high)
    return low


def fallen(controller: Controller, drawn: Drawn, *, tuned: bool) -> NDArray[np.bool_]:
    """Run all, in blocks and chunks between which settings change; return which fell."""
    ends = [_block(controller, drawn, first, tuned=tuned) for first in range(0, len(drawn.models), LANES)]
    return np.concatenate(ends)


def _block(controller: Controller, drawn: Drawn, first: int, *, tuned: bool) -> NDArray[np.bool_]:
    models = drawn.models[first : first + LANES]
    width, n, h = len(models), controller.robot.wheel_count, controller.sample_time
    height = controller.robot.body.center_of_mass
    lanes = [
        replace(
            drawn.lanes[k],
            pushes=tuple(
                Push.of_impulse(
                    impulse, float(drawn.directions[k]), time=time, duration=PUSH_DURATION, height=height
                )
                for time, impulse in zip(drawn.times[k].tolist(), drawn.impulses[k].tolist(), strict=True)
            ),
        )
        for k in range(first, first + width)
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
    added = tuned & ~without
    return Counted(
        name=f"{preset}, {kind}",
        runs=runs,
        untuned=int(without.sum()),
        added=int(added.sum()),
        spared=int((without & ~tuned).sum()),
        changes=sum(map(len, drawn.settings)),
    )


def campaign() -> Section:
    """Return the section of docs/generated/evidence.md."""
    cases = [(preset, kind) for preset in PRESETS for kind in ("nominal", "precise")][:-1]
    rows = [counted(preset, kind, seed=SEED + 1000 * k) for k, (preset, kind) in enumerate(cases)]
    runs, added = (sum(getattr(row, name) for row in rows) for name in ("runs", "added"))
    return Section(
        title="Changes of a running controller",
        before="Random sequences of changes (mixtures of two gains, compensation, steps back; one a second), jumps of "
        "the reference and two pushes, 16 s each, on robots drawn from the presets' default errors. The pushes are 50 "
        "to 90 % of the largest two from which the robot recovers in this run without the changes. Each run is "
        "repeated without the changes; an additional fall is one that the repetition does not have.",
        columns=[
            "robot, controller",
            "runs",
            "changes",
            "falls without",
            "additional falls",
            "falls spared",
        ],
        rows=[
            [row.name, *(str(n) for n in (row.runs, row.changes, row.untuned, row.added, row.spared))]
            for row in rows
        ],
        after=f"Additional falls: {added} of {runs}, {100.0 * added / runs:.2f} %; the one-sided upper 95 % bound "
        f"(Clopper and Pearson) is {100.0 * upper_bound(added, runs):.2f} %.",
    )
