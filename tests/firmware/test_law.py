"""The control law in C: the numbers of Python's law, without undefined behaviour."""

import ctypes
import tempfile
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.gain_set import tunable
from ballbot.control.law import ALLOWED, LAW, LAW_SIZE, MEMORY, control_law
from ballbot.control.references import circle
from ballbot.control.tuning import Setting
from ballbot.firmware.build import compile_sources, compilers, weights_folder
from ballbot.firmware.header import SOURCES
from ballbot.records import Schema, converted
from ballbot.simulation import inputs
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from tests.control.test_gain_set import mixed_numbers
from tests.support import law_comparison
from tests.support.compiled_estimators import DOUBLE
from tests.support.compiled_firmware import Library, library, library_of, weights_of
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled, with_policy
from tests.support.friction_law_examples import robot_by_law
from tests.support.law_comparison import TOLERANCE, compare, updates

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

CONTROLLERS = law_comparison.controllers()
LAW_SOURCES = [
    *(SOURCES / name for name in ("law.c", "decide.c", "estimation/heading.c")),
    *sorted((SOURCES / "parts").glob("*.c")),
]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_single_updates_have_the_torques_of_the_float64_law(name):
    found = compare(CONTROLLERS[name](), lanes=20, count=40, seed=1)
    # worst of a million states: docs/generated/evidence.md
    assert found.worst <= TOLERANCE
    assert found.beyond <= 1


@cache
def double_library(weights: str) -> Library:
    """Return the law in double precision, with a policy's weights."""
    with tempfile.TemporaryDirectory(prefix="ballbot-double-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        target = folder / "double.so"
        flags = ["-O2", "-fPIC", "-shared", "-include", str(DOUBLE), "-Wno-double-promotion", "-lm"]
        flags += [f"-I{folder}" for folder in weights_folder(folder, weights)]
        compile_sources(target, LAW_SOURCES, flags=flags)
        return Library(ctypes.CDLL(str(target)))


def mixing() -> Controller:
    """Return a controller with every part and three gains: whole, and two that are weaker."""
    whole = everything(alten(FRICTION))
    others = []
    for factor in (0.9, 0.7):
        other = whole.with_parts(whole.parts)
        for numbers in mixed_numbers(other):
            numbers *= factor
        others.append(other)
    return tunable(whole, others)


def random_setting(random: np.random.Generator) -> Setting:
    weights = tuple(random.dirichlet(np.ones(3)).tolist())
    return Setting(weights=weights, compensation=random.uniform())


EXAMPLES = {
    "everything": lambda: everything(alten(FRICTION)),
    "registered friction law": lambda: everything(robot_by_law()),
    "four wheels, with a policy": lambda: with_policy(
        everything(four_wheeled(friction=True)), feedback=0.6, units=24
    ),
    "policy alone": CONTROLLERS["policy alone, 3 wheels"],
    "three gains": mixing,
}


def assert_same_update(
    compiled: Library,
    law: NDArray[np.float64],
    memory: NDArray[np.void],
    state: NDArray[np.float64],
    reference: NDArray[np.float64],
    n: int,
) -> None:
    """Assert that both laws give a memory (1,) and torques to rounding alike."""
    own, torques, exact = memory.copy(), np.ones((1, n)), np.ones(n)
    numbers = law[:LAW_SIZE].view(LAW.dtype())
    compiled.control_law(numbers, own, state[None], reference[None], torques)
    plans = bool(numbers["feed_forward"]["on"][0])
    control_law(law, memory.view(np.float64), state, reference, exact, plans=plans)
    # 1e-9: the heading's fourth derivative multiplies the rounding of places of 10 m by w^4
    limit = 1e-9 * max(1.0, float(numbers["torque_limit"][0]))
    np.testing.assert_allclose(torques[0], exact, rtol=0, atol=limit)
    for part in MEMORY.fields:
        if part != "prediction":  # it has nothing to remember, and works in other steps
            found, wanted = (np.frombuffer(one[part].tobytes()) for one in (own, memory))
            np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9, err_msg=part)


#: speeds increase; x, y and psi have no effect on a state's other numbers; and the fourth derivative of lags that are
#: apart is beyond double precision
UNFUZZED = ("table_speeds", "transition", "lags", "turned")


