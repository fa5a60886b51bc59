"""Work on a Dask cluster, on one machine or many. Dask is imported only when used."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from importlib import import_module
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from colony.experiment.parallel import WorkersLostError
from colony.extras import expect_extras

T = TypeVar("T")
R = TypeVar("R")

CONNECT_TIMEOUT_S = 10.0
"""Timeout in seconds for connecting to a scheduler."""


class DaskEngine:
    """An engine that does the work on the workers of a cluster.

    Args:
        address: the address of the scheduler, `tcp://HOST:8786`; "" starts a cluster on this machine, which
            ends with the work.
        workers: the number of processes of a local cluster; by default one per core.
    """

    def __init__(self, address: str = "", workers: int | None = None) -> None:
        self._address = address
        self._workers = workers

    def results(self, work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yield the result of `work` for each item, as the Dask workers finish them."""
        expect_extras("dask")
        distributed: Any = import_module("distributed")
        with ExitStack() as resources:
            client = self._client(distributed, resources)
            try:
                futures = client.map(work, items, pure=False)
                for future in distributed.as_completed(futures):
                    result: R = future.result()
                    yield result
                    future.release()
            except distributed.KilledWorker as problem:
                raise WorkersLostError(f"workers of the cluster died: {problem}") from None

    def _client(self, distributed: Any, resources: ExitStack) -> Any:
        if self._address:
            try:
                return resources.enter_context(distributed.Client(self._address, timeout=CONNECT_TIMEOUT_S))
            except (OSError, ValueError) as problem:  # ValueError: not an address
                where = f"no Dask scheduler at {self._address}"
                raise WorkersLostError(
                    f"{where}: {problem}; expected an address such as tcp://HOST:8786"
                ) from None
        cluster = distributed.LocalCluster(
            n_workers=self._workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            local_directory=resources.enter_context(TemporaryDirectory(prefix="colony-dask-")),
        )
        resources.enter_context(cluster)
        return resources.enter_context(distributed.Client(cluster))
