"""Contacts that slip: closed forms, MuJoCo's and Drake's mass matrices, momentum and energy; the loop with it."""

from dataclasses import replace
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ballbot import InputError, Model, Robot, simulate_batch
from ballbot.arrays import Floats
from ballbot.mechanics.engine.lanes import FLOOR, LANES, MOTOR, SLIP
from ballbot.mechanics.geometry import rotation, wheel_load
from ballbot.simulation.imperfections import Grip, Imperfections, Push
from ballbot.simulation.sensed_plant import SensedPlant
from tests.support.constraint_elimination import constraints, robot_acceleration
from tests.support.control_examples import FRICTION, alten, leaning
from tests.support.freed_mechanism import reflected_inertia, rolling_motion, wheel_places

pytestmark = pytest.mark.sample  # no other test compiles the engine with slip

ENGINES = {"mujoco": "tests.support.mujoco_mechanism", "pydrake": "tests.support.drake_mechanism"}


class Slider:
    """A robot under held torques in steps of h [s], from a state and a slip (n + 2) of its wheels and on the floor."""

    def __init__(self, robot: Robot, grip: Grip, h: float, *, play: float = 0.0) -> None:
        self.robot = robot.replace(sensors=replace(robot.sensors, sample_time=h))
        self.h = h
        self.plant = SensedPlant(Model(self.robot, step=h), Imperfections(grip=grip, backlash=play))
        self.rows = [*range(SLIP, SLIP + robot.wheel_count), SLIP + 4, SLIP + 5]

    def _row(self, row: int) -> Floats:
        return self.plant._memory.work[0, row * LANES : row * LANES + 1]

    @property
    def slip(self) -> Floats:
        return np.concatenate([self._row(row) for row in self.rows])

    @property
    def floor_load(self) -> float:
        return float(self._row(FLOOR)[0])

    def start(self, state: Floats, slip: Floats) -> None:
        self.plant.reset(state)
        for row, value in zip(self.rows, slip, strict=True):
            self._row(row)[0] = value
        rolling = state[5:].copy()
        rolling[:2] -= slip[-2:]
        speeds = self.plant.model.wheel_speed(state[:5], rolling) + slip[:-2]
        for i, speed in enumerate(speeds):
            self._row(MOTOR + i)[0] = self.plant._memory.speeds[0, i] = speed

    def steps(self, torques: Floats, count: int = 1) -> Floats:
        """Return the state after so many steps; its drive's limits are far away."""
        for _ in range(count - 1):
            self.plant.step(torques, self.h)
        return self.plant.step(torques, self.h).truth


# --- by hand ---------------------------------------------------------------------------------------


def turning(robot: Robot, u: float, traction: float | None) -> tuple[float, float, float]:
    """Return, upright under equal torques on frictionless wheels, q_dot, the yaw's w_dot and the traction l.

    (j_w + j_r) q_dot - j_w a w_dot = u - l,  J w_dot - n j_w a q_dot = -n A l,  and without slip q + A w = 0.
    """
    n, wheels = robot.wheel_count, robot.wheels
    a = np.sin(wheels.tilt)
    A, j_w = robot.ball.radius / wheels.radius * a, wheels.inertia
    J = robot.body.inertia_about_ball_center()[2, 2]
    last = [1.0, A, 0.0] if traction is None else [0.0, 0.0, 1.0]
    rows = [[j_w + reflected_inertia(robot), -j_w * a, 1.0], [-n * j_w * a, J, n * A], last]
    return tuple(np.linalg.solve(rows, [u, 0.0, traction or 0.0]))


@given(st.floats(0.05, 0.8), st.floats(1e-6, 0.3), st.booleans(), st.sampled_from([1.0, -1.0]))
@settings(max_examples=20, deadline=None)
def test_wheels_break_away_at_exactly_their_grip(mu, excess, beyond, direction):
    robot = alten()
    limit = mu * robot.wheels.radius * wheel_load(robot)
    u = limit / turning(robot, 1.0, None)[2] * (1.0 + excess if beyond else 1.0 - excess)
    slider = Slider(robot, Grip(wheels=mu), 1e-3)
    slider.start(np.zeros(10), np.zeros(5))
    slider.steps(np.full(3, direction * u))
    assert (slider.slip[:3] * direction > 0.0).tolist() == [beyond] * 3


