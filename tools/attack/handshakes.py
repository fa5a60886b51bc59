"""Connections that stop halfway: they begin TLS, or say nothing at all, and wait."""

from __future__ import annotations

import contextlib
import socket
import ssl
import threading


class HalfOpen:
    """Mutable: the connections that stand, and those that came later.

    Args:
        port: of the gateway, on loopback.
        count: connections from the beginning.
        rate: new ones a second, until the end.
        hello: whether each begins TLS; else it is silent.
    """

    def __init__(self, port: int, *, count: int, rate: float, hello: bool) -> None:
        self._port = port
        self._hello = _client_hello() if hello else b""
        self._sockets: list[socket.socket] = []
        self._ended = threading.Event()
        for _ in range(count):
            self._open()
        self._thread = threading.Thread(target=self._go_on, args=(rate,))
        self._thread.start()

    def _open(self) -> None:
        made = socket.create_connection(("127.0.0.1", self._port), timeout=5)
        made.sendall(self._hello)
        self._sockets.append(made)

    def _go_on(self, rate: float) -> None:
        while rate and not self._ended.wait(1 / rate):
            self._open()

    def standing(self) -> int:
        """Return the number of connections that the gateway has not closed."""
        return sum(not _closed(made) for made in tuple(self._sockets))

    def __len__(self) -> int:
        return len(self._sockets)

    def rest(self) -> None:
        """Stop opening connections."""
        self._ended.set()
        self._thread.join()

    def __enter__(self) -> HalfOpen:
        return self

    def __exit__(self, *raised: object) -> None:
        self.rest()
        for made in self._sockets:
            made.close()


def _client_hello() -> bytes:
    """The first message of TLS."""
    outgoing = ssl.MemoryBIO()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    with contextlib.suppress(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), outgoing, server_hostname="localhost").do_handshake()
    return outgoing.read()


def _closed(made: socket.socket) -> bool:
    """Return whether the other end has closed a connection, after reading what it sent."""
    made.setblocking(False)
    try:
        while made.recv(65536):
            pass
        return True
    except BlockingIOError:
        return False
    except ConnectionError:
        return True
