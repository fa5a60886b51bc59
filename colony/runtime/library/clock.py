"""Calls of the Clock: run a program, and read the participants of the run."""

from __future__ import annotations

import msgspec

from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Stopped


class ServerParticipant(msgspec.Struct, frozen=True, kw_only=True):
    """A server that must answer ticks, or the source of a Python module's activity."""

    server: str
    up: bool


class ClientParticipant(msgspec.Struct, frozen=True, kw_only=True):
    """A client of the run, by address. `ready` is True if it has reported to be ready for this run.

    `on_time` counts the frames decided with its request, `late` those decided without it although it was
    alive, by the verdicts that the Clock received.
    """

    client: str
    ready: bool
    lives: bool
    on_time: int
    late: int


class Participants(msgspec.Struct, frozen=True, kw_only=True):
    """The newest tick (k -1 before the first), and the participants of the run.

    `run` and `program` are of the deployment, "" if there is none; `leader` is the connection that deployed
    it. `begun` is false while the Clock waits for clients to be ready; `restarts` counts the restarts of all
    memory since. `stopped` is the emergency stop in force; `trouble` is the reason why its file could not be
    written or read.
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
    servers: tuple[ServerParticipant, ...]
    clients: tuple[ClientParticipant, ...]
    stopped: Stopped | None = None
    trouble: str | None = None


def release() -> Ask[None]:
    """Release the emergency stop, so that the robot may move again. Only the Clock accepts this call."""
    return Ask("release", NoArguments(), type(None), "command", repeatable=True)


def deploy(deployment: Deployment) -> Ask[None]:
    """Run a program: at the Clock, and at each server that it commands.

    The calling connection leads the run, which ends with the connection. Refused with the code "busy" during
    the run of another leader, "arguments" if the deployment is invalid.
    """
    return Ask("deploy", deployment, None, "command", repeatable=True)


def participants() -> Ask[Participants]:
    """Read which servers and clients take part in the run."""
    return Ask("participants", NoArguments(), Participants, "read", repeatable=True)
