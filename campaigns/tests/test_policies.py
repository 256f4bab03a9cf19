"""Small samples of the campaigns on learned policies; `make evidence` runs the whole."""

import pytest

from ballbot.fitting.run import Threads
from ballbot.learning.ppo import Training
from campaigns import randomisation, section

TINY = Training(lanes=40, decisions=8, updates=2, batches=2)


@pytest.mark.sample
def test_policies_are_the_same_bytes_though_a_worker_of_the_cluster_is_killed(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    from campaigns.killed_policies import files_of, killed_files, sweep

    monkeypatch.setattr(section, "BUILD", tmp_path)
    runs = sweep(1, TINY)
    alone = files_of("alone", runs, workers=Threads(count=1))
    there, killed = killed_files("cluster", runs)
    assert killed == 3
    assert len(runs) == len(set(alone.values())) == 4
    assert there == alone


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
