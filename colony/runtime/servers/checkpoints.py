"""What clients of a network give DServer to keep: their memory, for the process that comes after them."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from colony.runtime import topics
from colony.runtime.fields import DSERVER
from colony.runtime.messages import Checkpoint, Recall, Send
from colony.runtime.store import Journal, Key

MEMORY_BYTES = 1 << 20
"""Of the largest memory that is kept."""

SPACE = 1 << 26
"""Bytes of all that are kept; each counts for its name and `OVERHEAD` more."""

OVERHEAD = 100

_RUN = Key("fact", "run")


class Checkpoints:
    """Mutable: the newest checkpoint of each client, by address. Goes into the journal as it changes."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._newest: dict[str, Checkpoint] = {}
        self._space = SPACE
        self._run: str | None = None

    def keep(self, checkpoint: Checkpoint) -> None:
        """Keep it, unless it is older than what is here, or too large."""
        client, size = checkpoint.client, _size(checkpoint)
        known = self._newest.get(client)
        if known is not None and (checkpoint.start, checkpoint.k) <= (known.start, known.k):
            return
        room = self._space + (0 if known is None else _size(known))
        if len(checkpoint.memory) > MEMORY_BYTES or size > room:
            return
        if not 0 < len(client.encode(errors="replace")) <= 255:
            return
        self._space = room - size
        self._newest[client] = checkpoint
        self._journal.put(Key("checkpoint", client), _encode(checkpoint))

    def recall(self, recall: Recall) -> Send:
        """The answer to a client that asks for its newest."""
        none = Checkpoint(client=recall.client, k=-1, start=-1, memory=b"")
        found = self._newest.get(recall.client, none)
        return Send(topics.recalled(DSERVER.name, recall.client), found)

    def begin(self, run: str) -> None:
        """Another run begins: what was kept is of no use to it. The same run again is nothing."""
        if run == self._run:
            return
        for client in self._newest:
            self._journal.drop(Key("checkpoint", client))
        self._newest.clear()
        self._space = SPACE
        self._run = run
        self._journal.put(_RUN, run.encode())

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Take over what a store had of the kind "checkpoint"."""
        run = entries.get(_RUN)
        self._run = None if run is None else run.decode()
        for key, data in entries.items():
            if key.kind == "checkpoint":
                self._newest[key.name] = _checkpoints.decode(data)
                self._space -= _size(self._newest[key.name])


def _size(checkpoint: Checkpoint) -> int:
    return len(checkpoint.memory) + len(checkpoint.client) + OVERHEAD


_encode = msgspec.msgpack.Encoder().encode
_checkpoints = msgspec.msgpack.Decoder(Checkpoint)
