"""What several figures share, each made once when it is first asked for.

The recordings are of the nominal twin; the friction is identified from two of them, as a user would; models, gains and
compensation know that friction and nothing else of the twin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign, held
from ballbot.control.nominal import design_gain, nominal_controller
from ballbot.control.references import Reference, hold
from ballbot.experiments.ball_movement import BallMovement, ball_movement
from ballbot.experiments.reproduce.film import FilmedBall, filmed_ball
from ballbot.experiments.reproduce.recordings import CHANGE, Logs
from ballbot.identification.axis.driveline import (
    DrivelineBounds,
    DrivelineFit,
    Sweep,
    fit_driveline,
    sweeps_of,
)
from ballbot.identification.swing import SwingFit, fit_swing, swing_of
from ballbot.identification.swing.pendulum import follow_pendulum
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.simulation.run import sample_count, simulate
from ballbot.validation import Validation, validate
from ballbot.validation.alignment import Alignment, align

#: how long a run on a model is [s]
MODEL_RUN = 30.0
#: a run that stands about the origin lasts so long [s], from a lean of so much [rad]
STANDING, FIRST_LEAN = 60.0, 0.02
#: speed below which the compensated friction's sign becomes a ramp [rad/s]: so small that it is the bare sign
SIGN = 1e-6
#: the swing of Appendix III: its length [s], the film's rate [1/s], first angle [rad], the tracking's error [rad], and
#: the pivot's friction [N m s/rad, N m]; the thesis says nothing of any of them
SWING, FILM_RATE, SWING_ANGLE, TRACKING_ERROR = 30.0, 30.0, 0.2, 0.003
PIVOT_VISCOUS, PIVOT_DRY = 0.05, 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """Recordings, and the robot identified from them."""

    robot: Robot  #: without friction
    identified: Robot  #: with the friction that the recordings tell
    recordings: Mapping[str, Logs]
    seed: int
    folder: Path  #: for what is made on the way

    @cached_property
    def design(self) -> LqrDesign:
        """The nominal gain."""
        return design_gain(self.robot)

    @cached_property
    def sweeps(self) -> list[Sweep]:
        """The drivelines' sweeps (Figure 3.1)."""
        return sweeps_of(self.robot, self.recordings["driveline_sweep"]["log"])

    @cached_property
    def driveline_fit(self) -> DrivelineFit:
        """Wheel 1's friction, from its sweep (Figure 3.2)."""
        return fit_driveline(self.sweeps[0], bounds=DrivelineBounds(), seed=self.seed, progress=_untold)

    @cached_property
    def ball_movement(self) -> BallMovement:
        """The ball on the clamped wheels, with friction and without (Figure 3.4)."""
        return ball_movement(self.identified)

    @cached_property
    def standing(self) -> dict[str, Log]:
        """Both models about the origin, from a small lean (Figure 3.5)."""
        start = np.zeros(10)
        start[2:4] = FIRST_LEAN
        controller = nominal_controller(self.identified)
        return {
            name: simulate(Model(robot), controller, hold(), duration=STANDING, initial_state=start)
            for name, robot in (("basic", self.robot), ("friction", self.identified))
        }

    @cached_property
    def basic_change(self) -> Log:
        """The model without friction through the change of reference."""
        return self._change(self.robot, "none", None)

    @cached_property
    def changes(self) -> dict[str, Log]:
        """The models through the change of reference, by what they are (Figures 5.1 and 5.3 to 5.6).

        "linear"; "basic", without friction; "none", "full" and "partial" with friction and that compensation, which has
        the controller's ramp in place of a sign; "full_sign" and "partial_sign" with the bare sign.
        """
        runs = {
            "linear": linear_run(self.robot, self.design.gain, CHANGE, duration=MODEL_RUN),
            "basic": self.basic_change,
        }
        for kind in ("none", "full", "partial"):
            runs[kind] = self._change(self.identified, kind, None)
        for kind in ("full", "partial"):
            runs[f"{kind}_sign"] = self._change(self.identified, kind, SIGN)
        return runs

    @cached_property
    def validation(self) -> Validation:
        """The models with and without friction against the log held out (chapter 4)."""
        log = self.recordings["held_out"]["log"].without_truth()
        return validate(self.identified, log, controller=nominal_controller(self.identified), seed=self.seed)

    @cached_property
    def alignment(self) -> Alignment:
        """The three minutes filmed by motion capture (Appendix IV)."""
        logs = self.recordings["drifting"]
        return align(logs["log"].without_truth(), logs["film"])

    @cached_property
    def swing(self) -> SwingFit:
        """The body swinging about where the ball's centre would be, filmed and fitted (Figure III.1)."""
        t = np.arange(round(SWING * FILM_RATE), dtype=np.float64) / FILM_RATE
        angle, rate = np.empty_like(t), np.empty_like(t)
        body = self.robot.body
        inertia = float(body.inertia_about_ball_center()[0, 0])
        stiffness = body.mass * self.robot.gravity * body.center_of_mass / inertia
        follow_pendulum(
            stiffness, PIVOT_VISCOUS / inertia, PIVOT_DRY / inertia, SWING_ANGLE, 0.0, t, 0.005, angle, rate
        )
        # the tracking's error: N(0, TRACKING_ERROR)
        error = TRACKING_ERROR * np.random.default_rng([self.seed, 3]).standard_normal(len(t))
        return fit_swing(swing_of(t, angle + error, kind="angle", source="a film of the hanging body"))

    @cached_property
    def film(self) -> FilmedBall:
        """The ball of the robot held upside down, filmed and followed (Appendix V)."""
        logs = self.recordings["upside_down"]
        return filmed_ball(self.robot, logs, path=self.folder / "ball.mp4", seed=self.seed)

    def _change(self, robot: Robot, compensation: Compensation, speed_band: float | None) -> Log:
        controller = Controller(robot, self.design.gain, compensation=compensation, speed_band=speed_band)
        return simulate(Model(robot), controller, CHANGE, duration=MODEL_RUN)


def linear_run(robot: Robot, gain: NDArray[np.float64], reference: Reference, *, duration: float) -> Log:
    """Return a run of x_dot = A x + B u under u = K (r - x), from rest, sampled and held.

    The linear model is of psi = 0 and knows no other heading, so that the error is not turned.
    """
    linear = Model(robot.replace(friction=Friction.none(robot.wheel_count))).linearize()
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


def _untold(share: float, note: str) -> None:
    """Tell nobody."""
