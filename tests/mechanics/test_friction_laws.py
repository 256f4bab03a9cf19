"""The friction law of one driveline: it is the robot's, and what it refuses."""

import math

import pytest

from ballbot import InputError
from ballbot.mechanics.friction_laws import Classical

NONSENSE = [
    ({"viscous": -0.1, "coulomb": 1.0}, "viscous"),
    ({"viscous": 0.0, "coulomb": math.nan}, "coulomb"),
    ({"viscous": 0.0, "coulomb": 1.0, "stribeck_speed": 0.0}, "stribeck_speed"),
]


@pytest.mark.parametrize(("values", "named"), NONSENSE)
def test_impossible_values_are_refused_by_name(values, named):
    with pytest.raises(InputError, match=named):
        Classical(**values)
