"""What is recorded on the nominal twin, and kept in a folder so that the command goes on where it was stopped.

Two rounds: the logs from which friction is identified and on which it is validated, and then, with that friction, the
compensated runs. Each recording is a function of the robot and the seed, so that it can be made in a process of its
own. Recordings from which a result is taken are made several times, each with a seed of its own.

All that balances runs on a grid, so that equal seeds give equal runs on every machine. The loop is chaotic: a rolling
friction larger by one part in 10^12 moves a peak error by centimetres within a minute, and so does another processor's
last digit. Rounding the state at every sample takes such differences away before they grow: the difference of two
machines within one sample, some 1e-9 at most, is far below the grid, so that both round to the same numbers and go on
alike. The grid itself is far below the sensors' and the motors' noise.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

import ballbot
from ballbot.control.controller import Compensation
from ballbot.control.presets import nominal_controller
from ballbot.control.references import Reference, change_pose, figure_eight, square
from ballbot.errors import InputError
from ballbot.files import read_sealed, write_sealed
from ballbot.fitting.sweep import ALL_CORES, RunFolder, identity
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.progress import ProgressCallback
from ballbot.robot import Robot
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement
from ballbot.simulation.run import simulate
from ballbot.thesis.reproduce.item import LONG_RUNS, RUNS, run_seed
from ballbot.twin import Scenario, Twin
from ballbot.twin.recording import MotionCapture, record_bench

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
        twin.engine.model.opt.tolerance = _TOLERANCE

    @property
    def robot(self) -> Robot:
        """The twin's robot."""
        return self._twin.robot

    def reset(self, initial_state: ArrayLike | None, *, seed: int) -> Measurement:
        """Start again; see `Twin.reset`."""
        measured = self._twin.reset(initial_state, seed=seed)
        self._round()
        return measured

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration; see `Twin.step`."""
        measured = self._twin.step(np.round(np.asarray(torques, np.float64), _TORQUE), duration)
        self._round()
        return measured

    def _round(self) -> None:
        engine = self._twin.engine
        for values, decimals in (
            (engine.qpos, _POSITION),
            (engine.qvel, _SPEED),
            (engine.data.qacc_warmstart, _WARM_START),
        ):
            np.round(values, decimals, out=values)


class ModelOnGrid(ModelPlant):
    """A `ModelPlant` whose state and torques are rounded at every sample."""

    def __init__(self, model: Model) -> None:
        super().__init__(model)

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration; see `ModelPlant.step`."""
        measured = super().step(np.round(np.asarray(torques, np.float64), _TORQUE), duration)
        self._state = np.round(self._state, _STATE)
        return measured


Logs = dict[str, Log]

#: the thesis's change of reference: from the origin to [1 m, -1 m, pi] at t = 3 s, in a step
CHANGE: Reference = change_pose(x=1.0, y=-1.0, psi=float(np.pi), at=3.0, ramp=0.0)
#: the packages that a recording depends on
_MADE_BY = ("robot", "mechanics", "log", "control", "estimation", "simulation", "twin")
#: how long a run through the change lasts [s]
CHANGE_RUN = 48.0
#: from when on a run counts as arrived [s]: the linear model is within 5 mm from 14.4 s on, and the model with friction
#: and compensation, slowed by the sample and by the remaining friction, has ended its approach at 24 s
ARRIVED = 25.0
#: of the ball on the wheels of the robot upside down [s]: friction is identified from all of it; the
#: video shows its beginning
UPSIDE_DOWN, VIDEO_LENGTH = 60.0, 8.0


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Something to record."""

    name: str
    make: Callable[[Robot, int], Logs]  #: of the robot, whose friction is compensated, and the seed


def driveline_sweep(robot: Robot, seed: int) -> Logs:
    """Record two periods of the thesis's sweep, the wheels in the air."""
    run = record_bench(robot, Scenario.nominal(robot), "driveline_sweep", duration=125.66, seed=seed)
    return {"log": run.logs["log"]}


def fit_square(robot: Robot, seed: int) -> Logs:
    """Record the first of two logs that friction is identified from."""
    return {"log": balance(robot, square(), duration=48.0, seed=run_seed(seed, 101))}


def fit_eight(robot: Robot, seed: int) -> Logs:
    """Record the second."""
    return {"log": balance(robot, figure_eight(), duration=48.0, seed=run_seed(seed, 102))}


def drifting(robot: Robot, seed: int, *, number: int) -> Logs:
    """Record three minutes around a square, recorded by motion capture (Appendix IV)."""
    own = run_seed(seed, 200 + number)
    log = balance(robot, square(), duration=180.0, seed=own)
    mocap = MotionCapture.drawn(own).record(log.truth(), ball_radius=robot.ball.radius)
    return {"log": log, "mocap": mocap}