def test_wheels_that_spin_on_the_ball_do_so_at_the_accelerations_by_hand_and_grip_again():
    robot, mu, h = alten(), 0.3, 1e-3
    A = robot.ball.radius / robot.wheels.radius * np.sin(robot.wheels.tilt)
    limit = mu * robot.wheels.radius * wheel_load(robot)
    slider = Slider(robot, Grip(wheels=mu), h)
    slider.start(np.zeros(10), np.zeros(5))
    q, w, _ = turning(robot, 2.0, limit)
    state = slider.steps(np.full(3, 2.0), 50)
    # every rate is constant: only rounding is left
    assert_allclose(slider.slip[:3], (q + A * w) * 50 * h, rtol=1e-10)
    assert_allclose(state[9], w * 50 * h, rtol=1e-10)
    off = turning(robot, 0.0, limit)  # the motors stop: the same traction brakes the slip
    stop = -(q + A * w) * 50 * h / (off[0] + A * off[1])
    state = slider.steps(np.zeros(3), int(stop / h) + 2)
    assert_array_equal(slider.slip, 0.0)
    assert_allclose(state[9], w * 50 * h + off[1] * stop, rtol=1e-10)


def test_a_ball_that_slides_takes_its_grip_from_the_momentum_and_then_rolls():
    robot, mu, h = alten(), 0.2, 2.5e-4
    slider = Slider(robot, Grip(wheels=10.0, floor=mu), h)
    start = leaning(0.05)
    start[5:7] = 0.3, 0.4
    slider.start(start, np.array([0.0, 0.0, 0.0, 0.3, 0.4]))
    body, mass = robot.body, robot.ball.mass + robot.body.mass

    def momentum(state: Floats) -> Floats:
        R = rotation(*state[2:5])
        rates = np.array([*state[7:9], 0.0])  # about the world's x and the turned y, with psi at rest
        w = rates[0] * np.array([1.0, 0.0, 0.0]) + rates[1] * rotation(state[2], 0.0, 0.0) @ [0.0, 1.0, 0.0]
        w = w + state[9] * R @ [0.0, 0.0, 1.0]
        return mass * state[5:7] + body.mass * body.center_of_mass * np.cross(w, R @ [0.0, 0.0, 1.0])[:2]

    given_by_floor, before, path = np.zeros(2), slider.slip[3:], start
    for _ in range(60):
        path = slider.steps(np.zeros(3))
        middle, before = 0.5 * (before + slider.slip[3:]), slider.slip[3:]
        given_by_floor -= h * mu * slider.floor_load * middle / np.hypot(*middle)
    assert np.hypot(*before) > 0.1
    # of 0.3 kg m/s; the momentum's own integration has order two
    assert_allclose(momentum(path) - momentum(start), given_by_floor, atol=2e-6)
    slider.steps(np.zeros(3), 200)
    assert_array_equal(slider.slip, 0.0)


# --- against engines that know nothing of rolling ----------------------------------------------------


