"""The ball on clamped wheels: closed forms, sticking, the identification of its friction, figures and command."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballbot import InputError, Log, Robot
from ballbot.cli.main import main
from ballbot.file_formats import read_results
from ballbot.identification.upside_down import BALL_NAMES, UpsideDown, cut_ball_windows, identify_upside_down
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Friction
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.thesis.reproduce.ball_movement import ball_movement
from tests.support.control_examples import FRICTION

ALTEN = Robot.load("alten")
BALL = ClampedBall.of_robot(ALTEN)
#: four wheels, which can strain against each other
FOUR = ClampedBall.of_robot(
    ALTEN.replace(
        wheels=replace(ALTEN.wheels, azimuths=tuple(0.5 * math.pi * i for i in range(4))),
        friction=Friction.none(4),
    )
)
NONE = Friction.none(3)


def run(
    ball: ClampedBall, law: Friction, start: np.ndarray, torques: np.ndarray, step: float = 1e-3
) -> np.ndarray:
    """Return Omega after each 5 ms sample of one run (samples, 3)."""
    return simulate_balls(
        ball, friction=law, initial=[start], torques=[torques], sample_time=0.005, step=step
    )[0]


def multisine(samples: int, *, seed: int, size: float = 0.3) -> np.ndarray:
    """Return torques (samples, 3) of some slow sines a wheel, all different."""
    random, t = np.random.default_rng(seed), 0.005 * np.arange(samples)
    parts = [
        np.sin(2 * math.pi * random.uniform(0.1, 0.8) * t + random.uniform(0.0, 6.28)) for _ in range(12)
    ]
    return size * np.stack([sum(parts[4 * i : 4 * i + 4]) for i in range(3)], axis=1)


@pytest.mark.slow
class TestPlant:
    def test_sliding_agrees_with_another_integrator(self):
        start = np.linalg.solve(BALL.A, [9.0, -7.0, 12.0])
        push = np.linalg.solve(BALL.inertia, BALL.A.T)

        def rate(_: float, omega: np.ndarray) -> np.ndarray:
            return push @ (np.array([0.2, -0.1, 0.1]) - wheel_friction(BALL.A @ omega, FRICTION))

        reference = solve_ivp(rate, (0.0, 0.2), start, rtol=1e-11, atol=1e-12)
        assert (np.sign(BALL.A @ reference.y) == np.sign(BALL.A @ reference.y[:, :1])).all()
        found = run(BALL, FRICTION, start, np.tile([0.2, -0.1, 0.1], (40, 1)))
        np.testing.assert_allclose(found[-1], reference.y[:, -1], rtol=1e-9)

    def test_loss_at_the_contacts_slows_the_ball_exponentially(self):
        start, B = np.array([3.0, -2.0, 5.0]), 0.02
        found = run(replace(BALL, loss=B), NONE, start, np.zeros((200, 3)))
        rates, axes = np.linalg.eig(np.linalg.inv(BALL.inertia) * B)
        exact = axes @ (np.exp(-rates) * np.linalg.solve(axes, start))
        # of first order in steps of 1 ms: half the step over the time constant, here 2 s
        np.testing.assert_allclose(found[-1], exact, rtol=1e-3)

    def test_what_friction_can_hold_stays_exactly_at_rest(self):
        limits = np.array(FRICTION.coulomb) + np.array(FRICTION.stribeck)
        assert not run(BALL, FRICTION, np.zeros(3), np.tile(0.999 * limits, (20, 1))).any()
        assert run(BALL, FRICTION, np.zeros(3), np.tile(1.001 * limits, (20, 1))).any()

    @settings(max_examples=30, deadline=None)
    @given(
        start=st.lists(st.floats(-20.0, 20.0), min_size=3, max_size=3),
        dry=st.lists(st.floats(0.0, 0.4), min_size=4, max_size=4),
        four=st.booleans(),
    )
    def test_friction_never_gives_energy_and_ends_in_rest(self, start, dry, four):
        ball, n = (FOUR, 4) if four else (BALL, 3)
        sizes = {"viscous": (0.01,) * n, "coulomb": tuple(dry[:n]), "stribeck": (0.03,) * n}
        law = replace(FRICTION, **sizes)
        found = np.vstack([start, run(ball, law, np.array(start), np.zeros((400, n)))])
        energy = np.einsum("ki,ij,kj->k", found, ball.inertia, found)
        assert (np.diff(energy) <= 1e-12 * energy[0]).all()
        if min(dry[:n]) > 0.15:  # decelerates from 20 rad/s within the two seconds
            assert not found[-1].any()

    @pytest.mark.slow
    def test_friction_by_direction_is_a_torque_and_load_is_coulomb_friction(self):
        d, mu, u = np.array([0.03, -0.02, 0.01]), np.array([0.1, 0.05, 0.2]), np.array([0.25, -0.3, 0.4])
        torques = np.concatenate([np.tile(u, (60, 1)), np.tile(-u, (60, 1))])[None]
        directed = replace(FRICTION, coulomb_asymmetry=tuple(d), load=tuple(mu))
        common = {"initial": np.zeros((1, 3)), "sample_time": 0.005}
        ours = simulate_balls(BALL, friction=directed, torques=torques, **common)
        loaded = replace(FRICTION, coulomb=tuple(FRICTION.coulomb + mu * np.abs(u)))
        theirs = simulate_balls(BALL, friction=loaded, torques=torques - d, **common)
        # the same law; only where a wheel reverses may the two choose another step, of first order, as the test below
        np.testing.assert_allclose(ours[:, :60], theirs[:, :60], rtol=0, atol=1e-12)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5)
        assert np.abs(ours[0] @ BALL.A.T).max(axis=0).min() > 0.3  # every wheel turns


def log_of(torques: np.ndarray, omega: np.ndarray, **wheels: np.ndarray) -> Log:
    """Return a log at 200 Hz of torques and the ball's angular velocity (N, 3)."""
    columns = {"t": 0.005 * np.arange(len(torques))} | {f"u{i + 1}": torques[:, i] for i in range(3)}
    return Log(columns | dict(zip(BALL_NAMES, omega.T, strict=True)) | wheels)


