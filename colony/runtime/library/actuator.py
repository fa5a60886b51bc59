"""Calls of every server that takes commands, except for the motions of RServer (`library/robot.py`).

    connection.do(actuator.command("move", {"height": 200.0}))

Commands are arbitrated by the connection's priority, as those of RServer are: during a run, a connection
whose priority is above that of the modules commands instead of them; one below them commands only while they
are idle. A priority that a client of that actuator or another connection already has is refused with the code
"tie". A command stays in force until its lease ends, unless it is repeated. Other codes: "arguments" for
values that the command, or the program's actuator, does not take; "stopped" while the emergency stop is on;
"locked" while another connection has the lock; "clock" where no frames begin.

Commands are held, frame by frame, to the limits of the program that runs, unless the connection ignores them
(`ignore_limits`).
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Stopped

LEASE_S = 0.5
"""Seconds for which a command stays in force if it is not repeated."""

LOCK_MARGIN_S = 1.0
"""Seconds by which a caller's wait for a lock exceeds the server's."""


# --- arguments -------------------------------------------------------------------------------------


class CommandArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `command`: the values of a command's parameters, in base units, for `lease_s`."""

    command: str
    values: dict[str, bool | float]
    lease_s: float = LEASE_S


class IgnoreLimits(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `ignore_limits`: False to obey the program's limits again."""

    ignoring: bool = True


class Lock(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `lock`: the maximum time to wait for the lock; 0 to not wait."""

    wait_ns: int = 0


# --- replies ---------------------------------------------------------------------------------------


class ClientReport(msgspec.Struct, frozen=True, kw_only=True):
    """A client of the program, with its frames counted by the fate of its request."""

    name: str
    priority: int
    on_time: int
    late: int
    lost: int
    refused: int


class ActuatorReport(msgspec.Struct, frozen=True, kw_only=True):
    """An actuator: its clients, highest priority first, and its newest note.

    `command` is the server's command; `acting` is the client or connection that commanded it in the newest
    frame.
    """

    name: str
    command: str
    acting: str | None
    frames: int
    clients: tuple[ClientReport, ...]
    last_note: str | None


class OutsideReport(msgspec.Struct, frozen=True, kw_only=True):
    """A connection that has commanded an actuator, and whose priority there is therefore taken.

    `values` is its current command, None if there is none, and `lease_s` the remaining time of its lease.
    `unlimited` is True if the connection ignores the limits of the program.
    """

    connection: str
    name: str
    priority: int
    command: str
    values: dict[str, bool | float] | None
    lease_s: float | None
    unlimited: bool = False


class Arbitration(msgspec.Struct, frozen=True, kw_only=True):
    """The clients and connections that may command the server's actuators, and those that do so.

    `run` is that of the newest frame, "" if no program runs; `leader` is the connection that deployed the
    program. `outside` has the connections of each actuator in the order of their priorities, `lock_waiting`
    those that wait for the lock in the order in which they will get it.
    """

    run: str
    leader: str | None
    actuators: tuple[ActuatorReport, ...]
    outside: tuple[OutsideReport, ...]
    lock_holder: str | None
    lock_waiting: tuple[str, ...]
    stopped: Stopped | None


# --- calls -----------------------------------------------------------------------------------------


def command(name: str, values: Mapping[str, bool | float], lease: float = LEASE_S) -> CallRequest[None]:
    """Command the server's command `name` with the values of its parameters, for `lease` s or until replaced.

    Values are in base units, those of an enum its members' numbers. A parameter that the program's actuator
    does not declare may be left out. At DServer, the command is the variable that an actuator sets, and the
    parameters are the actuator's fields.
    """
    arguments = CommandArguments(command=name, values=dict(values), lease_s=lease)
    return CallRequest("command", arguments, type(None), "command")


def give_way() -> CallRequest[None]:
    """End what this connection commands, without waiting for the end of its lease.

    The next connection or client in the order of priorities commands then, in the frame that is being decided
    if it can. Nothing is sent in the place of the command.
    """
    return CallRequest("give_way", NoArguments(), type(None), "command", repeatable=True)


def ignore_limits(ignoring: bool = True) -> CallRequest[None]:
    """Command beyond the limits of the program, or within them again; ranges and bumpers still hold.

    This lasts until the end of this connection. Frames that it commands are recorded as unlimited. Users on
    other machines need the right `unlimited`.
    """
    return CallRequest("ignore_limits", IgnoreLimits(ignoring=ignoring), type(None), "unlimited")


def lock(wait: bool = True, wait_s: float = 60.0) -> CallRequest[None]:
    """Keep all other connections, and the program, from commanding the server's actuators (`RobotLock`).

    The lock lasts until `unlock` or the end of this connection. If another connection has it, the call waits
    up to `wait_s`, behind connections of higher priority. Then, or immediately without `wait`, it is refused
    with the code "locked".
    """
    arguments = Lock(wait_ns=round(wait_s * 1e9) if wait else 0)
    return CallRequest(
        "lock", arguments, type(None), "command", wait_s=wait_s + LOCK_MARGIN_S if wait else None
    )


def unlock() -> CallRequest[None]:
    """Release the lock (`RobotUnlock`)."""
    return CallRequest("unlock", NoArguments(), type(None), "command")


def arbitration() -> CallRequest[Arbitration]:
    """Read the clients and connections that may command the actuators, and those that do so."""
    return CallRequest("arbitration", NoArguments(), Arbitration, "read", repeatable=True)
