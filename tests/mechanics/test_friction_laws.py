"""The friction law of one driveline: it is the robot's, and what it refuses."""

import math

import numpy as np
import pytest

from ballbot import InputError
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.friction_laws import Classical
from ballbot.robot import Friction


def test_classical_is_the_robots_law():
    law = Classical(viscous=0.014, coulomb=0.11, stribeck=0.05, stribeck_speed=0.6, stribeck_exponent=1.1)
    friction = Friction(
        viscous=(law.viscous,),
        coulomb=(law.coulomb,),
        stribeck=(law.stribeck,),
        stribeck_speed=law.stribeck_speed,
        stribeck_exponent=law.stribeck_exponent,
        rolling=0.0,
    )
    speeds = np.linspace(-5.0, 5.0, 41)
    ours = law.steady_friction(speeds)
    np.testing.assert_allclose(ours, wheel_friction(speeds[:, None], friction)[:, 0], rtol=1e-12)


NONSENSE = [
    ({"viscous": -0.1, "coulomb": 1.0}, "viscous"),
    ({"viscous": 0.0, "coulomb": math.nan}, "coulomb"),
    ({"viscous": 0.0, "coulomb": 1.0, "stribeck_speed": 0.0}, "stribeck_speed"),
]


@pytest.mark.parametrize(("values", "named"), NONSENSE)
def test_impossible_values_are_refused_by_name(values, named):
    with pytest.raises(InputError, match=named):
        Classical(**values)
