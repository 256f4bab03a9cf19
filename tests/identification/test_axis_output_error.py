"""Output error of one axis: simulation against an independent integrator, and known parameters found again."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballbot.errors import InputError
from ballbot.identification.axis import AXIS_LAWS, AxisRecord
from ballbot.identification.axis.laws import PARAMETERS
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.motion import speed_at_start
from ballbot.identification.axis.output_error import (
    ClosedLoop,
    OpenLoop,
    equal_spans,
    fit_output_error,
    sighting,
    windows_of,
)
from ballbot.identification.axis.record import KnownLoad
from ballbot.identification.axis.structure import AxisModel
from tests.support.axis_examples import LOOP, SAMPLE_TIME, TRUTH, simulated_record

ASYMMETRIC = {
    "mass": 95.0,
    "viscous_plus": 160.0,
    "coulomb_plus": 19.0,
    "viscous_minus": 240.0,
    "coulomb_minus": 21.0,
}
NOT_QUITE = {"mass": 80.0, "viscous": 150.0, "coulomb": 26.0, "offset": 1.0}


@pytest.mark.parametrize("law", ["coulomb", "asymmetric"])
def test_motion_against_an_adaptive_integrator_with_events(law):
    values = TRUTH if law == "coulomb" else ASYMMETRIC
    forces = 60.0 * np.sin(2.0 * np.pi * np.arange(2000) * SAMPLE_TIME / 0.8)
    positions = Axis(law=AXIS_LAWS[law], values=values).open_loop(
        forces, position=0.0, speed=0.1, sample_time=SAMPLE_TIME
    )
    expected = _by_scipy(values, forces)
    # in the one step of a reversal the asymmetric law is that of the step's start: 1 ms of 2 N on 95 kg, over 2 s
    np.testing.assert_allclose(positions, expected, atol=2e-6 if law == "coulomb" else 2e-4)


def _by_scipy(values: dict[str, float], forces: np.ndarray) -> np.ndarray:
    """Integrate sample by sample with smooth friction of known sign, resting where the force is too small."""
    x, v, positions = 0.0, 0.1, []
    for force in forces - values.get("offset", 0.0):
        left = SAMPLE_TIME
        while left > 0.0:
            sign = np.sign(v) if v != 0.0 else np.sign(force)
            side = "plus" if sign > 0.0 else "minus"
            b = values.get("viscous", values.get(f"viscous_{side}"))
            c = values.get("coulomb", values.get(f"coulomb_{side}"))
            if v == 0.0 and abs(force) <= c:
                break

            def rate(t, y, b=b, c=c, sign=sign, force=force):  # noqa: ARG001
                return [y[1], (force - b * y[1] - sign * c) / values["mass"]]

            def stops(t, y):  # noqa: ARG001
                return y[1]

            stops.terminal, stops.direction = True, -sign
            part = solve_ivp(rate, (0.0, left), [x, v], events=stops, rtol=1e-10, atol=1e-13)
            x, v = part.y[:, -1]
            left -= part.t[-1]
            if part.status == 1:
                v = 0.0
            if part.t[-1] == 0.0:
                break
        positions.append(x)
    return np.array(positions)


MODEL = AxisModel(law=AXIS_LAWS["coulomb"])


@pytest.mark.parametrize("horizon", [0.1, 1.0, 20.0])
def test_open_loop_finds_known_parameters(horizon):
    seen = sighting(simulated_record(), 20.0)
    windows = windows_of(seen, equal_spans(seen.record, horizon))
    found = fit_output_error(MODEL, NOT_QUITE, OpenLoop(model=MODEL, sightings=[seen], windows=[windows]))
    for name, value in TRUTH.items():
        # the filter's start of a window is not exact next to a reversal, and its correction is linear
        assert found.values[name] == pytest.approx(value, rel=0.02)


def test_equal_numbers_under_other_names_are_simulated_anew():
    seen = sighting(simulated_record(duration=3.0), 20.0)
    windows = [windows_of(seen, equal_spans(seen.record, 0.5))]
    problem, fresh = (OpenLoop(model=MODEL, sightings=[seen], windows=windows) for _ in range(2))
    exchanged: dict[str, float] = dict(
        zip(("mass", "coulomb", "viscous", "offset"), NOT_QUITE.values(), strict=True)
    )
    problem.errors(NOT_QUITE)
    np.testing.assert_array_equal(problem.errors(exchanged), fresh.errors(exchanged))


def test_closed_loop_finds_known_parameters():
    seen = sighting(simulated_record(), 20.0)
    found = fit_output_error(MODEL, NOT_QUITE, ClosedLoop(model=MODEL, sightings=[seen]))
    for name, value in TRUTH.items():
        # the start's speed is a cubic's slope; all else is the simulation that made the record
        assert found.values[name] == pytest.approx(value, rel=0.005)


def test_closed_loop_standard_errors_are_of_the_size_of_the_errors():
    pulls = []
    for seed in range(12):
        seen = sighting(simulated_record(noise=3.0, seed=seed), 20.0)
        found = fit_output_error(MODEL, TRUTH, ClosedLoop(model=MODEL, sightings=[seen]))
        pulls += [(found.values[name] - value) / found.standard_errors[name] for name, value in TRUTH.items()]
    # 48 pulls, four of a run dependent: their root mean square is 1 +- 0.2 or so
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_forces_over_position_against_an_adaptive_integrator():
    """A spring, gravity, cogging and a known load, without dry friction, which SciPy integrates by itself."""
    values = {"mass": 0.2, "viscous": 0.05, "coulomb": 0.0, "offset": 0.1, "spring": 0.3}
    values |= {"sin_1": 1.0, "cos_1": -0.4, "sin_12": 0.05, "cos_12": 0.02}
    load = KnownLoad(inertia=0.1, weight=2.0, hanging=0.3)
    rows, h = 400, 5e-3
    force = 1.5 * np.sin(0.02 * np.arange(rows)) + np.random.default_rng(1).standard_normal(rows)
    record = AxisRecord(
        name="arm", sample_time=h, force=force, position=np.arange(rows) * 1.0, unit="rad", known_load=load
    )
    axis = Axis(law=AXIS_LAWS["coulomb"], values=values)
    found = axis.windows(record, np.array([0]), np.array([rows - 1]), np.array([[0.2, 0.5, 1.0]]))

    def rate(t, y, force):  # noqa: ARG001
        q, w = y
        against = 0.3 * q + np.sin(q) - 0.4 * np.cos(q) + 0.05 * np.sin(12 * q) + 0.02 * np.cos(12 * q)
        against += 0.1 + 0.05 * w + 2.0 * np.sin(q - 0.3)
        return [w, (force - against) / 0.3]

    y, expected = [0.2, 0.5], []
    for one in force[:-1]:
        y = solve_ivp(rate, (0.0, h), y, args=(one,), rtol=1e-10, atol=1e-12).y[:, -1]
        expected.append(y[0])
    # a step is at most 0.15 rad of the fastest force's phase, whose second order leaves 1e-3 of it
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_rows_at_uneven_times_move_as_even_ones():
    """A force held over two rows is the same force over one row twice as long."""
    forces = 60.0 * np.sin(np.arange(400) / 40.0)
    even = Axis(law=AXIS_LAWS["coulomb"], values=TRUTH).open_loop(
        np.repeat(forces, 2), position=0.0, speed=0.1, sample_time=SAMPLE_TIME
    )
    kept = np.sort(np.random.default_rng(2).choice(np.arange(1, 800), 500, replace=False))
    begins = np.append(0, kept)
    # rows begin wherever the force changes, and at some other times
    begins = np.unique(np.append(begins, 2 * np.arange(400)))
    record = AxisRecord(
        name="uneven",
        sample_time=SAMPLE_TIME,
        force=forces[begins // 2],
        position=begins * 1.0,
        times=begins * SAMPLE_TIME,
    )
    uneven = Axis(law=AXIS_LAWS["coulomb"], values=TRUTH).windows(
        record, np.array([0]), np.array([len(begins) - 1]), np.array([[0.0, 0.1, 1.0]])
    )
    # RK4's steps of one and of two milliseconds agree to its order
    np.testing.assert_allclose(uneven, even[begins[1:] - 1], atol=1e-8)


def test_a_record_without_its_loop_has_no_closed_loop():
    record = simulated_record()
    bare = AxisRecord(name="bare", sample_time=SAMPLE_TIME, force=record.force, position=record.position)
    with pytest.raises(InputError, match="bare does not contain the control loop"):
        Axis(law=AXIS_LAWS["coulomb"], values=TRUTH).closed_loop(bare, speed=0.0)


def test_the_speed_at_the_start_is_that_of_the_motion():
    t = np.arange(1000) * SAMPLE_TIME
    record = AxisRecord(
        name="cubic", sample_time=SAMPLE_TIME, force=np.zeros(1000), position=0.3 * t - t**2 + 2.0 * t**3
    )
    assert speed_at_start(record) == pytest.approx(0.3, rel=1e-9)


def test_axis_laws_are_nested():
    for law in AXIS_LAWS.values():
        if law.below and law.symmetric:
            assert set(AXIS_LAWS[law.below].names) < set(law.names)
        assert set(law.names) <= set(PARAMETERS)


def test_the_loops_limit_holds():
    record = simulated_record()
    assert np.abs(record.force).max() <= LOOP.limit * LOOP.force_per_input


def test_a_stribeck_speed_near_zero_is_simulated_as_coulomb_friction():
    """A search tries such speeds; with steps as short as their slope asks for, it would take 50 times as long."""
    forces = 60.0 * np.sin(2.0 * np.pi * np.arange(2000) * SAMPLE_TIME / 0.8)
    falling = Axis(law=AXIS_LAWS["stribeck"], values=TRUTH | {"stribeck": 1e-3, "stribeck_speed": 1e-7})
    coulomb = Axis(law=AXIS_LAWS["coulomb"], values=TRUTH)
    moved, expected = (
        one.open_loop(forces, position=0.0, speed=0.1, sample_time=SAMPLE_TIME) for one in (falling, coulomb)
    )
    # 1 mN of break-away, of 20 N of friction, acts for a moment at each reversal
    np.testing.assert_allclose(moved, expected, atol=1e-6)
    assert falling._steps(SAMPLE_TIME, KnownLoad()) == coulomb._steps(SAMPLE_TIME, KnownLoad()) == 1


def test_what_was_simulated_last_is_not_simulated_again(monkeypatch):
    record = simulated_record(duration=4.0)
    seen, model = sighting(record, 20.0), AxisModel(law=AXIS_LAWS["coulomb"])
    problem = OpenLoop(model=model, sightings=[seen], windows=[windows_of(seen, equal_spans(record, 0.5))])
    runs = []
    windows = Axis.windows
    monkeypatch.setattr(Axis, "windows", lambda *a, **k: (runs.append(1), windows(*a, **k))[1])
    first = problem.projection(TRUTH)(problem.errors(TRUTH))
    # the motion, and those from two other starts
    assert len(runs) == 3
    np.testing.assert_array_equal(problem.projection(TRUTH)(problem.errors(TRUTH)), first)
    assert len(runs) == 3
    problem.errors(NOT_QUITE | {"offset": 0.0})
    assert len(runs) == 4