def sliding_acceleration(robot: Robot, state: Floats, slip: Floats, u: Floats, grip: Grip, engine: str):
    """Return q_ddot (5), by an engine's M and bias, and whether nothing else slips, is lifted or may stick.

    Constraints of contacts that slide give way to friction: f_i = -mu N_i sgn(sigma_i), F = -mu_f N c/|c|.
    """
    n, q, q_dot = robot.wheel_count, state[None, :5], state[None, 5:]
    motion, rolling = rolling_motion(robot, q, q_dot, seed=1), q_dot.copy()
    rolling[0, :2] -= slip[n:]
    turning = rolling_motion(robot, q, rolling, seed=1).velocities[0]
    nu = motion.velocities[0]
    nu[3:6], nu[12:] = turning[3:6], turning[12:] + slip[:n]
    G, g = (part[0] for part in constraints(robot, motion))
    freed = import_module(ENGINES[engine]).freed(robot, motion)
    size, m, friction, rates = 12 + n, 7 + n, robot.friction, nu[12:]
    decay = np.exp(-(np.abs(rates / friction.stribeck_speed) ** friction.stribeck_exponent))
    dry = np.array(friction.coulomb) + np.array(friction.stribeck) * decay
    tau = np.zeros(size)
    tau[12:] = u - np.array(friction.viscous) * rates - dry * np.sign(rates)
    tau[3:5] = -robot.rolling_force * robot.ball.radius * nu[3:5] / np.hypot(*nu[3:5])
    K, right = np.zeros((size + m, size + m)), np.concatenate([tau - freed.bias[0], -g])
    K[:size, :size], K[:size, size:], K[size:, :size] = freed.mass_matrix[0], -G.T, G
    directions = np.array([place.contact for place in wheel_places(robot)])
    pressing = np.linalg.pinv(directions.T) @ motion.body.as_matrix()[0].T
    limits = np.zeros((m, m))  # of each contact's friction, from the multipliers
    limits[:2, 2], limits[7:, 4:7] = grip.floor, grip.wheels * pressing
    speeds = G @ nu
    sizes = np.concatenate([[np.hypot(*speeds[:2])] * 2, np.abs(speeds[2:])])
    slides = np.array([*[bool(slip[n:].any())] * 2, *[False] * 5, *(slip[:n] != 0.0)])
    K[size:][slides] = 0.0
    K[size:, size:][slides] = (np.eye(m) + limits * (speeds / np.maximum(sizes, 1e-9))[:, None])[slides]
    right[size:][slides] = 0.0
    solution = np.linalg.solve(K, right)
    forces = solution[size:]
    needed = np.concatenate([[np.hypot(*forces[:2])], np.abs(forces[7:])])
    most = (limits @ forces)[[0, *range(7, m)]]
    held = ~slides[[0, *range(7, m)]]
    acceleration = robot_acceleration(q, q_dot, np.asarray(solution[None, :size], dtype=float))[0]
    loaded, moving = (pressing @ forces[4:7]).min() > 1.0, np.abs(rates).min() > 0.1
    return acceleration, loaded and moving and (needed < 0.98 * most)[held].all()


@pytest.mark.parametrize("engine", list(ENGINES))
def test_accelerations_of_sliding_robots_equal_the_engine_s(engine):
    pytest.importorskip(engine, reason=f"{engine} is not installed")
    robot, rng, compared, h = alten(FRICTION), np.random.default_rng(0), 0, 1e-5
    while compared < 40:
        state = np.concatenate([*(rng.uniform(-s, s, k) for s, k in ((0.1, 2), (0.3, 2), (3, 1), (1, 5)))])
        slip = rng.uniform(2.0, 4.0, 5) * rng.choice([-1.0, 0.0, 1.0], 5)
        slip[3:] *= 0.1
        u, grip = rng.uniform(-1, 1, 3), Grip(wheels=rng.uniform(0.2, 0.8), floor=rng.uniform(0.1, 0.5))
        expected, stays = sliding_acceleration(robot, state, slip, u, grip, engine)
        if not stays:
            continue
        rates = []
        for step in (h, 2.0 * h):
            slider = Slider(robot, grip, step)
            slider.start(state, slip)
            rates.append((slider.steps(u)[5:] - state[5:]) / step)
            assert_array_equal(slider.slip[:3][slip[:3] == 0.0], 0.0)
        # extrapolated to h = 0: the remaining error is of order h^2, at most 4e-6, where the Stribeck curve is steep
        assert_allclose(2.0 * rates[0] - rates[1], expected, atol=1e-5 * np.abs(expected).max())
        compared += 1


# --- properties ------------------------------------------------------------------------------------


def energy(slider: Slider, state: Floats) -> float:
    """Return the energy of ball, body and wheels, each a body of its own."""
    robot, slip = slider.robot, slider.slip
    rolling = state[5:].copy()
    rolling[:2] -= slip[3:]
    motion = rolling_motion(robot, state[None, :5], state[None, 5:], seed=0)
    turning = rolling_motion(robot, state[None, :5], rolling[None], seed=0).velocities[0]
    v, Omega, w = motion.velocities[0, :3], turning[3:6], motion.velocities[0, 9:12]
    R, rates = motion.body.as_matrix()[0], turning[12:] + slip[:3]
    up, body, w = R[:, 2], robot.body, R.T @ motion.velocities[0, 9:12]
    along = v + body.center_of_mass * np.cross(R @ w, up)
    J = body.inertia_about_center_of_mass()
    axles = np.array([place.axle for place in wheel_places(robot)])
    j_w = robot.wheels.inertia
    own = 0.5 * (j_w + reflected_inertia(robot)) * rates @ rates + j_w * rates @ (axles @ w)
    height = body.mass * robot.gravity * body.center_of_mass * up[2]
    ball = robot.ball.mass * v @ v + robot.ball.inertia * Omega @ Omega
    return 0.5 * (ball + body.mass * along @ along + w @ J @ w) + own + height


