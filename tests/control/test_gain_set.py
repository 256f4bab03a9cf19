"""Gains that may be mixed: their Lyapunov function against another solver, and changes while a controller runs."""

import clarabel
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from ballbot import Controller, InputError, Robot
from ballbot.control.gain_set import certified, gain_set, growths, tunable
from ballbot.control.presets import NOMINAL_STATE_WEIGHTS, design_gain, nominal_controller, precise_controller
from ballbot.control.presets import PRECISE_STATE_WEIGHTS as STIFF
from ballbot.control.tuning import CHANGE_TIME, Setting
from tests.support.control_examples import FRICTION, alten

ROBOT = Robot.load("alten")


def stiffer(share: float, robot: Robot = ROBOT) -> Controller:
    """Return the nominal controller with weights between its own (0) and those of the precise one (1)."""
    weights = np.array(NOMINAL_STATE_WEIGHTS) ** (1.0 - share) * np.array(STIFF) ** share
    return Controller(robot, design_gain(robot, state_weights=weights.tolist()).gain)


def has_lyapunov(loops: np.ndarray, growth: float) -> bool:
    """Return whether some P > 0 has M^T P M <= growth^2 P for all loops (v, m, m), by clarabel."""
    m = loops.shape[-1]
    rows, columns = np.tril_indices(m)  # clarabel takes the upper triangle by columns
    scale, entries = np.where(rows == columns, 1.0, np.sqrt(2.0)), np.arange(len(rows))
    changes = np.zeros((len(rows), m, m))
    changes[entries, rows, columns] = changes[entries, columns, rows] = 1.0
    # of P - I, and of each loop
    blocks = [changes, *(growth**2 * changes - M.T @ changes @ M for M in loops)]
    A = np.vstack([-(scale * block[:, rows, columns]).T for block in blocks])
    b = np.zeros(len(A))
    b[: len(rows)] = -(rows == columns).astype(float)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    nothing, cones = sparse.csc_matrix((len(rows), len(rows))), [clarabel.PSDTriangleConeT(m)] * len(blocks)
    solver = clarabel.DefaultSolver(nothing, np.zeros(len(rows)), sparse.csc_matrix(A), b, cones, settings)
    status = str(solver.solve().status)
    assert status in ("Solved", "PrimalInfeasible", "AlmostPrimalInfeasible")
    return status == "Solved"


def test_growth_is_the_least_by_another_solver():
    gains = gain_set(tunable(nominal_controller(ROBOT), [stiffer(1.0)]))
    m = len(gains.P)
    U = np.linalg.cholesky(gains.P).T
    loops = U @ gains.loops.reshape(-1, m, m) @ np.linalg.inv(U)  # of a size that solvers like
    # 1.00096; closer than this, clarabel ends with a numerical error
    assert has_lyapunov(loops, gains.growth + 2e-5)
    assert not has_lyapunov(loops, 0.9999)


def test_loops_shrink_under_fast_changes_of_certified_gains():
    gains = certified(tunable(nominal_controller(ROBOT), [stiffer(0.3), stiffer(0.5)]))
    random, m = np.random.default_rng(1), len(gains.P)
    weights = random.dirichlet(np.full(3, 0.3), 2000)
    robots = random.integers(0, len(gains.loops), 2000)
    z = np.linalg.solve(np.linalg.cholesky(gains.P).T, random.standard_normal(m))
    sizes = []
    for w, r in zip(weights, robots, strict=True):
        z = np.einsum("k,kij->ij", w, gains.loops[r]) @ z
        sizes.append(np.sqrt(z @ gains.P @ z))
    # 1e-9: rounding of P, whose eigenvalues span eight decades
    assert (np.diff(np.log(sizes)) <= np.log(gains.growth) + 1e-9).all()
    assert growths(gains.loops.reshape(-1, m, m), gains.P).max() < 1.0


def test_drawn_robots_join_the_loops():
    weighed = ROBOT.annotated(standard_deviations={"body.mass": 0.2})
    assert len(gain_set(tunable(stiffer(0.0, weighed), [stiffer(0.1, weighed)])).loops) == 30


def test_gains_too_far_apart_are_refused_with_what_they_would_do():
    with pytest.raises(InputError, match=r"share no .* factor of 1\.00\d+ a sample .* at most 0\.99\d+"):
        certified(tunable(nominal_controller(ROBOT), [stiffer(1.0)]))


