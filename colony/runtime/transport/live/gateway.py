"""The gateway to a robot from other machines: it joins the robot's sockets and listens with TLS.

It routes messages, informs users of their rights, and never forwards a message without the required right.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterable
from contextlib import ExitStack

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import CallDispatcher, CallId, NoArguments, method
from colony.runtime.protocol.messages import Effect, Message, QuietNode, WakeAt
from colony.runtime.transport.live import configuration
from colony.runtime.transport.live.configuration import GATEWAY as GATEWAY
from colony.runtime.transport.live.configuration import parse_endpoint
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.limits import RECEIVING_THREADS, allow_descriptors
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.outbox import Report
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import GatewayFullError
from colony.runtime.transport.live.security import PERMISSIONS, Permission, Security, access_control


class UserIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """The result of `whoami`: the authenticated user, and the permissions granted to that user."""

    user: str
    may: tuple[Permission, ...]


def whoami() -> CallRequest[UserIdentity]:
    """Return the identity of the caller, and the permissions granted to it."""
    return CallRequest("whoami", NoArguments(), UserIdentity, "read", repeatable=True)


MAX_GROWTH_BYTES = 128 * 1024 * 1024
"""Growth of a gateway's resident memory, in bytes, at which it restarts; it starts with about 45 MiB.

Zenoh keeps 1.3 KB for every key that a session declares, for the life of the session and without a limit. The
robot's servers also keep it, for keys that come through the gateway. The largest messages
of twenty sessions, received at the same time, stay below the limit.
"""

MEMORY_CHECK_INTERVAL_NS = 500_000_000
"""Nanoseconds between two checks of the gateway's memory."""


def resident_bytes() -> int:
    """Return the resident memory of this process."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


class GatewayNode(QuietNode):
    """A node that answers `whoami` and checks the gateway's memory.

    Users who are not in the table are local to this machine, and have all permissions.

    Args:
        security: table of users.
        memory: function that returns the resident memory of this process in bytes.

    Raises:
        GatewayFullError: from `handle`, when the memory has reached its limit.
    """

    address = GATEWAY

    def __init__(self, security: Security, memory: Callable[[], int] = resident_bytes) -> None:
        self._users = security.users
        self._memory = memory
        self._check_ns = self._initial_bytes = 0
        self._calls = CallDispatcher(GATEWAY, (method("whoami", NoArguments, self._whoami, right="read"),))
        self.listens = self._calls.listens

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Record the initial memory and schedule the first check."""
        self._initial_bytes = self._memory()
        self._check_ns = now_ns + MEMORY_CHECK_INTERVAL_NS
        yield WakeAt(self._check_ns)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer a call, and check the memory when a check is due."""
        yield from self._calls.handle(message, now_ns)
        if now_ns >= self._check_ns:
            self._check_memory()
            self._check_ns = now_ns + MEMORY_CHECK_INTERVAL_NS
            yield WakeAt(self._check_ns)

    def _check_memory(self) -> None:
        used = self._memory()
        if used > self._initial_bytes + MAX_GROWTH_BYTES:
            limit = (self._initial_bytes + MAX_GROWTH_BYTES) >> 20
            raise GatewayFullError(f"{GATEWAY}: it uses {used >> 20} MiB of memory; expected at most {limit}")

    def _whoami(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> UserIdentity:
        user = call_id.caller.user
        return UserIdentity(user=user, may=self._users.get(user, PERMISSIONS))


def open_gateway(
    robot_address: Local, listen: str, security: Security, *, report: Report = lambda problem: None
) -> Host:
    """Open a gateway to a robot on this machine that listens at `listen` (`tls/HOST:PORT`).

    It routes messages as soon as it is open, and answers calls once its `run` is called.

    Raises:
        SecurityError: `listen` is not a TLS address.
        AlreadyRunningError: the robot already has a gateway.
        RunDirectoryError: the robot's folder cannot be used.
        UnreachableError: the gateway cannot listen there.
    """
    parse_endpoint(listen)
    allow_descriptors()
    settings = {
        **configuration.gateway_settings(robot_address.directory, listen, security),
        "access_control": access_control(robot_address.robot, security),
    }
    with ExitStack() as resources:
        network = resources.enter_context(
            ZenohSession.open(
                robot_address,
                server_names=(GATEWAY,),
                settings=settings,
                receiving_threads=RECEIVING_THREADS,
            )
        )
        host = Host(network, [GatewayNode(security)], time=local_time(robot_address), report=report)
        host.take_ownership(resources.pop_all())
        return host
