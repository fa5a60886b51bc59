"""Calls of the leader of a run: the process of `colony run` that supervises it."""

from __future__ import annotations

from typing import Literal

import msgspec

from colony.runtime.library.ask import CallRequest
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
    that a site set, "" for none. `faults` are the sensors with a value of the wrong type in the newest frame.
    `broken` counts the frames in which each contract was broken, of those that were; `assumptions`
    likewise of what the program assumes. `site` has the values of
    the params that a site set, as the language writes them.
    `still` says why nothing moves, "" while something does.
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
    faults: tuple[str, ...] = ()
    broken: dict[str, int] = {}
    assumptions: dict[str, int] = {}
    site: dict[str, str] = {}
    still: str = ""


class ReadVariable(msgspec.Struct, frozen=True, kw_only=True):
    """A variable of DServer that the program reads as `sensor`: numbers or bools, `size` of them in a list.

    `size` is 0 for a value that is no list.
    """

    variable: str
    sensor: str
    kind: Literal["number", "bool"]
    size: int = 0

    def fits(self, value: object) -> bool:
        """Return True if a value is none, or of the kind and size that the program reads."""
        if value is None:
            return True
        elements = value if self.size and isinstance(value, list) else [value]
        is_bool = self.kind == "bool"
        kinds = (isinstance(x, int | float) and isinstance(x, bool) is is_bool for x in elements)
        return (
            isinstance(value, list) is bool(self.size) and len(elements) == max(self.size, 1) and all(kinds)
        )

    @property
    def expected(self) -> str:
        """What the program reads, as text."""
        one, many = ("true or false", "bools") if self.kind == "bool" else ("a number", "numbers")
        return f"a list of {self.size} {many}" if self.size else one


class SourceText(msgspec.Struct, frozen=True, kw_only=True):
    """A source file of the program, as `SourceFile` has it."""

    kind: Literal["behavior", "body", "python"]
    path: str
    data: bytes


class RunProgram(msgspec.Struct, frozen=True, kw_only=True):
    """The program of a run: its source files, the path of its behavior in them, and the params of a site.

    `site` is JSON, as recordings have it, "" for none. `reads` are the variables of DServer that it reads.
    """

    run: str
    root: str
    sources: tuple[SourceText, ...]
    site: str = ""
    reads: tuple[ReadVariable, ...] = ()


class RunKeyframe(msgspec.Struct, frozen=True, kw_only=True):
    """The newest keyframe of a run: the memory before frame `k`, as JSON of recordings; "" for none."""

    k: int
    text: str


def run_program() -> CallRequest[RunProgram]:
    """Read the program of the run."""
    return CallRequest("program", NoArguments(), RunProgram, "read", repeatable=True)


def run_keyframe() -> CallRequest[RunKeyframe]:
    """Read the newest keyframe of the run, from which a reader that joins goes on."""
    return CallRequest("keyframe", NoArguments(), RunKeyframe, "read", repeatable=True)


def run_status() -> CallRequest[RunStatus]:
    """Read the state of the run."""
    return CallRequest("run", NoArguments(), RunStatus, "read", repeatable=True)