def test_sliding_never_creates_energy():
    rng, lost = np.random.default_rng(3), []
    for _ in range(10):
        slider = Slider(alten(), Grip(wheels=rng.uniform(0.1, 0.5), floor=rng.uniform(0.1, 0.5)), 2.5e-4)
        state = np.concatenate([np.zeros(2), rng.uniform(-0.1, 0.1, 2), rng.uniform(-1, 1, 6)])
        slip = rng.uniform(-5.0, 5.0, 5)
        slip[3:] *= 0.1
        slider.start(state, slip)
        energies = [energy(slider, state)]
        energies += [energy(slider, slider.steps(np.zeros(3))) for _ in range(100)]
        lost.append(-np.diff(energies))
        assert energies[0] - energies[-1] > 0.05
    # of some joules; what the method of order two errs by in a step without slip
    assert np.min(lost) > -1e-7


@pytest.mark.parametrize("slip", [(3.0, 0, 0, 0, 0), (3.0, -4.0, 0, 0.3, 0.2), (0, 0, 0, 0.5, 0.1)])
def test_order_is_two_while_each_contact_stays_as_it_is(slip):
    state = np.array([0.1, 0.2, 0.1, -0.05, 0.4, 0.5, -0.3, 0.2, 0.1, 2.0])  # no wheel is near rest
    ends = []
    for steps in (4, 8, 16):
        slider = Slider(alten(FRICTION), Grip(wheels=0.3 if any(slip[:3]) else 1.0, floor=0.1), 0.002 / steps)
        slider.start(state, np.array(slip))
        ends.append(np.concatenate([slider.steps(np.array([0.4, -0.2, 0.3]), steps), slider.slip]))
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(ends))
    assert coarse / fine == pytest.approx(4.0, rel=0.05)


def test_gears_with_hardly_any_play_slip_like_rigid_ones():
    state, ends = np.array([0.1, 0.2, 0.1, -0.05, 0.4, 0.5, -0.3, 0.2, 0.1, 0.3]), []
    for play in (0.0, 1e-7):
        slider = Slider(alten(FRICTION), Grip(wheels=0.2, floor=0.1), 1e-4, play=play)
        slider.start(state, np.array([3.0, -4.0, 5.0, 0.3, 0.2]))
        ends.append(np.concatenate([slider.steps(np.array([0.4, -0.2, 0.3]), 40), slider.slip]))
    # motors cross 1e-7 rad at once; the sliding that is left is some rad/s and 0.2 m/s
    assert_allclose(ends[1], ends[0], atol=2e-3)


# --- the loop --------------------------------------------------------------------------------------

HARD = Push.of_impulse(25.0, 0.3, time=0.2, duration=0.1, height=0.4)


def test_contacts_that_hold_change_nothing_and_lanes_without_slip_stay_as_they_are():
    robot, start = alten(FRICTION), leaning(0.05)

    def run(*by_lane: Imperfections) -> Floats:
        options = {"duration": 1.0, "initial_states": start, "imperfections": list(by_lane)}
        return simulate_batch(robot, "nominal", "hold", **options).states

    without, strong = run(Imperfections(), Imperfections(grip=Grip(wheels=50.0, floor=50.0)))
    assert_array_equal(without, strong)
    pushed = Imperfections(pushes=(HARD,))
    free, held, slips = run(
        pushed, replace(pushed, grip=Grip(wheels=50, floor=50)), replace(pushed, grip=Grip(wheels=0.3))
    )
    # a force on the robot in each step, and not its impulse before each sample: of 2 m/s
    assert np.abs(free - held)[:, 5:7].max() < 0.1
    assert np.abs(slips - held)[:, 5:7].max() > 0.1
    assert_array_equal(free, run(pushed)[0])


def test_slip_is_refused_for_the_thesis_s_equations_and_wheels_without_inertia():
    slips = Imperfections(grip=Grip())
    options = {"duration": 0.1, "imperfections": slips}
    with pytest.raises(InputError, match=r"slip.*need the formulation 'exact'"):
        simulate_batch(Model("alten", "thesis"), "nominal", "hold", **options)
    massless = alten().replace(wheels=replace(alten().wheels, inertia=0.0))
    with pytest.raises(InputError, match=r"wheels\.inertia"):
        SensedPlant(Model(massless), slips)
    with pytest.raises(InputError, match="floor"):
        Grip(floor=0.0)
