"""What several figures share, each made once when it is first needed.

The recordings are of the nominal twin; the friction is identified from two of them, as a user would; models, gains and
compensation know that friction and nothing else of the twin. A model has no randomness, but the loop around it is
chaotic: a model with friction is evaluated over several initial states.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign, held
from ballbot.control.presets import design_gain, nominal_controller
from ballbot.control.references import Reference, change_pose, hold
from ballbot.fitting.run import Run
from ballbot.identification.driveline import Sweep, sweeps_of
from ballbot.identification.identify import identify
from ballbot.identification.swing import SwingFit, fit_swing, pendulum_motion, swing_of
from ballbot.identification.upside_down import identify_upside_down
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.progress import ProgressCallback, ignore_progress, in_stage
from ballbot.robot import Friction, Robot
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import sample_count, simulate
from ballbot.thesis.reproduce.ball_movement import BallMovement, ball_movement
from ballbot.thesis.reproduce.item import RUNS, run_seed
from ballbot.thesis.reproduce.recordings import CHANGE, CHANGE_RUN, Logs, ModelOnGrid, record
from ballbot.thesis.reproduce.runs import Validated, validated
from ballbot.validation.alignment import Alignment, align

#: duration [s] of a run about the origin, and the lean that it starts from [rad]
STANDING, FIRST_LEAN = 60.0, 0.02
#: standard deviation of the lean from which a run through the change of reference starts [rad]
_START_LEAN = 1e-2
#: speed below which the compensated friction's sign becomes a ramp [rad/s]: so small that it is the bare sign
SIGN = 1e-6
#: digits that are kept of an identified friction, so that it is the same on every machine
_FRICTION_DIGITS = 3
#: straight ways along x and y [m], on which the models part as the lean grows (Figure 5.1)
STEPS = (1.0, 2.0, 4.0, 8.0)
#: friction and compensation of a model's runs through the change; "_sign" has the thesis's bare sign, not a ramp
KINDS: Mapping[str, tuple[Compensation, float | None]] = MappingProxyType(
    {
        "none": ("none", None),
        "full": ("full", None),
        "partial": ("partial", None),
        "full_sign": ("full", SIGN),
        "partial_sign": ("partial", SIGN),
    }
)
#: what "without friction" may be: the exact equations, or the thesis's own, which are its basic model
BASIC: Mapping[Formulation, str] = MappingProxyType(
    {"exact": "without friction", "thesis": "without friction, the thesis's equations"}
)
#: the swing of Appendix III: its length [s], a video's rate [1/s], first angle [rad], the tracking's error [rad], and
#: the pivot's friction [N m s/rad, N m]; the thesis gives none of them
SWING, FILM_RATE, SWING_ANGLE, TRACKING_ERROR = 30.0, 30.0, 0.2, 0.003
PIVOT_VISCOUS, PIVOT_DRY = 0.05, 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """Recordings, and the robot identified from them."""

    robot: Robot  #: without friction
    seed: int
    progress: ProgressCallback = ignore_progress
    _recorded: dict[str, list[Logs]] = field(default_factory=dict[str, list[Logs]], init=False)

    def recorded(self, kind: str) -> list[Logs]:
        """Return the twin's recordings of a kind; see `recordings.KINDS`."""
        if kind not in self._recorded:
            robot = self.identified if kind == "with_compensation" else self.robot
            self._recorded[kind] = record(kind, robot, seed=self.seed, progress=self.progress)
        return self._recorded[kind]

    @cached_property
    def identified(self) -> Robot:
        """The robot with the friction of balancing, identified from two recordings."""
        logs = [recording["log"].without_truth() for recording in self.recorded("fit")]
        run = Run(seed=self.seed, progress=in_stage(self.progress, "identifying the friction"))
        return rounded_friction(identify(self.robot, logs, run=run).robot)

    @cached_property
    def design(self) -> LqrDesign:
        """The nominal gain."""
        return design_gain(self.robot)

    @cached_property
    def sweeps(self) -> list[Sweep]:
        """The drivelines' sweeps (Figure 3.1)."""
        return sweeps_of(self.robot, self.recorded("driveline_sweep")[0]["log"])

    @cached_property
    def contact(self) -> Robot:
        """The robot with the friction of drivelines and contacts, identified upside down as section 3.2 has it."""
        log = self.recorded("upside_down")[0]["log"]
        return rounded_friction(identify_upside_down(self.robot, log, run=Run(seed=self.seed)).robot)

    @cached_property
    def ball_movement(self) -> BallMovement:
        """The ball on the clamped wheels, with that friction and without (Figure 3.4)."""
        return ball_movement(self.contact)

    @cached_property
    def standing(self) -> dict[str, tuple[Log, ...]]:
        """The models about the origin, from a small lean to all sides (Figure 3.5): "exact", "thesis", "friction"."""
        controller = nominal_controller(self.robot)
        # without friction nothing is chaotic, and a grid would keep the model from coming to rest
        models: dict[str, Plant | Model] = {name: Model(self.robot, formulation=name) for name in BASIC}
        return {
            name: tuple(
                simulate(model, controller, hold(), duration=STANDING, initial_state=_leaning(number))
                for number in range(RUNS)
            )
            for name, model in {**models, "friction": ModelOnGrid(Model(self.identified))}.items()
        }

    @cached_property
    def linear(self) -> dict[Formulation, Log]:
        """Both formulations' linear models without friction through the change of reference."""
        return {name: self._linear(name, CHANGE) for name in BASIC}

    @cached_property
    def basic(self) -> dict[Formulation, Log]:
        """Both formulations' nonlinear models without friction through it."""
        return {name: self.frictionless(name, CHANGE) for name in BASIC}

    @cached_property
    def parting(self) -> dict[Formulation, list[tuple[Log, Log]]]:
        """The linear and the nonlinear model without friction on straight ways, each twice as far as the one before."""
        return {
            name: [
                (self._linear(name, straight(step)), self.frictionless(name, straight(step)))
                for step in STEPS
            ]
            for name in BASIC
        }

    @cached_property
    def changes(self) -> dict[str, tuple[Log, ...]]:
        """The model with friction through the change of reference, by `KINDS`, from several starts."""
        return {
            kind: tuple(self._change(number, *how) for number in range(RUNS)) for kind, how in KINDS.items()
        }

    def twin_changes(self, kind: Literal["none", "full"]) -> tuple[Log, ...]:
        """Return the twin's runs through it with that compensation."""
        name = {"none": "without_compensation", "full": "with_compensation"}[kind]
        return tuple(recording["log"] for recording in self.recorded(name))

    @cached_property
    def validations(self) -> tuple[Validated, ...]:
        """The models with and without friction against each of the twin's runs without compensation (chapter 4)."""
        return tuple(
            validated(self.robot, self.identified, log.without_truth()) for log in self.twin_changes("none")
        )

    @cached_property
    def alignments(self) -> tuple[Alignment, ...]:
        """The three-minute runs beside motion capture (Appendix IV)."""
        return tuple(align(pair["log"].without_truth(), pair["mocap"]) for pair in self.recorded("drifting"))

    @cached_property
    def swings(self) -> tuple[SwingFit, ...]:
        """Simulated swings of the body about where the ball's centre would be, fitted (Figure III.1)."""
        t = np.arange(round(SWING * FILM_RATE), dtype=np.float64) / FILM_RATE
        body = self.robot.body
        inertia = float(body.inertia_about_ball_center()[0, 0])
        stiffness = body.mass * self.robot.gravity * body.center_of_mass / inertia
        viscous, dry = PIVOT_VISCOUS / inertia, PIVOT_DRY / inertia
        angle, _ = pendulum_motion(np.array([stiffness, viscous, dry, SWING_ANGLE, 0.0]), t)
        fits = []
        for number in range(RUNS):
            # the tracking's error: N(0, TRACKING_ERROR)
            random = np.random.default_rng(run_seed(self.seed, 500 + number))
            error = TRACKING_ERROR * random.standard_normal(len(t))
            fits.append(fit_swing(swing_of(t, angle + error, kind="angle", source="a simulated swing")))
        return tuple(fits)

    def _linear(self, formulation: Formulation, reference: Reference) -> Log:
        gain = self.design.gain
        return linear_run(self.robot, gain, reference, duration=CHANGE_RUN, formulation=formulation)

    def frictionless(self, formulation: Formulation, reference: Reference) -> Log:
        """Return the run of a nonlinear model without friction under the nominal gain."""
        plant = ModelOnGrid(Model(self.robot, formulation=formulation))
        controller = Controller(self.robot, self.design.gain)
        return simulate(plant, controller, reference, duration=CHANGE_RUN, initial_state=np.zeros(10))

    def _change(self, number: int, compensation: Compensation, speed_band: float | None) -> Log:
        controller = Controller(
            self.identified, self.design.gain, compensation=compensation, speed_band=speed_band
        )
        # leans: N(0, _START_LEAN)
        start = np.zeros(10)
        random = np.random.default_rng(run_seed(self.seed, 400 + number))
        start[2:4] = np.round(_START_LEAN * random.standard_normal(2), 6)
        plant = ModelOnGrid(Model(self.identified))
        return simulate(plant, controller, CHANGE, duration=CHANGE_RUN, initial_state=start)


