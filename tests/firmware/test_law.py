"""The control law in C: the numbers of Python's law, without undefined behaviour."""

import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller, InputError
from ballbot.control.law import ALLOWED, LAW, MEMORY, control_law
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.records import converted
from ballbot.firmware.build import compile_sources, compilers
from ballbot.firmware.header import SOURCES
from campaigns import firmware_numbers
from campaigns.firmware_estimators import DOUBLE
from campaigns.firmware_numbers import TOLERANCE, Update, compare, of_a_branch, python_torques, updates
from tests.support.compiled_firmware import Library, library
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled
from tests.support.friction_law_examples import robot_by_law

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

CONTROLLERS = firmware_numbers.controllers()
HERE = Path(__file__).parent
LAW_SOURCES = [SOURCES / "law.c", SOURCES / "attitude.c", *sorted((SOURCES / "parts").glob("*.c"))]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_single_updates_have_the_torques_of_the_float64_law(name):
    found = compare(CONTROLLERS[name](), lanes=20, count=40, seed=1)
    # worst of a million states: docs/generated/evidence.md
    assert found.worst <= TOLERANCE
    assert found.unexplained == 0
    assert found.switching <= 1


def at_threshold(controller: Controller, update: Update) -> Update:
    """Return an update whose leans leave no torque for the first wheel, but for rounding."""
    bare = Controller(controller.robot, controller.gain, torque_limit=1e9)
    state = update.state.astype(np.float64)
    for row, reference in zip(state, update.reference, strict=True):
        torque, slope = (bare.update(0.0, one, reference)[0] for one in (row, row + 1e-3 * np.eye(10)[3]))
        row[3] -= 1e-3 * torque / (slope - torque)
    return Update(memory=update.memory, state=state.astype(np.float32), reference=update.reference)


def test_torque_at_a_threshold_is_that_of_a_branch():
    controller = nominal_controller(alten(FRICTION), compensation="partial")
    (update, _), *_ = updates(controller, library(), lanes=300, count=1, seed=2)
    update = at_threshold(controller, update)
    torques = np.zeros((300, 3), dtype=np.float32)
    library().control_law(
        converted(controller.record, LAW), update.memory.copy(), update.state, update.reference, torques
    )
    exact, _ = python_torques(controller, update)
    other = np.abs(torques - exact).max(axis=1) > TOLERANCE * controller.torque_limit
    assert other.sum() > 10  # the friction jumps by several percent of the limit
    assert of_a_branch(controller, update, torques).all()
    wrong = torques + np.float32(3.0 * TOLERANCE * controller.torque_limit) * (np.abs(torques) < 5.9)
    assert not of_a_branch(controller, update, wrong)[other].any()


def test_reference_at_the_limit_of_speed_gives_the_torque_of_a_branch():
    controller = precise_controller(alten(FRICTION))
    random = np.random.default_rng(3)
    memory, state = np.zeros(200, MEMORY.dtype("single")), np.zeros((200, 10), dtype=np.float32)
    law, torques = converted(controller.record, LAW), np.zeros((200, 3), dtype=np.float32)
    library().control_law(law, memory, state, state, torques)
    angle, length = random.uniform(0.0, 6.3, 200), 0.0025 * (1.0 + random.uniform(-1e-7, 1e-7, 200))
    reference = state.copy()
    reference[:, 0], reference[:, 1] = length * np.cos(angle), length * np.sin(angle)
    update = Update(memory=memory.copy(), state=state, reference=reference)
    library().control_law(law, memory, state, reference, torques)
    exact, _ = python_torques(controller, update)
    other = np.abs(torques - exact).max(axis=1) > TOLERANCE * controller.torque_limit
    assert other.any()
    assert of_a_branch(controller, update, torques).all()


@cache
def double_library(folder: Path) -> Library:
    """Return the law in double precision."""
    target = folder / "double.so"
    flags = ("-O2", "-fPIC", "-shared", "-include", str(DOUBLE), "-Wno-double-promotion", "-lm")
    compile_sources(target, LAW_SOURCES, flags=flags)
    return Library.open(target)


