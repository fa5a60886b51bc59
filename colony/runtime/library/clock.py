"""Calls of the Clock: run a program, and read the participants of the run."""

from __future__ import annotations

import msgspec

from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import Nothing
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Stopped


class ServerWho(msgspec.Struct, frozen=True, kw_only=True):
    """A server that is expected to answer ticks, or the source of a Python module's activity."""

    server: str
    up: bool


class ClientWho(msgspec.Struct, frozen=True, kw_only=True):
    """A client of the run, by address. `ready`: it has reported that it listens, in this run.

    `on_time` counts the frames that were decided with its request, `late` those that were decided without it
    although it was alive; both according to the verdicts that the Clock received.
    """

    client: str
    ready: bool
    lives: bool
    on_time: int
    late: int


class Who(msgspec.Struct, frozen=True, kw_only=True):
    """The newest tick (k -1 if there was none yet), and the participants.

    `run` and `program` are of the deployment, "" if there is none; `leader` is the connection that deployed
    it. `begun` is false while the Clock still waits for clients to be ready; `restarts` counts the restarts
    of all memory since. `stopped` is the emergency stop in force; `trouble` is the reason why it could not be
    written to, or read from, its file.
    """

    k: int
    t_ns: int
    start: int
    frame_ns: int
    run: str
    program: str
    leader: str | None
    begun: bool
    restarts: int
    servers: tuple[ServerWho, ...]
    clients: tuple[ClientWho, ...]
    stopped: Stopped | None = None
    trouble: str | None = None


def release() -> Ask[None]:
    """Release the emergency stop, so that the robot may move again. Only the Clock accepts this call."""
    return Ask("release", Nothing(), type(None), "command", repeatable=True)


def deploy(deployment: Deployment) -> Ask[None]:
    """Run a program: at the Clock, and at each server that it commands.

    The calling connection leads the run, which ends with the connection. Refused with the code "busy" while
    another leader's run is on, "arguments" if the deployment is invalid.
    """
    return Ask("deploy", deployment, None, "command", repeatable=True)


def who() -> Ask[Who]:
    """Read which servers and clients take part in the run."""
    return Ask("who", Nothing(), Who, "read", repeatable=True)
