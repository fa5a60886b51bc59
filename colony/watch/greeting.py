"""The greeting of a page: it is one of this user, and both sides prove that they know the token."""

from __future__ import annotations

import asyncio
import os

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from colony.watch.peers import is_of, own_users
from colony.watch.security import LOOPBACK, PROTOCOL, Admission, new_nonce

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
