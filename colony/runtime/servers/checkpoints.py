"""Checkpoints at DServer: the memory of a program's clients, for the processes that replace lost clients.

DServer accepts checkpoints only of clients of the deployed program.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import msgspec

from colony.ir.servers import DSERVER
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Checkpoint, Recall, Send
from colony.runtime.servers.bounds import Bound
from colony.runtime.store.store import Journal, Key

MAX_MEMORY_BYTES = 1 << 20
"""Byte limit of the memory in one checkpoint."""

MAX_TOTAL_BYTES = 1 << 24
"""Byte limit of all checkpoints; each counts its memory, its name and `OVERHEAD`."""

OVERHEAD = 100

_RUN = Key("fact", "run")
_CLIENTS = Key("fact", "clients")


class Checkpoints:
    """The newest checkpoint of each client, by address. Mutable; changes are written to the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._newest: dict[str, Checkpoint] = {}
        self._bound = Bound("checkpoints", MAX_TOTAL_BYTES, in_bytes=True)
        self._used = 0
        self._run: str | None = None
        self._clients: frozenset[str] = frozenset()

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return self._bound.limit_messages(self._used)

    def put(self, checkpoint: Checkpoint) -> None:
        """Keep a checkpoint of a client of the program, unless it is too large or outdated."""
        client = checkpoint.client
        if client not in self._clients:
            return
        previous = self._newest.get(client)
        if previous is not None and (checkpoint.start, checkpoint.k) <= (previous.start, previous.k):
            return
        used = self._used + _size(checkpoint) - (0 if previous is None else _size(previous))
        if len(checkpoint.memory) > MAX_MEMORY_BYTES or not self._bound.allows(used):
            return
        self._used = used
        self._newest[client] = checkpoint
        self._journal.put(Key("checkpoint", client), _encode(checkpoint))

    def recall(self, recall: Recall) -> Iterator[Send]:
        """Send a client its newest checkpoint; ignore a client that is not of the deployed program."""
        if recall.client in self._clients:
            empty = Checkpoint(client=recall.client, k=-1, start=-1, memory=b"")
            newest = self._newest.get(recall.client, empty)
            yield Send(topics.recall_answers(DSERVER.name, recall.client), newest)

    def begin(self, run: str, clients: Iterable[str]) -> None:
        """Begin a run with these clients; drop all checkpoints if the run is new."""
        if run == self._run:
            return
        for client in self._newest:
            self._journal.drop(Key("checkpoint", client))
        self._newest.clear()
        self._used = 0
        self._run, self._clients = run, frozenset(clients)
        self._journal.put(_RUN, run.encode())
        self._journal.put(_CLIENTS, _encode(sorted(self._clients)))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the checkpoints, their run and its clients from the entries of a store."""
        run = entries.get(_RUN)
        self._run = None if run is None else run.decode()
        if _CLIENTS in entries:
            self._clients = _clients.decode(entries[_CLIENTS])
        for key, data in entries.items():
            if key.kind == "checkpoint":
                self._newest[key.name] = _checkpoints.decode(data)
                self._used += _size(self._newest[key.name])


def _size(checkpoint: Checkpoint) -> int:
    return len(checkpoint.memory) + len(checkpoint.client) + OVERHEAD


_encode = msgspec.msgpack.Encoder().encode
_checkpoints = msgspec.msgpack.Decoder(Checkpoint)
_clients = msgspec.msgpack.Decoder(frozenset[str])
