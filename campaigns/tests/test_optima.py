"""A small sample of the campaign in campaigns/optima.py; `make evidence` runs the whole."""

import pytest

from ballbot.identification.identify import IdentificationOptions
from campaigns.optima import Task, ends_of
from campaigns.twin_logs import twin_log

pytest.importorskip("mujoco")


@pytest.mark.sample
def test_fit_ends_no_higher_than_from_random_starts():
    log = twin_log("square", duration=24.0, seed=1)
    ends = ends_of(Task(robot="alten", log=log, options=IdentificationOptions()), starts=4, processes=1)
    # windows that settle from random starts leave 1e-4 of chance in either cost
    assert ends.searched.cost < min(end.cost for end in ends.drawn) + 2e-4
