"""Learn policies on a Dask cluster whose workers are killed with kill -9, and compare them with those learned here.

.venv/bin/python -m campaigns.evidence killed_policies
.venv/bin/python -m campaigns.killed_policies 1000000      with at least so many episodes: half an hour of two cores
"""

import math
import os
import pickle
import shutil
import signal
import sys
from collections.abc import Callable, Generator, Mapping, Sequence

from distributed import LocalCluster

from ballbot.control.file import controller_text
from ballbot.fitting.cluster import Cluster
from ballbot.fitting.run import Executor, Piece, Result, Threads
from ballbot.learning.ppo import Training
from campaigns import section
from campaigns.randomisation import PACKAGES, PolicyRun, learned
from campaigns.section import Section, finished
from campaigns.twin_logs import ROBOT

TASKS, KINDS = ("balance", "drive"), ("none", "boxes")
#: of a training, and of each of its episodes [s]
UPDATES, EPISODE = 8, 1.0
#: of the section of the evidence
EPISODES = 20_000
#: share of the policies after which a worker is killed
_KILLED_AFTER = (0.1, 0.5, 0.8)


def two_workers() -> LocalCluster:
    """Return a cluster of this computer that says nothing of workers and clients that are killed."""
    return LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=60)  # pyright: ignore[reportArgumentType]


def address_of(local: LocalCluster) -> str:
    """Return where its scheduler is."""
    return str(local.scheduler_address)  # pyright: ignore[reportAttributeAccessIssue]


class KillingCluster(Cluster):
    """Workers of a local cluster, one of which is killed after each of some numbers of results."""

    def __init__(self, local: LocalCluster, after: Sequence[int]) -> None:
        super().__init__(address_of(local))
        self._local, self._after, self.killed = local, set(after), 0

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the index and the result of each piece as they finish."""
        for count, made in enumerate(super().each(make, pieces), start=1):
            if count in self._after:
                worker = next(iter(self._local.workers.values()))
                os.kill(worker.pid, signal.SIGKILL)
                self.killed += 1
            yield made


def policy_of(run: PolicyRun) -> tuple[str, int]:
    """Learn a policy; return its controller's file and how many episodes ended in its training."""
    made = learned(run)
    return controller_text(made.controller), sum(point.episodes for point in made.curve)


def sweep(seeds: int, training: Training) -> dict[str, PolicyRun]:
    """Return seeds x randomisations x tasks."""
    return {
        f"{task}_{kind}_{seed:04d}": PolicyRun(
            task=task, kind=kind, seed=seed, robot=ROBOT, training=training, episode=EPISODE
        )
        for seed in range(seeds)
        for task in TASKS
        for kind in KINDS
    }


def files_of(name: str, runs: Mapping[str, PolicyRun], *, workers: Executor) -> dict[str, bytes]:
    """Learn the policies that a folder lacks, and return its files."""
    finished(name, policy_of, runs, packages=PACKAGES, workers=workers)
    return {run: (section.BUILD / name / run).read_bytes() for run in runs}


def killed_files(name: str, runs: Mapping[str, PolicyRun]) -> tuple[dict[str, bytes], int]:
    """Return the files of policies learned anew on a cluster, and how many of its workers were killed."""
    shutil.rmtree(section.BUILD / name, ignore_errors=True)
    after = sorted({max(1, round(share * len(runs))) for share in _KILLED_AFTER})
    with two_workers() as local, KillingCluster(local, after) as cluster:
        return files_of(name, runs, workers=cluster), cluster.killed


def campaign(episodes: int = EPISODES) -> Section:
    """Learn the policies twice and return the section of docs/generated/evidence.md."""
    training = Training(updates=UPDATES)
    # at 100 decisions a second, of episodes of at most `EPISODE`
    least = training.updates * training.lanes * training.decisions / (100.0 * EPISODE)
    runs = sweep(math.ceil(episodes / (least * len(TASKS) * len(KINDS))), training)
    alone = files_of("killed_policies/alone", runs, workers=Threads(count=1))
    there, killed = killed_files("killed_policies/cluster", runs)
    ended = sum(pickle.loads(made)[1] for made in there.values())
    same = sum(there[name] == alone[name] for name in runs)
    return Section(
        title="Policies learned on a cluster whose workers are killed",
        before=f"{len(TASKS)} tasks x {len(KINDS)} randomisations x {len(runs) // (len(TASKS) * len(KINDS))} seeds, "
        f"each policy trained by {UPDATES} updates in episodes of {EPISODE:g} s, first in one process, then by a Dask "
        "LocalCluster of 2 workers, of which one is killed with SIGKILL while it works, again and again.",
        columns=["policies", "episodes", "workers killed", "files of the same bytes"],
        rows=[[str(len(runs)), f"{ended:,}", str(killed), f"{same} of {len(runs)}"]],
        after="`python -m campaigns.killed_policies 1000000` does the same with a million episodes.",
    )


if __name__ == "__main__":
    print(campaign(int(sys.argv[1])).markdown())
