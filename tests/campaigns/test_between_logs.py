"""A sample of the campaign on intervals between logs: its twins, and its verdict on logs made by the statistics."""

from __future__ import annotations

import numpy as np
import pytest

from ballbot.fitting.between_logs import Limits95
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.parameters import Bounds
from ballbot.identification.variation import LogEstimates
from ballbot.twin.scenario import check_scenario
from campaigns.between_logs import ROBOT, Fit, drawn, fitted_priors, judge, references_of

VALUES = np.array([0.02] * 3 + [0.1] * 3 + [0.05] * 3 + [0.6, 1.1, 0.01])


@pytest.mark.parametrize("seed", [0, 1, 17, 1000, 1007])
def test_twins_have_all_faults_and_can_be_simulated(seed: int) -> None:
    twin = drawn(seed)
    check_scenario(twin, ROBOT)
    assert twin == drawn(seed)
    assert twin != drawn(seed + 1)
    faults = (twin.load_dependence, twin.softness, twin.compliance, twin.current_loop, twin.supply)
    more = (twin.payload, twin.roughness, twin.timing, twin.sensor_faults)
    assert None not in (*faults, *more)
    assert set(references_of(seed)) <= {"square", "figure_eight"}


def pair(random: np.random.Generator) -> tuple[Fit, Fit]:
    """Return the fits of two logs of a robot: errors of 5 % within a log, and variations of 10 % between logs."""
    coordinates = estimated_parameters(ROBOT, free=("friction",), law="stribeck", bounds=Bounds())
    fits = []
    for _ in range(2):
        values = VALUES * np.exp(0.1 * random.standard_normal(12) + 0.05 * random.standard_normal(12))
        scaled = coordinates.scaled(values)
        half = 1.96 * 0.05 * values
        fits.append(
            Fit(
                coordinates=coordinates,
                values=values,
                conditional={
                    label: Limits95(lower=float(low), upper=float(high))
                    for label, low, high in zip(coordinates.labels, values - half, values + half, strict=True)
                },
                by_log=LogEstimates(
                    points=scaled[None], errors=(0.05 * values / coordinates.slopes(scaled))[None]
                ),
            )
        )
    return fits[0], fits[1]


@pytest.mark.slow
def test_predictions_hold_the_other_log_and_the_conditional_intervals_do_not() -> None:
    random = np.random.default_rng(1)
    priors = fitted_priors([pair(random) for _ in range(12)])
    judged = [one for _ in range(40) for one in judge(pair(random), priors)]
    predicted = np.mean([one.prediction.lower <= one.value <= one.prediction.upper for one in judged])
    conditional = np.mean([one.conditional.lower <= one.value <= one.conditional.upper for one in judged])
    # 480 estimates, 95 %; the prior of 12 robots errs by a fifth, which is four per cent of coverage
    assert predicted > 0.9
    assert conditional < 0.75
