"""Work on a Dask cluster: `pip install 'ballbot[cluster]'`, a scheduler, and workers with the same packages.

Workers may join, leave and be killed: the scheduler repeats the work that was lost with them, and without any worker
the work waits for one. Results are the same to the bit on every worker with the same packages and processor; other
workers refuse the work.
"""

from __future__ import annotations

import hashlib
import pickle
import re
import warnings
from collections import OrderedDict
from collections.abc import Callable, Generator, Sequence
from typing import cast

from distributed import Client, Future, as_completed
from distributed.client import FutureCancelledError
from distributed.scheduler import KilledWorker

from ballbot.errors import InputError
from ballbot.fitting.run import Executor, ExecutorError, Piece, Result
from ballbot.fitting.sweep import machine

#: address of a scheduler; without host and port Dask waits for a minute and fails
_ADDRESS = r"((tcp|tls|ws|wss|ucx)://)?[^/]+:(\d{1,5})"
_PATIENCE = 30.0  #: timeout for the scheduler, and for the first worker [s]
_KEPT = 16  #: shared inputs kept on the cluster


class Cluster(Executor):
    """The workers of a Dask scheduler; a context manager that closes the connection.

    Parameters
    ----------
    address : str
        Of the scheduler, such as "tcp://10.0.0.5:8786".

    Raises
    ------
    InputError
        If the address is invalid.
    ExecutorError
        If no scheduler answers, or no worker joins it.
    """

    def __init__(self, address: str) -> None:
        match = re.fullmatch(_ADDRESS, address, re.ASCII)
        if not (match and 0 < int(match[3]) < 2**16):
            raise InputError(
                f"--cluster is {address!r}; it must be the address of a "
                "Dask scheduler with its port, such as tcp://10.0.0.5:8786."
            )
        try:
            self._client = Client(address, timeout=_PATIENCE, set_as_default=False)
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise ExecutorError(f"There is no Dask cluster with a worker at {address!r}: {error}.") from None
        self._address = address
        self._held: OrderedDict[str, Future] = OrderedDict()

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; the cluster keeps running."""
        self._held.clear()
        self._client.close()

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield each piece's index and result; ExecutorError if a worker differs or the connection is lost."""
        try:
            held, here = self._hold(make), machine()
            indices = {
                self._client.submit(_made, held, piece, here, pure=False, retries=0): index
                for index, piece in enumerate(pieces)
            }
            for future in as_completed(list(indices), loop=self._client.loop):
                result = cast("Result", future.result())
                index = indices.pop(future)  # without a reference to it, the cluster frees the result
                del future
                yield index, result
        except (KilledWorker, FutureCancelledError, OSError, TimeoutError) as error:
            raise ExecutorError(
                f"The connection to the Dask cluster at {self._address!r} was lost: {error}."
            ) from None

    def _hold(self, make: object) -> Future:
        """Send the shared input once, as the result of a task, which is repeated if its worker is lost."""
        data = pickle.dumps(make)
        key = hashlib.sha256(data).hexdigest()
        if key not in self._held:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Sending large graph")
                self._held[key] = self._client.submit(pickle.loads, data, pure=False)
        self._held.move_to_end(key)
        while len(self._held) > _KEPT:
            self._held.popitem(last=False)
        return self._held[key]


def _made(make: Callable[[Piece], Result], piece: Piece, asked_from: dict[str, str]) -> Result:
    """Make a piece on a worker."""
    here = machine()
    for name, asked in asked_from.items():
        if here[name] != asked:
            raise ExecutorError(
                f"A worker of the cluster has {name} {here[name]} and this process has {asked}; "
                "use the same versions and processors everywhere, or results would depend on the worker."
            )
    return make(piece)