@pytest.mark.parametrize("name", ["everything", "four wheels", "registered friction law"])
def test_law_in_double_precision_is_python_s_law(name, tmp_path_factory):
    """Torques and memories of many updates in a row agree to rounding: nothing but precision sets the two apart."""
    controller = {
        "everything": lambda: everything(alten(FRICTION)),
        "four wheels": lambda: everything(four_wheeled(friction=True)),
        "registered friction law": lambda: everything(robot_by_law()),
    }[name]()
    compiled = double_library(tmp_path_factory.getbasetemp())
    memory, of_python = (np.zeros(1, MEMORY.dtype()) for _ in range(2))
    torques, exact = np.zeros((1, len(controller.gain))), np.zeros(len(controller.gain))
    for update, _ in updates(controller, library(), lanes=1, count=250, seed=4):
        if not update.memory.tobytes().strip(b"\0"):  # another run
            memory[:] = of_python[:] = np.zeros(1, MEMORY.dtype())
        state, reference = update.state.astype(np.float64), update.reference.astype(np.float64)
        compiled.control_law(controller.record, memory, state, reference, torques)
        control_law(controller.packed, of_python.view(np.float64), state[0], reference[0], exact)
        # 1e-9: the shaping's fourth derivative multiplies the rounding of places of 10 m by w^4
        np.testing.assert_allclose(torques[0], exact, rtol=0, atol=1e-9 * controller.torque_limit)
        for part in MEMORY.fields:
            if part != "prediction":  # it has nothing to remember, and works in other steps
                found, wanted = (np.frombuffer(one[part].tobytes()) for one in (memory, of_python))
                np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9, err_msg=part)


@pytest.mark.parametrize(
    ("place", "value"), [(2, 0.1), (9, -1e-30), (0, np.nan), (4, np.inf), (1, 2e6), (6, np.nan)]
)
def test_reference_that_is_refused_gives_no_torque_and_leaves_the_memory(place, value):
    controller = everything(alten(FRICTION))
    for update, _ in updates(controller, library(), lanes=1, count=3, seed=5):
        memory, reference = update.memory.copy(), update.reference.copy()
        reference[0, place] = value
        torques = np.ones((1, 3), dtype=np.float32)
        law = converted(controller.record, LAW)
        assert library().control_law(law, memory, update.state, reference, torques) == [place]
        assert not torques.any()
        assert memory.tobytes() == update.memory.tobytes()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.1e6])
def test_invalid_state_gives_no_torque_and_leaves_the_memory(value):
    controller = everything(alten(FRICTION))
    for update, _ in updates(controller, library(), lanes=10, count=3, seed=6):
        memory, state = update.memory.copy(), update.state.copy()
        state[np.arange(10), np.arange(10)] = value
        torques = np.ones((10, 3), dtype=np.float32)
        law = converted(controller.record, LAW)
        assert (library().control_law(law, memory, state, update.reference, torques) == ALLOWED).all()
        assert not torques.any()
        assert memory.tobytes() == update.memory.tobytes()


@pytest.mark.board
def test_sanitizers_find_nothing_and_change_no_bit(tmp_path):
    replay = tmp_path / "replay"
    flags = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    try:
        compile_sources(replay, [*LAW_SOURCES, SOURCES / "ballbot_math.c", HERE / "replay.c"], flags=flags)
    except InputError as refusal:
        pytest.skip(f"the compiler has no sanitizers: {str(refusal)[:200]}")
    for controller in (everything(four_wheeled(friction=True)), CONTROLLERS["precise, 3 wheels"]()):
        law, n = converted(controller.record, LAW), len(controller.gain)
        given, wanted = law.tobytes(), b""
        for update, torques in updates(controller, library(), lanes=20, count=30, seed=7):
            memory = update.memory.copy()
            library().control_law(law, memory, update.state, update.reference, torques)
            for k in range(20):
                given += (
                    update.memory[k].tobytes() + update.state[k].tobytes() + update.reference[k].tobytes()
                )
                wanted += torques[k].tobytes() + memory[k].tobytes()
        done = subprocess.run([replay, str(n)], input=given, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr.decode()
        assert done.stdout == wanted
