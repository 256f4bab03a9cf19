"""The firmware's control law in single precision against the float64 law of Python, single updates from equal states.

Lanes run side by side. In each, a robot moves at random, far from what a controller would let it do, and its reference
moves on and jumps; with feed-forward some are plans, with leans and rates. Before each update both laws get the same
memory, state and reference, all in numbers that single precision has. Python has the controller's numbers in double
precision, the C code has them rounded.

A torque may differ by more than `TOLERANCE` only where the law switches: a wheel's partial compensation with the sign
of its torque or of the work against rolling friction, and a plan's switches with the reference's speed.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot import Controller, Robot
from ballbot.control.law import LAW, MEMORY, MEMORY_SIZE, control_law
from ballbot.control.parts import KINDS, Parts
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.records import converted
from ballbot.twin import Scenario
from tests.support.compiled_firmware import Library, library_of
from tests.support.control_examples import everything, four_wheeled, with_policy

#: largest difference of a torque, over the torque limit
TOLERANCE = 1e-5
#: half ranges of a new state: 10 m, 10 rad, leans of 17 degrees, and rates of a robot that is about to fall
_STATE = np.array([10.0, 10.0, 0.3, 0.3, 10.0, 1.0, 1.0, 2.0, 2.0, 2.0])
#: standard deviations of the rates' changes in an update: accelerations of 4 m/s^2 and 10 rad/s^2
_CHANGE = np.array([0.02, 0.02, 0.05, 0.05, 0.05])
#: lanes side by side
LANES = 500
#: chance of a new state, and of a jump of the reference, in an update
_JUMP = 0.02
#: chances that a reference that jumps becomes a plan, and that its next row does not come; places that only plans have
_PLAN, _LOST, _MOVING = 0.25, 0.8, [2, 3, *range(5, 10)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Update:
    """One update of every lane, before the laws are evaluated; numbers of single precision."""

    memory: NDArray[np.void]  #: (lanes,) of `MEMORY`
    state: NDArray[np.float32]  #: (lanes, 10)
    reference: NDArray[np.float32]  #: (lanes, 10)


def updates(
    controller: Controller, compiled: Library, *, lanes: int, count: int, seed: int
) -> Iterator[tuple[Update, NDArray[np.float32]]]:
    """Return updates one after the other, each with the torques (lanes, n) of the C law, whose memory goes on."""
    random = np.random.default_rng(seed)
    law = converted(controller.record, LAW)
    memory = np.zeros(lanes, MEMORY.dtype("single"))
    state, reference = _new_states(random, lanes), np.zeros((lanes, 10))
    reference[:, [0, 1, 4]] = state[:, [0, 1, 4]]
    speed, planned = np.zeros((lanes, 3)), np.zeros(lanes, bool)
    for _ in range(count):
        state[:, 5:] += random.normal(size=(lanes, 5)) * _CHANGE
        state[:, :5] += controller.sample_time * state[:, 5:]
        new = random.uniform(size=lanes) < _JUMP
        state[new] = _new_states(random, int(new.sum()))
        memory[new] = np.zeros((), memory.dtype)  # another run
        jumps = random.uniform(size=lanes) < _JUMP
        speed[jumps] = random.uniform(-2.2, 2.2, (int(jumps.sum()), 3))  # the planner follows up to 2 m/s
        offsets = np.where(random.uniform(size=lanes) < 0.5, 0.05, 1.0)[:, None]
        pose = state[:, [0, 1, 4]] + offsets * random.uniform(-1.0, 1.0, (lanes, 3))
        last = reference.copy()
        reference[:, [0, 1, 4]] += controller.sample_time * speed
        reference[np.ix_(new | jumps, [0, 1, 4])] = pose[new | jumps]
        if controller.follows_plans:
            lost = planned & ~(new | jumps) & (random.uniform(size=lanes) < _LOST)
            begun = jumps & (random.uniform(size=lanes) < _PLAN)
            planned = (planned & ~(new | jumps)) | begun
            reference[:, 5:] += random.normal(size=(lanes, 5)) * _CHANGE
            reference[:, 2:4] += controller.sample_time * reference[:, 7:9]
            reference[np.ix_(begun, _MOVING)] = _new_states(random, int(begun.sum()))[:, _MOVING]
            reference[np.ix_(~planned, _MOVING)] = 0.0
            reference[lost] = last[lost]
        update = Update(
            memory=memory.copy(), state=state.astype(np.float32), reference=reference.astype(np.float32)
        )
        torques = np.zeros((lanes, len(controller.gain)), dtype=np.float32)
        compiled.control_law(law, memory, update.state, update.reference, torques)
        yield update, torques


def _new_states(random: np.random.Generator, lanes: int) -> NDArray[np.float64]:
    """Return states (lanes, 10), a third of them near rest."""
    sizes = np.where(random.uniform(size=lanes) < 1.0 / 3.0, 0.01, 1.0)[:, None]
    states = random.uniform(-1.0, 1.0, (lanes, 10)) * _STATE
    states[:, 2:4] *= sizes
    states[:, 5:] *= sizes
    return states


def python_torques(controller: Controller, update: Update) -> NDArray[np.float64]:
    """Return the torques (lanes, n) of an update by the law of Python."""
    memory = update.memory.astype(MEMORY.dtype())
    rows = memory.view(np.float64).reshape(-1, MEMORY_SIZE)
    states, references = update.state.astype(np.float64), update.reference.astype(np.float64)
    torques = np.zeros((len(rows), len(controller.gain)))
    for row, state, reference, answer in zip(rows, states, references, torques, strict=True):
        control_law(controller.packed, row, state, reference, answer, plans=controller.follows_plans)
    return torques


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The differences of torques over the torque limit."""

    states: int
    worst: float  #: of the updates within `TOLERANCE`
    beyond: int  #: updates beyond it


