"""Robots with faults that a study did not know: twins drawn at random, each with the logs of two controllers.

The study is of the nominal twin (`studied`). Each faulty twin differs from it by one fault of `KINDS`, mild to severe,
and in half of the cases by a second, mild one. Logs and the study are kept in build/controller_prediction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ballbot.control.controller import Controller
from ballbot.estimation import named_estimator
from ballbot.identification import Identification
from ballbot.log import Log
from ballbot.robot import Friction, Robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.simulation.imperfections import Roughness, Supply
from ballbot.simulation.plant import Measurement, Plant
from ballbot.simulation.run import simulate
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Compliance, CurrentLoop, LoadDependence, Payload, Softness, Timing
from ballbot.workflows.controller_choice import (
    SQUARE,
    ControllerChoice,
    candidates,
    choose_controller,
    draw_plants,
)
from campaigns.section import finished, kept
from campaigns.twin_logs import NOMINAL, ROBOT, identified

#: the folder of what is finished, within build
KEPT = "controller_prediction"
SAMPLE_TIME = 0.005
#: of the study
DRAWS, SEED = 20, 100
#: share of severe faults
SEVERE = 0.25
CONTROLLERS = ("precise", "none")


@dataclass(frozen=True, kw_only=True)
class FaultyTwin:
    """A robot that is not the one studied."""

    seed: int  #: of its run
    kind: str  #: of its main fault, one of `KINDS`
    robot: Robot = ROBOT
    scenario: Scenario = NOMINAL
    torque_scale: tuple[float, ...] = (1.0, 1.0, 1.0)  #: what the motors give of the torques commanded


def asymmetric(friction: Friction, fraction: float) -> Friction:
    """Return friction whose dry terms are (1 + fraction) times as large forward, (1 - fraction) times backward."""
    return replace(
        friction,
        coulomb_asymmetry=tuple(fraction * c for c in friction.coulomb),
        stribeck_asymmetry=tuple(fraction * s for s in friction.stribeck),
    )


#: kinds of faults in the order in which they take turns
KINDS = (
    *(
        "delay",
        "other friction",
        "grip",
        "gyro bias",
        "torque scale",
        "mass and height",
        "asymmetric friction",
    ),
    *(
        "lean error",
        "late sensors",
        "payload",
        "tilted floor",
        "carpet",
        "sensor noise",
        "slow current",
        "wheels",
    ),
    *("load-dependent friction", "soft ball", "compliance", "supply sag"),
)


def with_fault(twin: FaultyTwin, kind: str, random: np.random.Generator, size: float) -> FaultyTwin:
    """Return a twin with a fault more, of a size: 1 is what a robot still has in use."""
    if kind == "mass and height":
        mass, height = 1.0 + 0.15 * size * random.choice([-1.0, 1.0], 2)
        body = scaled_body(twin.robot.body, mass=mass, height=height)
        return replace(twin, robot=twin.robot.replace(body=body))
    if kind == "torque scale":
        factor = float(random.choice([max(1.0 - 0.5 * size, 0.2), 1.0 + 0.6 * size]))
        scale = [factor] * 3
        if random.random() < 0.5:
            scale = [1.0] * 3
            scale[random.integers(3)] = factor
        return replace(twin, torque_scale=tuple(scale))
    return replace(twin, scenario=replace(twin.scenario, **_changes(twin.scenario, kind, random, size)))


def _changes(s: Scenario, kind: str, random: np.random.Generator, size: float) -> dict[str, Any]:
    """Return the fields of a scenario that a fault changes."""
    friction, sensors, rollers = s.friction, s.sensors, s.rollers
    match kind:
        case "delay":
            return {"timing": Timing(delay=max(1, round(4.0 * size)))}
        case "other friction":
            factor = random.choice([max(1.0 - 0.4 * size, 0.1), 1.0 + 0.6 * size])
            return {"friction": scaled_friction(friction, factor)}
        case "grip":
            return dict.fromkeys(("roller_grip", "floor_grip"), max(0.8 - 0.5 * size, 0.1))
        case "gyro bias":
            return {"sensor_faults": SensorFaults(gyro_bias=0.02 * size, gyro_bias_walk=0.002 * size)}
        case "asymmetric friction":
            return {
                "friction": asymmetric(friction, float(random.choice([-1.0, 1.0]) * min(0.4 * size, 0.9)))
            }
        case "lean error":
            return {"sensor_faults": SensorFaults(lean_error=0.015 * size, lean_error_time=10.0)}
        case "late sensors":
            return {"sensor_faults": SensorFaults(latency=SAMPLE_TIME * max(1, round(3.0 * size)))}
        case "payload":
            return {"payload": Payload(mass=2.0 * size, position=(*_any_way(random, 0.05), 0.6))}
        case "tilted floor":
            return {"floor_tilt": _any_way(random, float(np.radians(size)))}
        case "carpet":
            soft = replace(friction, rolling=friction.rolling * (1.0 + 2.0 * size))
            floor = Roughness(height=2e-4 * size, wavelength=0.1, seed=int(random.integers(1000)))
            return {"friction": soft, "roughness": floor}
        case "sensor noise":
            noise = {
                name: (1.0 + 6.0 * size) * getattr(sensors, name) for name in ("gyro_noise", "attitude_noise")
            }
            return {"sensors": replace(sensors, **noise)}
        case "slow current":
            return {"current_loop": CurrentLoop(bandwidth=max(40.0 - 32.0 * size, 3.0))}
        case "wheels":
            if random.random() < 0.5:
                return {"rollers": replace(rollers, rows=1, per_row=2 * rollers.per_row)}
            wide = rollers.row_spacing + min(size, 1.5) * (0.022 - rollers.row_spacing)
            return {"rollers": replace(rollers, row_spacing=wide)}
        case "load-dependent friction":
            return {"load_dependence": LoadDependence(fraction=min(size, 1.0))}
        case "soft ball":
            return {"softness": Softness(stiffness=3e4 / float(np.clip(size, 0.3, 1.5)), damping=200.0)}
        case "compliance":
            return {"compliance": Compliance(frequency=max(60.0 - 20.0 * size, 20.0), damping_ratio=0.1)}
        case _:
            return {"supply": Supply(internal_resistance=1.5 * size)}


def _any_way(random: np.random.Generator, length: float) -> tuple[float, float]:
    """Return a vector of a length in a random direction."""
    way = random.uniform(0.0, 2.0 * np.pi)
    return length * float(np.cos(way)), length * float(np.sin(way))


def drawn(seed: int) -> FaultyTwin:
    """Return the twin of a seed: kinds take turns.

    A quarter of the main faults is severe, one to three times the size that a robot still has in use; the others are
    a tenth to the whole of that.
    """
    random = np.random.default_rng([seed, 27])
    chance = np.random.default_rng([seed, 28])
    kind = KINDS[seed % len(KINDS)]
    twin = FaultyTwin(seed=seed, kind=kind)
    if random.random() < 0.5:  # a second fault first, so that the main one wins where both set a thing
        second = KINDS[random.integers(len(KINDS))]
        twin = with_fault(twin, second, random, random.uniform(0.05, 0.3))
    size = random.uniform(0.1, 1.0)
    return with_fault(twin, kind, random, chance.uniform(1.0, 3.0) if is_severe(seed) else size)


def is_severe(seed: int) -> bool:
    """Return whether the main fault of a seed's twin is severe."""
    return bool(np.random.default_rng([seed, 29]).random() < SEVERE)


