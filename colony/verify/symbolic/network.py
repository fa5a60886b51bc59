"""The network: which module's output gets through to each wire and actuator (language reference, Network)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

import z3

from colony.ir import program as ir
from colony.verify.symbolic.builder import Builder
from colony.verify.symbolic.frame_values import FrameValues
from colony.verify.symbolic.logic import TRUE, any_of, both, either, negation
from colony.verify.symbolic.memory import Memory


@dataclass(frozen=True, slots=True)
class Output:
    """The output of a wire, or of a part of its expression.

    `by_module` gives for each module the condition that its command gets through; `active` is the condition
    that any does.
    """

    by_module: Mapping[str, z3.BoolRef]
    active: z3.BoolRef


class NetworkEncoder:
    """Encodes the wires, each after its operands. Mutable."""

    def __init__(self, program: ir.Program, builder: Builder, frame_values: FrameValues) -> None:
        self.program = program
        self.builder = builder
        self.frame_values = frame_values
        self._outputs = {m.name: _module_output(m.name, frame_values.active[m.name]) for m in program.modules}

    def encode_wires(self) -> None:
        """Encode all wires into `frame_values`."""
        for actuator in self.program.robot.actuators:
            self.frame_values.wins[actuator.name] = {}
        for wire in self.program.wires:
            output = self._wiring(wire.wiring, wire.name)
            if wire.actuator is None:
                self._outputs[wire.name] = output
                self.frame_values.active[wire.name] = output.active
            else:
                self.frame_values.wins[wire.actuator] = dict(output.by_module)

    def _wiring(self, wiring: ir.Wiring, wire: str) -> Output:
        match wiring:
            case ir.Use(name=name):
                return self._outputs[name]
            case ir.Chain():
                return self._chain(wiring, [self._wiring(o, wire) for o in wiring.operands], wire)
            case _:
                assert_never(wiring)

    def _chain(self, chain: ir.Chain, operands: list[Output], wire: str) -> Output:
        """Return the output of a chain: each operand but the last dominates what follows it."""
        count = len(operands) - 1
        dominates = [
            self._dominates(operands[i].active, chain.windows_ns[i], f"{wire}.{chain.relation}")
            for i in range(count)
        ]
        rest = operands[count].active  # the output of the operands from i + 1 on is active
        for i in reversed(range(count)):
            rest = both(rest, negation(dominates[i]))
            if chain.relation == "suppresses":
                rest = either(operands[i].active, rest)
        return Output(_through(chain, operands, dominates), rest)

    def _dominates(self, active: z3.BoolRef, window_ns: int, hint: str) -> z3.BoolRef:
        """Return the condition that the dominant side is active, or was active less than `window_ns` ago."""
        return Memory(self.builder, self.frame_values, TRUE, hint).recently(active, window_ns)


def _through(chain: ir.Chain, operands: list[Output], dominates: list[z3.BoolRef]) -> dict[str, z3.BoolRef]:
    """Return, for each module, the condition that its output gets through a chain.

    The output of a chain is that of the first operand that is not dominated.
    """
    conditions: dict[str, list[z3.BoolRef]] = {}
    undominated = TRUE  # no operand before this one dominates
    for i, operand in enumerate(operands):
        is_last = i == len(operands) - 1
        if chain.relation == "suppresses" or is_last:
            for module, gets_through in operand.by_module.items():
                conditions.setdefault(module, []).append(both(undominated, gets_through))
        if not is_last:
            undominated = both(undominated, negation(dominates[i]))
    return {module: any_of(alternatives) for module, alternatives in conditions.items()}


def _module_output(name: str, active: z3.BoolRef) -> Output:
    return Output({name: active}, active)