def change(robot: Robot, seed: int, *, number: int, compensation: Compensation) -> Logs:
    """Record the change of reference (Figures 4.1 to 4.3, 5.7 and 5.8); both compensations of a number share noise."""
    own = run_seed(seed, 300 + number)
    return {"log": balance(robot, CHANGE, duration=CHANGE_RUN, seed=own, compensation=compensation)}


def upside_down(robot: Robot, seed: int) -> Logs:
    """Record the ball on the wheels of the robot held upside down (section 3.2, Appendix V)."""
    return dict(
        record_bench(robot, Scenario.nominal(robot), "upside_down", duration=UPSIDE_DOWN, seed=seed).logs
    )


def _changes(name: str, compensation: Compensation) -> tuple[Recording, ...]:
    return tuple(
        Recording(
            name=f"{name}_{k}",
            make=partial(change, number=k, compensation=compensation),
        )
        for k in range(RUNS)
    )


FIRST = (
    *(Recording(name=f"drifting_{k}", make=partial(drifting, number=k)) for k in range(LONG_RUNS)),
    Recording(name="fit_square", make=fit_square),
    Recording(name="fit_eight", make=fit_eight),
    *_changes("without_compensation", "none"),
    Recording(name="upside_down", make=upside_down),
    Recording(name="driveline_sweep", make=driveline_sweep),
)
SECOND = _changes("with_compensation", "full")


class Recorded(Mapping[str, Logs]):
    """The logs of recordings by name. Those of one kind are made together, when one of them is first asked for.

    Parameters
    ----------
    make : callable
        Returns the logs of some recordings by name.
    """

    def __init__(self, make: Callable[[tuple[Recording, ...]], dict[str, Logs]]) -> None:
        self._make = make
        self._logs: dict[str, Logs] = {}

    def make(self, recordings: tuple[Recording, ...]) -> None:
        """Make some recordings at once."""
        self._logs |= self._make(tuple(one for one in recordings if one.name not in self._logs))

    def __getitem__(self, name: str) -> Logs:
        """Return the logs of a recording."""
        if name not in self._logs:
            kind = name.rstrip("0123456789")
            for round_ in (FIRST, SECOND):
                self.make(tuple(one for one in round_ if one.name.rstrip("0123456789") == kind))
        return self._logs[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(one.name for one in (*FIRST, *SECOND))

    def __len__(self) -> int:
        """Return how many recordings there are."""
        return len(FIRST) + len(SECOND)


def record_all(
    recordings: tuple[Recording, ...], robot: Robot, *, seed: int, folder: Path, progress: ProgressCallback
) -> dict[str, Logs]:
    """Return the logs of each recording by name, from the folder where it has them, else made on all cores.

    Parameters
    ----------
    recordings : tuple of Recording
    robot : Robot
        Its friction is what is compensated.
    seed : int
    folder : Path
        If logs are kept.
    progress : callable
        Called after each recording.
    """
    made_from = identity({"robot": [robot]}, {"seed": seed, "code": sources_of(*_MADE_BY)})
    kept = RunFolder(path=folder, made_from=made_from, write=_write, read=_read)
    found, _ = kept.complete(
        partial(_made, robot, seed),
        {f"{one.name}.npz": one for one in recordings},
        workers=ALL_CORES,
        stage="recording the twin",
        progress=progress,
    )
    return {name.removesuffix(".npz"): logs for name, logs in found.items()}


def _made(robot: Robot, seed: int, one: Recording) -> Logs:
    return one.make(robot, seed)


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


@cache
def sources_of(*packages: str) -> str:
    """Return a digest of the code of some packages, so that what older code made is not taken for theirs."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for package in packages:
        for path in sorted((Path(ballbot.__file__).parent / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _write(path: Path, logs: Mapping[str, Log]) -> None:
    buffer = io.BytesIO()
    columns = {f"{name}/{column}": log[column] for name, log in logs.items() for column in log}
    np.savez(buffer, **columns)  # pyright: ignore[reportArgumentType]
    write_sealed(path, buffer.getvalue())


def _read(path: Path) -> Logs | None:
    """Return the logs of a file, or None if the file is missing, damaged or edited: they are then made again."""
    try:
        with np.load(io.BytesIO(read_sealed(path))) as kept:
            names = dict.fromkeys(key.partition("/")[0] for key in kept)
            return {
                name: Log({key.partition("/")[2]: kept[key] for key in kept if key.startswith(f"{name}/")})
                for name in names
            }
    except (InputError, EOFError, ValueError, BadZipFile):  # the last three as NumPy has it
        return None
