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
    """A client of the network, by address: its standing in the newest frame, and its frames by fate.

    `restarts` counts the restarts of its process; `last_error` is the last line that the process printed
    before it crashed.
    """

    address: str
    standing: Standing
    on_time: int
    late: int
    lost: int
    restarts: int
    last_error: str | None


class RunStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A run of a program: `frames` is the number of decided frames, `k` the newest one.

    `process` is the id of the leader's process; `processes` has the ids of the processes that it started, by
    name. `restarts` counts the frames in which all memory was restarted. `commanded_by` has the client that
    commanded each actuator in the newest frame, None if none did. `disagreements` counts the frames in which
    the runtime deviated from the program: it should be 0. `params` is the file with the params
    that a site set, "" for none.
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
    params: str = ""


def run_status() -> Ask[RunStatus]:
    """Read the state of the run."""
    return Ask("run", NoArguments(), RunStatus, "read", repeatable=True)