def compare(controller: Controller, *, lanes: int, count: int, seed: int) -> Comparison:
    """Return how the C law's torques differ from those of Python over so many updates of so many lanes."""
    worst, beyond = 0.0, 0
    for update, torques in updates(controller, library_of(controller), lanes=lanes, count=count, seed=seed):
        exact = python_torques(controller, update)
        differences = np.abs(torques - exact).max(axis=1) / controller.torque_limit
        within = differences <= TOLERANCE
        worst = max(worst, float(differences[within].max(initial=0.0)))
        beyond += int((~within).sum())
    return Comparison(states=lanes * count, worst=worst, beyond=beyond)


def controllers() -> dict[str, Callable[[], Controller]]:
    """Return functions that design the presets and every part on and off, for three and four wheels, by name."""
    alten = Robot.load("alten").replace(friction=Scenario.nominal(Robot.load("alten")).friction)
    by_name: dict[str, Callable[[], Controller]] = {}
    for robot, wheels in ((alten, "3 wheels"), (four_wheeled(friction=True), "4 wheels")):
        for compensation in ("none", "full", "partial"):
            by_name[f"nominal, {compensation}, {wheels}"] = partial(
                nominal_controller, robot, compensation=compensation
            )
        by_name[f"precise, {wheels}"] = partial(precise_controller, robot)
        by_name[f"every part, {wheels}"] = partial(everything, robot)
        directed = replace(
            robot.friction,
            coulomb_asymmetry=(0.02,) * robot.wheel_count,
            stribeck_asymmetry=(-0.01,) * robot.wheel_count,
            load=(0.05,) * robot.wheel_count,
        )
        by_name[f"every part, directed friction, {wheels}"] = partial(
            everything, robot.replace(friction=directed)
        )
        by_name[f"policy alone, {wheels}"] = partial(_learned, partial(precise_controller, robot))
        by_name[f"policy beside every part, {wheels}"] = partial(
            _learned, partial(everything, robot), feedback=0.6
        )
    for name in [name for name in KINDS if name != "policy"]:
        by_name[f"without {name}"] = partial(_without, alten, name)
        by_name[f"{name} alone"] = partial(_alone, alten, name)
    return by_name


def _learned(design: Callable[[], Controller], *, feedback: float = 0.0) -> Controller:
    """Return a controller with a policy of random weights."""
    return with_policy(design(), feedback=feedback)


def _without(robot: Robot, name: str) -> Controller:
    """Return the controller of every part without one and without those that need it."""
    whole = everything(robot)
    gone = {name, *(other for other, kind in KINDS.items() if name in kind.needs)}
    return whole.with_parts(replace(whole.parts, **dict.fromkeys(gone)))


def _alone(robot: Robot, name: str) -> Controller:
    """Return the precise controller with one part and those that it needs."""
    kept = {name, *KINDS[name].needs}
    parts = Parts(**{name: part for name, part in everything(robot).parts.present() if name in kept})
    return precise_controller(robot).with_parts(parts)
