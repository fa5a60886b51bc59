"""Checkpoints of a follower as plain JSON values, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from colony.analysis.follower import Checkpoint
from colony.ir.types import ScalarValue
from colony.verify.explain.history import CellKey, History, Since
from colony.verify.reference.memory import InterpreterMemory, InterpreterState


def saved(checkpoint: Checkpoint) -> dict[str, Any]:
    """Return a checkpoint as dicts, lists, numbers and texts."""
    state, history = checkpoint.state, checkpoint.history
    return {
        "known": checkpoint.is_known,
        "state": None if state is None else _state(state),
        "modules": _since(history.modules),
        "sensors": _since(history.sensors),
        "states": _since(history.states),
        "winners": _since(history.winners),
        "cells": [[*_cell(key), *since] for key, since in history.cells.items()],
        "last_active": dict(history.last_active_ns),
    }


def restored(values: dict[str, Any]) -> Checkpoint:
    """Return the checkpoint that `saved` made such values of.

    Raises:
        ValueError: the values are not those of a checkpoint.
    """
    try:
        state = values["state"]
        history = History(
            modules=_read_since(values["modules"]),
            sensors=_read_since(values["sensors"]),
            states=_read_since(values["states"]),
            cells={_read_cell(row[:3]): _one_since(row[3:]) for row in values["cells"]},
            winners=_read_since(values["winners"]),
            last_active_ns={_text(name): _whole(t) for name, t in values["last_active"].items()},
        )
        read = None if state is None else _read_state(state)
        return Checkpoint(read, values["known"] is True, history)
    except (KeyError, TypeError, IndexError, AttributeError) as problem:
        raise ValueError(f"not a checkpoint: {problem}") from None


def _state(state: InterpreterState) -> dict[str, Any]:
    memory = state.memory
    return {
        "functions": [[*_cell(key), _plain(value)] for key, value in memory.functions.items()],
        "windows": [[list(node), t_ns] for node, t_ns in memory.last_active_ns.items()],
        "states": dict(memory.states),
        "held": [[a, i, x] for fields in memory.held.values() for (a, i), x in fields.items()],
        "late": sorted(memory.late),
        "last": dict(state.last),
        "number": state.number,
        "first_ns": state.first_ns,
        "t_ns": state.t_ns,
    }


def _read_state(values: dict[str, Any]) -> InterpreterState:
    held: dict[str, dict[tuple[str, int], ScalarValue]] = {}
    for actuator, index, value in values["held"]:
        held.setdefault(_text(actuator), {})[actuator, _whole(index)] = _scalar(value)
    memory = InterpreterMemory(
        functions={_read_cell(row[:3]): _read_plain(row[3]) for row in values["functions"]},
        last_active_ns={_node(path): _whole(t_ns) for path, t_ns in values["windows"]},
        states={_text(name): _scalar(x) for name, x in values["states"].items()},
        held=held,
        late={_text(actuator) for actuator in values["late"]},
    )
    last = {_text(name): _scalar(x) for name, x in values["last"].items()}
    number, first_ns, t_ns = (_whole(values[name]) for name in ("number", "first_ns", "t_ns"))
    return InterpreterState(memory, last, number, first_ns, t_ns)


def _since(of: Mapping[str, Since]) -> dict[str, list[Any]]:
    return {name: [*since] for name, since in of.items()}


def _read_since(values: dict[str, Any]) -> dict[str, Since]:
    return {_text(name): _one_since(row) for name, row in values.items()}


def _one_since(row: list[Any]) -> Since:
    value, t_ns, first = row
    if not (value is None or isinstance(value, str)):
        value = _scalar(value)
    return Since(value, _whole(t_ns), first is True)


def _cell(key: CellKey) -> list[Any]:
    cell, loops, element = key
    return [cell, list(loops), element]


def _read_cell(row: list[Any]) -> CellKey:
    cell, loops, element = row
    return _whole(cell), tuple(_whole(k) for k in loops), _whole(element)


def _node(path: list[Any]) -> tuple[str | int, ...]:
    wire, *operands = path
    return _text(wire), *(_whole(i) for i in operands)


def _plain(value: Any) -> Any:
    return [_plain(x) for x in value] if isinstance(value, tuple) else value


def _read_plain(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_read_plain(x) for x in value)
    return value if value is None else _scalar(value)


def _scalar(value: Any) -> ScalarValue:
    if not isinstance(value, bool | int | float):
        raise TypeError(f"found {type(value).__name__}; expected a number")
    return value


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"found {type(value).__name__}; expected a whole number")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"found {type(value).__name__}; expected a text")
    return value
