"""Work over a Dask cluster: the same bits as in one process, also where a worker is killed on the way."""

import json
import operator
import os
import signal
import socket
from collections.abc import Iterator
from threading import Timer

import pytest

from ballbot.errors import InputError
from ballbot.fitting.run import Executor, Run, Threads
from ballbot.identification import Identification, Progress, identify
from ballbot.identification.identify import IdentificationOptions
from ballbot.progress import ProgressCallback, ignore_progress
from tests.support.control_examples import alten
from tests.support.identification_examples import balancing_log, noisy

distributed = pytest.importorskip("distributed")

from ballbot.fitting import cluster as module  # noqa: E402
from ballbot.fitting.cluster import Cluster  # noqa: E402


@pytest.fixture(scope="module")
def local() -> Iterator[distributed.LocalCluster]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as made:
        yield made


@pytest.fixture
def cluster(local: distributed.LocalCluster) -> Iterator[Cluster]:
    with Cluster(local.scheduler_address) as made:
        yield made


def quick(*, executor: Executor, report: ProgressCallback = ignore_progress) -> Identification:
    log = noisy(balancing_log(), seed=2).between(6.0, 10.0)
    options = IdentificationOptions(most_steps=2, step=2.5e-3, most_profiles=1)
    run = Run(executor=executor, progress=report)
    return identify(alten(), log, window=0.1, seed=3, options=options, run=run)


@pytest.mark.slow
def test_an_identification_ends_in_the_same_bytes_though_a_worker_is_killed_on_the_way(local, cluster):
    alone = quick(executor=Threads(count=1))
    killed, due = [], {("search", 3)}

    def kill_a_worker(progress: Progress) -> None:
        if (progress.stage, progress.done) in due:
            due.remove((progress.stage, progress.done))
            worker = next(iter(local.workers.values()))
            killed.append(worker.pid)
            # while the next step is computed
            Timer(0.03, os.kill, (worker.pid, signal.SIGKILL)).start()

    spread = quick(executor=cluster, report=kill_a_worker)
    assert len(killed) == 1
    assert json.dumps(spread.to_dict()) == json.dumps(alone.to_dict())


@pytest.mark.slow
def test_workers_of_another_kind_are_refused(cluster, monkeypatch):
    other = module.machine() | {"numba": "0.1"}
    monkeypatch.setattr(module, "machine", lambda: other)
    with pytest.raises(InputError, match=r"A worker of the cluster has numba \S+ and this process has 0\.1"):
        cluster(operator.mul, 1, [1])


def test_missing_cluster_ends_in_one_sentence(monkeypatch):
    monkeypatch.setattr(module, "_PATIENCE", 0.5)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listened to: no one answers
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(InputError, match="There is no Dask cluster with a worker at"):
            Cluster(address)
    with pytest.raises(InputError, match="--cluster is 'nonsense://a:1'; it must be the address"):
        Cluster("nonsense://a:1")