def camera_log(*, duration: float, seed: int, law: Friction = FRICTION, size: float = 0.3) -> Log:
    """Return a run of the plant with a friction, watched by a camera with noise of 0.03 rad/s."""
    torques, random = multisine(round(duration / 0.005), seed=seed, size=size), np.random.default_rng(seed)
    omega = np.vstack([np.zeros(3), run(BALL, law, np.zeros(3), torques, step=5e-4)[:-1]])
    return log_of(torques, omega + 0.03 * random.standard_normal(omega.shape))


@pytest.fixture(scope="module")
def log() -> Log:
    return camera_log(duration=12.0, seed=5)


@pytest.fixture(scope="module")
def smooth() -> Log:
    """Return torques and a motion that do not belong together, for what is decided before anything is simulated."""
    return log_of(multisine(2400, seed=5), multisine(2400, seed=6, size=2.0))


def creeping_log(*, seed: int) -> Log:
    """Return a run of 12 s in which the wheels creep on the ball by a speed that follows the force, encoders logged."""
    samples, parts, h = 2400, 20, 0.005
    torques, J, A = multisine(samples, seed=seed), ALTEN.ball.inertia, BALL.A
    j = (BALL.inertia - J * np.eye(3))[0, 0] / (A.T @ A)[0, 0]
    grip, omega, w = 0.5, np.zeros(3), np.zeros(3)  # [N m s/rad]: creep of some per cent of the speed
    rows = []
    for u in torques:
        rows.append([*omega, *w])
        for _ in range(parts):
            force = grip * (w - A @ omega)
            free = w + h / parts * (u - force - np.array(FRICTION.viscous) * w) / j
            dry = np.array(FRICTION.coulomb) + np.array(FRICTION.stribeck) * np.exp(
                -((np.abs(w) / FRICTION.stribeck_speed) ** FRICTION.stribeck_exponent)
            )
            w = np.sign(free) * np.maximum(np.abs(free) - h / parts * dry / j, 0.0)
            omega = omega + h / parts * A.T @ force / J
    seen = np.array(rows) + np.random.default_rng(seed).normal(0.0, [0.03] * 3 + [0.05] * 3, (samples, 6))
    return log_of(torques, seen[:, :3], **{f"wheel{i + 1}_dot": seen[:, 3 + i] for i in range(3)})


