"""Jobs computed in other processes ahead of being asked for, so that a checkpoint gets their results in order."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Generic, TypeVar

from ballbot.fitting.run import ExecutorError, uninterrupted, worker_pool

Job = TypeVar("Job")
Result = TypeVar("Result")


class RunAhead(Generic[Job, Result]):
    """Results of jobs, in order: from the first that is asked for, the rest are computed in other processes.

    A job whose result is on file is not asked for, and not computed. Use it in a `with` block.

    Parameters
    ----------
    work : callable
        Returns a job's result; it and the jobs are pickled if there is more than one process.
    jobs : sequence
    processes : int, optional
        One for each core by default; with one, all is computed in this process.
    """

    def __init__(
        self, work: Callable[[Job], Result], jobs: Sequence[Job], *, processes: int | None = None
    ) -> None:
        self._work, self._jobs, self._processes = work, jobs, processes or os.cpu_count() or 1
        self._pool: ProcessPoolExecutor | None = None
        self._ahead: dict[int, Future[Result]] = {}

    def __enter__(self) -> RunAhead[Job, Result]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool:
            self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def result(self, place: int) -> Result:
        """Return the result of the job at that place; those before it are not computed any more.

        Raises
        ------
        SpreadError
            If a process was killed.
        """
        workers = min(self._processes, len(self._jobs) - place)
        if workers < 2 and not self._pool:
            return self._work(self._jobs[place])
        if not self._pool:
            self._pool = worker_pool(workers)
            with uninterrupted():
                for later in range(place, len(self._jobs)):
                    self._ahead[later] = self._pool.submit(self._work, self._jobs[later])
        try:
            return self._ahead.pop(place).result()
        except BrokenProcessPool:
            raise ExecutorError(
                "A worker process was killed, perhaps because memory ran out. Finished runs are kept; "
                "continue with --resume."
            ) from None
