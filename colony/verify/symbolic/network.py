"""The network: which module's output gets through to each wire and actuator (language reference, Network)."""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import accumulate
from typing import TypeAlias, assert_never

import z3

from colony.ir import program as ir
from colony.verify.symbolic.builder import Builder, FrameValues
from colony.verify.symbolic.logic import TRUE, any_of, both, either, negation
from colony.verify.symbolic.memory import Memory


@dataclass(frozen=True, slots=True)
class _Chain:
    """An encoded chain.

    Attributes:
        operands: The modules and chains that it joins, dominant ones first.
        open: For each operand, the condition that no operand before it dominates.
        merges: True if the outputs of all operands get through, not only that of the last.
    """

    operands: tuple[_Part, ...]
    open: tuple[z3.BoolRef, ...]
    merges: bool


_Part: TypeAlias = str | int
"""A part of the network: a module by its name, or a chain by its number."""


class NetworkEncoder:
    """Encodes the wires, each after its operands. Mutable."""

    def __init__(self, program: ir.Program, builder: Builder, frame_values: FrameValues) -> None:
        self.program = program
        self.builder = builder
        self.frame_values = frame_values
        self._chains: list[_Chain] = []
        self._active: list[z3.BoolRef] = []  # of the chains
        self._wires: dict[str, _Part] = {}

    def encode_wires(self) -> None:
        """Encode all wires into `frame_values`."""
        for actuator in self.program.robot.actuators:
            self.frame_values.wins[actuator.name] = {}
        for wire in self.program.wires:
            output = self._wiring(wire.wiring, wire.name)
            if wire.actuator is None:
                self._wires[wire.name] = output
                self.frame_values.active[wire.name] = self._is_active(output)
            else:
                self.frame_values.wins[wire.actuator] = self._through(output)

    def _is_active(self, part: _Part) -> z3.BoolRef:
        return self._active[part] if isinstance(part, int) else self.frame_values.active[part]

    def _wiring(self, wiring: ir.Wiring, wire: str) -> _Part:
        match wiring:
            case ir.Use(name=name):
                return self._wires.get(name, name)
            case ir.Chain():
                return self._chain(wiring, [self._wiring(o, wire) for o in wiring.operands], wire)
            case _:
                assert_never(wiring)

    def _chain(self, chain: ir.Chain, operands: list[_Part], wire: str) -> _Part:
        """Encode a chain: each operand but the last dominates what follows it."""
        count = len(operands) - 1
        hint = f"{wire}.{chain.relation}"
        dominates = [
            self._dominates(self._is_active(operands[i]), chain.windows_ns[i], hint) for i in range(count)
        ]
        rest = self._is_active(operands[count])  # the output of the operands from i + 1 on is active
        for i in reversed(range(count)):
            rest = both(rest, negation(dominates[i]))
            if chain.relation == "suppresses":
                rest = either(self._is_active(operands[i]), rest)
        undominated = accumulate(dominates, lambda before, d: both(before, negation(d)), initial=TRUE)
        self._chains.append(_Chain(tuple(operands), tuple(undominated), chain.relation == "suppresses"))
        self._active.append(rest)
        return len(self._chains) - 1

    def _dominates(self, active: z3.BoolRef, window_ns: int, hint: str) -> z3.BoolRef:
        """Return the condition that the dominant side is active, or was active less than `window_ns` ago."""
        return Memory(self.builder, self.frame_values, TRUE, hint).recently(active, window_ns)

    def _through(self, output: _Part) -> dict[str, z3.BoolRef]:
        """Return, for each module, the condition that its output gets through to `output`.

        From the output down, each chain is passed once, with the condition that its own output gets through.
        """
        conditions: dict[_Part, list[z3.BoolRef]] = {output: [TRUE]}
        pending = (
            [-output] if isinstance(output, int) else []
        )  # a chain has a greater number than its operands
        while pending:
            number = -heappop(pending)
            chain, through = self._chains[number], any_of(conditions[number])
            for i, operand in enumerate(chain.operands):
                if not chain.merges and i < len(chain.operands) - 1:
                    continue
                if operand not in conditions and isinstance(operand, int):
                    heappush(pending, -operand)
                conditions.setdefault(operand, []).append(both(through, chain.open[i]))
        return {
            module: both(any_of(conditions[module]), self.frame_values.active[module])
            for module in self._modules(output)
        }

    def _modules(self, output: _Part) -> list[str]:
        """Return the modules whose outputs can get through, dominant ones first."""
        found, seen, pending = list[str](), set[_Part](), [output]
        while pending:
            part = pending.pop()
            if part in seen:
                continue
            seen.add(part)
            if isinstance(part, str):
                found.append(part)
            else:
                operands = self._chains[part].operands
                pending += reversed(operands if self._chains[part].merges else operands[-1:])
        return found
