"""The network of a program as joints: one per suppressor or inhibitor, in topological order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, assert_never

from colony.ir.program import Chain, Program, Use, Wire, Wiring


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A suppressor or inhibitor.

    Attributes:
        name: Name of the joint, which no module or wire can have.
        place: Wire, indices of operands from the outermost chain inward, and index of the dominant operand.
        chain: Chain that it is part of.
        dominant: Module or joint whose output dominates.
        inferior: Module or joint whose output is dominated.
    """

    name: str
    place: tuple[str, *tuple[int, ...]]
    chain: Chain
    dominant: str
    inferior: str

    @property
    def index(self) -> int:
        """Index of the dominant operand in the chain."""
        return int(self.place[-1])

    @property
    def relation(self) -> Literal["suppresses", "inhibits"]:
        """Return the dominant output's effect on the inferior one."""
        return self.chain.relation

    @property
    def window_ns(self) -> int:
        """Time constant, 0 for none."""
        return self.chain.windows_ns[self.index]

    def wire(self, name: str, dominant: str, inferior: str) -> Wire:
        """Return a wire that has this joint alone, between other inputs."""
        operands = (Use(name=dominant), Use(name=inferior))
        wiring = replace(self.chain, operands=operands, windows_ns=(self.window_ns,))
        return Wire(name=name, span=self.chain.span, wiring=wiring)


@dataclass(frozen=True, slots=True, kw_only=True)
class Joints:
    """The network of a program.

    Attributes:
        joints: All joints, each after those that are its inputs.
        wires: Module or joint of each named wire.
        roots: Module or joint that drives each wired actuator.
    """

    joints: tuple[Joint, ...]
    wires: Mapping[str, str]
    roots: Mapping[str, str]


def joints_of(program: Program) -> Joints:
    """Return the network of a program as joints."""
    reader = _Reader()
    for wire in program.wires:
        found = reader.wiring(wire.wiring, (wire.name,))
        if wire.actuator is None:
            reader.wires[wire.name] = found
        else:
            reader.roots[wire.actuator] = found
    return Joints(joints=tuple(reader.joints), wires=reader.wires, roots=reader.roots)


class _Reader:
    """A reader of wiring. Mutable: the joints and wires so far. It recurses: only parentheses nest."""

    def __init__(self) -> None:
        self.joints: list[Joint] = []
        self.wires: dict[str, str] = {}
        self.roots: dict[str, str] = {}

    def wiring(self, wiring: Wiring, place: tuple[str, *tuple[int, ...]]) -> str:
        """Add the joints of a wiring; return the module or joint at its output."""
        match wiring:
            case Use(name=name):
                return self.wires.get(name, name)
            case Chain(operands=operands):
                *dominant, below = (self.wiring(o, (*place, i)) for i, o in enumerate(operands))
                for i in reversed(range(len(dominant))):
                    below = self._joint(wiring, (*place, i), dominant[i], below)
                return below
            case _:
                assert_never(wiring)

    def _joint(self, chain: Chain, place: tuple[str, *tuple[int, ...]], dominant: str, inferior: str) -> str:
        """Add a joint and return its name; `a op[w0] b op[w1] c` is `a op[w0] (b op[w1] c)`."""
        name = f"joint {len(self.joints)}"
        self.joints.append(Joint(name=name, place=place, chain=chain, dominant=dominant, inferior=inferior))
        return name