def test_other_controllers_may_differ_in_gains_only():
    with pytest.raises(InputError, match=r"more than their gains: compensation\."):
        tunable(
            nominal_controller(alten(FRICTION)), [nominal_controller(alten(FRICTION), compensation="full")]
        )
    with pytest.raises(InputError, match="5 gains are given; firmware can mix 3"):
        tunable(nominal_controller(ROBOT), [stiffer(0.1)] * 4)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (Setting(weights=(1.2, -0.2)), r"gain 1\.2 -0\.2 is no mixture .* 0\.2 away"),
        (Setting(weights=(0.5, 0.6)), "0.1 away"),
        (Setting(weights=(float("nan"), 1.0)), "no mixture"),
        (Setting(weights=(0.2, 0.2, 0.6)), "3 weights are given; the controller has 2 gains"),
        (Setting(compensation=1.1), "must be 0 to 1"),
    ],
)
def test_setting_outside_is_refused_and_changes_nothing(setting, words):
    controller = tunable(nominal_controller(ROBOT), [stiffer(0.5)])
    with pytest.raises(InputError, match=words):
        controller.tune(setting)
    assert not controller.memory["tuning"]["wanted"].any()


def test_compensation_is_bounded_by_what_is_certain():
    uncertain = alten(FRICTION).annotated(standard_deviations={"friction.coulomb": (0.01,) * 3})
    controller = tunable(nominal_controller(alten(FRICTION), compensation="full"), robot=uncertain)
    most = float(controller.record["tuning"]["compensation"][0])
    assert 0.5 < most < 1.0
    with pytest.raises(InputError, match="the certain one"):
        controller.tune(Setting(compensation=1.0))
    controller.tune(Setting(compensation=0.5))
    controller.tune(None)  # back to the one that it was made with, but no further than is certain
    assert controller.memory["tuning"]["wanted"][0, 2] == pytest.approx(1.0 - most)


def test_controller_moves_to_the_gain_without_a_jump_and_steps_back():
    soft, stiff = nominal_controller(ROBOT), stiffer(0.5)
    controller, state = tunable(soft, [stiff]), np.array([0.02, -0.01, 0.01, 0.02, 0.1, *np.zeros(5)])

    def torques(samples: int) -> np.ndarray:
        return np.array([controller.update(0.0, state, np.zeros(10)) for _ in range(samples)])

    first, last = (one.update(0.0, state, np.zeros(10)) for one in (soft, stiff))
    assert_allclose(torques(1)[0], first, atol=1e-12)
    controller.tune(Setting(weights=(0.0, 1.0)))
    samples = round(CHANGE_TIME / controller.sample_time)
    moved = torques(samples)
    assert_allclose(moved[-1], last, atol=1e-12)
    steps = np.abs(np.diff(np.vstack([first, moved]), axis=0))
    assert_allclose(steps, np.abs(last - first)[None] / samples * np.ones((samples, 1)), atol=1e-12)
    controller.tune(Setting(weights=(0.0, 1.0)))  # again, as after an answer that was lost
    controller.tune(None)
    assert_allclose(torques(samples)[-1], first, atol=1e-12)


def test_setting_moves_along_a_straight_line_of_mixtures():
    controller = tunable(nominal_controller(ROBOT), [stiffer(0.3), stiffer(0.5)])
    now = controller.memory["tuning"]["now"]
    for weights in ((0.1, 0.9, 0.0), (0.1, 0.0, 0.9), (0.55, 0.45, 0.0), (0.1, 0.45, 0.45)):
        controller.tune(Setting(weights=weights))
        for _ in range(300):
            controller.update(0.0, np.zeros(10), np.zeros(10))
            assert (now[0, :2] >= 0.0).all()
            assert now[0, :2].sum() <= 0.9 + 1e-12
        assert_array_equal(now, controller.memory["tuning"]["wanted"])


def mixed_numbers(controller: Controller) -> list[np.ndarray]:
    record = controller.record
    return [record["gain"], record["integral"]["gain"], record["lean_limit"]["asked"]]


def test_precise_gains_are_mixed_with_their_integrals_and_lean_limits():
    stiff = precise_controller(ROBOT)
    half = stiff.with_parts(stiff.parts)
    for part in mixed_numbers(half):
        part *= 0.5
    controller = tunable(stiff, [half])
    controller.tune(Setting(weights=(0.0, 1.0)))
    for _ in range(201):
        controller.update(0.0, np.zeros(10), np.zeros(10))
    tuned = controller.memory["tuning"][0]
    for name, own, other in zip(
        ("gain", "integral", "asked"), mixed_numbers(half), mixed_numbers(stiff), strict=True
    ):
        assert_allclose(other[0] + tuned[name], own[0])
