"""Calls of the leader of a run: the process of `colony run` that supervises it."""

from __future__ import annotations

from typing import Literal

import msgspec

from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import NoArguments

LEADER = "Leader"
"""Name of the leader among the servers of a robot."""

Standing = Literal["alive", "late", "lost", "starting"]


class ClientStanding(msgspec.Struct, frozen=True, kw_only=True):
    """A client of the network, by address: its standing in the newest frame, and its counts of frames.

    `restarts` counts those of its process; `last_error` is the last line of output of a crashed process.
    """

    address: str
    standing: Standing
    on_time: int
    late: int
    lost: int
    restarts: int
    last_error: str | None


class RunStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A run of a program: `frames` were decided, the newest of them k; `process` leads it.

    All memory was restarted in `restarts` of them. `commanded_by` has the client that commanded each actuator
    in the newest frame, None for none. `disagreements` counts frames in which the runtime deviated from the
    program: it should be 0. `processes` has the ids of the processes that the leader started, by
    name.
    """

    run: str
    program: str
    file: str
    process: int
    k: int
    frames: int
    restarts: int
    disagreements: int
    commanded_by: dict[str, str | None]
    clients: tuple[ClientStanding, ...]
    processes: dict[str, int] = {}


def run_status() -> Ask[RunStatus]:
    """Read the state of the run."""
    return Ask("run", NoArguments(), RunStatus, "read", repeatable=True)
