"""The zenoh configuration of a robot's processes.

On one machine every server listens on a unix socket in the robot's folder. All processes know the same order
of sockets: the gateway's, those of the standard servers, then numbered slots, one of which every other server
takes. A server dials the sockets before its own, a process that only connects dials all of them, and retries
go on whether a socket exists or not. Scouting, gossip, ports and shared memory are not used, so no process
connects to an address that came over the network.

Only one end of a link ever dials, or a break could split it for good: with a link in each direction, one end
may close both and dial again before the other has noticed the loss of its own link. Zenoh then adds the new
link to the old transport of that end, which never repeats its declarations.

Two more settings keep a link from being lost. Each dialed endpoint carries its retry period, because zenoh
then dials again only after it has closed the old transport. Handshakes over unix sockets have no timeout in
practice, because zenoh may cut one off half-way, and keep a transport that reads nothing; a frozen process
answers when it continues, and the socket of a dead one closes.
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

DIALED_SERVERS = (GATEWAY, "Clock", "RServer", "PServer", "DServer")
"""The servers with a socket of their own, in the order of dialing; the slots of other servers follow."""

BLOCK_TIMEOUT_US = 1_000_000
"""Timeout, in microseconds, of a message that waits for room on a link; the link is then closed.

Its receiver is frozen by then, and must not block the sender any longer.
"""

FRAME_QUEUE_BATCHES = 16
"""Maximum number of batches of 64 KiB queued for frame messages on a link; allocated on demand.

A direct host does not wait for room, so the requests of the largest possible program must fit.
"""

LOGIN_MS = 3000
"""Timeout in milliseconds for a gateway to accept this process."""

LOCAL_HANDSHAKE_MS = 3_600_000
"""Timeout in milliseconds of a handshake over a unix socket, longer than any process is frozen."""

RETRY_MS, SLOT_RETRY_MS = 200, 500
"""Longest retry periods in milliseconds for missing sockets and slots: a server is found within them."""

Settings = Mapping[str, object]


def configuration(settings: Settings) -> zenoh.Config:
    """Return the settings as a zenoh configuration."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def settings(robot_address: RobotAddress, *, server: str | None = None) -> Settings:
    """Return the settings of a process that serves as `server`, or of one that only connects.

    A server without a socket of its own takes a slot.

    Raises:
        RunDirectoryError: all slots are taken, or the robot's folder cannot be used.
        ValueError: the process would serve a robot on another machine; only the robot's own machine has its
            sockets.
    """
    queue_size = {"transport/link/tx/queue/size/interactive_high": FRAME_QUEUE_BATCHES}
    match robot_address:
        case Local(directory=directory):
            return _local(directory, server) | queue_size
        case Remote(endpoint=endpoint, credentials=credentials):
            if server is not None:
                raise ValueError(f"{server} cannot serve {robot_address.robot} from another machine")
            return (
                _common("client", REMOTE_LINKS)
                | {"listen/endpoints": [], "connect/endpoints": [endpoint], "connect/timeout_ms": LOGIN_MS}
                | _tls_client(credentials)
                | queue_size
            )


def stop_settings(directory: RobotDirectory) -> Settings:
    """Return the settings of a server's second session, a link to the gateway that carries emergency stops.

    On it, servers subscribe only to calls made with the `stop` right, so that no flood can fill it.
    """
    return _dialing([], _dialed(directory)[:1])


def gateway_settings(directory: RobotDirectory, listen: str, security: Security) -> Settings:
    """Return the settings of a gateway that listens at `listen`, without its access control.

    The gateway dials no process: all processes of the robot dial it.
    """
    return _common("router", (*LOCAL_LINKS, *REMOTE_LINKS)) | {
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


def _local(directory: RobotDirectory, server: str | None) -> dict[str, object]:
    """Return the settings to listen as `server`, and to dial the sockets before its own."""
    dialed = _dialed(directory)
    if server is None:
        return _dialing([], dialed)
    if server in DIALED_SERVERS:
        rank = DIALED_SERVERS.index(server)
    else:
        rank = len(DIALED_SERVERS) + directory.take_slot(server)
    return _dialing([directory.endpoint(server)], dialed[:rank])


def _dialed(directory: RobotDirectory) -> list[str]:
    """Return the endpoints of all sockets and slots, in the order of dialing."""
    named = [f"{directory.endpoint(name)}#retry_period_max_ms={RETRY_MS}" for name in DIALED_SERVERS]
    slots = [f"{endpoint}#retry_period_max_ms={SLOT_RETRY_MS}" for endpoint in directory.slot_endpoints()]
    return named + slots


def _dialing(listen: list[str], dialed: list[str]) -> dict[str, object]:
    return _common("peer", LOCAL_LINKS) | {
        "listen/endpoints": listen,
        "connect/endpoints": dialed,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "transport/unicast/open_timeout": LOCAL_HANDSHAKE_MS,
        "transport/unicast/accept_timeout": LOCAL_HANDSHAKE_MS,
    }


def _common(mode: str, links: tuple[str, ...]) -> dict[str, object]:
    return {
        "mode": mode,
        "adminspace/enabled": False,
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": links,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": LOGIN_MS,
        "transport/link/tx/lease": LINK_LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCK_TIMEOUT_US,
        "transport/link/rx/max_message_size": 2 * MAX_MESSAGE_BYTES,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": RETRY_MS, "period_increase_factor": 2},
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
