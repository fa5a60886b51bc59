"""A DServer on a stage, which can be killed and started again, and a store that is full."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from colony.ir.servers import DSERVER
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import Checkpoint, Effect, Recall, Request, ServerFrame, Tick
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.store import Key, MemoryStore, Store, StoreFullError
from tests.kit.node_stage import MS, NodeStage, S, messages


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

    def tick(self, k: int, run: str = "run") -> list[Effect]:
        """Begin frame `k` of a run, which is now."""
        return self.handle(Tick(k=k, t_ns=self.now_ns, run=run))

    def recalled(self, client: str = "drive/go") -> Checkpoint:
        """Return the checkpoint with which it answers a client that has lost its memory."""
        (found,) = messages(self.handle(Recall(client=client)), Checkpoint)
        return found


# --- what is deployed to it ------------------------------------------------------------------------


def field(name: str, kind: Any = "number") -> ActuatorFieldSpec:
    return ActuatorFieldSpec(name=name, kind=kind, factor=1.0, low=None, high=None)


def table(
    name: str,
    *fields: ActuatorFieldSpec,
    server: str = DSERVER.name,
    clients: tuple[tuple[str, int], ...] = (("counter", 1),),
) -> ActuatorSpec:
    return ActuatorSpec(
        name=name,
        fields=fields,
        server=server,
        command=name.title(),
        field_indices=(),
        idle=None,
        on_loss="stop",
        clients=clients,
    )


LAMP, POSE = table("lamp", field("on", "bool")), table("pose", field("x"), field("y"))
DRIVE = table("drive", field("x"), server="RServer", clients=(("go", 1), ("other", 2)))


def program(run: str, *actuators: ActuatorSpec, **options: Any) -> Deployment:
    return Deployment(run=run, program="demo", frame_ns=50 * MS, seed=1, actuators=actuators, **options)


def request(k: int, actuator: str, *values: float | bool) -> Request:
    """Return a request of the client `counter`."""
    return Request(k=k, actuator=actuator, client="counter", bid="command", values=values)


def checkpoint(k: int, start: int = 0, memory: bytes = b"m", client: str = "drive/go") -> Checkpoint:
    return Checkpoint(client=client, k=k, start=start, memory=memory)
