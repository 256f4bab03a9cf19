"""The twins of the campaign on intervals between logs."""

from __future__ import annotations

import pytest

from ballbot.twin.scenario import check_scenario
from campaigns.between_logs import ROBOT, drawn, references_of


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