def rounded_friction(robot: Robot) -> Robot:
    """Return a robot whose friction is rounded to three digits, so that a search ends alike on every machine."""

    def rounded(value: float) -> float:
        return float(f"{value:.{_FRICTION_DIGITS}g}")

    values = {
        name: tuple(map(rounded, value)) if isinstance(value, tuple) else rounded(value)
        for name, value in vars(robot.friction).items()
        if name not in ("law", "own")  # the classical law, without parameters of its own
    }
    return robot.replace(friction=replace(robot.friction, **values))


def straight(step: float) -> Reference:
    """Return a change of reference without a turn: by `step` metres along x and back along y, at t = 3 s."""
    return change_pose(x=step, y=-step, psi=0.0, at=3.0, ramp=0.0)


def _leaning(number: int) -> Floats:
    """Return the start of a run that stands, at rest and leaning to a side of its own."""
    start = np.zeros(10)
    side = 2.0 * np.pi * number / RUNS
    start[2:4] = np.round(FIRST_LEAN * np.array([np.cos(side), np.sin(side)]), 6)
    return start


def linear_run(
    robot: Robot, gain: Floats, reference: Reference, *, duration: float, formulation: Formulation = "exact"
) -> Log:
    """Return a run of x_dot = A x + B u under u = K (r - x), from rest, sampled and held.

    The linear model is of psi = 0 and knows no other heading, so that the error is not turned.
    """
    frictionless = robot.replace(friction=Friction.none(robot.wheel_count))
    linear = Model(frictionless, formulation=formulation).linearize()
    h = robot.sensors.sample_time
    F, G = held(linear.A, linear.B, h)
    count = sample_count(duration, h)
    t = np.round(h * np.arange(count, dtype=np.float64), 9)
    x, states, torques = np.zeros(10), np.empty((count, 10)), np.empty((count, robot.wheel_count))
    wanted = np.array([reference(float(time)) for time in t])
    for k in range(count):
        states[k] = x
        torques[k] = gain @ (wanted[k] - x)
        x = F @ x + G @ torques[k]
    columns = {"t": t} | dict(zip(STATE_NAMES, states.T, strict=True))
    columns |= {f"u{i + 1}": column for i, column in enumerate(torques.T)}
    return Log(columns | {"ref_x": wanted[:, 0], "ref_y": wanted[:, 1], "ref_psi": wanted[:, 4]})
