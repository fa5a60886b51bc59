"""A DServer in a process of its own, over pipes: messages in, and after each commit what it sends out.

    python -m tests.runtime.servers.data_child STORE

Each message has its length before it, four bytes, little end first.
"""

from __future__ import annotations

import os
import sys
import time

from colony.runtime.protocol import codec
from colony.runtime.protocol.messages import Reply, Send
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.sqlite import SqliteStore


def framed(data: bytes) -> bytes:
    return len(data).to_bytes(4, "little") + data


def split(data: bytes) -> tuple[list[bytes], bytes]:
    """The whole messages in some bytes, and the rest."""
    found = []
    while len(data) >= 4 and len(data) - 4 >= (size := int.from_bytes(data[:4], "little")):
        found.append(data[4 : 4 + size])
        data = data[4 + size :]
    return found, data


def main() -> None:
    server = DServer(store=SqliteStore(sys.argv[1]))
    list(server.start(time.monotonic_ns()))
    rest = b""
    while data := os.read(0, 4096):
        messages, rest = split(rest + data)
        effects = [e for m in messages for e in server.handle(codec.decode(m), time.monotonic_ns())]
        server.settle()
        replies = [e.message for e in effects if isinstance(e, Send) and isinstance(e.message, Reply)]
        for reply in replies:
            os.write(1, framed(codec.encode(reply)))


if __name__ == "__main__":
    main()
