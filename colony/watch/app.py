"""The web application: the page's files, and the WebSocket that serves a page its run."""

from __future__ import annotations

from pathlib import Path

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, Router, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from colony.watch.greeting import REFUSED, Strangers, greet
from colony.watch.security import Admission
from colony.watch.shown import Shown
from colony.watch.viewer import Viewer

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
