"""Gateway addresses: `tls/HOST:PORT`. Traffic between machines is always encrypted."""

from __future__ import annotations

import re
from typing import NamedTuple

from colony.runtime.transport.live.errors import SecurityError

_TLS = re.compile(r"tls/(?:\[([0-9A-Fa-f:.]+)\]|([^\s:/\[\]]+)):([0-9]{1,5})")
_MAX_PORT = 65535


class Endpoint(NamedTuple):
    """A host (name or address) and a port."""

    host: str
    port: int


def parse_endpoint(text: str) -> Endpoint:
    """Parse `tls/HOST:PORT`; an IPv6 address is enclosed in brackets.

    Raises:
        SecurityError: the text is anything else, or names an unencrypted protocol.
    """
    match = _TLS.fullmatch(text)
    if match is not None and int(match[3]) <= _MAX_PORT:
        return Endpoint(match[1] or match[2], int(match[3]))
    if text.partition("/")[0] in ("tcp", "udp", "ws"):
        raise SecurityError(
            f"`{text}` is unencrypted, so that anyone on the network could drive the robot: "
            "expected tls/HOST:PORT"
        )
    raise SecurityError(f"`{text}` is not the address of a gateway: expected tls/HOST:PORT")
