"""The configuration of zenoh for a process of a robot.

On one machine every server listens on a unix socket in the robot's folder, and everyone connects to those
that are known, present or not: a server that comes, or comes back, is found by trying again, and servers of
other names by gossip. There is no scouting, no port, no shared memory.

No process dials an address that came over the network: processes of the robot can open links of unix sockets
only, and the gateway, the only process that strangers reach, takes no part in gossip. It needs none, because
all others connect to it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

import zenoh

from colony.runtime.protocol.codec import LARGEST
from colony.runtime.transport.live.limits import HANDSHAKE_MS, limits
from colony.runtime.transport.live.place import Credentials, Local, Place, Remote
from colony.runtime.transport.live.run_directory import RobotDirectory
from colony.runtime.transport.live.security import Security

GATEWAY = "Gateway"

LOCAL_LINKS = ("unixsock-stream",)
REMOTE_LINKS = ("tls",)

LET_IN = [
    {"filters": [{"modes": ["peer"], "interfaces": ["none: a link of a unix socket"]}]},
    {"filters": [{"modes": ["client"]}]},
]
"""Filters of the sessions that a gateway accepts: peers of this machine, and clients from anywhere. A peer
that comes by a network interface is refused, because it would learn the ids of the robot's processes."""

LEASE_MS = 3000
"""After this time without a sign of life zenoh gives up a link; it must outlast a long reception."""

KNOWN = ("Clock", "RServer", "PServer", "DServer")
"""The servers that a robot has; others are found by their sockets and by gossip."""

BLOCKED_US = 1_000_000
"""After so long without room for a message that must not be dropped, its link is given up instead: its
receiver is frozen, and who sends must not be for much longer."""

FRAMES_ROOM = 16
"""Batches of 64 KiB that may wait on a link of a process for the messages of frames, allocated as they are
needed. A direct host waits for no room, so the requests of as many clients as a program may have must find
it."""

LOGIN_MS = 3000
"""For how long the other end of a link, a gateway for one, may take to let us in."""

RETRY = {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2}
"""How often a socket is tried that is not there: one that comes back is found within the longest period."""

Settings = Mapping[str, object]


def configuration(settings: Settings) -> zenoh.Config:
    """The settings as zenoh takes them."""
    made = zenoh.Config()
    for key, value in settings.items():
        made.insert_json5(key, json.dumps(value))
    return made


def settings(place: Place, *, listens: tuple[str, ...] = ()) -> Settings:
    """Those of a process that serves under the names `listens` on this machine, or that only connects.

    Raises:
        ValueError: it would serve a robot of another machine: only the robot's own machine has its sockets.
    """
    room = {"transport/link/tx/queue/size/interactive_high": FRAMES_ROOM}
    match place:
        case Local(directory=directory):
            names = {*KNOWN, GATEWAY, *directory.servers()}
            return _common("peer", LOCAL_LINKS, gossip=True) | _local(directory, listens, names) | room
        case Remote(endpoint=endpoint, credentials=credentials):
            if listens:
                raise ValueError(f"{listens[0]} cannot serve {place.robot} from another machine")
            return (
                _common("client", REMOTE_LINKS, gossip=False)
                | {"listen/endpoints": [], "connect/endpoints": [endpoint], "connect/timeout_ms": LOGIN_MS}
                | _tls_client(credentials)
                | room
            )


def stop_settings(directory: RobotDirectory) -> Settings:
    """Return the settings of a server's second session, a link to the gateway that carries emergency stops.

    Servers subscribe on it to calls under the right to stop, and to nothing else: no flood fills it.
    """
    return _common("peer", LOCAL_LINKS, gossip=False) | {
        "listen/endpoints": [],
        "connect/endpoints": [directory.endpoint(GATEWAY)],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }


def gateway_settings(directory: RobotDirectory, listen: str, security: Security) -> Settings:
    """Return the settings of a gateway that listens at `listen`, without its access control.

    It connects to nobody: all processes of the robot connect to it. Two ends that dial each other after a
    link broke can each take the other's link for the one that stands, and then neither dials again.
    """
    return _common("router", (*LOCAL_LINKS, *REMOTE_LINKS), gossip=False) | {
        "gateway": {"south": LET_IN},
        "connect/endpoints": [],
        "listen/endpoints": [
            directory.endpoint(GATEWAY),
            f"{listen}#tls_handshake_timeout_ms={HANDSHAKE_MS}",
        ],
        "transport/link/tls/root_ca_certificate": str(security.authority),
        "transport/link/tls/listen_certificate": str(security.certificate),
        "transport/link/tls/listen_private_key": str(security.key),
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/close_link_on_expiration": True,
        **limits(directory.robot),
    }


def _local(directory: RobotDirectory, listens: tuple[str, ...], names: set[str]) -> dict[str, object]:
    """Return the settings to listen as `listens`, and to connect to all other `names`, present or not."""
    return {
        "listen/endpoints": [directory.endpoint(name) for name in listens],
        "connect/endpoints": [directory.endpoint(name) for name in sorted(names.difference(listens))],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }


def _common(mode: str, links: tuple[str, ...], *, gossip: bool) -> dict[str, object]:
    return {
        "mode": mode,
        "adminspace/enabled": False,
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "scouting/gossip/enabled": gossip,
        "transport/link/protocols": links,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": LOGIN_MS,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCKED_US,
        "transport/link/rx/max_message_size": 2 * LARGEST,
        "connect/retry": RETRY,
        "open/return_conditions/connect_scouted": False,
    }


def _tls_client(credentials: Credentials) -> dict[str, object]:
    return {
        "transport/link/tls/root_ca_certificate": str(credentials.authority),
        "transport/link/tls/connect_certificate": str(credentials.certificate),
        "transport/link/tls/connect_private_key": str(credentials.key),
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/verify_name_on_connect": True,
    }