class WeakMotors:
    """A plant whose motors give other torques than they are commanded: a wrong torque constant or gear ratio."""

    def __init__(self, plant: Plant, scale: Sequence[float]) -> None:
        self._plant, self._scale = plant, np.asarray(scale)
        self.robot = plant.robot

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Start as the plant does."""
        return self._plant.reset(initial_state, seed=seed)

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the scaled torques (n,) [N m] for a duration [s]."""
        return self._plant.step(self._scale * np.asarray(torques), duration)


@dataclass(frozen=True, kw_only=True, eq=False)
class Studied:
    """The study of the nominal twin: what it identified, and its candidates on perturbed plants."""

    found: Identification
    controllers: dict[str, Controller]
    choice: ControllerChoice


def studied() -> Studied:
    """Return the study, from file if it is there."""
    return kept(KEPT, "study.pickle", _study)


def _study() -> Studied:
    identification = identified()
    made = candidates(identification, sample_time=SAMPLE_TIME)
    controllers = {name: made[name] for name in CONTROLLERS}
    plants = draw_plants(identification, scenario=Scenario.nominal(ROBOT), count=DRAWS, seed=SEED)
    choice = choose_controller(controllers, plants)
    return Studied(found=identification, controllers=controllers, choice=choice)


def record(study: Studied, twin: FaultyTwin, name: str) -> Log:
    """Return the log that a faulty twin's own sensors make of the square with a controller of the study."""
    controller = study.controllers[name]
    estimator = named_estimator(controller.estimator, study.found.robot, sample_time=SAMPLE_TIME)
    plant = WeakMotors(Twin(twin.robot, twin.scenario, estimator=estimator), twin.torque_scale)
    log = simulate(
        plant, controller, SQUARE.reference_spec.reference(), duration=SQUARE.duration, seed=twin.seed
    )
    return log.without_truth()


def recorded(twins: Sequence[FaultyTwin], *, of: str) -> list[dict[str, Log]]:
    """Return each twin's logs by controller, recorded in processes beside this one if they are not on file.

    Parameters
    ----------
    twins : sequence of FaultyTwin
    of : str
        Name of the folder within `KEPT`.
    """
    studied()  # on file before processes look for it
    runs = {f"{twin.seed:04d}_{name}": (twin, name) for twin in twins for name in CONTROLLERS}
    logs = finished(f"{KEPT}/{of}", _recorded_one, runs)
    return [{name: logs[f"{twin.seed:04d}_{name}"] for name in CONTROLLERS} for twin in twins]


def _recorded_one(run: tuple[FaultyTwin, str]) -> Log:
    return record(studied(), *run)
