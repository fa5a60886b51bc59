"""The protection against other pages and other users: Host, Origin, a token, and what a page may load.

The token is in the fragment of the page's address, which browsers do not send. The page itself is public,
and has no data; it gets all of them through its WebSocket, which needs the token.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from hmac import compare_digest

LOOPBACK = "127.0.0.1"

PROTOCOL = "colony.watch"
"""The WebSocket's subprotocol; the page offers it and the token."""

_TOKEN_BYTES = 24


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Guard:
    """Decides what may talk to the server.

    Attributes:
        port: port of the server.
        token: what the page must know.
    """

    port: int
    token: str

    @property
    def hosts(self) -> tuple[str, ...]:
        """The values of `Host` that name this server; others come from DNS rebinding."""
        return f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"

    def is_for_us(self, headers: Mapping[str, str]) -> bool:
        """Return True if a request names this server as its host."""
        return headers.get("host", "") in self.hosts

    def admits(self, headers: Mapping[str, str], offered: tuple[str, ...]) -> bool:
        """Return True if a WebSocket comes from our own page and knows the token."""
        is_ours = self.is_for_us(headers) and headers.get("origin", "") == f"http://{headers['host']}"
        token = next((text for text in offered if text != PROTOCOL), "")
        return is_ours and PROTOCOL in offered and compare_digest(token.encode(), self.token.encode())

    @property
    def response_headers(self) -> dict[str, str]:
        """Headers of every response: the page loads and connects to nothing but this server."""
        sockets = " ".join(f"ws://{host}" for host in self.hosts)
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
            f"connect-src {sockets}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
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
