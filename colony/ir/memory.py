"""The memory of a whole program between two frames, by places in its text.

Executors remember in forms of their own; this one belongs to the language, so that what one executor
remembered another can go on from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramMemory:
    """A program's memory, except that of modules in Python, which keep their own.

    `first_ns` is the time of the first frame since all memory was initial, None if there was none. `cells`
    are named by their places (see `state_cell`, `function_cell` and `window_cell`). A cell that is absent
    has its initial value, or nothing depends on it. Values are in base units, times in ns since `first_ns`:

        state                             its value
        previous, changed, rising, falling    `last`, the argument in the last frame
        held                              `until`, when the value turns false
        elapsed                           `was`, the argument in the last frame; `since`, when it turned true
        latch                             `value`
        captured                          `held` and `key`
        every                             `due`, when it is true again
        time constant                     `until`, when the dominant side ceases to dominate

    With `started`, that of `changed`, `captured` and `previous`: whether there was a frame before.
    """

    first_ns: int | None
    cells: Mapping[str, float | bool | int]


def state_cell(name: str) -> str:
    """Name the cell of a state or machine, which for a state of a module is `module.state`."""
    return f"state {name}"


def function_cell(function: str, cell: int, loops: tuple[int, ...], element: int) -> str:
    """Name what the cells of a memory function begin with.

    Args:
        function: its keyword.
        cell: its number among the memory functions of the program, in the order of the text.
        loops: the values of the variables of the reductions around it, outermost first.
        element: the index of the element, 0 for a scalar.
    """
    return f"{function} {cell}{''.join(f'.{k}' for k in loops)}[{element}]"


def window_cell(wire: str, operands: tuple[int, ...]) -> str:
    """Name what the cell of a time constant begins with.

    Args:
        wire: the wire, or the actuator, in whose wiring it stands.
        operands: the index of the operand before it, after those of the enclosing chains, outermost first.
    """
    return f"window {wire}{''.join(f'.{i}' for i in operands)}"
