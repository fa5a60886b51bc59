"""Walks over the expressions of a whole program."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, assert_never

from colony.ir.expression import (
    Expression,
    IsCommanded,
    IsIdle,
    MemoryCall,
    SentField,
    WonBy,
    subexpressions,
)
from colony.ir.frame import OverriddenCommand
from colony.ir.program import (
    AnyModule,
    Chain,
    Contract,
    Derived,
    Let,
    Machine,
    Module,
    Program,
    PythonModule,
    Robot,
    State,
    Use,
    Wire,
    Wiring,
)

# --- wiring --------------------------------------------------------------------------------------------
#
# The network of a program as a graph with one node per suppressor or inhibitor.


@dataclass(frozen=True, slots=True, kw_only=True)
class WiringNode:
    """A suppressor or inhibitor.

    Attributes:
        name: Unique name; no module or wire can have it.
        path: Wire, indices of operands from the outermost chain inward, and index of the dominant operand.
        chain: Chain that contains it.
        dominant: Module or node whose output dominates.
        inferior: Module or node whose output is dominated.
    """

    name: str
    path: tuple[str, *tuple[int, ...]]
    chain: Chain
    dominant: str
    inferior: str

    @property
    def index(self) -> int:
        """Index of the dominant operand in the chain."""
        return int(self.path[-1])

    @property
    def relation(self) -> Literal["suppresses", "inhibits"]:
        """The effect of the dominant input on the inferior one."""
        return self.chain.relation

    @property
    def window_ns(self) -> int:
        """Time constant, 0 for none."""
        return self.chain.windows_ns[self.index]

    def wire(self, name: str, dominant: str, inferior: str) -> Wire:
        """Return a wire that consists of this node alone, with the given inputs."""
        operands = (Use(name=dominant), Use(name=inferior))
        wiring = replace(self.chain, operands=operands, windows_ns=(self.window_ns,))
        return Wire(name=name, span=self.chain.span, wiring=wiring)


@dataclass(frozen=True, slots=True, kw_only=True)
class WiringGraph:
    """The network of a program.

    Attributes:
        nodes: All nodes in topological order: each comes after its inputs.
        wires: Module or node at the output of each named wire.
        roots: Module or node that drives each wired actuator.
    """

    nodes: tuple[WiringNode, ...]
    wires: Mapping[str, str]
    roots: Mapping[str, str]


def wiring_graph(program: Program) -> WiringGraph:
    """Return the network of a program as a graph."""
    builder = _GraphBuilder()
    for wire in program.wires:
        output = builder.wiring(wire.wiring, (wire.name,))
        if wire.actuator is None:
            builder.wires[wire.name] = output
        else:
            builder.roots[wire.actuator] = output
    return WiringGraph(nodes=tuple(builder.nodes), wires=builder.wires, roots=builder.roots)


def wired_modules(program: Program) -> frozenset[str]:
    """Return the modules whose output the wiring of their actuator can pass on: its clients."""
    wires = {wire.name: wire.wiring for wire in program.wires}
    pending: list[Wiring] = [wire.wiring for wire in program.wires if wire.actuator is not None]
    names = set[str]()
    while pending:
        wiring = pending.pop()
        if isinstance(wiring, Chain):
            pending += wiring.operands if wiring.relation == "suppresses" else wiring.operands[-1:]
        elif wiring.name not in names:
            names.add(wiring.name)
            pending += [wires[wiring.name]] if wiring.name in wires else []
    return frozenset(names - wires.keys())


class _GraphBuilder:
    """Builds a graph from wirings. Mutable. Recursion is only as deep as the nesting of parentheses."""

    def __init__(self) -> None:
        self.nodes: list[WiringNode] = []
        self.wires: dict[str, str] = {}
        self.roots: dict[str, str] = {}

    def wiring(self, wiring: Wiring, path: tuple[str, *tuple[int, ...]]) -> str:
        """Add the nodes of a wiring; return the module or node at its output."""
        match wiring:
            case Use(name=name):
                return self.wires.get(name, name)
            case Chain(operands=operands):
                *dominant, inferior = (self.wiring(o, (*path, i)) for i, o in enumerate(operands))
                for i in reversed(range(len(dominant))):
                    inferior = self._joint(wiring, (*path, i), dominant[i], inferior)
                return inferior
            case _:
                assert_never(wiring)

    def _joint(self, chain: Chain, path: tuple[str, *tuple[int, ...]], dominant: str, inferior: str) -> str:
        """Add a node and return its name; `a op[w0] b op[w1] c` is `a op[w0] (b op[w1] c)`."""
        name = f"node {len(self.nodes)}"
        self.nodes.append(WiringNode(name=name, path=path, chain=chain, dominant=dominant, inferior=inferior))
        return name


# --- in time -------------------------------------------------------------------------------------------
#
# Contracts `in time`: they are about frames in which no client of their actuators is late or lost.
#
# A run in which one is late cannot break such a contract in that frame. If the contract remembers what its
# actuators were given, nothing is known of it in later frames either, until memory is initial again.


@dataclass(frozen=True, slots=True, kw_only=True)
class InTime:
    """The actuators that a contract `in time` names; `remembers` if it depends on their earlier frames."""

    actuators: tuple[str, ...]
    remembers: bool

    def excuses(self, now: Collection[str], before: Collection[str]) -> bool:
        """Return True if a frame cannot break the contract.

        Args:
            now: actuators that are idle in the frame because a client is late or lost.
            before: those that were since memory was initial.
        """
        return any(a in now or (self.remembers and a in before) for a in self.actuators)


def in_time(robot: Robot, contract: Contract) -> InTime | None:
    """Return the actuators of a contract `in time`; None for another contract."""
    if not contract.in_time:
        return None
    holding = {a.name for a in robot.actuators if a.idle is None}
    remembers = any(
        (isinstance(x, MemoryCall) and actuators_named(x))
        or (isinstance(x, SentField) and x.actuator in holding)
        for x in subexpressions(contract.expression)
    )
    return InTime(actuators=actuators_named(contract.expression), remembers=remembers)


def remembered(rules: Iterable[InTime | None]) -> frozenset[str]:
    """Return the actuators whose earlier frames matter to contracts `in time`."""
    return frozenset(a for rule in rules if rule is not None and rule.remembers for a in rule.actuators)


def actuators_named(expression: Expression) -> tuple[str, ...]:
    """Return the actuators of which an expression reads what they were given, in the order written."""
    kinds = (SentField, WonBy, IsCommanded, IsIdle)
    return tuple(dict.fromkeys(x.actuator for x in subexpressions(expression) if isinstance(x, kinds)))


def idled(given: Mapping[str, OverriddenCommand]) -> set[str]:
    """Return the actuators that are idle whatever the network decided."""
    return {actuator for actuator, what in given.items() if what.values is None}


# --- walk ----------------------------------------------------------------------------------------------


def all_subexpressions(program: Program) -> Iterator[Expression]:
    """Yield the expressions of a program and all their subexpressions, in the order of `expressions`."""
    for root in expressions(program):
        yield from subexpressions(root)


def expressions(program: Program) -> Iterator[Expression]:
    """Yield all expressions of a program that are evaluated every frame."""
    for derived in program.derived:
        yield from expressions_of_derived(derived)
    for module in program.modules:
        yield from expressions_of(module)
    for limit in program.limits:
        yield from (limit.bound,) if limit.condition is None else (limit.bound, limit.condition)
    yield from (contract.expression for contract in program.contracts)


def expressions_of_derived(derived: Derived) -> Iterator[Expression]:
    """Yield all expressions of a derived value."""
    match derived:
        case Let(expression=expression):
            yield expression
        case State(next=next_value):
            yield from () if next_value is None else (next_value,)
        case Machine(transitions=transitions):
            yield from (t.condition for t in transitions)
        case _:
            assert_never(derived)


def expressions_of(module: AnyModule) -> tuple[Expression, ...]:
    """Return all expressions of a module; it is silent if any of them reads something missing."""
    match module:
        case Module(lets=lets, when=when, command=command, states=states):
            fields = command.fields if command else ()
            next_value = (s.next for s in states if s.next is not None)
            return (*(let.expression for let in lets), when, *fields, *next_value)
        case PythonModule(reads=reads):
            return tuple(r.expression for r in reads)
        case _:
            assert_never(module)
