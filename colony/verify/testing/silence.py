"""Reasons why modules are silent or blind in a frame, and derived values missing."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import assert_never

from colony.ir import expression as ir
from colony.ir.program import AnyModule, Let, Module, Program, PythonModule, Use, Wiring
from colony.text.wording import listed, quoted
from colony.verify.reference.interpreter import Interpreter

_MAX_CANDIDATES = 100
"""Maximum number of silent or blind modules of a frame that are considered."""


class Silence:
    """The values that are missing in the last frame of an interpreter, and the modules without an answer.

    `missing` has each missing sensor, and the reason if it is too old: `too old (350 ms)`.
    """

    def __init__(self, program: Program, interpreter: Interpreter, missing: Mapping[str, str]) -> None:
        self._program, self._interpreter, self._sensors = program, interpreter, missing
        self._lets: dict[str, tuple[str, ...]] = {}  # the missing sensors that each let needs
        for let in program.derived:
            if isinstance(let, Let):
                self._lets[let.name] = tuple(self._sensors_of(_needed(let.expression)))

    def text(self, name: str) -> str | None:
        """Return why a sensor or a let of a file is missing; None if it is not."""
        if name in self._sensors:
            return self._absent([name])
        sensors = self._lets.get(name)
        if not sensors:
            return None
        if any(self._sensors[sensor] for sensor in sensors):
            return f"`{name}` is missing since {self._absent(sensors)}"
        return f"`{name}` is missing since {quoted(sensors)} {'are' if len(sensors) > 1 else 'is'}"

    def missing_in(self, expression: ir.Expression) -> tuple[str, ...]:
        """Return the missing sensors that an expression needs, itself or by way of lets of files."""
        return tuple(self._sensors_of(_needed(expression)))

    def reasons(self, expression: ir.Expression) -> Iterator[str]:
        """Yield why modules are silent or blind that an expectation names, or that would change it."""
        named = set(_modules_named(expression))
        candidates = [m for m in self._program.modules if self._state(m.name)]
        candidates = sorted(candidates, key=lambda m: m.name not in named)[:_MAX_CANDIDATES]
        active = {m.name for m in self._program.modules if self._interpreter.is_active(m.name)}
        before = _outputs(self._program, active) if candidates else {}
        for module in candidates:
            after = {} if module.name in named else _outputs(self._program, active ^ {module.name})
            if module.name in named or _differs(expression, before, after):
                yield f"`{module.name}` is {self._state(module.name)}: {self._reason(module)}"

    def _state(self, module: str) -> str:
        if self._interpreter.is_silent(module):
            return "silent"
        return "blind" if self._interpreter.is_blind(module) else ""

    def _reason(self, module: AnyModule) -> str:
        needed = dict.fromkeys(leaf for e in _evaluated(module) for leaf in _needed(e))
        sensors = [name for name in needed if name in self._sensors and " " not in name]
        lets = [text for name in needed if name in self._lets and (text := self.text(name))]
        return ", ".join([*([self._absent(sensors)] if sensors else []), *lets]) or "it has no answer"

    def _sensors_of(self, names: Iterable[str]) -> dict[str, None]:
        """Return the missing sensors among names, and those that the lets among them need."""
        found: dict[str, None] = {}
        for name in names:
            found |= dict.fromkeys((name,) if name in self._sensors else self._lets.get(name, ()))
        return found

    def _absent(self, sensors: Sequence[str]) -> str:
        """Return `a and b are missing and c is too old (350 ms)`."""
        gone = [name for name in sensors if not self._sensors[name]]
        parts = [f"{quoted(gone)} {'are' if len(gone) > 1 else 'is'} missing"] if gone else []
        parts += [f"`{name}` is {self._sensors[name]}" for name in sensors if self._sensors[name]]
        return listed(parts)


def _needed(e: ir.Expression) -> Iterator[str]:
    """Yield the sensors and the lets of files that an expression needs."""
    match e:
        case ir.SensorValue(name=name) | ir.DerivedValue(name=name):
            yield name
        case ir.ValueOr(other=other):
            yield from _needed(other)
        case _:
            for child in ir.children(e):
                yield from _needed(child)


def _evaluated(module: AnyModule) -> tuple[ir.Expression, ...]:
    """Return what a module evaluates in every frame."""
    match module:
        case Module():
            lets = (let.expression for let in module.lets)
            updates = (state.next for state in module.states if state.next is not None)
            return (*lets, module.when, *(module.command.fields if module.command else ()), *updates)
        case PythonModule():
            return tuple(reading.expression for reading in module.reads)
        case _:
            assert_never(module)


def _modules_named(expression: ir.Expression) -> Iterator[str]:
    for leaf in ir.subexpressions(expression):
        match leaf:
            case ir.WonBy(module=name) | ir.IsActive(name=name):
                yield name
            case ir.LocalValue(name=name):
                yield name.rpartition(".")[0]
            case _:
                pass


# --- the network without its time constants --------------------------------------------------------


_Outputs = Mapping[str, str | None]
"""The module whose output gets through, by module, wire or actuator; None if none does."""


def _outputs(program: Program, active: Collection[str]) -> _Outputs:
    """Return what gets through if these modules are active."""
    outputs = {m.name: m.name if m.name in active else None for m in program.modules}
    for wire in program.wires:
        outputs[wire.actuator or wire.name] = _output(wire.wiring, outputs)
    return outputs


def _differs(expression: ir.Expression, a: _Outputs, b: _Outputs) -> bool:
    """Return True if an expression reads a winner, or the activity of a wire, that differs."""
    for leaf in ir.subexpressions(expression):
        match leaf:
            case (
                ir.SentField(actuator=name)
                | ir.WonBy(actuator=name)
                | ir.IsCommanded(actuator=name)
                | ir.IsIdle(actuator=name)
            ):
                if a.get(name) != b.get(name):
                    return True
            case ir.IsActive(name=name):
                if (a[name] is None) != (b[name] is None):
                    return True
            case _:
                pass
    return False


def _output(wiring: Wiring, outputs: _Outputs) -> str | None:
    if isinstance(wiring, Use):
        return outputs[wiring.name]
    *dominant, last = wiring.operands
    result = _output(last, outputs)
    for operand in reversed(dominant):
        winner = _output(operand, outputs)
        if winner is not None:
            result = winner if wiring.relation == "suppresses" else None
    return result
