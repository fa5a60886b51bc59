"""The greeting of a page: it and the server prove to each other that they know the token."""

from __future__ import annotations

import asyncio

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from colony.watch.peer import is_stranger
from colony.watch.security import PROTOCOL, Guard, new_nonce

REFUSED = 4403
"""Close code of a WebSocket that is not admitted."""

PROOF_TIMEOUT_S = 10.0
"""Maximum seconds to wait for the proof of a page."""


class Greeting(msgspec.Struct, frozen=True, kw_only=True):
    """What the server sends first: a nonce for the page, and its proof for the nonce of the page."""

    nonce: str
    proof: str


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """What a page answers: its proof for the nonce of the server."""

    proof: str


async def greet(socket: WebSocket, guard: Guard) -> bool:
    """Return True if a WebSocket is one of our own page, which knows the token; close it otherwise.

    Those of other users are closed at once: one of them might pass on what a page says that has connected
    to them while there was no server.
    """
    offered = guard.nonce(socket.headers, tuple(socket.scope.get("subprotocols", ())))
    if offered is None or socket.client is None or is_stranger(socket.client.port, guard.port):
        await socket.close(REFUSED)
        return False
    await socket.accept(subprotocol=PROTOCOL)
    nonce = new_nonce()
    greeting = Greeting(nonce=nonce, proof=guard.proof(offered))
    try:
        await socket.send_text(msgspec.json.encode(greeting).decode())
        text = await asyncio.wait_for(socket.receive_text(), PROOF_TIMEOUT_S)
        if guard.accepts(msgspec.json.decode(text, type=Reply).proof, nonce):
            return True
        await socket.close(REFUSED)
    except WebSocketDisconnect:
        pass
    except (TimeoutError, KeyError, msgspec.MsgspecError):  # KeyError: the message is binary
        await socket.close(REFUSED)
    return False
