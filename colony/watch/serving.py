"""The server of pages: in a thread of its own, on the loopback interface alone."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import os
import re
import secrets
import socket
import sys
import threading
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import msgspec
import uvicorn
from starlette.datastructures import Address, Headers
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, Router, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.watch.viewer import MAX_REQUEST_BYTES, Viewer
from colony.watch.watched import Watched

# --- shown ---------------------------------------------------------------------------------------------
#
# The run that pages show, and its successors.


class Shown:
    """The run that all pages show. Mutable; threads may share it.

    Args:
        watched: the first run.
    """

    def __init__(self, watched: Watched) -> None:
        self._changed = threading.Condition()
        self._watched = watched
        self._pages = Counter[int]()

    @contextmanager
    def page(self) -> Iterator[Watched]:
        """Count a page as long as the context lasts; its value is the run that it shows."""
        with self._changed:
            watched = self._watched
            self._pages[id(watched)] += 1
        try:
            yield watched
        finally:
            with self._changed:
                self._pages[id(watched)] -= 1
                self._changed.notify_all()

    def is_shown(self, watched: Watched) -> bool:
        """Return False if another run has taken the place of this one."""
        return self._watched is watched

    def show(self, watched: Watched) -> None:
        """Show another run; wait until no page shows the one before, which may be closed then."""
        with self._changed:
            before, self._watched = self._watched, watched
            self._changed.wait_for(lambda: not self._pages[id(before)])


# --- peers ---------------------------------------------------------------------------------------------
#
# The user at the other end of a connection on this machine, as the kernel's table of sockets says.


_TABLE = Path("/proc/net/tcp")
_LOCAL, _REMOTE, _UID = 1, 2, 7  # columns
_ROOT = 0


def own_users(environment: Mapping[str, str], user: int) -> frozenset[int]:
    """Return the numbers of the users whose connections a process of a user accepts.

    These are the user, root, and of root in `sudo` the user who called it. Root forwards the connections of
    virtual machines, and can read everything anyway.
    """
    caller = environment.get("SUDO_UID", "") if user == _ROOT else ""
    return frozenset({user, _ROOT, *([int(caller)] if caller.isdecimal() else [])})


def is_of(users: Container[int], client: tuple[str, int], server: tuple[str, int]) -> bool:
    """Return True if a TCP connection over IPv4 was opened by a process of one of these users.

    Also where the kernel has no table of sockets in /proc: then nobody can tell.

    Args:
        users: the numbers of the users.
        client: the address and port of the client, on this machine.
        server: the address and port of the server.
    """
    wanted = _hexadecimal(client), _hexadecimal(server)
    try:
        table = _TABLE.read_text(encoding="ascii")
    except OSError:
        return True
    rows = (line.split() for line in table.splitlines()[1:])
    return any(
        (columns[_LOCAL], columns[_REMOTE]) == wanted and int(columns[_UID]) in users for columns in rows
    )


def _hexadecimal(address: tuple[str, int]) -> str:
    """Return an address as the table has it: in the byte order of this machine."""
    number = int.from_bytes(socket.inet_aton(address[0]), sys.byteorder)
    return f"{number:08X}:{address[1]:04X}"


# --- security ------------------------------------------------------------------------------------------
#
# The protection against other pages and other users: Host, Origin, a token, and what a page may load.
#
# `peer_of` refuses connections of other users.
#
# The token is in the fragment of the page's address, which browsers do not send. The page itself is public,
# and has no data; it gets all of them through its WebSocket. There server and page prove to each other that
# they know the token, without sending it: another program at the port, after the server has ended, learns
# nothing from a page that reconnects.


LOOPBACK = "127.0.0.1"

PROTOCOL = "colony.watch"
"""The WebSocket's subprotocol; the page offers it and a nonce."""

Side = Literal["server", "page"]

_TOKEN_BYTES = 24
_NONCE_BYTES = 16


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


def new_nonce() -> str:
    """Return a random text that is used once."""
    return secrets.token_hex(_NONCE_BYTES)


def proof(token: str, side: Side, nonce: str, host: str) -> str:
    """Return the proof that a side knows the token: it answers the nonce of the other side.

    It names the host that the side believes in, so that nobody can pass on the proof of another server.
    """
    text = f"colony.watch {side} {nonce} {host}"
    return hmac.new(token.encode(), text.encode(), hashlib.sha256).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Admission:
    """Decides what may talk to the server.

    Attributes:
        port: port of the server.
        token: what the page must know.
    """

    port: int
    token: str

    @property
    def host(self) -> str:
        """The value of `Host` that names this server; others come from DNS rebinding.

        It is an address: at `localhost` another user might listen on the IPv6 address that it stands for.
        """
        return f"{LOOPBACK}:{self.port}"

    def is_for_us(self, headers: Mapping[str, str]) -> bool:
        """Return True if a request names this server as its host."""
        return headers.get("host", "") == self.host

    def nonce(self, headers: Mapping[str, str], offered: tuple[str, ...]) -> str | None:
        """Return the nonce that a WebSocket of our own page offers; None for any other WebSocket."""
        is_ours = self.is_for_us(headers) and headers.get("origin", "") == f"http://{self.host}"
        nonces = [text for text in offered if text != PROTOCOL]
        return nonces[0] if is_ours and len(nonces) == 1 and PROTOCOL in offered else None

    def proof(self, nonce: str) -> str:
        """Return the server's proof to a page that offered this nonce."""
        return proof(self.token, "server", nonce, self.host)

    def accepts(self, given: str, nonce: str) -> bool:
        """Return True if this is a page's proof for this nonce."""
        return hmac.compare_digest(given.encode(), proof(self.token, "page", nonce, self.host).encode())

    @property
    def response_headers(self) -> dict[str, str]:
        """Headers of every response: the page loads and connects to nothing but this server."""
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
            f"connect-src ws://{self.host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        return {
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
        }


