"""Pieces of work over a Dask cluster: `pip install 'ballbot[cluster]'`, a scheduler, workers with the same packages.

Workers may come, go and be killed: the scheduler does again what was lost with them. A piece of work has the same bits
wherever it is done as long as the packages and the processor's kind are the same, and a worker of which they are
not refuses.
"""

from __future__ import annotations

import hashlib
import pickle
import warnings
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import cast

from distributed import Client, Future, as_completed
from distributed.client import FutureCancelledError
from distributed.scheduler import KilledWorker

from ballbot.errors import InputError
from ballbot.fitting.run import ExecutorError, Piece, Result, Shared
from ballbot.fitting.sweep import machine

_KINDS = ("tcp", "tls", "ws", "wss", "ucx")  #: of addresses
_PATIENCE = 30.0  #: how long a scheduler, and then a first worker, is waited for [s]
_TASKS_A_THREAD = (
    4  #: pieces are sent in so many lots for each thread of the cluster, to even out their lengths
)
_KEPT = 8  #: so many different shared things are kept on the cluster


class Cluster:
    """The workers of a Dask scheduler, as an `Executor` and as `Workers`; a context manager that ends the connection.

    Parameters
    ----------
    address : str
        The scheduler's, such as "tcp://10.0.0.5:8786".

    Raises
    ------
    InputError
        If that is no address.
    ExecutorError
        If no scheduler answers there, or no worker joins it.
    """

    def __init__(self, address: str) -> None:
        check_address(address)
        try:
            self._client = Client(address, timeout=_PATIENCE, set_as_default=False)
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise ExecutorError(f"There is no Dask cluster with a worker at {address!r}: {error}.") from None
        self._address = address
        self._shared: OrderedDict[str, Future] = OrderedDict()

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the connection; the cluster stays."""
        self._shared.clear()
        self._client.close()

    def __call__(
        self, function: Callable[[Shared, Piece], Result], shared: Shared, pieces: Sequence[Piece]
    ) -> list[Result]:
        """Return [function(shared, piece) for piece in pieces].

        Raises
        ------
        ExecutorError
            If a worker's packages or processor are others than here, or the cluster is lost.
        """
        lots = self._lots(pieces)
        with self._connected():
            held = self._hold(shared)
            futures = [self._submit(function, held, lot) for lot in lots]
            done = cast("list[list[Result]]", self._client.gather(futures))
        return [result for lot in done for result in lot]

    def each(
        self, make: Callable[[Piece], Result], pieces: Sequence[Piece]
    ) -> Generator[tuple[int, Result], None, None]:
        """Yield the place and the result of each piece, as they are finished; see `ballbot.fitting.sweep.Workers`.

        Raises
        ------
        ExecutorError
            As a call.
        """
        with self._connected():
            held = self._hold(make)
            places = {self._submit(_made, held, [piece]): place for place, piece in enumerate(pieces)}
            for future in as_completed(list(places), loop=self._client.loop):
                (result,) = cast("list[Result]", future.result())
                place = places.pop(future)  # with the last hold on it, the cluster forgets the result
                del future
                yield place, result

    def _submit(
        self, function: Callable[[Shared, Piece], Result], held: Future, lot: Sequence[Piece]
    ) -> Future:
        return self._client.submit(_run_lot, function, held, lot, machine(), pure=False, retries=0)

    @contextmanager
    def _connected(self) -> Iterator[None]:
        """Turn what Dask raises if the cluster is lost into one sentence."""
        try:
            yield
        except (KilledWorker, FutureCancelledError, OSError, TimeoutError) as error:
            raise ExecutorError(
                f"The connection to the Dask cluster at {self._address!r} was lost: {error}."
            ) from None

    def _lots(self, pieces: Sequence[Piece]) -> list[Sequence[Piece]]:
        threads = sum(cast("dict[str, int]", self._client.nthreads()).values()) or 1
        lots = min(len(pieces), _TASKS_A_THREAD * threads)
        edges = [round(number * len(pieces) / lots) for number in range(lots + 1)] if lots else [0]
        return [pieces[first:end] for first, end in pairwise(edges)]

    def _hold(self, shared: object) -> Future:
        """Send what pieces share once; as the result of a task, so that it is made again where its worker is lost."""
        data = pickle.dumps(shared)
        key = hashlib.sha256(data).hexdigest()
        if key not in self._shared:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="Sending large graph")
                self._shared[key] = self._client.submit(pickle.loads, data, pure=False)
        self._shared.move_to_end(key)
        while len(self._shared) > _KEPT:
            self._shared.popitem(last=False)
        return self._shared[key]


def _made(make: Callable[[Piece], Result], piece: Piece) -> Result:
    return make(piece)


def check_address(address: str) -> None:
    """Do nothing if a text is the address of a scheduler: a host and a port.

    Raises
    ------
    InputError
        If it is not; Dask would wait for a minute and fail.
    """
    host, _, port = address.removeprefix(f"{address.partition('://')[0]}://").rpartition(":")
    kind = address.partition("://")[0] if "://" in address else "tcp"
    if (
        kind not in _KINDS
        or not host
        or not (port.isascii() and port.isdigit() and 0 < int(port[:6]) < 2**16)
    ):
        raise InputError(
            f"--cluster is {address!r}; it must be the address of a "
            "Dask scheduler with its port, such as tcp://10.0.0.5:8786."
        )


def _run_lot(
    function: Callable[[Shared, Piece], Result],
    shared: Shared,
    pieces: Sequence[Piece],
    asked_from: dict[str, str],
) -> list[Result]:
    """Do a lot of pieces; runs on a worker."""
    here = machine()
    differing = [name for name in asked_from if here[name] != asked_from[name]]
    if differing:
        name = differing[0]
        raise ExecutorError(
            f"A worker of the cluster has {name} {here[name]} and this process has {asked_from[name]}; "
            "use the same versions and processors everywhere, or results would depend on the worker."
        )
    return [function(shared, piece) for piece in pieces]
