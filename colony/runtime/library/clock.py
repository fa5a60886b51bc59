"""Calls of the Clock: deploy a program, read who takes part in the run, release an emergency stop."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.deployment import Deployment, Tunable
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.messages import Stopped


class ServerParticipant(msgspec.Struct, frozen=True, kw_only=True):
    """A server that must answer ticks, or the source of a Python module's activity."""

    server: str
    up: bool


class ClientParticipant(msgspec.Struct, frozen=True, kw_only=True):
    """A client of the run, by address. `ready` is True if it has reported that it is ready for this run.

    According to the verdicts that the Clock received, `on_time` counts the frames decided with its request,
    and `late` those decided without it although it was alive.
    """

    client: str
    ready: bool
    lives: bool
    on_time: int
    late: int


class Participants(msgspec.Struct, frozen=True, kw_only=True):
    """The newest tick (`k` is -1 before the first), and the participants of the run.

    `run` and `program` are those of the deployment, "" if there is none; `leader` is the connection that
    deployed it. `begun` is False while the Clock waits for clients to be ready; `restarts` counts the
    restarts of all memory in this run. `stopped` is the emergency stop in force; `trouble` is the reason why
    the file of the stop could not be written or read.
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


class Tune(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `tune`: values by name, in declared units; None for the value at the start of the run."""

    values: dict[str, float | None]


class TunedParam(msgspec.Struct, frozen=True, kw_only=True):
    """A tunable param of the program that runs, and its value, in its declared unit."""

    tunable: Tunable
    value: float


def tune(values: Mapping[str, float | None]) -> CallRequest[int]:
    """Change tunable params of the program that runs; returns the first frame with the new values.

    All of them change with the same frame, or none: refused with the code "arguments" if one is not tunable,
    or a value outside of its interval.
    """
    return CallRequest("tune", Tune(values=dict(values)), int, "command", repeatable=True)


def tunables() -> CallRequest[tuple[TunedParam, ...]]:
    """Read the tunable params of the program that runs; none while no program does."""
    return CallRequest("tunables", NoArguments(), tuple[TunedParam, ...], "read", repeatable=True)


def release() -> CallRequest[None]:
    """Release the emergency stop, so that the robot may move again. Only the Clock accepts this call."""
    return CallRequest("release", NoArguments(), type(None), "command", repeatable=True)


def deploy(deployment: Deployment) -> CallRequest[None]:
    """Deploy a program; to be called on the Clock and on each server that the program commands.

    The calling connection becomes the leader of the run, which ends when that connection does. Refused with
    the code "busy" while another leader's run lasts, "arguments" if the deployment is invalid.
    """
    return CallRequest("deploy", deployment, None, "command", repeatable=True)


def participants() -> CallRequest[Participants]:
    """Read the newest tick, and the servers and clients that take part in the run."""
    return CallRequest("participants", NoArguments(), Participants, "read", repeatable=True)


def interface() -> CallRequest[Interface]:
    """Read the interface of the robot's description; it has no parts if the robot is served without one."""
    return CallRequest("interface", NoArguments(), Interface, "read", repeatable=True)