# --- greeting ------------------------------------------------------------------------------------------
#
# The greeting of a page: it is one of this user, and both sides prove that they know the token.


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


class PageProof(msgspec.Struct, frozen=True, kw_only=True):
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
        if admission.accepts(msgspec.json.decode(text, type=PageProof).proof, nonce):
            return True
        await socket.close(REFUSED)
    except WebSocketDisconnect:
        pass
    except (TimeoutError, KeyError, msgspec.MsgspecError):  # KeyError: the message is binary
        await socket.close(REFUSED)
    return False


# --- app -----------------------------------------------------------------------------------------------
#
# The web application: the page's files, and the WebSocket that serves a page its run.


PAGE = Path(__file__).parent / "page"
"""Folder of the page's files."""

CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Types of the page's files, by suffix; others are not served."""

MAX_VIEWERS = 20
"""Maximum number of pages at one time."""

REPLACED = 1012
"""Close code of a WebSocket whose run has a successor: the page comes back for it."""


def page_files() -> dict[str, tuple[bytes, str]]:
    """Return the files of the page, by name, with their types."""
    found = (path for path in sorted(PAGE.iterdir()) if path.suffix in CONTENT_TYPES)
    return {path.name: (path.read_bytes(), CONTENT_TYPES[path.suffix]) for path in found}


def build_app(shown: Shown, admission: Admission, strangers: Strangers) -> ASGIApp:
    """Return the application that shows a run, and its successors, to the pages that are admitted."""
    files, viewers = page_files(), set[WebSocket]()

    async def page(request: Request) -> Response:
        name = request.path_params["name"] or "index.html"
        if name not in files:
            return PlainTextResponse("not found\n", 404, headers=admission.response_headers)
        content, type_ = files[name]
        return Response(content, media_type=type_, headers=admission.response_headers)

    async def run(socket: WebSocket) -> None:
        if not await greet(socket, admission):
            return
        if len(viewers) >= MAX_VIEWERS:
            await socket.close(REFUSED)
            return
        viewers.add(socket)
        try:
            with strangers.admitted(socket.client), shown.page() as watched:
                await Viewer(socket, watched).serve(lambda: shown.is_shown(watched))
            if not shown.is_shown(watched):
                await socket.close(REPLACED)
        except (WebSocketDisconnect, RuntimeError):  # the connection is closed
            pass
        finally:
            viewers.discard(socket)

    routes = Router([Route("/{name:path}", page), WebSocketRoute("/run", run)], redirect_slashes=False)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        is_for_us = admission.is_for_us(Headers(scope=scope))
        misdirected = PlainTextResponse(f"the page is at http://{admission.host}/\n", 421)
        await (routes if is_for_us else misdirected)(scope, receive, send)

    return app


# --- serving -------------------------------------------------------------------------------------------


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


# --- user files ----------------------------------------------------------------------------------------
#
# Files that a user's pages need, in the user's cache, readable by the user alone: the token, and a link.


_VALID = re.compile(r"[A-Za-z0-9_-]{32,64}")
_MAX_BYTES = 100

_LINK = """<!doctype html>
<meta charset="utf-8">
<title>colony watch</title>
<meta http-equiv="refresh" content="0; url={url}">
<a href="{url}">colony watch</a>
"""


def user_token(environment: Mapping[str, str]) -> str:
    """Return the user's token, so that a page outlives its server; a new one if none can be kept."""
    file = user_cache(environment, "watch-token")
    if file is None:
        return new_token()
    with suppress(OSError, UnicodeDecodeError):
        known = read_from_cache(file, _MAX_BYTES).decode().strip()
        if _VALID.fullmatch(known) and file.stat().st_mode & 0o077 == 0:
            return known
    token = new_token()
    with suppress(OSError):
        keep_in_cache(file, token.encode())
    return token


def page_link(environment: Mapping[str, str], url: str) -> str | None:
    """Return the address of a file that leads to a page; None if there can be no such file.

    A browser gets it as an argument. Other users see arguments, so the address of the page, which has the
    token, must not be one.
    """
    file = user_cache(environment, "watch.html")
    if file is None:
        return None
    try:
        keep_in_cache(file, _LINK.format(url=url).encode())
    except OSError:
        return None
    return file.as_uri()
