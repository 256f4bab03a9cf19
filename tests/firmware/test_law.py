"""The control law in C: the numbers of Python's law, without undefined behaviour."""

import ctypes
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ballbot.control.law import ALLOWED, LAW, MEMORY, control_law
from ballbot.control.records import converted
from ballbot.firmware.build import compile_sources, compilers, weights_folder
from ballbot.firmware.header import SOURCES
from tests.support import law_comparison
from tests.support.compiled_estimators import DOUBLE
from tests.support.compiled_firmware import Library, library, library_of, weights_of
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled, with_policy
from tests.support.friction_law_examples import robot_by_law
from tests.support.law_comparison import TOLERANCE, compare, updates

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

CONTROLLERS = law_comparison.controllers()
LAW_SOURCES = [SOURCES / "law.c", SOURCES / "attitude.c", *sorted((SOURCES / "parts").glob("*.c"))]


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


@pytest.mark.parametrize(
    "make",
    [
        lambda: everything(alten(FRICTION)),
        lambda: everything(robot_by_law()),
        lambda: with_policy(everything(four_wheeled(friction=True)), feedback=0.6, units=24),
        CONTROLLERS["policy alone, 3 wheels"],
    ],
    ids=["everything", "registered friction law", "four wheels, with a policy", "policy alone"],
)
def test_law_in_double_precision_is_python_s_law(make):
    """Torques and memories of many updates in a row agree to rounding: nothing but precision sets the two apart."""
    controller = make()
    compiled = double_library(weights_of(controller))
    memory, of_python = (np.zeros(1, MEMORY.dtype()) for _ in range(2))
    torques, exact = np.zeros((1, len(controller.gain))), np.zeros(len(controller.gain))
    for update, _ in updates(controller, library_of(controller), lanes=1, count=250, seed=4):
        if not update.memory.tobytes().strip(b"\0"):  # another run
            memory[:] = of_python[:] = np.zeros(1, MEMORY.dtype())
        state, reference = update.state.astype(np.float64), update.reference.astype(np.float64)
        compiled.control_law(controller.record, memory, state, reference, torques)
        memory_of_python = of_python.view(np.float64)
        control_law(controller.packed, memory_of_python, state[0], reference[0], exact, plans=True)
        # 1e-9: the shaping's fourth derivative multiplies the rounding of places of 10 m by w^4
        np.testing.assert_allclose(torques[0], exact, rtol=0, atol=1e-9 * controller.torque_limit)
        for part in MEMORY.fields:
            if part != "prediction":  # it has nothing to remember, and works in other steps
                found, wanted = (np.frombuffer(one[part].tobytes()) for one in (memory, of_python))
                np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9, err_msg=part)


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