def fuzzed(record: NDArray[np.void], schema: Schema, random: np.random.Generator) -> NDArray[np.void]:
    """Return a record with numbers up to a third smaller or larger, and without some parts."""
    changed = record.copy()
    if "on" in schema.fields and random.uniform() < 0.1:
        return np.zeros_like(record)
    for name, field in schema.fields.items():
        if isinstance(field, Schema):
            changed[name] = fuzzed(changed[name], field, random)
        elif not field.whole and name not in UNFUZZED:
            changed[name] *= random.uniform(0.7, 1.4, changed[name].shape) ** (random.uniform() < 0.3)
    return changed


@pytest.mark.parametrize("name", EXAMPLES)
def test_law_in_double_precision_is_python_s_law(name):
    """From equal memories both give the same, whatever numbers, memory and state are: only precision sets them apart.

    Robots move at random, far beyond the limits, begin again and lose their state; gains and compensation change.
    """
    controller, random = EXAMPLES[name](), np.random.default_rng(4)
    compiled, n = double_library(weights_of(controller)), len(controller.gain)
    for update, _ in updates(controller, library_of(controller), lanes=4, count=80, seed=4):
        memories = update.memory.astype(MEMORY.dtype())
        for lane in range(4):
            law, memory, state = (
                controller.packed.copy(),
                memories[lane : lane + 1],
                update.state[lane].astype(float),
            )
            if lane > 1:
                numbers = fuzzed(controller.record, LAW, random)
                law[:LAW_SIZE] = numbers.view(np.float64)
                memory = fuzzed(memory, MEMORY, random)
            if lane % 2:
                memory["tuning"]["wanted"] = random_setting(random).numbers()
            if random.uniform() < 0.05:
                state[random.integers(10)] = random.choice([np.nan, np.inf, -2e6])
            assert_same_update(compiled, law, memory, state, update.reference[lane].astype(float), n)


@pytest.mark.parametrize("name", ["everything", "four wheels, with a policy"])
def test_robots_move_alike_by_either_law(name, monkeypatch):
    """64 robots over 4 s, some of which start beyond what they recover from, and all blind for a while."""
    controller = EXAMPLES[name]()
    states = np.random.default_rng(6).normal(size=(64, 10)) * (0.1, 0.1, 0.05, 0.05, 0.3, *(0.1,) * 5)
    states[::16, 2] = 0.6
    blind = Imperfections(missing=2, missing_from=200)
    run = partial(simulate_batch, controller.robot, controller, circle(radius=0.3, period=4.0), duration=4.0,
                  initial_states=states, imperfections=blind)  # fmt: skip
    exact = run()
    code = double_library(weights_of(controller)).functions.ballbot_control_law
    monkeypatch.setattr(inputs, "law_code", lambda: ctypes.cast(code, ctypes.c_void_p).value)
    found = run()
    # rounding, which a robot that does not recover makes larger; 3e-12 measured
    np.testing.assert_allclose(found.states, exact.states, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.torques, exact.torques, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("place", "value"), [(2, 0.1), (9, -1e-30), (0, np.nan), (4, np.inf), (1, 2e6), (6, np.nan), (None, np.nan),
                         (None, -np.inf), (None, 1.1e6)],
)  # fmt: skip
def test_wrong_reference_or_state_gives_no_torque_and_leaves_the_memory(place, value):
    """A reference is wrong in one place, or the states of ten robots each in another one."""
    leans_or_moves = value in (0.1, -1e-30)  # which feed-forward follows
    controller = CONTROLLERS["nominal, full, 3 wheels"]() if leans_or_moves else everything(alten(FRICTION))
    for update, _ in updates(controller, library(), lanes=10, count=3, seed=5):
        memory, state, reference = update.memory.copy(), update.state.copy(), update.reference.copy()
        if place is None:
            state[np.arange(10), np.arange(10)] = value
        else:
            reference[:, place] = value
        torques = np.ones((10, 3), dtype=np.float32)
        found = library().control_law(converted(controller.record, LAW), memory, state, reference, torques)
        assert (found == (ALLOWED if place is None else place)).all()
        assert not torques.any()
        assert memory.tobytes() == update.memory.tobytes()
