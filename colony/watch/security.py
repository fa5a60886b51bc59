"""The protection against other pages and other users: Host, Origin, a token, and what a page may load.

`peers.py` refuses connections of other users.

The token is in the fragment of the page's address, which browsers do not send. The page itself is public,
and has no data; it gets all of them through its WebSocket. There server and page prove to each other that
they know the token, without sending it: another program at the port, after the server has ended, learns
nothing from a page that reconnects.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

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
