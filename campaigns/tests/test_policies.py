"""Small samples of the campaigns on learned policies; `make evidence` runs the whole."""

import pytest

from ballbot.learning.ppo import Training
from campaigns import randomisation, section

TINY = Training(lanes=40, decisions=8, updates=2, batches=2)


@pytest.mark.sample
def test_policies_of_each_kind_are_tried_on_a_true_robot(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(section, "BUILD", tmp_path)
    monkeypatch.setattr(randomisation, "RUNS", {"loop": 2, "twin": 1})
    monkeypatch.setattr(randomisation, "DURATION", 3.0)
    seed = randomisation.HELD_OUT[0]
    robot = randomisation.identified(seed)
    for kind in randomisation.KINDS:
        run = randomisation.PolicyRun(task="drive", kind=kind, seed=seed, robot=robot, training=TINY)
        trials = randomisation.tried((run, randomisation.policy_of(run)))
        assert [len(runs) for runs in trials.values()] == [2, 1]
        assert all(0.0 < trial.reward <= 1.0 for runs in trials.values() for trial in runs)
