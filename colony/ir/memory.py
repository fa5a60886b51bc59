"""The memory of a whole program between two frames, keyed by position in its source text.

Each executor stores memory in its own form. In this common form, one executor can continue from the memory
of another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from colony.ir.types import ScalarValue


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramMemory:
    """A program's memory, without that of modules in Python, which keep their own.

    `first_ns` is the time of the first frame after all memory was initial, None if there was none. The
    keys of `cells` are made by `state_cell`, `function_cell`, `sent_cell`, `window_cell` and `late_cell`. An
    absent cell has its initial value, or nothing depends on it. Values are in base units, times in ns since
    `first_ns`:

        state                             its value
        previous, changed, rising, falling    `last`, the argument in the last frame
        recently                          `until`, when the value turns false
        sustained                         `was`, the argument in the last frame, false where it was not
                                          evaluated; `due`, when the value turns true
        elapsed                           `was`, the argument in the last frame; `since`, when it turned true
        latch                             `value`
        captured                          `held` and `key`
        every                             `due`, when it is true again
        time constant                     `until`, when the dominant side ceases to dominate
        field of an actuator that holds   `value`, the last one sent; `known`, true once there was one
        actuator that contracts `in time` remember    true once it was idle as a client was late or lost

    `changed`, `captured` and `previous` also have `started`: true after the first frame in which they were
    evaluated. `last` has the values of `last.ACTUATOR.FIELD` in the next frame by these names, in declared
    units; without those of fields to which nothing was sent.
    """

    first_ns: int | None
    cells: Mapping[str, float | bool | int]
    last: Mapping[str, ScalarValue] = field(default_factory=dict)


def state_cell(name: str) -> str:
    """Return the name of the cell of a state or machine; a state of a module is called `module.state`."""
    return f"state {name}"


def function_cell(function: str, cell: int, loops: tuple[int, ...], element: int) -> str:
    """Return the prefix of the names of a memory function's cells.

    Args:
        function: Keyword of the function.
        cell: Number of the call among the memory functions of the program, in the order of the text.
        loops: Values of the variables of the enclosing reductions, outermost first.
        element: Index of the element, 0 for a scalar.
    """
    return f"{function} {cell}{''.join(f'.{k}' for k in loops)}[{element}]"


def sent_cell(actuator: str, field: int) -> str:
    """Return the prefix of the names of the cells of a field that an actuator on `idle hold` holds."""
    return f"sent {actuator} {field}"


def window_cell(wire: str, operands: tuple[int, ...]) -> str:
    """Return the prefix of the name of a time constant's cell.

    Args:
        wire: Wire or actuator whose wiring contains it.
        operands: Indices of the operands that lead to it, outermost chain first, its dominant operand last.
    """
    return f"window {wire}{''.join(f'.{i}' for i in operands)}"


def late_cell(actuator: str) -> str:
    """Return the name of the cell of an actuator whose earlier frames matter to a contract `in time`."""
    return f"late {actuator}"
