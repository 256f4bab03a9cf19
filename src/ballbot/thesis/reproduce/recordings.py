"""What is recorded on the nominal twin.

Recordings from which a result is taken are made several times, each with a seed of its own.

All that balances runs on a grid, so that equal seeds give equal runs on every machine. The loop is chaotic: a rolling
friction larger by one part in 10^12 moves a peak error by centimetres within a minute, and so does another processor's
last digit. Rounding the state at every sample takes such differences away before they grow: the difference of two
machines within one sample, some 1e-9 at most, is far below the grid, so that both round to the same numbers and go on
alike. The grid itself is far below the sensors' and the motors' noise.
"""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ballbot.control.controller import Compensation
from ballbot.control.presets import nominal_controller
from ballbot.control.references import Reference, change_pose, figure_eight, square
from ballbot.fitting.run import ALL_CORES
from ballbot.log import Log
from ballbot.progress import Progress, ProgressCallback
from ballbot.robot import Robot
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement
from ballbot.simulation.run import simulate
from ballbot.thesis.reproduce.item import LONG_RUNS, RUNS, run_seed
from ballbot.twin import Scenario, Twin
from ballbot.twin.recording import Experiment, MotionCapture, record_bench

Logs = dict[str, Log]

#: decimals that are kept of the torques [N m]
_TORQUE = 4
#: of the twin's positions [m, rad], speeds [m/s, rad/s] and of the accelerations that its solver starts from
_POSITION, _SPEED, _WARM_START = 7, 5, 0
#: of the model's state, whose differences within a sample are smaller
_STATE = 7
#: the solver's; with MuJoCo's own, 1e-8, where it stops makes differences of 1e-5 rad/s in a roller
_TOLERANCE = 1e-12


class TwinOnGrid:
    """A `Twin` whose state and torques are rounded at every sample."""

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self.robot = twin.robot
        twin.engine.model.opt.tolerance = _TOLERANCE

    def reset(self, initial_state: ArrayLike | None, *, seed: int) -> Measurement:
        """Start again; see `Twin.reset`."""
        return self._rounded(self._twin.reset(initial_state, seed=seed))

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration; see `Twin.step`."""
        return self._rounded(self._twin.step(np.round(np.asarray(torques, np.float64), _TORQUE), duration))

    def _rounded(self, measured: Measurement) -> Measurement:
        engine = self._twin.engine
        for values, decimals in (
            (engine.qpos, _POSITION),
            (engine.qvel, _SPEED),
            (engine.data.qacc_warmstart, _WARM_START),
        ):
            np.round(values, decimals, out=values)
        return measured


class ModelOnGrid(ModelPlant):
    """A `ModelPlant` whose state and torques are rounded at every sample."""

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration; see `ModelPlant.step`."""
        measured = super().step(np.round(np.asarray(torques, np.float64), _TORQUE), duration)
        self._state = np.round(self._state, _STATE)
        return measured


#: the thesis's change of reference: from the origin to [1 m, -1 m, pi] at t = 3 s, in a step
CHANGE: Reference = change_pose(x=1.0, y=-1.0, psi=float(np.pi), at=3.0, ramp=0.0)
#: how long a run through the change lasts [s]
CHANGE_RUN = 48.0
#: from when on a run counts as arrived [s]: the linear model is within 5 mm from 14.4 s on, and the model with friction
#: and compensation, slowed by the sample and by the remaining friction, has ended its approach at 24 s
ARRIVED = 25.0


def balance(
    robot: Robot, reference: Reference, *, duration: float, seed: int, compensation: Compensation = "none"
) -> Log:
    """Return a run of the nominal twin on a grid under the nominal gain.

    Parameters
    ----------
    robot : Robot
        Its friction is what is compensated.
    reference : callable
    duration : float
        [s]
    seed : int
        Of the run.
    compensation : {"none", "full", "partial"}
    """
    controller = nominal_controller(robot, compensation=compensation)
    plant = TwinOnGrid(Twin(robot, Scenario.nominal(robot)))
    return simulate(plant, controller, reference, duration=duration, initial_state=np.zeros(10), seed=seed)


def _fit(robot: Robot, seed: int, number: int) -> Logs:
    """Record a log that friction is identified from: a square, then an eight."""
    reference = (square, figure_eight)[number]()
    return {"log": balance(robot, reference, duration=48.0, seed=run_seed(seed, 101 + number))}


def _drifting(robot: Robot, seed: int, number: int) -> Logs:
    """Record three minutes around a square, recorded by motion capture (Appendix IV)."""
    seed = run_seed(seed, 200 + number)
    log = balance(robot, square(), duration=180.0, seed=seed)
    return {"log": log, "mocap": MotionCapture.drawn(seed).record(log.truth(), ball_radius=robot.ball.radius)}


def _change(robot: Robot, seed: int, number: int, *, compensation: Compensation) -> Logs:
    """Record the change of reference (Figures 4.1 to 4.3, 5.7 and 5.8); both compensations of a number share noise."""
    seed = run_seed(seed, 300 + number)
    return {"log": balance(robot, CHANGE, duration=CHANGE_RUN, seed=seed, compensation=compensation)}


def _bench(robot: Robot, seed: int, _: int, *, experiment: Experiment, duration: float) -> Logs:
    return dict(record_bench(robot, Scenario.nominal(robot), experiment, duration=duration, seed=seed).logs)


#: how often each kind is recorded, and by what: a function of the robot, whose friction is compensated, the seed and
#: the recording's number, so that each can be made in a process of its own
KINDS: Mapping[str, tuple[int, Callable[[Robot, int, int], Logs]]] = MappingProxyType(
    {
        "fit": (2, _fit),
        "drifting": (LONG_RUNS, _drifting),
        "without_compensation": (RUNS, partial(_change, compensation="none")),
        "with_compensation": (RUNS, partial(_change, compensation="full")),
        # section 3.2 and Appendix V
        "upside_down": (1, partial(_bench, experiment="upside_down", duration=60.0)),
        # two periods of the thesis's sweep, the wheels in the air
        "driveline_sweep": (1, partial(_bench, experiment="driveline_sweep", duration=125.66)),
    }
)


def record(kind: str, robot: Robot, *, seed: int, progress: ProgressCallback) -> list[Logs]:
    """Return the logs of each recording of a kind, made on all cores.

    Parameters
    ----------
    kind : str
        Of `KINDS`.
    robot : Robot
        Its friction is what is compensated.
    seed : int
    progress : callable
        Called after each recording.
    """
    count, make = KINDS[kind]
    stage, made = f"recording the twin, {kind.replace('_', ' ')}", dict[int, Logs]()
    progress(Progress(stage=stage, done=0, total=count))
    for number, logs in ALL_CORES.each(partial(make, robot, seed), range(count)):
        made[number] = logs
        progress(Progress(stage=stage, done=len(made), total=count))
    return [made[number] for number in range(count)]
