"""The greeting of a page: it is one of this user, and both sides prove that they know the token."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
from starlette.datastructures import Address
from starlette.websockets import WebSocket, WebSocketDisconnect

from colony.watch.peers import is_of, own_users
from colony.watch.security import LOOPBACK, PROTOCOL, Admission, new_nonce

REFUSED = 4403
"""Close code of a WebSocket that is not admitted."""

PROOF_TIMEOUT_S = 10.0
"""Maximum seconds to wait for the proof of a page."""

MAX_STRANGERS = min(64, os.sysconf("SC_OPEN_MAX") // 16)
"""Maximum number of open connections that are not of an admitted page; browsers open six a page.

As many again may be accepted at once, a few times, before the excess is closed.
"""


class Strangers:
    """The open connections that are not of an admitted page: a new one too many closes the oldest. Mutable.

    A connection is counted before it sends a byte, so that silent connections use up no descriptors.
    """

    def __init__(self) -> None:
        self._transports: dict[tuple[str, int] | None, asyncio.Transport] = {}

    def add(self, transport: asyncio.Transport) -> None:
        """Count a connection."""
        self._transports = {at: known for at, known in self._transports.items() if not known.is_closing()}
        self._transports[transport.get_extra_info("peername")] = transport
        if len(self._transports) > MAX_STRANGERS:
            self._transports.pop(next(iter(self._transports))).abort()

    @contextmanager
    def admitted(self, client: Address | None) -> Iterator[None]:
        """Keep the connection of a client open as long as the context lasts."""
        transport = self._transports.pop(client, None)
        try:
            yield
        finally:
            if transport is not None:
                self.add(transport)


class Greeting(msgspec.Struct, frozen=True, kw_only=True):
    """What the server sends first: a nonce for the page, and its proof for the nonce of the page."""

    nonce: str
    proof: str


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """What a page answers: its proof for the nonce of the server."""

    proof: str


def _is_of_user(socket: WebSocket, admission: Admission) -> bool:
    client = socket.client
    return client is not None and is_of(
        own_users(os.environ, os.getuid()), (client.host, client.port), (LOOPBACK, admission.port)
    )


async def greet(socket: WebSocket, admission: Admission) -> bool:
    """Return True if a WebSocket is one of our own page, which knows the token; close it otherwise."""
    offered = admission.nonce(socket.headers, tuple(socket.scope.get("subprotocols", ())))
    if offered is None or not _is_of_user(socket, admission):
        await socket.close(REFUSED)
        return False
    await socket.accept(subprotocol=PROTOCOL)
    nonce = new_nonce()
    greeting = Greeting(nonce=nonce, proof=admission.proof(offered))
    try:
        await socket.send_text(msgspec.json.encode(greeting).decode())
        text = await asyncio.wait_for(socket.receive_text(), PROOF_TIMEOUT_S)
        if admission.accepts(msgspec.json.decode(text, type=Reply).proof, nonce):
            return True
        await socket.close(REFUSED)
    except WebSocketDisconnect:
        pass
    except (TimeoutError, KeyError, msgspec.MsgspecError):  # KeyError: the message is binary
        await socket.close(REFUSED)
    return False
