"""Diagnosis of the reason why a gateway cannot be reached.

Zenoh reports only a timeout, so this module tries each step of a connection with the standard library's TLS.
"""

from __future__ import annotations

import socket
import ssl

from colony.runtime.transport.live.endpoint import parse_endpoint
from colony.runtime.transport.live.robot_address import Remote

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
