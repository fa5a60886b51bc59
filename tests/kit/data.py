"""A DServer on a stage, which can be killed and started again, and a store that is full."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from colony.runtime.protocol.messages import ServerFrame, Tick
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.store import Key, MemoryStore, Store, StoreFullError
from tests.kit.node_stage import NodeStage, S


class Cramped(MemoryStore):
    """A store in memory that has room, or has not. Mutable: whether it has."""

    def __init__(self) -> None:
        super().__init__()
        self.room = True
        self.commits = 0

    def check_space(self) -> None:
        self.full = None if self.room else "no room"

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        self.commits += 1
        if not self.room:
            self.full = "no room"
            raise StoreFullError(self.full)
        super().commit(changes)


class DataStage(NodeStage):
    """One DServer, that can be killed and started again."""

    node: DServer

    def __init__(self, store: Store | None = None, **options: Any) -> None:
        self.store: Store = MemoryStore() if store is None else store
        self.options = options
        super().__init__(self._server(), S)

    def _server(self) -> DServer:
        return DServer(store=self.store, **{"frames_kept": 40} | self.options)

    def kill_and_restart(self) -> None:
        """As by SIGKILL: what was not committed is gone."""
        self.start(self._server())

    def frame(self, k: int, run: str = "") -> ServerFrame:
        """The frame of tick `k`, which is now."""
        return self.server_frame(Tick(k=k, t_ns=self.now_ns, run=run))

    def fields(self, k: int, run: str = "") -> dict[str, Any]:
        return {name: s.value for name, s in self.frame(k, run).fields.items() if s is not None}
