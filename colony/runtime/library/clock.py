"""Calls of the Clock: run a program, and read who takes part in the run."""

from __future__ import annotations

import msgspec

from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import Nothing
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Stopped


class ServerWho(msgspec.Struct, frozen=True, kw_only=True):
    """A server that is expected to answer ticks, or what tells the activity of a module in Python."""

    server: str
    up: bool


class ClientWho(msgspec.Struct, frozen=True, kw_only=True):
    """A client of the run, by address. `ready`: it has said that it listens, in this run.

    `on_time` counts the frames that were decided with its request, `late` those that were decided without it
    although it lived; both as the verdicts say, as far as the Clock heard them.
    """

    client: str
    ready: bool
    lives: bool
    on_time: int
    late: int


class Who(msgspec.Struct, frozen=True, kw_only=True):
    """The newest tick (k -1 where there was none yet), and who takes part.

    `run` and `program` are of the deployment, "" where there is none; `leader` is the connection that
    deployed it. `begun` is false while the Clock still waits for clients to be ready; `restarts` counts how
    often all memory began anew since. `stopped` is the emergency stop that is on; `trouble` says that it
    could not be written to, or read from, its file.
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
    """Let the robot be moved again after an emergency stop. Only the Clock takes this call."""
    return Ask("release", Nothing(), type(None), "command", repeatable=True)


def deploy(deployment: Deployment) -> Ask[None]:
    """Run a program: at the Clock, and at each server that it commands. The connection that asks leads the
    run, which ends with the connection.

    Refused with the code "busy" while somebody else leads another run, "arguments" where it makes no sense.
    """
    return Ask("deploy", deployment, None, "command", repeatable=True)


def who() -> Ask[Who]:
    """Read which servers and clients take part in the run."""
    return Ask("who", Nothing(), Who, "read", repeatable=True)
