"""The server of pages: in a thread of its own, on the loopback interface alone."""

from __future__ import annotations

import asyncio
import socket
import threading
from contextlib import ExitStack
from typing import cast

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from colony.watch.app import build_app
from colony.watch.greeting import MAX_STRANGERS, Strangers
from colony.watch.requests import MAX_REQUEST_BYTES
from colony.watch.security import LOOPBACK, Admission
from colony.watch.shown import Shown
from colony.watch.watched import Watched

DEFAULT_PORT = 7450

END_S = 1
"""Grace period of open pages at the end, in seconds."""


class PageServer:
    """A server that runs until it is closed. Mutable.

    Args:
        watched: the run that it shows first.
        port: its port; None for the default one, or any if that is taken.
        token: what pages must know.

    Raises:
        OSError: the port is taken.
    """

    def __init__(self, watched: Watched, *, port: int | None, token: str) -> None:
        self._shown = Shown(watched)
        with ExitStack() as resources:
            listener = resources.enter_context(_listener(port))
            self.port: int = listener.getsockname()[1]
            admission = Admission(port=self.port, token=token)
            self.host = admission.host
            """Address and port of the server."""
            self.url = f"http://{admission.host}/#{token}"
            """Address of the page, with its token."""
            strangers = Strangers()

            class Counted(H11Protocol):
                def connection_made(self, transport: asyncio.BaseTransport) -> None:
                    super().connection_made(cast(asyncio.Transport, transport))
                    strangers.add(cast(asyncio.Transport, transport))

            config = uvicorn.Config(
                build_app(self._shown, admission, strangers),
                loop="asyncio",
                http=Counted,
                backlog=MAX_STRANGERS,
                proxy_headers=False,  # they would let a client claim the address of another
                log_level="critical",
                access_log=False,
                lifespan="off",
                ws="websockets-sansio",
                ws_max_size=MAX_REQUEST_BYTES,
                ws_per_message_deflate=False,
                server_header=False,
                timeout_graceful_shutdown=END_S,
            )
            self._server = uvicorn.Server(config)
            self._thread = threading.Thread(
                target=self._server.run, kwargs={"sockets": [listener]}, name="pages", daemon=True
            )
            self._thread.start()
            self._resources = resources.pop_all()

    def show(self, watched: Watched) -> None:
        """Show another run; pages come back for it. The one before may be closed afterwards."""
        self._shown.show(watched)

    def close(self) -> None:
        """Close all pages' connections, and end. Idempotent."""
        self._server.should_exit = True
        self._thread.join()
        self._resources.close()

    def __enter__(self) -> PageServer:
        """Return the server."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End."""
        self.close()


def _listener(port: int | None) -> socket.socket:
    """Return a socket that listens on the port."""
    try:
        return _bound(DEFAULT_PORT if port is None else port)
    except OSError:
        if port is not None:
            raise
        return _bound(0)


def _bound(port: int) -> socket.socket:
    with ExitStack() as resources:
        listener = resources.enter_context(socket.socket())
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((LOOPBACK, port))
        listener.listen()
        resources.pop_all()
        return listener