def outside(found: UpsideDown) -> list[str]:
    """Return the numbers whose 95 % interval does not contain the truth."""
    amounts = (*FRICTION.viscous, *FRICTION.coulomb, *FRICTION.stribeck)
    truth = (*amounts, FRICTION.stribeck_speed, FRICTION.stribeck_exponent)
    return [
        label
        for label, value in zip(found.estimate.labels, truth, strict=True)
        if not found.intervals[label][0] <= value <= found.intervals[label][1]
    ]


@pytest.mark.slow
class TestIdentification:
    def test_known_friction_is_found(self):
        found = identify_upside_down(ALTEN, camera_log(duration=24.0, seed=5), window=0.5)
        # 11 intervals of 95 %: two outside in less than one log of a hundred
        assert len(outside(found)) <= 1
        assert np.abs(np.array(found.parameters["c"]) / FRICTION.coulomb - 1.0).max() < 0.1
        assert found.verdict.usable
        assert found.verdict.sentence.startswith("Usable: ")
        assert found.held_out["none"].min() > 10.0 * found.held_out["found"].max()
        assert "robot file" not in found.held_out
        assert list(found.robot.friction.coulomb) == found.parameters["c"]
        assert found.robot.sources["friction.coulomb"].startswith("identified")

    def test_encoders_show_the_creep_between_wheels_and_ball(self):
        found = identify_upside_down(ALTEN, creeping_log(seed=1), window=0.4)
        assert len(outside(found)) <= 1
        assert np.abs(np.array(found.parameters["b"]) / FRICTION.viscous - 1.0).max() < 0.1
        assert np.abs(np.array(found.parameters["c"]) / FRICTION.coulomb - 1.0).max() < 0.1

    @pytest.mark.usefixtures("undrawn")
    def test_without_friction_none_is_found_and_that_is_said_first(self, tmp_path, capsys):
        log = camera_log(duration=24.0, seed=3, law=NONE, size=0.05)  # clear of the speed limit
        found = identify_upside_down(ALTEN, log, window=0.5)
        assert not found.verdict.usable
        assert found.verdict.reasons[0] == "no friction was found"
        assert "the prediction is no better with friction than without" in found.verdict.reasons[1]
        assert found.parameters["s"] == [0.0] * 3
        # its own errors hold zero: three of 0.03 rad/s of noise over 24 s
        assert max(found.parameters["c"]) < 0.005
        assert max(found.parameters["b"]) < 0.0005
        log.write(tmp_path / "log.csv")
        out = tmp_path / "out"
        words = ["alten", str(tmp_path / "log.csv"), "--window", "0.5", "--out", str(out)]
        assert main(["identify-upside-down", *words]) == 2
        assert "Verdict: Not usable: " in capsys.readouterr().out
        assert not (out / "robot.toml").exists()
        results = read_results(out / "results.json")
        assert isinstance(results, dict)
        assert results["verdict"]["usable"] is False

    def test_rows_at_the_supplys_limit_are_left_out(self):
        log = camera_log(duration=24.0, seed=8)
        speeds = np.abs(np.column_stack([log[name] for name in BALL_NAMES]) @ BALL.A.T)
        drive = ALTEN.drive
        # the fastest twentieth of the rows is beyond 0.95 of the limit
        fastest = float(np.quantile(speeds.max(axis=1), 0.95)) / 0.95
        volts = fastest * drive.gear_ratio / drive.speed_constant
        weak = ALTEN.replace(drive=replace(drive, supply_voltage=volts))
        beyond = (speeds > 0.95 * fastest).any(axis=1)
        wrong = log.with_columns({f"u{i}": np.where(beyond, 2.0, 1.0) * log[f"u{i}"] for i in (1, 2, 3)})
        found, spoilt = (identify_upside_down(weak, one, window=0.5) for one in (log, wrong))
        assert spoilt.parameters == found.parameters

    def test_the_robot_files_friction_is_judged(self, log: Log):
        robot = ALTEN.replace(friction=FRICTION)
        found, again = (identify_upside_down(robot, log, window=0.4) for _ in range(2))
        assert found.held_out["robot file"].max() < 1.3 * 0.03
        assert found.to_dict() == again.to_dict()
        assert found.robot.friction.rolling == FRICTION.rolling
        assert all(one.code != "methods-differ" for one in found.findings)
        stated = {"friction.viscous": (1e-4,) * 3, "friction.coulomb": (1e-3,) * 3}
        other = replace(
            FRICTION,
            viscous=tuple(1.9 * one for one in FRICTION.viscous),
            coulomb=tuple(0.8 * one for one in FRICTION.coulomb),
        )
        balanced = robot.replace(friction=other).annotated(standard_deviations=stated)
        compared = identify_upside_down(balanced, log, window=0.4)
        (differs,) = (one for one in compared.findings if one.code == "methods-differ")
        assert "The robot file and the logs upside down differ" in differs.text

    def test_logs_that_disagree_are_named_and_widen_the_errors(self, log: Log):
        other = replace(FRICTION, coulomb=tuple(1.3 * one for one in FRICTION.coulomb))
        heavier = camera_log(duration=12.0, seed=9, law=other)
        same = camera_log(duration=12.0, seed=9)
        apart, alike = (identify_upside_down(ALTEN, [log, one], window=0.4) for one in (heavier, same))
        assert [one.code for one in apart.findings].count("logs-differ") == 1
        assert all(one.code != "logs-differ" for one in alike.findings)
        assert min(apart.standard_errors["c"]) > 1.5 * max(alike.standard_errors["c"])

    @pytest.mark.parametrize(
        ("change", "options", "sentence"),
        [
            ({"ball_omega_x": None}, {}, "ball_omega_x"),
            ({"u1": 0.0, "u2": 0.0, "u3": 0.0}, {}, "torques u are zero"),
            ({"ball_omega_x": 0.0, "ball_omega_y": 0.0, "ball_omega_z": 0.0}, {}, "0 windows a wheel turns"),
            ({}, {"window": 4.0}, "choose a shorter window"),
            ({}, {"held_out": 1.0}, "held_out"),
        ],
    )
    def test_refusals(self, smooth: Log, change, options, sentence):
        columns = {name: smooth[name] for name in smooth.names if change.get(name, 0.0) is not None}
        columns |= {name: np.full(len(smooth), value) for name, value in change.items() if value is not None}
        with pytest.raises(InputError, match=sentence):
            identify_upside_down(ALTEN, Log(columns), **options)

    def test_a_gap_costs_the_windows_it_touches(self, smooth: Log):
        broken = smooth["u1"].copy()
        broken[1040:1050] = np.nan
        logs = (smooth, smooth.with_columns({"u1": broken}))
        whole, holed = (cut_ball_windows(ALTEN, [one], duration=0.5) for one in logs)
        assert len(whole) - len(holed) == 1
        np.testing.assert_array_equal(
            whole.torques[0], [[smooth[f"u{i}"][k] for i in (1, 2, 3)] for k in range(4, 104)]
        )
        np.testing.assert_array_equal(whole.measured[0, :, 0], smooth["ball_omega_x"][5:105])


@pytest.mark.slow
def test_friction_leaves_the_ball_short_and_moves_it_about_other_axes():
    movement = ball_movement(ALTEN.replace(friction=FRICTION))
    reference = movement.reference[-1]
    np.testing.assert_allclose(movement.without_friction[-1], reference, atol=1e-4)
    assert np.abs(movement.with_friction[-1] - reference).max() > 0.05
    assert movement.off_axis_with_friction > 0.02


@pytest.mark.sample
def test_the_stand_in_robot_by_the_command(shared_data, tmp_path):
    path = tmp_path / "log.csv"
    Log.read(shared_data / "bbr" / "upside_down.csv").between(10.0, 34.0).write(path)
    command = ["identify-upside-down", "alten", str(path), "--window", "0.5", "--out", str(tmp_path)]
    assert main(command) == 0
    results = json.loads((tmp_path / "results.json").read_text())
    errors = results["rmse"]["held_out"]
    assert (np.array(errors["found"]) < 0.06 * np.array(errors["none"])).all()
    assert len(results["parameters"]["b"]) == 3
    assert Robot.load(tmp_path / "robot.toml").friction.coulomb[0] == results["parameters"]["c"][0]
    assert "held-out" in (tmp_path / "report.html").read_text(encoding="utf-8")
