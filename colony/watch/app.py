"""The web application: the page's files, and the WebSocket that serves a page its run."""

from __future__ import annotations

from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from colony.watch.greeting import REFUSED, greet
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


def build_app(shown: Shown, admission: Admission) -> Starlette:
    """Return the application that shows a run, and its successors, to the pages that are admitted."""
    files, viewers = page_files(), set[WebSocket]()

    async def page(request: Request) -> Response:
        if not admission.is_for_us(request.headers):
            return PlainTextResponse(f"the page is at http://{admission.host}/\n", 421)
        name = request.path_params.get("name", "index.html")
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
            with shown.page() as watched:
                await Viewer(socket, watched).serve(lambda: shown.is_shown(watched))
            if not shown.is_shown(watched):
                await socket.close(REPLACED)
        except (WebSocketDisconnect, RuntimeError):  # the connection is closed
            pass
        finally:
            viewers.discard(socket)

    return Starlette(
        routes=[Route("/", page), Route("/{name}", page), WebSocketRoute("/run", run)],
    )
