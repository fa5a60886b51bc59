"""The zenoh configuration of a robot's processes.

On one machine every server listens on a unix socket in the robot's folder, and every process connects to all
known sockets, whether they exist yet or not. Retries find a server that starts or restarts; gossip finds
servers with other names. Scouting, ports and shared memory are not used.

No process connects to an address that came over the network: the robot's processes open links over unix
sockets only, and the gateway, the only process that other machines can reach, does not take part in gossip;
all other processes connect to it anyway.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

import zenoh

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.transport.live.limits import HANDSHAKE_MS, limits
from colony.runtime.transport.live.robot_address import Credentials, Local, Remote, RobotAddress
from colony.runtime.transport.live.run_directory import RobotDirectory
from colony.runtime.transport.live.security import Security

GATEWAY = "Gateway"

LOCAL_LINKS = ("unixsock-stream",)
REMOTE_LINKS = ("tls",)

ACCEPTED_SESSIONS = [
    {"filters": [{"modes": ["peer"], "interfaces": ["none: a link of a unix socket"]}]},
    {"filters": [{"modes": ["client"]}]},
]
"""Filters of the sessions that a gateway accepts: peers on this machine, and clients from anywhere.

A peer that arrives over a network interface is refused, because it would learn the ids of the robot's
processes.
"""

LINK_LEASE_MS = 3000
"""Milliseconds without a keepalive after which zenoh closes a link; longer than any reception takes."""

STANDARD_SERVERS = ("Clock", "RServer", "PServer", "DServer")
"""The servers of every robot; other servers are found by their sockets and by gossip."""

BLOCK_TIMEOUT_US = 1_000_000
"""Timeout, in microseconds, of a message that waits for room on a link; the link is then closed.

Its receiver is frozen by then, and must not block the sender any longer.
"""

FRAME_QUEUE_BATCHES = 16
"""Maximum number of batches of 64 KiB queued for frame messages on a link; allocated on demand.

A direct host does not wait for room, so the requests of the largest possible program must fit.
"""

LOGIN_MS = 3000
"""Timeout in milliseconds for the other end of a link, such as a gateway, to accept this process."""

RETRY = {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2}
"""Retry periods for missing sockets; a server that restarts is found within the longest period."""

Settings = Mapping[str, object]


def configuration(settings: Settings) -> zenoh.Config:
    """Return the settings as a zenoh configuration."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def settings(robot_address: RobotAddress, *, server_names: tuple[str, ...] = ()) -> Settings:
    """Return the settings of a process that serves as `server_names`; a process without names only connects.

    Raises:
        ValueError: the process would serve a robot on another machine; only the robot's own machine has its
            sockets.
    """
    queue_size = {"transport/link/tx/queue/size/interactive_high": FRAME_QUEUE_BATCHES}
    match robot_address:
        case Local(directory=directory):
            names = {*STANDARD_SERVERS, GATEWAY, *directory.servers()}
            return (
                _common("peer", LOCAL_LINKS, gossip=True)
                | _local(directory, server_names, names)
                | queue_size
            )
        case Remote(endpoint=endpoint, credentials=credentials):
            if server_names:
                raise ValueError(f"{server_names[0]} cannot serve {robot_address.robot} from another machine")
            return (
                _common("client", REMOTE_LINKS, gossip=False)
                | {"listen/endpoints": [], "connect/endpoints": [endpoint], "connect/timeout_ms": LOGIN_MS}
                | _tls_client(credentials)
                | queue_size
            )


def stop_settings(directory: RobotDirectory) -> Settings:
    """Return the settings of a server's second session, a link to the gateway that carries emergency stops.

    On it, servers subscribe only to calls made with the `stop` right, so that no flood can fill it.
    """
    return _common("peer", LOCAL_LINKS, gossip=False) | {
        "listen/endpoints": [],
        "connect/endpoints": [directory.endpoint(GATEWAY)],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }


def gateway_settings(directory: RobotDirectory, listen: str, security: Security) -> Settings:
    """Return the settings of a gateway that listens at `listen`, without its access control.

    The gateway connects to no process: all processes of the robot connect to it. If both ends dialed each
    other after a broken link, each could take the other's link for the surviving one, and neither would dial
    again.
    """
    return _common("router", (*LOCAL_LINKS, *REMOTE_LINKS), gossip=False) | {
        "gateway": {"south": ACCEPTED_SESSIONS},
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


def _local(directory: RobotDirectory, server_names: tuple[str, ...], names: set[str]) -> dict[str, object]:
    """Return the settings to listen as `server_names`, and to connect to all other `names`."""
    return {
        "listen/endpoints": [directory.endpoint(name) for name in server_names],
        "connect/endpoints": [directory.endpoint(name) for name in sorted(names.difference(server_names))],
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
        "transport/link/tx/lease": LINK_LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCK_TIMEOUT_US,
        "transport/link/rx/max_message_size": 2 * MAX_MESSAGE_BYTES,
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
