"""The memory of another executor, in the form in which the interpreter remembers it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from colony.ir import expression as e
from colony.ir import program as ir
from colony.ir.memory import ProgramMemory, state_cell, window_cell
from colony.ir.types import ScalarValue
from colony.verify.reference.expressions import Memory

Parts = dict[str, float | bool | int]
"""The cells of one memory function, by the last words of their names."""

_FUNCTION = re.compile(
    r"(?P<function>\w+) (?P<cell>\d+)(?P<loops>(\.-?\d+)*)\[(?P<element>\d+)\] (?P<part>\w+)"
)


class Recalled(NamedTuple):
    """Memory functions, when dominant sides were last active, and states, as an interpreter has them."""

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
    for key, window_ns in _windows(program):
        until = cells.pop(f"{window_cell(key[0], key[1:])} until", 0)
        if until > 0:
            dominated[key] = first_ns + int(until) - window_ns
    calls = {call.cell: call for call in _calls(program)}
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
    """What `interpreter_expressions.remember` remembers of a call: None at first, and where nothing depends
    on it, so that cells are left out."""
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


def _windows(program: ir.Program) -> Iterator[tuple[tuple[str, *tuple[int, ...]], int]]:
    """Every time constant: its wire with the indices of operands, and its length."""
    work: list[tuple[tuple[str, *tuple[int, ...]], ir.Wiring]] = [
        ((w.name,), w.wiring) for w in program.wires
    ]
    while work:
        place, wiring = work.pop()
        if isinstance(wiring, ir.Chain):
            yield from (((*place, i), ns) for i, ns in enumerate(wiring.windows_ns) if ns > 0)
            work += [((*place, i), operand) for i, operand in enumerate(wiring.operands)]


def _calls(program: ir.Program) -> Iterator[e.MemoryCall]:
    work: list[e.Expression] = list(_expressions(program))
    while work:
        node = work.pop()
        if isinstance(node, e.MemoryCall):
            yield node
        work += e.children(node)


def _expressions(program: ir.Program) -> Iterator[e.Expression]:
    for derived in program.derived:
        match derived:
            case ir.Let():
                yield derived.expression
            case ir.State(next=following):
                yield from () if following is None else (following,)
            case ir.Machine():
                yield from (t.condition for t in derived.transitions)
    for module in program.modules:
        if isinstance(module, ir.Module):
            yield from (let.expression for let in module.lets)
            yield module.when
            yield from module.command.fields if module.command else ()
            yield from (s.next for s in module.states if s.next is not None)
    for limit in program.limits:
        yield limit.bound
        yield from () if limit.condition is None else (limit.condition,)
    yield from (contract.expression for contract in program.contracts)
