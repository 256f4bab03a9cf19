"""Margins: against python-control, the law that runs, and loops that just so little more makes unstable."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from ballbot.control.controller import Controller
from ballbot.control.linear import linear_controller, robot_loop
from ballbot.control.margins import HEADINGS, Margins, loop_margins
from ballbot.control.parts import Parts
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.errors import InputError
from ballbot.results import plain
from tests.support.control_examples import alten, four_wheeled


@cache
def controller(name: str) -> Controller:
    if name == "nominal":
        return nominal_controller(alten())
    if name == "four wheels":
        return nominal_controller(four_wheeled(friction=False))
    precise = precise_controller(alten(), compensation="none")
    return precise.with_parts(
        replace(precise.parts, planner=None, feed_forward=None)
    )  # they act on references


@cache
def found(name: str) -> Margins:
    return loop_margins(controller(name))


def largest_difference(chosen: Controller, size: float, rng: np.random.Generator) -> float:
    """Return the largest difference of the compiled law's torques from the linear one's, over the largest torque."""
    law = linear_controller(chosen)
    memory = np.zeros(len(law.A))
    chosen.reset()
    chosen.update(0.0, np.zeros(10), np.zeros(10))  # from now on the observer has rates to compare with
    differences, torques = [0.0], [0.0]
    for _ in range(60):
        x = size * rng.normal(size=10)
        u = chosen.update(0.0, x, np.zeros(10))
        differences.append(np.abs(u - law.C @ memory - law.D @ x).max())
        torques.append(np.abs(u).max())
        memory = law.A @ memory + law.B @ x
    return max(differences) / max(torques)


@given(
    name=st.sampled_from(["nominal", "precise", "four wheels"]),
    notch=st.none() | st.builds(Notch, frequency=st.floats(5.0, 80.0), depth=st.floats(0.0, 0.9)),
    prediction=st.none() | st.builds(DelayPrediction, delay=st.floats(0.001, 0.03) | st.just(0.010)),
    seed=st.integers(0, 99),
)
@settings(max_examples=25)
def test_linear_controller_is_the_law_that_runs(name, notch, prediction, seed):
    base = controller(name)
    chosen = base.with_parts(replace(base.parts, notch=notch, prediction=prediction))
    rng = np.random.default_rng(seed)
    # turning into the heading frame is not linear: the difference shrinks as the size does
    assert largest_difference(chosen, 1e-7, rng) < 3e-6


@pytest.mark.parametrize(("name", "wheel"), [("nominal", 0), ("precise", 1), ("four wheels", 3)])
def test_margins_of_a_wheel_are_those_of_python_control(name, wheel):
    control = pytest.importorskip("control")
    loop, one = robot_loop(controller(name)), found(name).wheels[wheel]
    A, B, C = loop.broken()
    others = [place for place in range(B.shape[1]) if place != wheel]  # they are closed
    closed = A + B[:, others] @ C[others]
    system = control.StateSpace(closed, B[:, [wheel]], -C[[wheel]], 0.0, loop.sample_time)
    omega = np.geomspace(0.3, math.pi / loop.sample_time, 500)
    # by its polynomials it is wrong by factors: ten poles about z = 1
    gains, phases, *_, crossings = control.stability_margins(control.frd(system, omega), returnall=True)[:5]
    gains = np.append(gains, -1.0 / system(-1.0).real)  # at the end of its grid, z = -1, L is real
    # required: 1e-3; it interpolates between the frequencies
    assert one.gain_up == pytest.approx(gains[gains > 1.0].min(initial=np.inf), rel=1e-3)
    assert one.gain_down == pytest.approx(gains[gains < 1.0].max(initial=0.0), rel=1e-3)
    phases = np.abs(np.array(phases))
    assert math.degrees(one.phase) == pytest.approx(phases.min(), rel=1e-3)
    assert one.phase_frequency == pytest.approx(crossings[np.argmin(phases)], rel=1e-2)
    alpha, gain, phase = control.disk_margins(system, omega)
    assert one.disk.alpha == pytest.approx(alpha, rel=1e-3)
    assert 20.0 * math.log10(one.disk.gain[1]) == pytest.approx(gain, rel=1e-3)
    assert math.degrees(one.disk.phase) == pytest.approx(phase, rel=1e-3)


def disk_factors(alpha: float, delta: np.ndarray) -> np.ndarray:
    return (1.0 + 0.5 * alpha * delta) / (1.0 - 0.5 * alpha * delta)


@pytest.mark.parametrize("name", ["nominal", "precise"])
def test_some_factors_on_the_rim_of_the_disk_are_just_unstable(name):
    """For three wheels the bound is exact: factors of that size make 1 + L singular at the frequency stated."""
    disk = found(name).together.disk
    (L,) = robot_loop(controller(name)).response(np.array([disk.frequency]))

    def smallest(angles: np.ndarray) -> float:
        factors = disk_factors(disk.alpha, np.exp(1j * angles))
        return float(np.linalg.svd(np.eye(3) + L * factors, compute_uv=False)[-1])

    rng = np.random.default_rng(1)
    best = min(minimize(smallest, rng.uniform(-3, 3, 3), method="Nelder-Mead").fun for _ in range(6))
    assert best < 1e-3  # of a matrix whose other singular values are about 1


@pytest.mark.parametrize("name", ["nominal", "precise", "four wheels"])
def test_no_factors_within_the_disk_are_unstable(name):
    A, B, C = robot_loop(controller(name)).broken()
    rng = np.random.default_rng(2)
    size = (400, B.shape[1])
    delta = np.sqrt(rng.uniform(0.5, 1.0, size)) * np.exp(1j * rng.uniform(-math.pi, math.pi, size))
    for one, marked in ((found(name).together, 1.0), (found(name).wheels[0], np.eye(B.shape[1])[0])):
        factors = 1.0 + marked * (disk_factors(0.999 * one.disk.alpha, delta) - 1.0)
        assert np.abs(np.linalg.eigvals(A + (B * factors[:, None, :]) @ C)).max() < 1.0


def test_wheels_of_a_symmetric_robot_share_a_row():
    rows = found("nominal").rows()
    assert [row[0] for row in rows] == ["each wheel", "all wheels"]
    assert all(len(row) == len(HEADINGS) for row in rows)
    assert [row[0] for row in found("four wheels").rows()] == ["u1", "u2", "u3", "u4", "all wheels"]


def test_margins_are_results():
    written = plain(found("nominal").to_dict())
    assert isinstance(written, dict)
    assert list(written["wheels"]) == ["u1", "u2", "u3"]
    gain = found("nominal").together.disk.gain
    assert written["together"]["disk"]["gain"][0] == pytest.approx(1.0 / gain[1])


def test_unstable_loop_is_refused():
    nominal = controller("nominal")
    with pytest.raises(
        InputError, match=r"The loop of this controller is unstable: an error grows by 0.86 % in each sample"
    ):
        loop_margins(nominal.with_parts(Parts(notch=Notch(frequency=0.5, width=5.0, depth=0.0))))
