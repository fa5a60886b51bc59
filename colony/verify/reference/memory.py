"""The memory of another executor, in the form in which the interpreter remembers it."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from colony.ir import expression as e
from colony.ir import program as ir
from colony.ir.memory import ProgramMemory, state_cell, window_cell
from colony.ir.types import ScalarValue
from colony.ir.walk import nodes
from colony.ir.wiring import joints_of
from colony.verify.reference.expressions import Memory

Parts = dict[str, float | bool | int]
"""The cells of one memory function, by the last words of their names."""

_FUNCTION = re.compile(
    r"(?P<function>\w+) (?P<cell>\d+)(?P<loops>(\.-?\d+)*)\[(?P<element>\d+)\] (?P<part>\w+)"
)


class Recalled(NamedTuple):
    """The memory of an interpreter: memory functions, last activities of dominant sides, and states."""

    functions: Memory
    dominated: dict[tuple[str | int, ...], int]
    states: dict[str, ScalarValue]


def recalled(program: ir.Program, memory: ProgramMemory, initial: dict[str, ScalarValue]) -> Recalled:
    """Return what the interpreter of `program` remembers; `initial` are the initial values of its states.

    Raises:
        ValueError: the memory is of another program.
    """
    cells, first_ns = dict(memory.cells), memory.first_ns or 0
    states = {name: cells.pop(state_cell(name), value) for name, value in initial.items()}
    dominated: dict[tuple[str | int, ...], int] = {}
    for joint in joints_of(program).joints:
        wire, *operands = joint.place
        until = cells.pop(f"{window_cell(wire, tuple(operands))} until", 0) if joint.window_ns else 0
        if until > 0:
            dominated[joint.place] = first_ns + int(until) - joint.window_ns
    calls = {call.cell: call for call in nodes(program) if isinstance(call, e.MemoryCall)}
    functions: dict[tuple[int, tuple[int, ...], int], Parts] = {}
    for name, value in cells.items():
        found = _FUNCTION.fullmatch(name)
        call = calls.get(int(found["cell"])) if found else None
        if found is None or call is None or call.function.value != found["function"]:
            raise ValueError(f"the memory has `{name}`, the program has not")
        loops = tuple(int(k) for k in found["loops"].split(".")[1:])
        functions.setdefault((call.cell, loops, int(found["element"])), {})[found["part"]] = value
    remembered = {key: _remembered(calls[key[0]], parts, first_ns) for key, parts in functions.items()}
    return Recalled({key: found for key, found in remembered.items() if found is not None}, dominated, states)


def _remembered(call: e.MemoryCall, parts: Parts, first_ns: int) -> Any:
    """Return the state that `expressions.remember` keeps of a call.

    None at first, and where nothing depends on it, so that cells are left out.
    """
    match call.function, parts:
        case _, {"started": False}:
            return None
        case (e.Memory.HELD, {"until": end}) | (e.Memory.EVERY, {"due": end}):
            return first_ns + int(end) - call.duration_ns if end > 0 else None
        case e.Memory.ELAPSED, {"was": was, "since": since}:
            return first_ns + int(since) if was else None
        case e.Memory.CAPTURED, {"held": held, "key": key}:
            return held, key
        case e.Memory.LATCH, {"value": last}:
            return last
        case _, {"last": last}:
            return last
        case _:
            return None
