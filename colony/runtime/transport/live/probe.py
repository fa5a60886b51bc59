"""A diagnosis of why a gateway cannot be reached.

Zenoh reports only a timeout, so this module tries the steps one by one with the TLS of the standard library.
"""

from __future__ import annotations

import socket
import ssl

from colony.runtime.transport.live.endpoint import parse_endpoint
from colony.runtime.transport.live.place import Remote

STEP_TIMEOUT_S = 2.0
"""Timeout of each step of the connection, in seconds."""
ALERT_TIMEOUT_S = 0.5
"""Seconds to wait after the handshake for the gateway to refuse this process's certificate."""


def diagnose(place: Remote) -> str:
    """Return one sentence: no listener, not a gateway, an untrusted gateway, or a refused login."""
    host, port = parse_endpoint(place.endpoint)
    credentials = place.credentials
    try:
        with socket.create_connection((host, port), timeout=STEP_TIMEOUT_S) as plain:
            return _diagnose_login(plain, host, place)
    except TimeoutError:
        return f"{place.endpoint} does not answer: is the machine on, and on the network?"
    except ssl.SSLCertVerificationError as problem:
        return (
            f"{place.endpoint} is not to be trusted: {problem.verify_message} "
            f"(checked with {credentials.authority}, and the certificate must be for `{host}`)"
        )
    except ssl.SSLError as problem:
        return f"{place.endpoint} does not speak TLS: {problem.reason or problem}"
    except OSError as problem:
        return f"no process listens at {place.endpoint}: {problem.strerror or problem}"


def _diagnose_login(plain: socket.socket, host: str, place: Remote) -> str:
    credentials = place.credentials
    context = ssl.create_default_context(cafile=str(credentials.authority))
    context.load_cert_chain(credentials.certificate, credentials.key)
    with context.wrap_socket(plain, server_hostname=host) as secured:
        secured.settimeout(ALERT_TIMEOUT_S)
        try:
            # TLS 1.3 sends the verdict on our certificate after the handshake
            closed = secured.recv(1) == b""
        except TimeoutError:
            closed = False
        except (ssl.SSLError, ConnectionError) as problem:
            reason = getattr(problem, "reason", None) or problem
            return f"{place.endpoint} refuses {credentials.certificate}: {reason}"
    if closed:
        return f"{place.endpoint} ended the login with {credentials.certificate}"
    return f"{place.endpoint} accepts the login of {credentials.user}, but does not answer as a gateway"
