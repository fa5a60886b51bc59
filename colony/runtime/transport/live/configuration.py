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
import re
import socket
import ssl
from collections.abc import Mapping
from typing import NamedTuple

import zenoh

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.transport.live.limits import HANDSHAKE_MS, limits
from colony.runtime.transport.live.robot_address import Credentials, Local, Remote, RobotAddress
from colony.runtime.transport.live.run_directory import RobotDirectory, SecurityError
from colony.runtime.transport.live.security import Security

# --- endpoint ------------------------------------------------------------------------------------------
#
# Gateway addresses: `tls/HOST:PORT`. Traffic between machines is always encrypted.


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


# --- probe ---------------------------------------------------------------------------------------------
#
# Diagnosis of the reason why a gateway cannot be reached.
#
# Zenoh reports only a timeout, so this module tries each step of a connection with the standard library's
# TLS.


STEP_TIMEOUT_S = 2.0
"""Timeout of each step of the connection, in seconds."""
ALERT_TIMEOUT_S = 0.5
"""Seconds to wait after the handshake for the gateway to refuse this process's certificate."""


def diagnose(robot_address: Remote) -> str:
    """Return one sentence on why the gateway cannot be reached, such as an untrusted certificate."""
    host, port = parse_endpoint(robot_address.endpoint)
    credentials = robot_address.credentials
    try:
        with socket.create_connection((host, port), timeout=STEP_TIMEOUT_S) as connection:
            return _diagnose_login(connection, host, robot_address)
    except TimeoutError:
        return f"{robot_address.endpoint} does not answer: is the machine on, and on the network?"
    except ssl.SSLCertVerificationError as problem:
        return (
            f"{robot_address.endpoint} is not to be trusted: {problem.verify_message} "
            f"(checked with {credentials.authority}, and the certificate must be for `{host}`)"
        )
    except ssl.SSLError as problem:
        return f"{robot_address.endpoint} does not speak TLS: {problem.reason or problem}"
    except OSError as problem:
        return f"no process listens at {robot_address.endpoint}: {problem.strerror or problem}"


def _diagnose_login(connection: socket.socket, host: str, robot_address: Remote) -> str:
    credentials = robot_address.credentials
    context = ssl.create_default_context(cafile=str(credentials.authority))
    context.load_cert_chain(credentials.certificate, credentials.key)
    with context.wrap_socket(connection, server_hostname=host) as secured:
        secured.settimeout(ALERT_TIMEOUT_S)
        try:
            # TLS 1.3 sends the verdict on our certificate after the handshake
            closed = secured.recv(1) == b""
        except TimeoutError:
            closed = False
        except (ssl.SSLError, ConnectionError) as problem:
            reason = getattr(problem, "reason", None) or problem
            return f"{robot_address.endpoint} refuses {credentials.certificate}: {reason}"
    if closed:
        return f"{robot_address.endpoint} ended the login with {credentials.certificate}"
    return (
        f"{robot_address.endpoint} accepts the login of {credentials.user}, but does not answer as a gateway"
    )


# --- configuration -------------------------------------------------------------------------------------


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
