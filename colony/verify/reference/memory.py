"""Conversion of another executor's memory into the interpreter's own form."""

from __future__ import annotations

import re
from typing import Any, NamedTuple, assert_never

from colony.ir import expression as e
from colony.ir import program as ir
from colony.ir.memory import ProgramMemory, late_cell, sent_cell, state_cell, window_cell
from colony.ir.types import ScalarValue
from colony.ir.walk import all_subexpressions, wiring_graph
from colony.verify.reference.expressions import Memory

Parts = dict[str, float | bool | int]
"""The cells of one memory function, by the last word of their names."""

RESTORED = 0
"""Number of the frame whose memory was restored."""

_FUNCTION = re.compile(
    r"(?P<function>\w+) (?P<cell>\d+)(?P<loops>(\.-?\d+)*)\[(?P<element>\d+)\] (?P<part>\w+)"
)


class InterpreterMemory(NamedTuple):
    """The memory of an interpreter: memory functions, last activity of each dominant side, and states.

    `held` are the fields that actuators on `idle hold` hold, by actuator, then by actuator and field. `late`
    are the actuators of contracts `in time` that were idle because a client was late or lost.
    """

    functions: Memory
    last_active_ns: dict[tuple[str | int, ...], int]
    states: dict[str, ScalarValue]
    held: dict[str, dict[tuple[str, int], ScalarValue]]
    late: set[str]


class InterpreterState(NamedTuple):
    """All that an interpreter remembers between two frames.

    `last` has the values of `last.ACTUATOR.FIELD` in declared units. `number` counts the frames since memory
    was initial or restored; `first_ns` and `t_ns` are the times of the first and of the last frame.
    """

    memory: InterpreterMemory
    last: dict[str, ScalarValue]
    number: int
    first_ns: int
    t_ns: int


def restored_memory(
    program: ir.Program, memory: ProgramMemory, initial: dict[str, ScalarValue]
) -> InterpreterMemory:
    """Return `memory` as an interpreter holds it; `initial` are the initial values of the states.

    Raises:
        ValueError: the memory is of another program.
    """
    cells, first_ns = dict(memory.cells), memory.first_ns or 0
    states = {name: cells.pop(state_cell(name), value) for name, value in initial.items()}
    last_active_ns: dict[tuple[str | int, ...], int] = {}
    for node in wiring_graph(program).nodes:
        wire, *operands = node.path
        until = cells.pop(f"{window_cell(wire, tuple(operands))} until", 0) if node.window_ns else 0
        if until > 0:
            last_active_ns[node.path] = first_ns + int(until) - node.window_ns
    held: dict[str, dict[tuple[str, int], ScalarValue]] = {}
    for actuator in program.robot.actuators:
        for i in range(len(actuator.fields)):
            value = cells.pop(f"{sent_cell(actuator.name, i)} value", 0.0)
            if cells.pop(f"{sent_cell(actuator.name, i)} known", False):
                held.setdefault(actuator.name, {})[actuator.name, i] = value
    late = {a.name for a in program.robot.actuators if cells.pop(late_cell(a.name), False)}
    calls = {call.cell: call for call in all_subexpressions(program) if isinstance(call, e.MemoryCall)}
    functions: dict[tuple[int, tuple[int, ...], int], Parts] = {}
    for name, value in cells.items():
        found = _FUNCTION.fullmatch(name)
        call = calls.get(int(found["cell"])) if found else None
        if found is None or call is None or call.function.value != found["function"]:
            raise ValueError(f"the memory has a cell `{name}`, which the program lacks")
        loops = tuple(int(k) for k in found["loops"].split(".")[1:])
        functions.setdefault((call.cell, loops, int(found["element"])), {})[found["part"]] = value
    states_of_functions = {
        key: _function_state(calls[key[0]], parts, first_ns) for key, parts in functions.items()
    }
    return InterpreterMemory(
        {key: found for key, found in states_of_functions.items() if found is not None},
        last_active_ns,
        states,
        held,
        late,
    )


def _function_state(call: e.MemoryCall, parts: Parts, first_ns: int) -> Any:
    """Return the state that `expressions.remember` keeps for a call.

    None if the state is still initial, or if nothing depends on it, so that its cells were omitted.
    """
    match call.function, parts:
        case _, {"started": False}:
            return None
        case (e.MemoryFunction.RECENTLY, {"until": end}) | (e.MemoryFunction.EVERY, {"due": end}):
            return first_ns + int(end) - call.duration_ns if end > 0 else None
        case e.MemoryFunction.SUSTAINED, {"was": was, "due": due}:
            return (first_ns + int(due) - call.duration_ns, RESTORED) if was else None
        case e.MemoryFunction.ELAPSED, {"was": was, "since": since}:
            return first_ns + int(since) if was else None
        case e.MemoryFunction.CAPTURED, {"held": held, "key": key}:
            return held, key
        case e.MemoryFunction.LATCH, {"value": last}:
            return last
        case _, {"last": last}:
            return last
        case _:
            return None


def memory_cells(program: ir.Program) -> list[tuple[ir.State | ir.Machine, ScalarValue]]:
    """Return every state and machine with its initial value."""
    cells: list[tuple[ir.State | ir.Machine, ScalarValue]] = []
    for derived in program.derived:
        match derived:
            case ir.State():
                cells.append((derived, derived.initial))
            case ir.Machine():
                cells.append((derived, derived.start))
            case ir.Let():
                pass
            case _:
                assert_never(derived)
    for module in program.modules:
        if isinstance(module, ir.Module):
            cells.extend((state, state.initial) for state in module.states)
    return cells
