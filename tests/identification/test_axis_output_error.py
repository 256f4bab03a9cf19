"""Output error of one axis: simulation against an independent integrator, and known parameters found again."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballbot.errors import InputError
from ballbot.identification.axis import AXIS_LAWS, AxisRecord
from ballbot.identification.axis.inverse import smoothed_motion, speed_at_start
from ballbot.identification.axis.model import PARAMETERS, Axis
from ballbot.identification.axis.output_error import (
    closed_loop_residuals,
    equal_spans,
    fit_output_error,
    open_loop_residuals,
)
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


def test_open_loop_finds_known_parameters():
    record = simulated_record()
    motion = smoothed_motion(record, bandwidth=20.0)
    residuals = open_loop_residuals(record, motion, equal_spans(record, 1.0), block=1.0)
    found = fit_output_error(AXIS_LAWS["coulomb"], NOT_QUITE, residuals, scale=1e-4)
    for name, value in TRUTH.items():
        # windows start from a filtered speed, which is not exact next to a reversal
        assert found.values[name] == pytest.approx(value, rel=0.02)


def test_closed_loop_finds_known_parameters():
    record = simulated_record()
    found = fit_output_error(
        AXIS_LAWS["coulomb"], NOT_QUITE, closed_loop_residuals(record, start=49, block=1.0), scale=1.0
    )
    for name, value in TRUTH.items():
        # the start's speed is a cubic's slope; all else is the simulation that made the record
        assert found.values[name] == pytest.approx(value, rel=0.005)


def test_closed_loop_standard_errors_are_of_the_size_of_the_errors():
    pulls = []
    for seed in range(12):
        record = simulated_record(noise=3.0, seed=seed)
        residuals = closed_loop_residuals(record, start=49, block=0.5)
        found = fit_output_error(AXIS_LAWS["coulomb"], TRUTH, residuals, scale=1.0)
        pulls += [(found.values[name] - value) / found.standard_errors[name] for name, value in TRUTH.items()]
    # 48 pulls, four of a run dependent: their root mean square is 1 +- 0.2 or so
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.6


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
