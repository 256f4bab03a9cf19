"""A friction law that a user registers is estimated as the classical one is."""

import numpy as np
import pytest

from ballbot import InputError, LawParameter, Robot, identify, register_friction_law
from ballbot.control.presets import nominal_controller
from ballbot.identification.laws import bounds_of, law_named
from ballbot.identification.quantities import Bounds
from ballbot.report.identification import friction_curve
from tests.support.control_examples import alten
from tests.support.friction_law_examples import FRICTION
from tests.support.identification_examples import balancing_log, exact, noisy

TRUTH = np.array(
    [*FRICTION.viscous, *FRICTION.coulomb, *FRICTION.stribeck, 0.6, 1.0, 0.007, 0.004, 0.006, 0.005, 0.1]
)


@pytest.mark.slow
def test_law_is_found_from_a_log_and_predicts_better_than_the_classical_one(tmp_path):
    log = noisy(balancing_log(friction=FRICTION), seed=3)
    found = identify(exact(), log, law="toothed")
    assert found.labels[12:] == ("b_21", "b_22", "b_23", "m")
    errors = found.errors
    known = np.isfinite(errors)
    assert known.sum() == len(TRUTH) - 1  # delta is no parameter of the law
    # of 15 normal numbers the largest is below 3 with a probability of 96 %
    assert (np.abs(found.values - TRUTH)[known] < 3.0 * errors[known]).all()
    assert errors[12:].max() < 0.003  # the law's own parameters are identified
    classical = identify(alten(), log)
    worse = classical.held_out.squares_with.sum(axis=0) / found.held_out.squares_with.sum(axis=0)
    assert np.median(worse) > 1.5
    # the found robot is one like any other: in its file, and in a controller that compensates what was found
    found.robot.write(tmp_path / "robot.toml")
    read = Robot.load(tmp_path / "robot.toml")
    assert read.friction == found.robot.friction
    assert read.standard_deviations["friction.own.teeth"] == pytest.approx(errors[-1], rel=1e-3)
    assert nominal_controller(read, compensation="full").robot.friction.own == read.friction.own
    torque, error = friction_curve(found, 0, np.array([-1.0, 3.0]))
    wanted = np.array([-0.014 - 0.11 - 0.05 * 0.36 / 1.36 - 0.004, 0.042 + 0.11 + 0.05 * 0.04 / 1.04 + 0.036])
    assert (np.abs(torque - wanted) < 3.0 * error).all()


def test_quantities_of_a_law_have_bounds_and_those_that_it_lacks_are_held():
    law = law_named("toothed")
    assert law.free == (
        *("viscous", "coulomb", "stribeck", "stribeck_speed", "quadratic", "teeth", "rolling"),
    )
    assert bounds_of(law, Bounds()).limits == {"stribeck_exponent": (1.0, 1.0)}
    assert Bounds({"quadratic": (0.0, 0.1)}).limits == {"quadratic": (0.0, 0.1)}
    with pytest.raises(InputError, match="did you mean 'toothed'"):
        law_named("toothet")


def test_parameter_with_the_name_of_another_quantity_is_refused():
    pivoting = LawParameter(
        name="pivoting", symbol="p", meaning="m", unit="N m", usual=(0.0, 1.0), default=0.0
    )

    def spinning(speed, load, pivoting):  # noqa: ARG001
        return pivoting

    register_friction_law(spinning, parameters=[pivoting])
    with pytest.raises(InputError, match="pivoting"):
        law_named("spinning")
